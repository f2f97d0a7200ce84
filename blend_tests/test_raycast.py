"""The node Raycast of Blender 5.1 and later tells what it tells in Cycles."""

import bpy
import pytest

from cards import Cards, differences, node
from helpers import add_quad, exported

pytestmark = [
    pytest.mark.oldest_and_newest,
    pytest.mark.skipif(not hasattr(bpy.types, "ShaderNodeRaycast"), reason="this Blender has no such node"),
]

UP = (0.0, 0.0, 1.0)
SLANTED = (0.0, 0.5, 1.2)


def show(cards, name, output, inputs, offset=(0.0, 0.0, 0.0), **settings):
    """A card that shows an output, half of it under a plate of its own mesh."""
    tree, surface = cards.add(name)
    if any(offset):
        position = node(tree, "ShaderNodeNewGeometry").outputs["Position"]
        moved = node(tree, "ShaderNodeVectorMath", {0: position, 1: offset}, operation="ADD")
        inputs = inputs | {"Position": moved.outputs[0]}
    if "Direction" in inputs:
        direction = node(tree, "ShaderNodeCombineXYZ", dict(zip("XYZ", inputs["Direction"], strict=True)))
        inputs = inputs | {"Direction": direction.outputs[0]}
    cast = node(tree, "ShaderNodeRaycast", inputs, **settings)
    # Nothing emits less than 0.
    above = node(tree, "ShaderNodeVectorMath", {0: cast.outputs[output], 1: (0.2, 0.2, 0.2)}, operation="MULTIPLY_ADD")
    above.inputs[2].default_value = (0.5, 0.5, 0.5)
    cards.show(tree, surface, above.outputs[0])
    mesh = cards.scene.objects[name].data
    corners = [list(vertex.co) for vertex in mesh.vertices]
    materials = list(mesh.materials)
    mesh.clear_geometry()
    plate = [(-0.5, -0.5, 0.3), (0.0, -0.5, 0.3), (0.0, 0.5, 0.3), (-0.5, 0.5, 0.3)]
    mesh.from_pydata([*corners, *plate], [], [(0, 1, 2, 3), (4, 5, 6, 7)])
    mesh.uv_layers.new()
    for material in materials:
        if material.name not in mesh.materials:
            mesh.materials.append(material)


def test_rays_of_nodes_meet_what_they_meet_in_cycles(scene, tmp_path):
    cards = Cards(scene)
    outputs = ("Is Hit", "Self Hit", "Hit Distance", "Hit Position", "Hit Normal")
    for output in outputs:
        show(cards, output, output, {"Length": 3.0})
        show(cards, f"{output} slanted", output, {"Length": 3.0, "Direction": SLANTED}, offset=(0.1, -0.05, 0.35))
        show(cards, f"{output} down", output, {"Length": 1.2, "Direction": (0.2, 0.0, -0.8)}, offset=(0.0, 0.0, 0.5))
    show(cards, "local", "Hit Distance", {"Length": 3.0}, only_local=True)
    show(cards, "short", "Hit Distance", {"Length": 0.2})
    show(cards, "nowhere", "Hit Distance", {"Length": 2.0, "Direction": (0.0, 0.0, 0.0)})
    plate = add_quad(scene, "Ceiling", size=20.0)
    plate.location, plate.rotation_euler = (4.0, 1.5, 1.2), (0.1, 0.0, 0.0)
    plate.visible_camera = False
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, tolerance=0.02) == {}
    assert warnings == []


def test_what_is_not_known_of_a_hit_is_said(scene):
    cards = Cards(scene)
    tree, surface = cards.add("attribute")
    cast = node(tree, "ShaderNodeRaycast")
    cast.sample_attribute_items.new("RGBA", "paint")
    cards.show(tree, surface, cast.outputs["paint"])
    assert any("'paint' of what its ray meets" in text for text in exported(scene)["warnings"])


@pytest.mark.skipif(bpy.app.version < (5, 3, 0), reason="rays of nodes meet everything")
def test_rays_of_nodes_pass_objects_that_are_hidden_from_them(scene, tmp_path):
    """Cards below two plates, of which they should pass the lower one, or both; one looks at itself alone."""
    cards = Cards(scene)
    for name in ("all", "hidden itself"):
        show(cards, name, "Hit Distance", {"Length": 3.0})
    show(
        cards,
        "hidden, local",
        "Is Hit",
        {"Length": 3.0, "Direction": (0.0, 0.0, -1.0)},
        offset=(0, 0, 0.2),
        only_local=True,
    )
    for name in ("hidden itself", "hidden, local"):
        scene.objects[name].visible_raycast = False
    for height, is_met in ((0.4, False), (1.2, True)):
        plate = add_quad(scene, f"Plate {height}", size=20.0)
        plate.location = (4.0, 1.5, height)
        plate.visible_camera, plate.visible_raycast = False, is_met
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, tolerance=0.02) == {}
    assert warnings == []
