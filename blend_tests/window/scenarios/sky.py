"""A head of noise under a Sky Texture: the sky is rendered in another Blender while the window goes on, and again when
its sun is turned, without new paths."""

import bpy
from artist import Artist, addon, same

NEEDS = ["demo.blend"]


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (480, 270), samples=16, train_seconds=0)
        stand_outside(artist.scene)
        bpy.ops.ed.undo_push(message="Outside")
        yield from driver.drawn()
        driver.photo("open")
    with driver.step("start"):
        yield from artist.start()
        yield from artist.until_settled(120)
        driver.photo("sky")
        notes = artist.shot.notes
        driver.check(
            not [note for note in notes if "sky" in note.lower()], f"the sky is not named as left out: {notes}"
        )
        lit = artist.picture()[..., :3].mean()
    with driver.step("switch the sky off"):
        before = artist.shot.frame.serial
        world_row(artist).on = False
        yield from driver.until(lambda: artist.shot.frame.serial > before, "a picture without the sky")
        yield from artist.until_settled()
        dark = artist.picture()[..., :3].mean()
        driver.check(dark < 0.8 * lit, f"the sky lit the shot: {dark:.4f} without it, {lit:.4f} with it")
        driver.photo("dark")
    with driver.step("turn the sun"):
        world_row(artist).on = True
        yield from artist.until_settled()
        before = artist.picture()
        sky(artist.scene.world).sun_rotation = 2.0
        bpy.ops.ed.undo_push(message="Sun")
        yield from driver.until(lambda: artist.shot.is_changing_world, "the notice that the world has changed")
        driver.photo("reading")
        yield from driver.until(lambda: not artist.shot.is_changing_world, "the other sky", 120)
        yield from artist.until_settled(120)
        driver.photo("turned")
        changes = artist.shot.changes.sentences
        driver.check(not changes, f"the sky is followed, so nothing asks for new paths: {changes}")
        driver.check(not same(artist.picture(), before), "the sun shines from elsewhere")
    with driver.step("undo the turn"):
        yield from artist.undo()
        yield from driver.until(lambda: same(artist.picture(), before), "the picture of the first sky", 120)


def stand_outside(scene):
    """A head of noise under a sky, and no other lights than the sun in it."""
    for obj in scene.objects:
        if obj.type == "LIGHT":
            obj.hide_render = obj.hide_viewport = True
    world = scene.world = bpy.data.worlds.new("Sky")
    if bpy.app.version < (5, 2, 0):
        world.use_nodes = True
    tree = world.node_tree
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    background.inputs["Strength"].default_value = 0.05
    tree.links.new(tree.nodes.new("ShaderNodeTexSky").outputs["Color"], background.inputs["Color"])
    material = bpy.data.materials.new("Noise")
    if bpy.app.version < (5, 2, 0):
        material.use_nodes = True
    tree = material.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(noise.outputs["Color"], surface.inputs["Base Color"])
    noise.inputs["Scale"].default_value = 4.0
    scene.objects["Suzanne"].material_slots[0].material = material


def sky(world):
    """Its Sky Texture."""
    return next(node for node in world.node_tree.nodes if node.type == "TEX_SKY")


def world_row(artist):
    """The row of the world."""
    return next(row for row in artist.scene.relume_mix.rows if row.kind == addon("core.rows").WORLD)
