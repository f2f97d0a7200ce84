"""Nodes that tell of the surface around a point, of its ray and of particles give what they give in Cycles."""

import bpy
import numpy as np
import pytest
from mathutils import Vector

from cards import Cards, differences, node
from helpers import add_light, add_material, add_quad

pytestmark = pytest.mark.every_version


def compare(cards, tmp_path, tolerance=0.03, samples=64):
    means, warnings = cards.means(tmp_path, samples=samples)
    assert differences(means, tolerance=tolerance) == {}
    assert warnings == []


def add_wall(scene, card, height=0.4):
    """A wall across the middle of a card, part of its mesh: half of what the card sees is near it."""
    mesh = scene.objects[card].data
    vertices = [list(vertex.co) for vertex in mesh.vertices]
    faces = [list(polygon.vertices) for polygon in mesh.polygons]
    wall = [(-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, height), (-0.5, 0.0, height)]
    materials = list(mesh.materials)
    mesh.clear_geometry()
    mesh.from_pydata([*vertices, *wall], [], [*faces, [len(vertices) + i for i in range(4)]])
    mesh.uv_layers.new()
    for material in materials:
        if material.name not in mesh.materials:
            mesh.materials.append(material)


def test_ambient_occlusion_is_the_share_of_open_rays(scene, tmp_path):
    cards = Cards(scene)
    for name, settings, inputs in (
        ("near", {}, {"Distance": 0.3}),
        ("unlimited", {}, {"Distance": 0.0}),
        ("coloured", {}, {"Color": (0.2, 0.5, 0.8, 1.0)}),
        ("local", {"only_local": True}, {"Distance": 0.5}),
        ("inside", {"inside": True}, {"Distance": 0.5}),
        ("few", {"samples": 4}, {"Distance": 0.5}),
    ):
        tree, output = cards.add(name)
        add_wall(scene, name)
        made = node(tree, "ShaderNodeAmbientOcclusion", inputs, **settings)
        # The square tells the number of samples, the plate above what is local.
        squared = node(tree, "ShaderNodeMath", {0: made.outputs["AO"], 1: 2.0}, operation="POWER")
        cards.show(tree, output, made.outputs["Color"] if name == "coloured" else squared.outputs[0])
    plate = add_quad(scene, "plate", size=8.0)
    plate.location, plate.visible_camera = (4.0, 0.5, 0.7), False
    glass, tree, output = bpy.data.materials.new("clear"), None, None
    if bpy.app.version < (5, 2, 0):
        glass.use_nodes = True
    tree = glass.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], tree.get_output_node("ALL").inputs[0])
    plate.data.materials.append(glass)
    compare(cards, tmp_path, samples=128)


def test_bevel_rounds_edges_for_sharp_rays(scene, tmp_path):
    cards = Cards(scene)
    for name, samples, radius, is_linked in (("four", 4, 0.2, False), ("many", 16, 0.5, False), ("bent", 8, 0.3, True)):
        tree, output = cards.add(name)
        add_wall(scene, name)
        made = node(tree, "ShaderNodeBevel", {"Radius": radius}, samples=samples)
        if is_linked:
            tilted = node(tree, "ShaderNodeCombineXYZ", {0: 0.5, 1: 0.1, 2: 0.8})
            tree.links.new(tilted.outputs[0], made.inputs["Normal"])
        cards.show(
            tree, output, node(tree, "ShaderNodeVectorMath", {0: made.outputs[0]}, operation="ABSOLUTE").outputs[0]
        )
    compare(cards, tmp_path, samples=128)


