"""Node trees reach the native graph, and what does not is named."""

import bpy
import numpy as np
import pytest

from addon.export.materials import exporter
from helpers import add_material, add_quad, exported

pytestmark = pytest.mark.every_version

LINK = "link"

# Value nodes: properties to set, output socket, expected JSON type and output.
VALUE_NODES = {
    "ShaderNodeTexImage": ({}, "Color", "image_texture", "color"),
    "ShaderNodeTexCoord": ({}, "Object", "texture_coordinate", "vector"),
    "ShaderNodeUVMap": ({}, "UV", "uv_map", "vector"),
    "ShaderNodeMapping": ({}, "Vector", "mapping", "vector"),
    "ShaderNodeNormalMap": ({"space": "OBJECT"}, "Normal", "normal_map", "normal"),
    "ShaderNodeBump": ({"invert": True}, "Normal", "bump", "normal"),
    "ShaderNodeVertexColor": ({"layer_name": "Paint"}, "Color", "color_attribute", "color"),
    "ShaderNodeMath": ({"operation": "PINGPONG"}, "Value", "math", "value"),
    "ShaderNodeVectorMath": ({"operation": "REFLECT"}, "Vector", "vector_math", "vector"),
    "ShaderNodeMapRange": ({"interpolation_type": "STEPPED"}, "Result", "map_range", "value"),
    "ShaderNodeClamp": ({"clamp_type": "RANGE"}, "Result", "clamp", "value"),
    "ShaderNodeValToRGB": ({}, "Color", "color_ramp", "color"),
    "ShaderNodeRGBCurve": ({}, "Color", "rgb_curves", "color"),
    "ShaderNodeFloatCurve": ({}, "Value", "rgb_curves", "color"),
    "ShaderNodeHueSaturation": ({}, "Color", "hue_saturation", "color"),
    "ShaderNodeBrightContrast": ({}, "Color", "bright_contrast", "color"),
    "ShaderNodeGamma": ({}, "Color", "gamma", "color"),
    "ShaderNodeInvert": ({}, "Color", "invert", "color"),
    "ShaderNodeSeparateColor": ({"mode": "HSL"}, "Green", "separate_color", "y"),
    "ShaderNodeCombineColor": ({"mode": "HSV"}, "Color", "combine_color", "color"),
    "ShaderNodeSeparateXYZ": ({}, "Z", "separate_xyz", "z"),
    "ShaderNodeCombineXYZ": ({}, "Vector", "combine_xyz", "vector"),
    "ShaderNodeFresnel": ({}, 0, "fresnel", "value"),
    "ShaderNodeLayerWeight": ({}, "Facing", "layer_weight", "facing"),
    "ShaderNodeNewGeometry": ({}, "Backfacing", "geometry", "backfacing"),
    "ShaderNodeObjectInfo": ({}, "Random", "object_info", "random"),
    "ShaderNodeHairInfo": ({}, "Tangent Normal", "hair_info", "tangent_normal"),
    "ShaderNodePointInfo": ({}, "Radius", "point_info", "point_radius"),
    "ShaderNodeRGBToBW": ({}, 0, "math", "value"),
}

CLOSURES = {
    "ShaderNodeBsdfPrincipled": "principled",
    "ShaderNodeBsdfDiffuse": "diffuse",
    "ShaderNodeBsdfAnisotropic": "glossy",
    "ShaderNodeBsdfGlass": "glass",
    "ShaderNodeBsdfRefraction": "refraction",
    "ShaderNodeBsdfTranslucent": "translucent",
    "ShaderNodeBsdfTransparent": "transparent",
    "ShaderNodeEmission": "emission",
    "ShaderNodeBsdfSheen": "sheen",
    "ShaderNodeBsdfToon": "toon",
    "ShaderNodeBsdfHairPrincipled": "principled_hair",
    "ShaderNodeBsdfHair": "hair_bsdf",
}


@pytest.fixture
def tree(scene):
    """The tree of a material on a plane, its output node, and a function that exports it."""
    material, tree, output = add_material("Paint")
    add_quad(scene, "Wall", material=material)

    def export():
        out = exported(scene)
        return out["materials"][0], out["warnings"], out

    return tree, output, export


def diffuse_with(tree, output, socket, target="Color"):
    """A Diffuse surface fed by `socket`."""
    node = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(socket, node.inputs[target])
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return node


