"""Lamps whose nodes make them differ by direction or place shine as in Cycles."""

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from cards import node
from helpers import add_light, add_material, add_quad, exported, render_cycles, update

pytestmark = pytest.mark.every_version

VERTICAL = (0, 20, 40, 60, 75, 90)
PIXELS, BLOCK = 48, 8


def photometry(vertical=VERTICAL, horizontal=(0,), kind=1):
    """A photometric file whose candelas fall with both angles."""
    rows = [" ".join(f"{1000 - 6 * abs(v) + 2 * abs(h % 180 - 70):.1f}" for v in vertical) for h in horizontal]
    head = f"IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 {len(vertical)} {len(horizontal)} {kind} 2 0 0 0\n1 1 60"
    return "\n".join([head, " ".join(map(str, vertical)), " ".join(map(str, horizontal)), *rows, ""])


def ies(text):
    """Emission of a lamp by a photometric file, one half of it."""

    def build(tree):
        made = node(tree, "ShaderNodeTexIES", {"Strength": 0.5})
        made.ies = bpy.data.texts.new("Photometry")
        made.ies.write(text)
        return node(tree, "ShaderNodeEmission", {"Strength": made.outputs[0]}).outputs[0]

    return build


def colored(kind, output, coordinates="Normal", **inputs):
    """Emission of a lamp by a texture."""

    def build(tree):
        place = node(tree, "ShaderNodeTexCoord").outputs[coordinates]
        mapping = node(tree, "ShaderNodeMapping", {"Vector": place, "Rotation": (0.2, 0.4, 0.9)})
        texture = node(tree, kind, {"Vector": mapping.outputs[0], **inputs}).outputs[output]
        return node(tree, "ShaderNodeEmission", {"Color": texture, "Strength": 1.5}).outputs[0]

    return build


def picture(tree):
    """Emission of a lamp by an image in its UV square."""
    image = bpy.data.images.new("Gobo", 16, 16, float_buffer=True)
    values = np.ones((16, 16, 4), np.float32)
    values[..., 0], values[..., 1] = np.indices((16, 16)) / 15.0
    values[4:7, :, :3] = 0.0
    image.pixels.foreach_set(values.ravel())
    place = node(tree, "ShaderNodeTexCoord").outputs["UV"]
    texture = node(tree, "ShaderNodeTexImage", {"Vector": place}, image=image, extension="EXTEND")
    return node(tree, "ShaderNodeEmission", {"Color": texture.outputs[0], "Strength": 2.0}).outputs[0]


def of_world(tree):
    """Emission of a lamp by a direction of the world."""
    normal = node(tree, "ShaderNodeNewGeometry").outputs["Normal"]
    absolute = node(tree, "ShaderNodeVectorMath", {0: normal}, operation="ABSOLUTE").outputs[0]
    return node(tree, "ShaderNodeEmission", {"Color": absolute, "Strength": 3.0}).outputs[0]


EVERYWHERE = (0, 60, 120, 180, 240, 300, 360)
TEXTURE = colored("ShaderNodeTexVoronoi", "Color", Scale=4.0)
CASES = {
    "ies of one plane": ("POINT", ies(photometry())),
    "ies of a quadrant": ("POINT", ies(photometry(horizontal=(0, 45, 90)))),
    "ies of all planes": ("SPOT", ies(photometry(horizontal=EVERYWHERE))),
    "ies without the last plane": ("POINT", ies(photometry(horizontal=EVERYWHERE[:-1]))),
    "ies from above": ("POINT", ies(photometry((0, 30, 60, 90, 120, 150, 180), (0, 90, 180)))),
    "ies of type a": ("POINT", ies(photometry((-90, -60, -45, -30, 0), (-90, -45, 0, 45, 90), 3))),
    "ies of type b": ("POINT", ies(photometry((-90, -45, 0, 45, 90), (-90, -45, 0, 45, 90), 2))),
    "ies of half of type b": ("POINT", ies(photometry((0, 30, 60, 90), (0, 30, 60, 90), 2))),
    "broken ies": ("POINT", ies("no file of a lamp")),
    "voronoi by normal": ("SPOT", TEXTURE),
    "noise by uv": ("POINT", colored("ShaderNodeTexNoise", "Color", "UV", Scale=9.0)),
    "picture in the cone": ("SPOT", picture),
    "direction of the world": ("SPOT", of_world),
}