@pytest.mark.parametrize("map_name", ["", "Second", "None such"])
def test_tangents_follow_axes_and_uv_maps(scene, tmp_path, map_name):
    cards = Cards(scene)
    for kind, axis in (("RADIAL", "X"), ("RADIAL", "Y"), ("RADIAL", "Z"), ("UV_MAP", "Z")):
        name = f"{kind} {axis}"
        tree, output = cards.add(name)
        mesh = scene.objects[name].data
        for vertex in mesh.vertices:
            vertex.co.z = 0.3 * vertex.co.x + 0.2 * vertex.co.y  # A flat mesh has no middle in its depth.
        second = mesh.uv_layers.new(name="Second")
        for index, loop in enumerate(second.data):
            loop.uv = np.array(mesh.uv_layers[0].data[index].uv) @ np.array([[0.6, 0.8], [-0.8, 0.6]])
        made = node(tree, "ShaderNodeTangent", direction_type=kind, axis=axis, uv_map=map_name)
        cards.show(
            tree, output, node(tree, "ShaderNodeVectorMath", {0: made.outputs[0]}, operation="ABSOLUTE").outputs[0]
        )
    compare(cards, tmp_path)


def test_wires_wavelengths_and_coordinates_of_triangles(scene, tmp_path):
    cards = Cards(scene)
    for size, in_pixels in ((0.2, False), (0.5, False), (2.0, True)):
        tree, output = cards.add(f"wire {size}")
        made = node(tree, "ShaderNodeWireframe", {"Size": size}, use_pixel_size=in_pixels)
        cards.show(tree, output, made.outputs[0])
    tree, output = cards.add("parametric")
    cards.show(tree, output, tree.nodes.new("ShaderNodeNewGeometry").outputs["Parametric"])
    for nanometres in (370.0, 382.0, 450.0, 517.0, 580.0, 650.0, 779.0, 790.0):
        tree, output = cards.add(f"{nanometres} nm")
        cards.show(tree, output, node(tree, "ShaderNodeWavelength", {0: nanometres}).outputs[0])
    tree, output = cards.add("spectrum")
    u = node(tree, "ShaderNodeSeparateXYZ", {0: tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]}).outputs[0]
    along = node(tree, "ShaderNodeMath", {0: u, 1: 500.0, 2: 350.0}, operation="MULTIPLY_ADD")
    cards.show(tree, output, node(tree, "ShaderNodeWavelength", {0: along.outputs[0]}).outputs[0])
    compare(cards, tmp_path)


def test_light_falls_off_with_the_length_of_rays(scene, tmp_path):
    cards = Cards(scene)
    for name in ("Quadratic", "Linear", "Constant"):
        for smooth in (0.0, 3.0):
            tree, output = cards.add(f"{name} {smooth}")
            made = node(tree, "ShaderNodeLightFalloff", {"Strength": 0.3, "Smooth": smooth})
            cards.show(tree, output, made.outputs[name])
    compare(cards, tmp_path)


def test_photometric_files_shine_in_materials(scene, tmp_path):
    cards = Cards(scene)
    lines = [
        "IESNA:LM-63-2002",
        "TILT=NONE",
        "1 1000 1 5 1 1 2 0 0 0",
        "1 1 100",
        "0 30 60 90 180",
        "0",
        "900 500 300 50 10",
    ]
    text = bpy.data.texts.new("profile")
    text.from_string("\n".join(lines) + "\n")
    for name, direction in (("implied", None), ("given", (0.4, 0.2, -0.7))):
        tree, output = cards.add(name)
        inputs = {"Strength": 0.01} | ({} if direction is None else {"Vector": direction})
        made = node(tree, "ShaderNodeTexIES", inputs, ies=text)
        cards.show(tree, output, made.outputs[0])
        scene.objects[name].rotation_euler.x = 0.5
    compare(cards, tmp_path)