@pytest.mark.parametrize("kind", VALUE_NODES)
def test_value_nodes_round_trip(tree, kind):
    tree, output, export = tree
    properties, socket, expected, name = VALUE_NODES[kind]
    node = tree.nodes.new(kind)
    for key, value in properties.items():
        setattr(node, key, value)
    if kind == "ShaderNodeTexImage":
        node.image = bpy.data.images.new("Brick", 4, 2)
    if kind == "ShaderNodeRGBCurve":  # Of a constant there would be another.
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], node.inputs["Color"])
    bpy.data.objects["Wall"].data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    diffuse_with(tree, output, node.outputs[socket])
    material, warnings, _ = export()
    surface = material["nodes"][material["surface"]]
    assert surface["type"] == "diffuse"
    assert surface["color"]["output"] == name
    assert material["nodes"][surface["color"]["node"]]["type"] == expected
    assert warnings == []


@pytest.mark.parametrize("kind", CLOSURES)
def test_closures_round_trip(tree, kind):
    tree, output, export = tree
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    material, warnings, _ = export()
    assert material["nodes"][material["surface"]]["type"] == CLOSURES[kind]
    assert warnings == []


def test_principled_values_are_read_by_name(tree):
    tree, output, export = tree
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    values = {
        "Base Color": (0.1, 0.2, 0.3, 1.0),
        "Metallic": 0.25,
        "Roughness": 0.7,
        "IOR": 1.33,
        "Alpha": 0.9,
        "Transmission Weight": 0.6,
        "Coat Weight": 0.4,
        "Sheen Weight": 0.3,
        "Emission Strength": 2.0,
    }
    for name, value in values.items():
        node.inputs[name].default_value = value
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    found = export()[0]["nodes"][-1]
    assert found["base_color"] == pytest.approx([0.1, 0.2, 0.3])
    for name in ("metallic", "roughness", "ior", "alpha"):
        assert found[name] == pytest.approx(values[name.title() if name != "ior" else "IOR"])
    assert found["transmission_weight"] == pytest.approx(0.6)
    assert found["coat_weight"] == pytest.approx(0.4)
    assert found["sheen_weight"] == pytest.approx(0.3)
    assert found["emission_strength"] == pytest.approx(2.0)
    assert found["normal"] is None and found["distribution"] == "multi_ggx"


def test_constants_fold_with_blenders_conversions(tree):
    tree, output, export = tree
    rgb, value = tree.nodes.new("ShaderNodeRGB"), tree.nodes.new("ShaderNodeValue")
    rgb.outputs[0].default_value = (1.0, 0.5, 0.25, 1.0)
    value.outputs[0].default_value = 0.3
    node = diffuse_with(tree, output, value.outputs[0])
    tree.links.new(rgb.outputs[0], node.inputs["Roughness"])
    material = export()[0]
    assert len(material["nodes"]) == 1
    assert material["nodes"][0]["color"] == pytest.approx([0.3] * 3)
    assert material["nodes"][0]["roughness"] == pytest.approx(0.2126 + 0.5 * 0.7152 + 0.25 * 0.0722, rel=1e-3)


def test_blackbody_folds_to_a_color(tree):
    tree, output, export = tree
    node = tree.nodes.new("ShaderNodeBlackbody")
    node.inputs[0].default_value = 3000.0
    diffuse_with(tree, output, node.outputs[0])
    assert export()[0]["nodes"][0]["color"] == pytest.approx([1.771, 0.844, 0.272], abs=5e-4)


def test_groups_reroutes_and_muted_nodes_are_resolved(tree):
    tree, output, export = tree
    group = bpy.data.node_groups.new("Tint", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Result", in_out="OUTPUT", socket_type="NodeSocketColor")
    inside, outside = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    gamma, muted = group.nodes.new("ShaderNodeGamma"), group.nodes.new("ShaderNodeInvert")
    muted.mute = True
    reroute = group.nodes.new("NodeReroute")
    group.links.new(inside.outputs["Color"], gamma.inputs["Color"])
    group.links.new(gamma.outputs[0], muted.inputs["Color"])
    group.links.new(muted.outputs[0], reroute.inputs[0])
    group.links.new(reroute.outputs[0], outside.inputs["Result"])
    uses = []
    for color in ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0)):
        use = tree.nodes.new("ShaderNodeGroup")
        use.node_tree = group
        use.inputs["Color"].default_value = color
        uses.append(use)
    mix = tree.nodes.new("ShaderNodeMixShader")
    for index, use in enumerate(uses):
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        tree.links.new(use.outputs["Result"], diffuse.inputs["Color"])
        tree.links.new(diffuse.outputs[0], mix.inputs[1 + index])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    material, warnings, _ = export()
    gammas = [node for node in material["nodes"] if node["type"] == "gamma"]
    assert [node["color"] for node in gammas] == [[1, 0, 0], [0, 1, 0]]
    assert not [node for node in material["nodes"] if node["type"] == "invert"]
    assert warnings == []