def lit_by(scene, kind, build, **settings):
    """A white plane seen from above, with a lamp of these nodes above it; returns the lamp."""
    material, tree, output = add_material("White")
    tree.links.new(node(tree, "ShaderNodeBsdfDiffuse", {"Color": (1, 1, 1, 1)}).outputs[0], output.inputs["Surface"])
    add_quad(scene, size=6.0, material=material)
    blend = {"spot_size": 1.6, "spot_blend": 0.4} if kind == "SPOT" else {}
    size = {"shadow_soft_size": 0.1} if kind in {"POINT", "SPOT"} else {}
    lamp = add_light(scene, kind, location=(0.1, -0.2, 1.0), energy=50.0, **blend, **size, **settings)
    lamp.rotation_euler, lamp.scale = (0.3, -0.2, 0.7), (1.3, 1.3, 1.3)
    if bpy.app.version < (5, 2, 0):
        lamp.data.use_nodes = True
    shader = lamp.data.node_tree
    end = next(made for made in shader.nodes if made.bl_idname == "ShaderNodeOutputLight")
    shader.links.new(build(shader), end.inputs["Surface"])
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    camera = scene.camera
    camera.data.type, camera.data.ortho_scale = "ORTHO", 4.0
    camera.location, camera.rotation_euler = (0.0, 0.0, 5.0), (0.0, 0.0, 0.0)
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.cycles.max_bounces = 0
    update()
    return lamp


def blocks(image):
    """Means of squares of pixels."""
    count = PIXELS // BLOCK
    return image.reshape(count, BLOCK, count, BLOCK, 3).mean(axis=(1, 3))


def pictures(scene, folder, samples=256):
    """Relume's and Cycles' picture in blocks, and the warnings."""
    read = load_scene(scene)
    relume.bake(read, folder, trace_settings(scene, lambda _: None) | {"samples": samples}).wait()
    ours = relume.Relighter(folder).relight(read.lights(), denoise=False)["combined"][::-1]
    return blocks(ours), blocks(render_cycles(scene, samples=64)), read.warnings


@pytest.mark.parametrize("name", CASES)
def test_lamps_shine_by_direction_as_in_cycles(scene, tmp_path, name):
    kind, build = CASES[name]
    lit_by(scene, kind, build)
    ours, cycles, warnings = pictures(scene, tmp_path / "bake")
    assert warnings == [
        "light 'Lamp': IES file: it has no line that begins with TILT=; as in Cycles, it shines at a "
        "strength of 100 everywhere"
    ] * (name == "broken ies")
    assert cycles.max() > 0.0
    # Noise of a block of paths is some 2 %.
    error = np.abs(ours - cycles)
    assert error.mean() <= 0.02 * cycles.mean() and error.max() <= 0.08 * cycles.max(), error.max() / cycles.max()


LARGE = {
    "picture on an area": ("AREA", picture),
    "ies of an area": ("AREA", ies(photometry(horizontal=EVERYWHERE))),
    "voronoi on an ellipse": ("ELLIPSE", colored("ShaderNodeTexVoronoi", "Color", "UV", Scale=3.0)),
    "places on a square": ("SQUARE", colored("ShaderNodeTexVoronoi", "Color", "Object", Scale=3.0)),
    "picture of a sun": ("SUN", picture),
    "normals of a sun": ("SUN", colored("ShaderNodeTexVoronoi", "Color", Scale=9.0)),
}


@pytest.mark.parametrize("name", LARGE)
def test_areas_and_suns_shine_as_in_cycles(scene, tmp_path, name):
    shape, build = LARGE[name]
    lamp = lit_by(scene, "SUN" if shape == "SUN" else "AREA", build)
    if shape == "SUN":
        lamp.data.angle, lamp.data.energy = 0.8, 3.0
    else:
        lamp.data.shape = "RECTANGLE" if shape == "AREA" else shape
        lamp.data.size, lamp.data.size_y = 0.8, 0.5
    # The edge of its shadow tells which side of the light is which.
    add_quad(scene, size=0.5, material=bpy.data.materials["White"]).location = (0.0, 0.0, 0.5)
    update()
    if name == "places on a square" and bpy.app.version < (4, 5, 0):
        assert "light 'Lamp': its node 'Texture Coordinate'" in exported(scene)["warnings"][0]
        return
    ours, cycles, warnings = pictures(scene, tmp_path / "bake")
    error = np.abs(ours - cycles)
    assert warnings == [] and error.mean() <= 0.02 * cycles.mean() and error.max() <= 0.08 * cycles.max()


def test_a_sheared_area_with_a_texture_is_named(scene):
    lamp = lit_by(scene, "AREA", picture)
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.scale, lamp.parent = (1.0, 3.0, 1.0), parent
    update()
    read = exported(scene)
    assert read["lights"] == [] and "shears" in read["warnings"][0]


def fading(output, smooth=0.0, build=None):
    """Emission of a lamp by its distance, of a colour or an image."""

    def build_falloff(tree):
        strength = node(tree, "ShaderNodeLightFalloff", {"Strength": 2.0, "Smooth": smooth}).outputs[output]
        color = build(tree).node.inputs["Color"].links[0].from_socket if build else (1.0, 0.5, 0.2, 1.0)
        return node(tree, "ShaderNodeEmission", {"Color": color, "Strength": strength}).outputs[0]

    return build_falloff