def test_meshes_know_their_edges_and_islands(scene, tmp_path):
    cards = Cards(scene)
    for name in ("Pointiness", "Random Per Island"):
        tree, output = cards.add(name)
        grid = [(x / 4 - 0.5, y / 4 - 0.5, 0.2 * ((x * 7 + y * 3) % 5)) for y in range(5) for x in range(5)]
        faces = [[y * 5 + x, y * 5 + x + 1, y * 5 + x + 6, y * 5 + x + 5] for y in range(4) for x in range(4)]
        apart = [(-0.5, -0.5, 1.0), (0.1, -0.5, 1.0), (0.1, 0.1, 1.0), (-0.5, 0.1, 1.0)]
        mesh = scene.objects[name].data
        material = mesh.materials[0]
        mesh.clear_geometry()
        mesh.from_pydata([*grid, *apart], [], [*faces, [25, 26, 27, 28]])
        if not mesh.materials:
            mesh.materials.append(material)
        cards.show(tree, output, tree.nodes.new("ShaderNodeNewGeometry").outputs[name])
    compare(cards, tmp_path)


def test_particles_tell_of_themselves(scene, tmp_path):
    cards = Cards(scene)
    for name in ("Index", "Random", "Age", "Lifetime", "Size", "Location", "Velocity"):
        tree, output = cards.add(name)
        card = scene.objects[name]
        shown = tree.nodes.new("ShaderNodeParticleInfo").outputs[name]
        scaled = node(tree, "ShaderNodeVectorMath", {0: shown, "Scale": 0.05}, operation="SCALE")
        cards.show(
            tree, output, node(tree, "ShaderNodeVectorMath", {0: scaled.outputs[0]}, operation="ABSOLUTE").outputs[0]
        )
        emitter = add_quad(scene, f"emitter of {name}", size=0.4)
        emitter.location = (card.location.x, card.location.y, 0.5)
        emitter.show_instancer_for_render = False
        settings = emitter.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.settings
        settings.count, settings.frame_start, settings.frame_end, settings.lifetime = 3, 0.0, 2.0, 30.0
        settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", card, 0.12
        settings.effector_weights.gravity = 0.0
        settings.normal_factor, settings.size_random = 0.1, 0.5
    scene.frame_set(5)
    compare(cards, tmp_path, tolerance=0.06, samples=1024)


def white_sky(scene):
    """A world that is brighter on one side."""
    world = scene.world = bpy.data.worlds.new("Sky")
    if bpy.app.version < (5, 2, 0):
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (1.0, 1.0, 1.0, 1.0)


@pytest.mark.parametrize("kind", ["lacquer", "glass", "metal"])
def test_thin_films_shimmer(scene, tmp_path, kind):
    """Cards seen head on and askew under a white sky: what they reflect or let through is their film's colour."""
    cards = Cards(scene, columns=6)
    for thickness in (0.5, 20.0, 150.0, 380.0, 700.0, 1500.0):
        for ior in (1.33, 1.8):
            tree, output = cards.add(f"{thickness} nm {ior}")
            film = {"Thin Film Thickness": thickness, "Thin Film IOR": ior, "Roughness": 0.1}
            colors = {"Base Color": (0.9, 0.6, 0.4, 1.0) if kind == "metal" else (0.0, 0.0, 0.0, 1.0)}
            weights = {"metal": {"Metallic": 1.0}, "glass": {"Transmission Weight": 1.0}}.get(kind, {})
            cards.show(tree, output, node(tree, "ShaderNodeBsdfPrincipled", film | colors | weights).outputs[0])
    for name in cards.names[::3]:
        scene.objects[name].rotation_euler.x = 0.9
    white_sky(scene)
    means, warnings = cards.means(tmp_path, samples=256)
    assert differences(means, tolerance=0.02) == {}
    assert warnings == []


def glowing(name, color=(0.1, 0.4, 0.9, 1.0)):
    material, tree, output = add_material(name)
    tree.links.new(node(tree, "ShaderNodeEmission", {0: color}).outputs[0], output.inputs["Surface"])
    return material