def test_shared_nodes_are_translated_once(tree):
    tree, output, export = tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("Brick", 4, 2, alpha=True)
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    for socket in ("Base Color", "Roughness", "Emission Color"):
        tree.links.new(texture.outputs["Color"], node.inputs[socket])
    tree.links.new(texture.outputs["Alpha"], node.inputs["Alpha"])
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    material, _, out = export()
    assert [node["type"] for node in material["nodes"]] == ["image_texture", "principled"]
    assert material["nodes"][1]["alpha"] == {"node": 0, "output": "alpha"}
    assert len(out["textures"]) == 1


@pytest.mark.parametrize("data", ["FLOAT", "VECTOR", "RGBA"])
def test_mix_uses_the_sockets_of_its_data_type(tree, data):
    tree, output, export = tree
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type, node.clamp_result = data, True
    suffix = {"FLOAT": "Float", "VECTOR": "Vector", "RGBA": "Color"}[data]
    for socket in node.inputs:
        if socket.identifier == f"B_{suffix}":
            socket.default_value = 0.75 if data == "FLOAT" else (0.75,) * len(socket.default_value)
    result = next(socket for socket in node.outputs if socket.identifier == f"Result_{suffix}")
    diffuse_with(tree, output, result)
    mix = export()[0]["nodes"][0]
    assert mix["type"] == "mix" and mix["data"] == {"RGBA": "color"}.get(data, data.lower())
    assert mix["b"] == (0.75 if data == "FLOAT" else [0.75] * 3)
    assert mix["clamp_result"] == (data == "RGBA")


def test_ramps_and_curves_are_baked_as_blender_evaluates_them(tree):
    tree, output, export = tree
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.interpolation = "B_SPLINE"
    ramp.color_ramp.elements.new(0.3).color = (1, 0, 0, 0.5)
    curves = tree.nodes.new("ShaderNodeRGBCurve")
    curves.mapping.curves[0].points.new(0.5, 0.9)
    curves.mapping.curves[3].points.new(0.5, 0.2)
    tree.links.new(ramp.outputs["Color"], curves.inputs["Color"])
    diffuse_with(tree, output, curves.outputs[0])
    nodes = export()[0]["nodes"]
    table = nodes[0]["ramp"]["table"]
    assert len(table) == 256
    assert table[100] == pytest.approx(list(ramp.color_ramp.evaluate(100 / 255)), abs=1e-6)
    mapping = curves.mapping
    mapping.initialize()
    expected = mapping.evaluate(mapping.curves[0], mapping.evaluate(mapping.curves[3], 128 / 255))
    assert nodes[1]["curves"]["table"][128][0] == pytest.approx(expected, abs=1e-6)


def test_a_chain_of_curves_is_followed_once(tree):
    """Each feeds both inputs of the next: were none remembered, there would be two to the power of forty ways."""
    tree, output, export = tree
    socket = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
    for _ in range(40):
        curves = tree.nodes.new("ShaderNodeRGBCurve")
        for target in curves.inputs:
            tree.links.new(socket, target)
        socket = curves.outputs[0]
    diffuse_with(tree, output, socket)
    assert sum(node["type"] == "rgb_curves" for node in export()[0]["nodes"]) == 40


def test_unsupported_nodes_are_named_with_object_material_and_node(tree, monkeypatch):
    tree, output, export = tree
    monkeypatch.delitem(exporter.TABLES.values, "ShaderNodeTexMagic")
    diffuse_with(tree, output, tree.nodes.new("ShaderNodeTexMagic").outputs[0])
    material, warnings, _ = export()
    assert any("object 'Wall', material 'Paint': node 'Magic Texture'" in warning for warning in warnings)
    assert material["nodes"][-1]["color"] == [0.5, 0.5, 0.5]


def test_a_graph_that_is_not_understood_is_grey_and_named_and_the_rest_is_exported(tree, monkeypatch):
    tree, output, export = tree
    diffuse_with(tree, output, tree.nodes.new("ShaderNodeTexNoise").outputs["Color"])
    for settings in ({"type": "of another version"}, KeyError("of another version")):

        def translated(_translation, _source, settings=settings):
            if isinstance(settings, Exception):
                raise settings
            return {"node": _translation.emit(settings), "output": "color"}

        monkeypatch.setitem(exporter.TABLES.values, "ShaderNodeTexNoise", translated)
        material, warnings, _ = export()
        assert [node["type"] for node in material["nodes"]] == ["diffuse"]
        (warning,) = warnings
        assert warning.startswith("object 'Wall', material 'Paint': its nodes are not understood")


