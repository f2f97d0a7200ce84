"""Values and meshes that nobody means, but files hold: what nodes make of them is what Cycles makes of them."""

import bpy
import pytest

from cards import Cards, differences, node

pytestmark = pytest.mark.every_version

RANGE = {"From Min": 0.5, "From Max": 0.5, "To Min": 0.7, "To Max": 0.4}
VECTOR_RANGE = {
    "Vector": (0.2, 0.5, 0.9),
    "From_Min_FLOAT3": (0.2, 0.9, 0.5),
    "From_Max_FLOAT3": (0.7, 0.1, 0.5),
    "To_Min_FLOAT3": (0.7, 0.2, 0.3),
    "To_Max_FLOAT3": (0.4, 1.2, 0.8),
}


def facing(tree):
    """A value that Blender does not take for a constant."""
    return node(tree, "ShaderNodeLayerWeight", {"Blend": 0.3}).outputs[1]


def one_place(tree):
    """A vector that is a constant."""
    return node(tree, "ShaderNodeCombineXYZ", {0: -0.5, 1: -0.5, 2: -0.5}).outputs[0]


def curved(tree):
    """A curve beyond its end, which is steep there."""
    made = node(tree, "ShaderNodeRGBCurve", {1: (1.4, 1.1, -0.3, 1.0)})
    made.mapping.use_clip, made.mapping.extend = False, "EXTRAPOLATED"
    for position, value in ((0.3, 0.5), (0.8, 0.3)):
        made.mapping.curves[1].points.new(position, value)
    made.mapping.update()
    return made.outputs[0]


def checker_at_one_place(tree):
    """A texture whose mapping panel moves it."""
    made = node(tree, "ShaderNodeTexChecker", {"Vector": one_place(tree), "Color1": (0.8, 0.2, 0.1, 1.0)})
    made.texture_mapping.translation = (0.15, 0.0, 0.0)
    return made.outputs[0]


def combined(mode, hue, saturation, value):
    return lambda tree: node(tree, "ShaderNodeCombineColor", {0: hue, 1: saturation, 2: value}, mode=mode).outputs[0]


def mapped(**settings):
    return lambda tree: node(tree, "ShaderNodeMapRange", RANGE, **settings).outputs[0]


def mapped_vector(kind):
    settings = {"data_type": "FLOAT_VECTOR", "interpolation_type": kind}
    return lambda tree: node(tree, "ShaderNodeMapRange", VECTOR_RANGE, **settings).outputs[1]


def moved(location, scale, rotation=None):
    """A Mapping node whose rotation is a constant or that of `facing`."""

    def build(tree):
        inputs = {"Location": location, "Scale": scale, "Rotation": facing(tree) if rotation is None else rotation}
        return node(tree, "ShaderNodeMapping", inputs).outputs[0]

    return build


CASES = {
    **{f"HSV of hue {hue}": combined("HSV", hue, 0.6, 0.8) for hue in (-0.2, 1.0, 1.3, 2.0)},
    **{f"HSL of hue {hue}": combined("HSL", hue, 0.6, 0.8) for hue in (-0.2, 1.0, 1.3, 2.0)},
    "HSV below 0": combined("HSV", 0.4, 2.0, -0.5),
    "range of no width": mapped(clamp=False),
    "clamped range of no width": mapped(clamp=True),
    **{f"vector range {kind}": mapped_vector(kind) for kind in ("LINEAR", "STEPPED", "SMOOTHSTEP")},
    "varying range of no width": lambda tree: node(
        tree, "ShaderNodeMapRange", {"From Min": facing(tree), "From Max": facing(tree), "To Min": 0.7, "To Max": 0.4}
    ).outputs[0],
    "mortar below 0": lambda tree: node(tree, "ShaderNodeTexBrick", {"Mortar Smooth": -0.5, "Scale": 0.5}).outputs[1],
    "mortar below 0 at one place": lambda tree: node(
        tree, "ShaderNodeTexBrick", {"Mortar Smooth": -0.5, "Vector": one_place(tree)}
    ).outputs[1],
    "bump of a constant normal": lambda tree: node(tree, "ShaderNodeBump", {"Normal": one_place(tree)}).outputs[0],
    "curve beyond its end": curved,
    "mapping panel at one place": checker_at_one_place,
    "mapping of no size": moved((0.4, 0.2, 0.1), (0.0, 0.0, 0.0)),
    "constant mapping of no size": moved((0.4, 0.2, 0.1), (0.0, 0.0, 0.0), rotation=(0.1, 0.2, 0.3)),
}


def test_odd_values_give_what_they_give_in_cycles(scene, tmp_path):
    cards = Cards(scene)
    for name, build in CASES.items():
        tree, output = cards.add(name)
        cards.show(tree, output, build(tree))
    means, warnings = cards.means(tmp_path)
    assert differences(means) == {} and warnings == []


def test_normal_maps_without_a_usable_uv_map_bend_as_in_cycles(scene, tmp_path):
    cards = Cards(scene)
    for name in ("whole", "flat", "none", "bent"):
        for uv_map in ("", "UVMap", "missing"):
            tree, output = cards.add(f"{name} {uv_map}")
            bent = node(tree, "ShaderNodeNormalMap", {"Color": (0.8, 0.3, 0.7, 1)}, uv_map=uv_map)
            cards.show(tree, output, bent.outputs[0])
            card = bpy.data.objects[f"{name} {uv_map}"]
            card.rotation_euler = (0.3, 0.2, 0.1)
            mesh = card.data
            if name == "flat":
                mesh.uv_layers[0].uv.foreach_set("vector", [0.0] * (2 * len(mesh.loops)))
            if name in {"none", "bent"}:
                mesh.uv_layers.remove(mesh.uv_layers[0])
            if name == "bent":  # Of a flat one all corners are as far up as seen from the middle.
                mesh.vertices[0].co.z = mesh.vertices[2].co.z = 0.1
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, 0.03) == {}
    lacking = sorted(said.split("'")[1] for said in warnings if "no UV map" in said)
    assert lacking == (["bent ", "none "] if bpy.app.version >= (5, 0, 0) else []), warnings


def test_bricks_of_no_size_are_named(scene, tmp_path):
    cards = Cards(scene)
    tree, output = cards.add("Wall")
    cards.show(tree, output, node(tree, "ShaderNodeTexBrick", {"Brick Width": 0.0}).outputs[0])
    _, warnings = cards.means(tmp_path, samples=1)
    assert len(warnings) == 1 and "bricks of no width" in warnings[0]