@pytest.mark.skipif(bpy.app.version < (5, 2, 0), reason="thin walls are new in Blender 5.2")
def test_panes_reflect_and_let_through(scene, tmp_path):
    """Panes under a white sky with a blue glow below, some of them askew. Rough ones are those of Blender 5.3."""
    cards = Cards(scene, columns=6)
    for roughness in (0.0, 0.3, 0.8) if bpy.app.version >= (5, 3, 0) else (0.0, 0.3):
        for film in (0.0, 400.0):
            for is_askew in (False, True):
                name = f"{roughness} {film} {is_askew}"
                tree, output = cards.add(name)
                inputs = {"Roughness": roughness, "Transmission Weight": 1.0, "Thin Wall": True, "IOR": 1.8}
                inputs |= {"Base Color": (0.9, 0.6, 0.4, 1.0), "Thin Film Thickness": film}
                inputs["Specular Tint"] = (0.8, 1.0, 1.0, 1.0)
                cards.show(tree, output, node(tree, "ShaderNodeBsdfPrincipled", inputs).outputs[0])
                scene.objects[name].rotation_euler.x = 0.8 * is_askew
    add_quad(scene, "below", size=60.0, material=glowing("below")).location.z = -2.0
    white_sky(scene)
    compare(cards, tmp_path, tolerance=0.02, samples=256)


@pytest.mark.skipif(bpy.app.version < (5, 3, 0), reason="glass is anisotropic from Blender 5.3 on")
def test_glass_is_rough_along_its_tangent(scene, tmp_path):
    """Glass above glowing bars, which it spreads along or across."""
    cards = Cards(scene, columns=4)
    kinds = {"ShaderNodeBsdfGlass": ("Anisotropy", "Rotation"), "ShaderNodeBsdfPrincipled": ("Anisotropic",) * 2}
    for kind, (amount, rotation) in kinds.items():
        for turned in (0.0, 0.25):
            name = f"{kind} {turned}"
            tree, output = cards.add(name)
            inputs = {"Roughness": 0.3, amount: 0.8, "IOR": 1.3}
            tangent = node(tree, "ShaderNodeCombineXYZ", {0: 1.0}).outputs[0]
            made = node(tree, kind, inputs | {"Tangent": tangent})
            made.inputs[rotation if "Glass" in kind else "Anisotropic Rotation"].default_value = turned
            if "Principled" in kind:
                made.inputs["Transmission Weight"].default_value = 1.0
            cards.show(tree, output, made.outputs[0])
            bar = add_quad(scene, f"below {name}", size=1.0, material=glowing(name))
            bar.scale.y, bar.location = 0.2, scene.objects[name].location + Vector((0.0, 0.0, -0.4))
    compare(cards, tmp_path, samples=1024)


def test_a_small_sun_shines_through_rough_glass(scene, tmp_path):
    """Cards with a sun behind them, which shadow rays find."""
    cards = Cards(scene, columns=3)
    kinds = {"ShaderNodeBsdfGlass": {}, "ShaderNodeBsdfRefraction": {}, "ShaderNodeBsdfPrincipled": {}}
    kinds["ShaderNodeBsdfPrincipled"]["Transmission Weight"] = 0.5
    for roughness in (0.35, 0.5):
        for kind, more in kinds.items():
            name = f"{kind} {roughness}"
            tree, output = cards.add(name)
            cards.show(tree, output, node(tree, kind, {"Roughness": roughness, "IOR": 1.6} | more).outputs[0])
    add_light(scene, "SUN", "below", energy=3.0, angle=0.02).rotation_euler = (3.0, 0.1, 0.0)
    compare(cards, tmp_path, tolerance=0.02, samples=256)