def test_long_chains_are_followed_or_named(tree, monkeypatch):
    tree, output, export = tree
    socket = tree.nodes.new("ShaderNodeTexNoise").outputs["Color"]
    for _ in range(200):
        node = tree.nodes.new("ShaderNodeGamma")
        tree.links.new(socket, node.inputs["Color"])
        socket = node.outputs[0]
    diffuse_with(tree, output, socket)
    material, warnings, _ = export()
    assert len(material["nodes"]) == 202 and warnings == []
    monkeypatch.setattr(exporter, "DEEPEST", 1000)
    material, warnings, _ = export()
    assert material["nodes"][0]["type"] == "diffuse" and "too many follow each other" in warnings[0]


@pytest.mark.parametrize("kind", ["ShaderNodeBsdfPrincipled", "ShaderNodeBsdfGlass", "ShaderNodeBsdfMetallic"])
def test_thin_film_is_exported_where_it_has_a_thickness(tree, kind):
    tree, output, export = tree
    if not hasattr(bpy.types, kind):
        pytest.skip("this Blender has no such node")
    node = tree.nodes.new(kind)
    if "Thin Film Thickness" not in node.inputs:
        pytest.skip("this Blender has no thin film on this node")
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    assert "film" not in export()[0]["nodes"][-1]
    node.inputs["Thin Film Thickness"].default_value = 300.0
    assert export()[0]["nodes"][-1]["film"]["thickness"] == 300.0


@pytest.mark.parametrize("volume", [None, "ShaderNodeVolumeScatter", "ShaderNodeBsdfDiffuse"])
def test_a_volume_alone_is_passed_through_and_nothing_at_all_is_black(tree, volume):
    tree, output, export = tree
    if volume is not None:
        tree.links.new(tree.nodes.new(volume).outputs[0], output.inputs["Volume"])
    material = export()[0]
    if volume is None:
        assert material["surface"] is None and "volume" not in material
    else:
        expected = "volume_scatter" if "Scatter" in volume else "add_shader"
        assert material["nodes"][material["volume"]]["type"] == expected
        assert material["surface"] is None


@pytest.mark.skipif(bpy.app.version < (5, 2, 0), reason="the convention of normal maps is new in Blender 5.2")
@pytest.mark.parametrize("is_linked", [False, True])
def test_normal_maps_of_directx_point_the_other_way_in_green(tree, is_linked):
    tree, output, export = tree
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.convention = "DIRECTX"
    node.inputs["Color"].default_value = (0.6, 0.8, 0.9, 1.0)
    if is_linked:
        image = tree.nodes.new("ShaderNodeTexImage")
        image.image = bpy.data.images.new("Bumps", 4, 2)
        tree.links.new(image.outputs["Color"], node.inputs["Color"])
    diffuse_with(tree, output, node.outputs[0], "Normal")
    nodes = export()[0]["nodes"]
    color = next(found for found in nodes if found["type"] == "normal_map")["color"]
    if is_linked:
        flip = nodes[color["node"]]
        assert (flip["operation"], flip["b"], flip["c"]) == ("MULTIPLY_ADD", [1, -1, 1], [0, 1, 0])
        assert nodes[flip["a"]["node"]]["type"] == "image_texture"
    else:
        assert color == pytest.approx([0.6, 0.2, 0.9])


@pytest.mark.skipif(bpy.app.version < (4, 3, 0), reason="the Metallic BSDF is new in Blender 4.3")
@pytest.mark.parametrize("fresnel", ["F82", "PHYSICAL_CONDUCTOR"])
def test_metals_keep_their_colours_and_indices(tree, fresnel):
    tree, output, export = tree
    node = tree.nodes.new("ShaderNodeBsdfMetallic")
    node.fresnel_type = fresnel
    wanted = {"edge_tint": (0.1, 0.2, 0.3)} if fresnel == "F82" else {"ior": (0.2, 0.9, 1.1), "extinction": (4, 3, 2)}
    for field, value in wanted.items():
        socket = next(it for it in node.inputs if it.identifier.lower().replace(" ", "_") == field)
        socket.default_value = (*value, 1.0)[: len(socket.default_value)]
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    material, warnings, _ = export()
    assert warnings == [] and material["nodes"][-1]["fresnel"] == fresnel.lower()
    for field, value in wanted.items():
        assert material["nodes"][-1][field] == pytest.approx(value)