FALLOFFS = {
    "linear": ("POINT", fading("Linear")),
    "constant of a sphere": ("POINT", fading("Constant")),
    "smooth": ("SPOT", fading("Quadratic", 0.8)),
    "constant of a picture": ("AREA", fading("Constant", 0.3, picture)),
}


@pytest.mark.parametrize("name", FALLOFFS)
def test_lamps_fade_by_distance_as_in_cycles(scene, tmp_path, name):
    kind, build = FALLOFFS[name]
    lamp = lit_by(scene, kind, build)
    lamp.location.z = 0.6
    if name == "constant of a sphere":
        lamp.data.use_soft_falloff, lamp.data.shadow_soft_size = False, 0.3
    # Behind a pane, distances go on.
    glass, tree, output = add_material("Pane")
    pane = node(tree, "ShaderNodeBsdfTransparent", {"Color": (0.5, 0.5, 0.5, 1)}).outputs[0]
    tree.links.new(pane, output.inputs["Surface"])
    add_quad(scene, size=1.0, material=glass).location = (0.8, 0.0, 0.1)
    update()
    ours, cycles, warnings = pictures(scene, tmp_path / "bake", samples=512)
    error = np.abs(ours - cycles)
    assert warnings == [] and error.mean() <= 0.02 * cycles.mean() and error.max() <= 0.08 * cycles.max()


def test_a_falloff_of_a_part_is_named(scene):
    def build(tree):
        plain = node(tree, "ShaderNodeEmission").outputs[0]
        return node(tree, "ShaderNodeAddShader", {0: fading("Linear")(tree), 1: plain}).outputs[0]

    lit_by(scene, "POINT", build)
    read = exported(scene)
    assert read["lights"] == [] and "light 'Lamp': its node 'Emission" in read["warnings"][0]


def test_a_sphere_is_looked_up_by_its_normal(scene, tmp_path):
    lit_by(scene, "POINT", colored("ShaderNodeTexVoronoi", "Color", Scale=3.0), use_soft_falloff=False)
    bpy.data.objects["Lamp"].data.shadow_soft_size = 0.4
    ours, cycles, warnings = pictures(scene, tmp_path / "bake")
    error = np.abs(ours - cycles)
    assert warnings == [] and error.mean() <= 0.02 * cycles.mean() and error.max() <= 0.08 * cycles.max()


def test_a_stretched_spot_has_its_texture_in_its_own_space(scene, tmp_path):
    lamp = lit_by(scene, "SPOT", TEXTURE)
    lamp.scale = (1.6, 0.7, 1.0)
    ours, cycles, warnings = pictures(scene, tmp_path / "bake")
    error = np.abs(ours - cycles)
    assert warnings == [] and error.mean() <= 0.02 * cycles.mean() and error.max() <= 0.08 * cycles.max()


def test_what_has_no_place_in_a_table_is_named(scene):
    def by_place(tree):
        position = node(tree, "ShaderNodeNewGeometry").outputs["Position"]
        return node(tree, "ShaderNodeEmission", {"Color": position}).outputs[0]

    lamp = lit_by(scene, "SPOT", by_place)
    assert exported(scene)["lights"] == []
    assert "light 'Lamp': its node 'Geometry'" in exported(scene)["warnings"][0]
    # A sphere whose graph reads both the way back and the normal.
    tree = lamp.data.node_tree
    lamp.data.use_soft_falloff = False
    both = node(tree, "ShaderNodeTexIES", {"Strength": node(tree, "ShaderNodeTexCoord").outputs["Normal"]})
    emission = next(made for made in tree.nodes if made.bl_idname == "ShaderNodeEmission" and made.outputs[0].is_linked)
    tree.links.remove(emission.inputs["Color"].links[0])
    tree.links.new(both.outputs[0], emission.inputs["Strength"])
    update()
    assert exported(scene)["lights"] == []
    lamp.data.use_soft_falloff = True
    update()
    assert len(exported(scene)["lights"]) == 1


def test_an_edited_tree_is_another_table_and_a_turned_lamp_the_same(scene):
    lamp = lit_by(scene, "SPOT", picture)

    def read():
        update()
        return exported(scene)["lights"][0]

    first = read()
    lamp.rotation_euler = (0.1, 0.5, -0.4)
    turned = read()
    assert turned["map"]["map"] == first["map"]["map"]
    assert turned["map"]["local_from_world"] != first["map"]["local_from_world"]
    image = bpy.data.images["Gobo"]
    image.pixels.foreach_set(np.full(16 * 16 * 4, 0.5, np.float32))
    image.update()
    painted = read()
    assert painted["map"]["map"] != first["map"]["map"]
    emission = next(
        made
        for made in lamp.data.node_tree.nodes
        if made.bl_idname == "ShaderNodeEmission" and made.outputs[0].is_linked
    )
    emission.inputs["Strength"].default_value = 4.0
    assert read()["radiance"] == pytest.approx([2.0 * value for value in painted["radiance"]])