def test_portals_lead_elsewhere(scene, tmp_path):
    """Cards that show a lit floor, a glow and the depth of portals far away."""
    cards = Cards(scene)
    for name, moved, direction in (("straight", 20.0, (0.0, 0.0, 0.0)), ("aslant", 20.0, (0.3, 0.1, -1.0))):
        tree, output = cards.add(name)
        place = node(tree, "ShaderNodeVectorMath", {1: (0.0, moved, 0.0)}, operation="ADD")
        tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], place.inputs[0])
        inputs = {"Color": (0.9, 0.7, 0.5, 1.0), "Position": place.outputs[0], "Direction": direction}
        cards.show(tree, output, node(tree, "ShaderNodeBsdfRayPortal", inputs).outputs[0])
    tree, output = cards.add("half")
    portal = node(tree, "ShaderNodeBsdfRayPortal", {"Position": (2.5, 20.5, 1.0)}).outputs[0]
    white = tree.nodes.new("ShaderNodeEmission").outputs[0]
    mix = node(tree, "ShaderNodeMixShader", {0: 0.4, 1: portal, 2: white})
    cards.show(tree, output, mix.outputs[0])
    tree, output = cards.add("in place")
    cards.show(tree, output, node(tree, "ShaderNodeBsdfRayPortal", {"Color": (0.5, 0.8, 0.9, 1.0)}).outputs[0])
    add_quad(scene, "below", size=6.0, material=glowing("below")).location = (3.0, 0.0, -3.0)
    floor = add_quad(scene, "floor", size=12.0)
    floor.location = (2.0, 20.0, -1.0)
    add_light(scene, "POINT", "lamp", (1.0, 20.0, 1.0), energy=60.0, shadow_soft_size=0.1)
    if "Portal Depth" in bpy.data.node_groups.new("Probe", "ShaderNodeTree").nodes.new("ShaderNodeLightPath").outputs:
        material, tree, output = add_material("depth")
        depth = tree.nodes.new("ShaderNodeLightPath").outputs["Portal Depth"]
        emission = node(tree, "ShaderNodeEmission", {0: (0.0, 0.3, 0.0, 1.0), 1: depth})
        tree.links.new(emission.outputs[0], output.inputs["Surface"])
        add_quad(scene, "depth", size=1.0, material=material).location = (0.5, 20.5, -0.9)
    compare(cards, tmp_path, samples=512)


@pytest.mark.skipif(bpy.app.version < (4, 3, 0), reason="textures by Gabor are new in Blender 4.3")
def test_gabor_noise(scene, tmp_path):
    cards = Cards(scene)
    for kind in ("2D", "3D"):
        for anisotropy in (1.0, 0.3):
            for name in ("Value", "Phase", "Intensity"):
                tree, output = cards.add(f"{kind} {anisotropy} {name}")
                place = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
                inputs = {"Vector": place, "Scale": 2.0, "Anisotropy": anisotropy, "Orientation 3D": (0.3, 0.8, 0.2)}
                cards.show(tree, output, node(tree, "ShaderNodeTexGabor", inputs, gabor_type=kind).outputs[name])
    compare(cards, tmp_path)


def test_vectors_are_wrapped_refracted_and_turned(scene, tmp_path):
    cards = Cards(scene)
    known = bpy.types.ShaderNodeVectorMath.bl_rna.properties["operation"].enum_items.keys()
    for operation in ("WRAP", "FACEFORWARD", "REFRACT", "SIGN", "POWER", "ROUND"):
        if operation not in known:
            continue
        tree, output = cards.add(operation)
        place = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
        moved = node(tree, "ShaderNodeVectorMath", {0: place, 1: (-0.3, -0.6, -0.2)}, operation="ADD").outputs[0]
        inputs = {0: moved, 1: (0.3, 0.4, -0.9), 2: (0.1, -0.2, 0.7)}
        made = node(tree, "ShaderNodeVectorMath", inputs, operation=operation)
        if operation == "REFRACT":
            made.inputs["Scale"].default_value = 0.8
        cards.show(
            tree, output, node(tree, "ShaderNodeVectorMath", {0: made.outputs[0]}, operation="ABSOLUTE").outputs[0]
        )
    compare(cards, tmp_path)