def test_closures_of_a_later_blender_are_grey_and_named(tree, monkeypatch):
    tree, output, export = tree
    node = tree.nodes.new("ShaderNodeBsdfToon")
    monkeypatch.delitem(exporter.TABLES.closures, node.bl_idname)
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    material, warnings, _ = export()
    assert material["nodes"][-1]["type"] == "diffuse"
    assert any(f"node '{node.name}' (Toon BSDF) is not supported yet" in warning for warning in warnings)


def test_empty_slots_and_materials_without_nodes(scene):
    plain = bpy.data.materials.new("Plain")
    plain.diffuse_color = (0.2, 0.4, 0.6, 1.0)
    if bpy.app.version < (5, 0, 0):
        plain.use_nodes = False
    add_quad(scene, "A", material=plain)
    add_quad(scene, "B")
    out = exported(scene)
    by_name = {material["name"]: material for material in out["materials"]}
    assert by_name["Default"]["nodes"][0]["color"] == pytest.approx([0.8] * 3)
    if bpy.app.version < (5, 0, 0):
        assert by_name["Plain"]["nodes"][0]["color"] == pytest.approx([0.2, 0.4, 0.6])


def textured(scene, image):
    """A plane with `image` as colour; returns the exported texture and the warnings."""
    material, tree, output = add_material("Textured")
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    diffuse_with(tree, output, node.outputs["Color"])
    add_quad(scene, "Wall", material=material)
    out = exported(scene)
    return out["textures"][0], out["warnings"]


@pytest.mark.parametrize("space, expected", [("sRGB", "srgb"), ("Non-Color", "linear"), ("Linear Rec.709", "linear")])
def test_byte_images_keep_their_color_space(scene, space, expected):
    image = bpy.data.images.new("Brick", 8, 4)
    image.colorspace_settings.name = space
    image.alpha_mode = "CHANNEL_PACKED"
    texture, warnings = textured(scene, image)
    assert texture == {
        "name": "Brick",
        "width": 8,
        "height": 4,
        "encoding": expected,
        "alpha": "channel_packed",
        "float": False,
    }
    assert warnings == []


def test_float_images_stay_float(scene):
    texture, _ = textured(scene, bpy.data.images.new("Light", 8, 4, float_buffer=True))
    assert texture["float"] and texture["encoding"] == "linear"


def test_packed_images_are_read_from_the_file(scene, tmp_path):
    image = bpy.data.images.new("Brick", 8, 4)
    image.pixels.foreach_set(np.linspace(0, 1, 8 * 4 * 4, dtype=np.float32))
    image.pack()
    material, tree, output = add_material("Textured")
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    diffuse_with(tree, output, node.outputs["Color"])
    add_quad(scene, "Wall", material=material)
    path = str(tmp_path / "packed.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    out = exported(bpy.context.scene)
    assert (out["textures"][0]["width"], out["textures"][0]["height"]) == (8, 4)
    assert out["warnings"] == []


def test_missing_images_are_magenta_and_named(scene):
    image = bpy.data.images.new("Lost", 8, 4)
    image.source, image.filepath = "FILE", "/nowhere/lost.png"
    texture, warnings = textured(scene, image)
    assert (texture["width"], texture["height"]) == (1, 1)
    assert any("'Lost' could not be read from /nowhere/lost.png" in warning for warning in warnings)


def test_attributes_are_exported_where_a_material_asks_for_them_and_named_where_they_are_missing(tree, scene):
    tree, output, export = tree
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = "mask"
    diffuse_with(tree, output, node.outputs["Color"])
    wall = bpy.data.objects["Wall"].data
    for name in ("mask", "unasked"):
        wall.attributes.new(name, "FLOAT", "POINT")
    _, warnings, out = export()
    assert out["meshes"][0]["color_attributes"] == ["mask"] and warnings == []
    for name in ("Floor", "Ceiling"):
        add_quad(scene, name, material=bpy.data.materials["Paint"])
    _, warnings, _ = export()
    assert len(warnings) == 1 and "material 'Paint', node 'Attribute'" in warnings[0] and "'mask'" in warnings[0]
    node.attribute_name = ""  # Not the colour that renders, as the empty name of a Color Attribute is.
    material, warnings, _ = export()
    assert material["nodes"][-1]["color"] == [0.0, 0.0, 0.0] and warnings == []
