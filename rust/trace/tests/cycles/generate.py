"""Measures closures and node values in Cycles and writes them beside this file, for `cycles_reference.rs`.

Run with a Python that has the `bpy` module: `python generate.py`, or `python generate.py noise voronoi` for the cases
alone whose names begin with one of these words; the others are kept. A square of side 2 lies in the plane z = 0 about
the origin, its UV map is (x + 1) / 2, (y + 1) / 2. An orthographic camera looks at it along `direction`. For closures,
the world's radiance is a polynomial of the direction, see `WORLD`, and the mean over the square is recorded. For
values, the nodes' result is emitted and recorded at the centres of 4 x 4 pixels seen from above, of 6 x 6 for
procedural textures; some read a 4 x 4 image.
"""

import json
import math
import os
import sys
import tempfile

import bpy
import mathutils
import procedural

HERE = os.path.dirname(os.path.abspath(__file__))

PRINCIPLED = {
    "type": "principled", "base_color": [0.8, 0.5, 0.2], "metallic": 0.0, "roughness": 0.5, "diffuse_roughness": 0.0,
    "ior": 1.5, "alpha": 1.0, "normal": None, "subsurface_weight": 0.0, "specular_ior_level": 0.5,
    "specular_tint": [1.0, 1.0, 1.0], "anisotropic": 0.0, "anisotropic_rotation": 0.0, "tangent": None,
    "transmission_weight": 0.0, "coat_weight": 0.0, "coat_roughness": 0.03, "coat_ior": 1.5,
    "coat_tint": [1.0, 1.0, 1.0], "coat_normal": None, "sheen_weight": 0.0, "sheen_roughness": 0.5,
    "sheen_tint": [1.0, 1.0, 1.0], "emission_color": [1.0, 1.0, 1.0], "emission_strength": 0.0,
    "distribution": "multi_ggx",
}  # fmt: skip

HAIR = {
    "type": "principled_hair", "model": "chiang", "pigment": "melanin", "color": [0.5, 0.3, 0.1], "melanin": 0.4,
    "melanin_redness": 0.6, "tint": [1.0, 1.0, 1.0], "absorption_coefficient": [0.1, 0.3, 0.8], "aspect_ratio": 1.0,
    "roughness": 0.3, "radial_roughness": 0.4, "coat": 0.0, "ior": 1.55, "offset": 0.1, "random_color": 0.0,
    "random_roughness": 0.0, "random": None, "reflection": 1.0, "transmission": 1.0, "secondary_reflection": 1.0,
}  # fmt: skip

SHADERS = {
    "principled": "ShaderNodeBsdfPrincipled", "diffuse": "ShaderNodeBsdfDiffuse", "glossy": "ShaderNodeBsdfAnisotropic",
    "single_scattering_diffuse": "ShaderNodeBsdfDiffuse",
    "metallic": "ShaderNodeBsdfMetallic", "sheen": "ShaderNodeBsdfSheen", "toon": "ShaderNodeBsdfToon",
    "glass": "ShaderNodeBsdfGlass", "refraction": "ShaderNodeBsdfRefraction",
    "translucent": "ShaderNodeBsdfTranslucent", "transparent": "ShaderNodeBsdfTransparent",
    "principled_hair": "ShaderNodeBsdfHairPrincipled", "hair_bsdf": "ShaderNodeBsdfHair",
    "emission": "ShaderNodeEmission", "mix_shader": "ShaderNodeMixShader", "add_shader": "ShaderNodeAddShader",
}  # fmt: skip
VALUES = {
    "uv_map": "ShaderNodeUVMap", "math": "ShaderNodeMath", "vector_math": "ShaderNodeVectorMath",
    "mix": "ShaderNodeMix", "separate_xyz": "ShaderNodeSeparateXYZ",
    "combine_xyz": "ShaderNodeCombineXYZ",
    "hue_saturation": "ShaderNodeHueSaturation", "bright_contrast": "ShaderNodeBrightContrast",
    "gamma": "ShaderNodeGamma", "invert": "ShaderNodeInvert", "fresnel": "ShaderNodeFresnel",
    "layer_weight": "ShaderNodeLayerWeight", "map_range": "ShaderNodeMapRange",
    "mapping": "ShaderNodeMapping", "normal_map": "ShaderNodeNormalMap", "bump": "ShaderNodeBump",
    "texture_coordinate": "ShaderNodeTexCoord", "geometry": "ShaderNodeNewGeometry",
    "image_texture": "ShaderNodeTexImage", "separate_color": "ShaderNodeSeparateColor",
    "combine_color": "ShaderNodeCombineColor",
}  # fmt: skip
PROPERTIES = {
    "distribution": "distribution", "operation": "operation", "clamp": "use_clamp", "data": "data_type",
    "blend": "blend_type", "clamp_factor": "clamp_factor", "clamp_result": "clamp_result", "kind": "vector_type",
    "mode": "mode", "space": "space", "invert": "invert", "interpolation": "interpolation_type",
    "extension": "extension", "model": "model", "pigment": "parametrization", "component": "component",
    "fresnel": "fresnel_type",
}  # fmt: skip
OUTPUTS = {
    "color": "Color", "value": "Value", "vector": "Vector", "normal": "Normal", "fresnel": "Fresnel",
    "facing": "Facing", "alpha": "Alpha", "x": "X", "y": "Y", "z": "Z", "tangent": "Tangent", "incoming": "Incoming",
}  # fmt: skip
NOT_SOCKETS = ("type", "name", "uv_map", "filter_width", "texture", "multiple_scattering")


def principled(**changes):
    return [{**PRINCIPLED, **changes}]


def socket_name(field):
    special = {
        "roughness_u": "RoughnessU",
        "roughness_v": "RoughnessV",
        "ior": "IOR",
        "specular_ior_level": "Specular IOR Level",
        "coat_ior": "Coat IOR",
        "factor": "Fac",
    }
    return special.get(field, field.replace("_", " ").title())


def output_of(node, name):
    if node.bl_idname == "ShaderNodeMix":
        return next(o for o in node.outputs if o.enabled)
    if node.bl_idname in ("ShaderNodeSeparateColor",):
        return node.outputs["XYZ".index(name.upper())]
    if node.bl_idname == "ShaderNodeUVMap":
        return node.outputs["UV"]
    if node.bl_idname == "ShaderNodeMapRange":
        return node.outputs["Result"]
    if node.bl_idname == "ShaderNodeFresnel":
        return node.outputs[0]
    if node.bl_idname == "ShaderNodeTexCoord":
        return node.outputs[node["kind"]]
    if node.bl_idname in procedural.TEXTURES.values():
        return next(o for o in node.outputs if o.identifier == procedural.OUTPUTS[name])
    return node.outputs[OUTPUTS[name]]


def input_of(node, field):
    if node.bl_idname == "ShaderNodeMix":
        wanted = {"factor": "Factor", "a": "A", "b": "B"}[field]
        return next(i for i in node.inputs if i.enabled and i.name == wanted)
    if node.bl_idname in ("ShaderNodeMath", "ShaderNodeVectorMath", "ShaderNodeCombineColor") and field in "abc":
        return node.inputs["abc".index(field)]
    if node.bl_idname in ("ShaderNodeMixShader", "ShaderNodeAddShader") and field in "ab":
        return [i for i in node.inputs if i.type == "SHADER"]["ab".index(field)]
    if node.bl_idname == "ShaderNodeBrightContrast" and field == "bright":
        return node.inputs["Bright"]
    return node.inputs[socket_name(field)]


def set_property(node, field, value):
    name = PROPERTIES[field]
    if node.bl_idname == "ShaderNodeTexCoord":
        node["kind"] = {"uv": "UV"}.get(value, value.title())
    elif node.bl_idname == "ShaderNodeMix" and field == "data":
        node.data_type = {"color": "RGBA", "float": "FLOAT", "vector": "VECTOR"}[value]
    elif node.bl_idname == "ShaderNodeMapRange" and field == "clamp":
        node.clamp = value
    elif node.bl_idname == "ShaderNodeTexImage":
        setattr(node, field, {"linear": "Linear", "closest": "Closest", "cubic": "Cubic"}.get(value, value.upper()))
    else:
        cased = str.title if node.bl_idname == "ShaderNodeBsdfHair" and field == "component" else str.upper
        name = "distribution" if node.bl_idname == "ShaderNodeBsdfSheen" else name
        setattr(node, name, cased(value) if isinstance(value, str) else value)


def build(tree, nodes):
    """Blender's nodes for a graph; returns the last one."""
    made = []
    for spec in nodes:
        if spec["type"] == "procedural":
            node = tree.nodes.new(procedural.TEXTURES[spec["texture"]])
            settings = (*procedural.set_properties(node, spec), *procedural.NOT_SOCKETS)
        else:
            node = tree.nodes.new({**SHADERS, **VALUES}[spec["type"]])
            for field, value in spec.items():
                if field in PROPERTIES:
                    set_property(node, field, value)
            settings = (*PROPERTIES, *NOT_SOCKETS)
        for field, value in spec.items():
            if field in settings or value is None:
                continue
            # Blender hides sockets that the node's mode does not use.
            hidden = field in ("diffuse_roughness", "scale", "steps", "location")
            hidden = hidden or spec["type"] in ("procedural", "principled_hair", "metallic")
            if hidden and socket_name(field) not in node.inputs:
                continue
            socket = input_of(node, field)
            if field in "ab" and spec["type"] in ("mix_shader", "add_shader"):
                tree.links.new(made[value].outputs[0], socket)
            elif isinstance(value, dict):
                tree.links.new(output_of(made[value["node"]], value["output"]), socket)
            elif hasattr(socket.default_value, "__len__"):
                value = [value] * 3 if isinstance(value, float) else value
                socket.default_value = value + [1.0] * (len(socket.default_value) - 3)
            else:
                socket.default_value = value
        made.append(node)
    return made[-1]


TEXELS = [(37 * i + 90 * (i % 4)) % 256 if i % 4 < 3 else (i * 29) % 256 for i in range(64)]


def image(encoding, alpha):
    """The 4 x 4 image `TEXELS`."""
    image = bpy.data.images.new("test", 4, 4, alpha=True)
    image.colorspace_settings.name = {"srgb": "sRGB", "linear": "Non-Color"}[encoding]
    image.alpha_mode = {"premultiplied": "PREMUL"}.get(alpha, alpha.upper())
    image.pixels = [texel / 255 for texel in TEXELS]
    image.update()
    image.pack()
    return image


def world(tree):
    """Radiance ((1 + x) / 2)^8, 1, ((1 + z) / 2)^8 in red, green, blue."""
    direction = tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]
    parts = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(direction, parts.inputs[0])
    combine = tree.nodes.new("ShaderNodeCombineXYZ")
    combine.inputs[1].default_value = 1.0
    for axis in (0, 2):
        half = tree.nodes.new("ShaderNodeMath")
        half.operation = "MULTIPLY_ADD"
        half.inputs[1].default_value = half.inputs[2].default_value = 0.5
        tree.links.new(parts.outputs[axis], half.inputs[0])
        power = tree.nodes.new("ShaderNodeMath")
        power.operation = "POWER"
        power.inputs[1].default_value = 8.0
        tree.links.new(half.outputs[0], power.inputs[0])
        tree.links.new(power.outputs[0], combine.inputs[axis])
    background = tree.nodes["Background"]
    tree.links.new(combine.outputs[0], background.inputs["Color"])


def scene(nodes, direction, extent, samples, pixels):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("square")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    uv = mesh.uv_layers.new(name="UVMap")
    for loop, coords in zip(uv.data, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
        loop.uv = coords
    square = bpy.data.objects.new("square", mesh)
    scene.collection.objects.link(square)
    material = bpy.data.materials.new("test")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(build(material.node_tree, nodes).outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    camera = bpy.data.cameras.new("camera")
    camera.type = "ORTHO"
    camera.ortho_scale = extent
    view = bpy.data.objects.new("camera", camera)
    direction = mathutils.Vector(direction)
    view.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    view.location = -3 * direction
    scene.collection.objects.link(view)
    scene.camera = view
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.render.engine = "CYCLES"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.blur_glossy = 0.0
    scene.cycles.sample_clamp_indirect = 0.0
    scene.cycles.filter_width = 0.01
    scene.render.resolution_x = scene.render.resolution_y = pixels
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Raw"
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


def render(scene, pixels):
    path = os.path.join(tempfile.mkdtemp(), "out.exr")
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    values = list(image.pixels)
    # Six digits are what single precision has.
    return [[float(f"{value:.6g}") for value in values[4 * i : 4 * i + 3]] for i in range(pixels * pixels)]


def closure_graphs():
    white = [1.0, 1.0, 1.0]
    color = [0.8, 0.5, 0.2]
    glossy = {"color": color, "anisotropy": 0.0, "rotation": 0.0, "normal": None, "tangent": None}
    yield "diffuse", [{"type": "diffuse", "color": color, "roughness": 0.0, "normal": None}]
    rough = "diffuse" if bpy.app.version >= (4, 3, 0) else "single_scattering_diffuse"
    again = {"multiple_scattering": "full"} if bpy.app.version >= (5, 3, 0) else {}
    yield "rough diffuse", [{"type": rough, "color": color, "roughness": 0.8, "normal": None, **again}]
    yield "translucent", [{"type": "translucent", "color": color, "normal": None}]
    for distribution in ("ggx", "beckmann", "multi_ggx", "ashikhmin_shirley"):
        for roughness in (0.3, 0.7):
            spec = {"type": "glossy", **glossy, "roughness": roughness, "distribution": distribution}
            yield f"glossy {distribution} {roughness}", [spec]
    for distribution in ("ggx", "beckmann", "multi_ggx"):
        for roughness in (0.0, 0.5):
            spec = {"type": "glass", "color": color, "roughness": roughness, "ior": 1.45, "normal": None}
            yield f"glass {distribution} {roughness}", [{**spec, "distribution": distribution}]
    spec = {"type": "refraction", "color": color, "roughness": 0.4, "ior": 1.3, "normal": None}
    yield "refraction", [{**spec, "distribution": "ggx"}]
    yield "principled", principled()
    yield "principled rough", principled(roughness=1.0)
    yield "principled smooth", principled(roughness=0.1)
    yield "principled specular", principled(specular_ior_level=1.0, specular_tint=[0.9, 0.2, 0.1])
    yield "principled low ior", principled(ior=1.1, roughness=0.3)
    yield "principled metal", principled(metallic=1.0, roughness=0.4, specular_tint=[0.7, 0.9, 0.3])
    yield "principled rough metal", principled(metallic=1.0, roughness=1.0)
    yield "principled half metal", principled(metallic=0.5, roughness=0.6)
    yield "principled glass", principled(transmission_weight=1.0, roughness=0.3)
    yield "principled frosted", principled(transmission_weight=0.6, roughness=0.8, specular_tint=[0.3, 0.6, 0.9])
    yield "principled coat", principled(coat_weight=1.0, coat_roughness=0.2, roughness=0.7)
    yield "principled tinted coat", principled(coat_weight=0.7, coat_tint=[0.3, 0.7, 0.9], coat_ior=1.8)
    yield "principled sheen", principled(sheen_weight=1.0, sheen_roughness=0.5, sheen_tint=[0.9, 0.6, 0.8])
    yield "principled rough sheen", principled(sheen_weight=0.8, sheen_roughness=1.0, base_color=[0.0] * 3)
    yield "principled alpha", principled(alpha=0.4)
    along = {"type": "combine_xyz", "x": 0.8, "y": 0.6, "z": 0.0}
    tangent = {"node": 0, "output": "vector"}
    stretched = {"anisotropic": 0.8, "anisotropic_rotation": 0.1, "tangent": tangent, "base_color": white}
    yield "principled anisotropic", [along, {**PRINCIPLED, "metallic": 1.0, **stretched}]
    for anisotropy in (0.6, -0.7):
        spec = {"type": "glossy", **glossy, "roughness": 0.5, "distribution": "ggx", "anisotropy": anisotropy}
        yield f"glossy anisotropic {anisotropy}", [along, {**spec, "rotation": 0.2, "tangent": tangent}]
    yield "principled single scattering", principled(metallic=1.0, roughness=0.9, distribution="ggx")
    bent = {"type": "normal_map", "space": "tangent", "uv_map": "", "strength": 1.0, "color": [0.8, 0.6, 0.85]}
    normal = {"node": 0, "output": "normal"}
    yield "bent diffuse", [bent, {"type": "diffuse", "color": color, "roughness": 0.0, "normal": normal}]
    spec = {"type": "glossy", **glossy, "roughness": 0.4, "distribution": "ggx", "normal": normal}
    yield "bent glossy", [bent, spec]
    yield "bent principled", [bent, {**PRINCIPLED, "normal": normal}]
    weak = {**bent, "strength": 0.5}
    yield "weakly bent principled", [weak, {**PRINCIPLED, "normal": normal}]


def metal_graphs():
    """Needs Blender 4.3."""
    metal = {
        "type": "metallic", "base_color": [0.8, 0.5, 0.2], "edge_tint": [0.5, 0.8, 0.9], "ior": [0.2, 0.92, 1.1],
        "extinction": [3.9, 2.4, 2.2], "anisotropy": 0.0, "rotation": 0.0, "normal": None, "tangent": None,
    }  # fmt: skip
    for fresnel in ("f82", "physical_conductor"):
        for distribution in ("ggx", "beckmann", "multi_ggx"):
            spec = {**metal, "fresnel": fresnel, "roughness": 0.6, "distribution": distribution}
            yield f"metallic {fresnel} {distribution}", [spec]
    along = {"type": "combine_xyz", "x": 0.8, "y": 0.6, "z": 0.0}
    turned = {"anisotropy": 0.7, "rotation": 0.2, "tangent": {"node": 0, "output": "vector"}}
    spec = {**metal, **turned, "fresnel": "f82", "roughness": 0.5, "distribution": "multi_ggx"}
    yield "metallic anisotropic", [along, spec]


def cloth_and_toon_graphs():
    color = [0.8, 0.5, 0.2]
    for model in ("microfiber", "ashikhmin"):
        for roughness in (0.3, 0.8):
            spec = {"type": "sheen", "model": model, "color": color, "roughness": roughness, "normal": None}
            yield f"sheen {model} {roughness}", [spec]
    for component in ("diffuse", "glossy"):
        for size, smooth in ((0.4, 0.0), (0.3, 0.4), (0.8, 0.6)):
            spec = {"type": "toon", "component": component, "color": color, "size": size, "smooth": smooth}
            yield f"toon {component} {size} {smooth}", [{**spec, "normal": None}]


def hair_graphs():
    """Hair on a mesh, whose tangents differ from triangle to triangle."""
    for pigment in ("melanin", "color", "absorption"):
        yield f"hair {pigment}", [{**HAIR, "pigment": pigment}]
    yield "hair white", [{**HAIR, "pigment": "color", "color": [1.0, 1.0, 1.0], "roughness": 0.15}]
    yield "hair rough", [{**HAIR, "roughness": 0.8, "radial_roughness": 0.7, "ior": 1.3, "random_roughness": 0.4}]
    for roughness in (0.15, 0.4):
        # What Cycles' rays find differs from how it samples lamps where scales are tilted.
        huang = {"model": "huang", "roughness": roughness, "offset": 0.0}
        yield f"hair huang {roughness}", [{**HAIR, **huang}]
    parts = {"model": "huang", "offset": 0.0, "reflection": 0.5, "transmission": 0.3, "secondary_reflection": 2.0}
    yield "hair huang parts", [{**HAIR, **parts}]


def lit_hair_graphs():
    yield "hair melanin", [HAIR]
    yield "hair huang", [{**HAIR, "model": "huang", "tint": [0.9, 0.8, 0.7]}]
    lobe = {"type": "hair_bsdf", "color": [0.8, 0.5, 0.2], "offset": 0.2, "roughness_u": 0.3, "roughness_v": 0.4}
    for component in ("reflection", "transmission"):
        yield f"hair {component}", [{**lobe, "component": component, "tangent": None}]
    along = {"type": "combine_xyz", "x": 0.8, "y": 0.6, "z": 0.0}
    yield "hair along", [along, {**lobe, "component": "reflection", "tangent": link(0, "vector")}]


def link(node, output):
    return {"node": node, "output": output}


def value_graphs():
    uv = {"type": "uv_map", "name": "UVMap"}
    xyz = {"type": "separate_xyz", "vector": link(0, "vector")}
    scaled = {"type": "vector_math", "operation": "MULTIPLY_ADD", "a": link(0, "vector"), "b": [4.0, 4.0, 1.0],
              "c": [-1.91, -2.07, 0.3], "scale": 1.0}  # fmt: skip
    parts = {"type": "separate_xyz", "vector": link(1, "vector")}
    start = [uv, scaled, parts]
    math_operations = (
        "ADD SUBTRACT MULTIPLY DIVIDE MULTIPLY_ADD POWER LOGARITHM SQRT INVERSE_SQRT ABSOLUTE EXPONENT MINIMUM MAXIMUM "
        "LESS_THAN GREATER_THAN SIGN COMPARE SMOOTH_MIN SMOOTH_MAX ROUND FLOOR CEIL TRUNC FRACT MODULO "
        "FLOORED_MODULO WRAP SNAP PINGPONG SINE COSINE TANGENT ARCSINE ARCCOSINE ARCTANGENT ARCTAN2 SINH COSH TANH "
        "RADIANS DEGREES"
    )
    for operation in math_operations.split():
        spec = {"type": "math", "operation": operation, "clamp": False, "a": link(2, "x"), "b": link(2, "y"), "c": 0.4}
        yield f"math {operation}", [*start, spec], "value"
    vector_operations = (
        "ADD SUBTRACT MULTIPLY DIVIDE CROSS_PRODUCT PROJECT REFLECT DOT_PRODUCT DISTANCE LENGTH SCALE NORMALIZE "
        "ABSOLUTE MINIMUM MAXIMUM FLOOR CEIL FRACTION MODULO SNAP SINE COSINE TANGENT"
    )
    for operation in vector_operations.split():
        spec = {"type": "vector_math", "operation": operation, "a": link(1, "vector"), "b": [0.7, -0.4, 0.9],
                "c": [0.0, 0.0, 0.0], "scale": 1.7}  # fmt: skip
        is_value = operation in ("DOT_PRODUCT", "DISTANCE", "LENGTH")
        yield f"vector math {operation}", [*start, spec], "value" if is_value else "vector"
    unit = [uv, {"type": "separate_xyz", "vector": link(0, "vector")},
            {"type": "combine_xyz", "x": link(1, "x"), "y": link(1, "y"), "z": 0.6}]  # fmt: skip
    modes = (
        "MIX DARKEN MULTIPLY BURN LIGHTEN SCREEN DODGE ADD OVERLAY SOFT_LIGHT LINEAR_LIGHT DIFFERENCE EXCLUSION "
        "SUBTRACT DIVIDE HUE SATURATION COLOR VALUE"
    )
    for mode in modes.split():
        spec = {"type": "mix", "data": "color", "blend": mode, "clamp_factor": True, "clamp_result": False,
                "factor": 0.7, "a": link(2, "vector"), "b": [0.3, 0.9, 0.5]}  # fmt: skip
        yield f"mix {mode}", [*unit, spec], "color"
    spec = {"type": "hue_saturation", "hue": 0.7, "saturation": 1.4, "value": 0.9, "factor": 0.8,
            "color": link(2, "vector")}  # fmt: skip
    yield "hue saturation", [*unit, spec], "color"
    spec = {"type": "bright_contrast", "color": link(2, "vector"), "bright": 0.1, "contrast": 0.6}
    yield "bright contrast", [*unit, spec], "color"
    yield "gamma", [*unit, {"type": "gamma", "color": link(2, "vector"), "gamma": 1.7}], "color"
    yield "invert", [*unit, {"type": "invert", "factor": 0.6, "color": link(2, "vector")}], "color"
    for mode in ("hsv", "hsl"):
        separate = {"type": "separate_color", "mode": mode, "color": link(2, "vector")}
        xyz = {"type": "combine_xyz", "x": link(3, "x"), "y": link(3, "y"), "z": link(3, "z")}
        yield f"separate {mode}", [*unit, separate, xyz], "vector"
        combine = {"type": "combine_color", "mode": mode, "a": link(1, "x"), "b": link(1, "y"), "c": 0.6}
        yield f"combine {mode}", [*unit, combine], "color"
    for kind in ("LINEAR", "STEPPED", "SMOOTHSTEP", "SMOOTHERSTEP"):
        spec = {"type": "map_range", "interpolation": kind, "clamp": True, "value": link(2, "x"), "from_min": -1.0,
                "from_max": 1.2, "to_min": 3.0, "to_max": 0.5, "steps": 3.0}  # fmt: skip
        yield f"map range {kind}", [*start, spec], "value"
    for kind in ("point", "texture", "vector", "normal"):
        spec = {"type": "mapping", "kind": kind, "vector": link(0, "vector"), "location": [0.1, 0.2, 0.3],
                "rotation": [0.4, 0.5, 0.6], "scale": [2.0, 0.5, 3.0]}  # fmt: skip
        if kind in ("vector", "normal"):
            spec["location"] = [0.0, 0.0, 0.0]
        yield f"mapping {kind}", [uv, spec], "vector"
    plus_zero = {"type": "math", "operation": "ADD", "clamp": False, "b": 0.0, "c": 0.0}
    gamma = {"type": "gamma", "color": link(2, "vector"), "gamma": 1.0}
    yield "to float by luminance", [*unit, gamma, {**plus_zero, "a": link(3, "color")}], "value"
    yield "to float by mean", [*unit, {**plus_zero, "a": link(2, "vector")}], "value"
    for kind in ("uv", "object", "generated", "normal", "camera", "window", "reflection"):
        yield f"coordinate {kind}", [{"type": "texture_coordinate", "kind": kind}], "vector"
    yield "tangent", [{"type": "geometry"}], "tangent"
    for space in ("tangent", "object", "world", "blender_object", "blender_world"):
        for strength in (1.0, 0.4, 1.6):
            spec = {"type": "normal_map", "space": space, "uv_map": "", "strength": strength,
                    "color": link(2, "vector")}  # fmt: skip
            yield f"normal map {space} {strength}", [*unit, spec], "normal"
    sine = {"type": "math", "operation": "SINE", "clamp": False, "a": link(2, "x"), "b": 0.0, "c": 0.0}
    for strength in (1.0, 0.4):
        spec = {"type": "bump", "invert": strength != 1.0, "strength": strength, "distance": 0.2,
                "height": link(3, "value"), "normal": None}  # fmt: skip
        yield f"bump {strength}", [*start, sine, spec], "normal"


def views():
    for theta in (0.3, 1.2):
        yield [-math.sin(theta) * 0.96, -math.sin(theta) * 0.28, -math.cos(theta)]


def is_wanted(name):
    """True if a case is among those that the command line names."""
    wanted = tuple(sys.argv[1:])
    return not wanted or name.startswith(wanted)


def measure_closures():
    metals = metal_graphs() if bpy.app.version >= (4, 3, 0) else ()
    for name, nodes in (*closure_graphs(), *metals, *cloth_and_toon_graphs()):
        if not is_wanted(name):
            continue
        transmits = any(n["type"] in ("glass", "refraction") or n.get("transmission_weight") for n in nodes)
        for direction in views():
            for z in (1, -1) if transmits or "bent" in name else (1,):
                seen = [*direction[:2], z * direction[2]]
                setup = scene(nodes, seen, 0.2, 4096, 8)
                world(setup.world.node_tree)
                values = render(setup, 8)
                mean = [sum(v[i] for v in values) / len(values) for i in range(3)]
                yield {"name": name, "nodes": nodes, "direction": seen, "mean": mean}


def measure_hair():
    """As `measure_closures`, within the triangle below the diagonal alone."""
    for name, nodes in hair_graphs():
        if not is_wanted(name):
            continue
        for direction in views():
            target = [0.4, -0.4]
            setup = scene(nodes, direction, 0.2, 4096, 8)
            setup.camera.location += mathutils.Vector((*target, 0.0))
            world(setup.world.node_tree)
            # Where it samples light for hair on meshes, Cycles leaves some of it out.
            setup.world.cycles.sampling_method = "NONE"
            values = render(setup, 8)
            mean = [sum(v[i] for v in values) / len(values) for i in range(3)]
            yield {"name": name, "nodes": nodes, "direction": direction, "target": target, "mean": mean}


# Reflected at the edges of the fibre, which Cycles' quadrature of Huang's model resolves too coarsely.
GRAZING = ([-0.3, 0.9, -0.4], [0.1, -0.9, 0.2], [-0.6, 0.4, -0.7])
SUNS = ([0, 0, 1], [-0.8, -0.1, 0.6], [0, 0, -1])


def measure_lit_hair():
    """Light of suns of irradiance 1 that hair on a mesh scatters."""
    for name, nodes in lit_hair_graphs():
        if not is_wanted(name):
            continue
        for direction in views():
            target = [0.4, -0.4]
            for towards in (*SUNS, *GRAZING):
                # Huang's model is an estimate in itself.
                setup = scene(nodes, direction, 0.2, 2048 if "huang" in name else 64, 8)
                setup.camera.location += mathutils.Vector((*target, 0.0))
                setup.cycles.light_sampling_threshold = 0.0
                sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
                sun.data.energy, sun.data.angle = 1.0, 0.0
                sun.rotation_euler = mathutils.Vector(towards).to_track_quat("Z", "Y").to_euler()
                setup.collection.objects.link(sun)
                values = render(setup, 8)
                mean = [sum(v[i] for v in values) / len(values) for i in range(3)]
                case = {"name": name, "nodes": nodes, "direction": direction, "target": target}
                yield {**case, "towards": towards, "mean": mean}


def texture_graphs():
    uv = {"type": "uv_map", "name": "UVMap"}
    scaled = {"type": "vector_math", "operation": "MULTIPLY_ADD", "a": link(0, "vector"), "b": [2.6, 2.3, 0.0],
              "c": [-0.71, -0.62, 0.0], "scale": 1.0}  # fmt: skip
    node = {"type": "image_texture", "texture": 0, "vector": link(1, "vector"), "interpolation": "linear",
            "extension": "repeat"}  # fmt: skip
    for interpolation in ("linear", "closest", "cubic"):
        for extension in ("repeat", "extend", "clip", "mirror"):
            spec = {**node, "interpolation": interpolation, "extension": extension}
            yield f"{interpolation} {extension}", "linear", "channel_packed", [uv, scaled, spec], "color"
    for encoding in ("srgb", "linear"):
        for alpha in ("straight", "premultiplied", "channel_packed", "none"):
            name = f"{encoding} {alpha}"
            yield name, encoding, alpha, [uv, scaled, node], "color"
            yield f"{name} alpha", encoding, alpha, [uv, scaled, node], "alpha"
            both = {"type": "vector_math", "operation": "MULTIPLY", "a": link(2, "color"), "b": link(2, "alpha"),
                    "c": [0.0, 0.0, 0.0], "scale": 1.0}  # fmt: skip
            yield f"{name} both", encoding, alpha, [uv, scaled, node, both], "vector"


def measure_textures():
    for name, encoding, alpha, nodes, output in texture_graphs():
        if not is_wanted(name):
            continue
        emission = {"type": "emission", "color": link(len(nodes) - 1, output), "strength": 1.0}
        setup = scene([*nodes, emission], [0, 0, -1], 2.0, 1, 4)
        for node in bpy.data.materials["test"].node_tree.nodes:
            if node.bl_idname == "ShaderNodeTexImage":
                node.image = image(encoding, alpha)
        texture = {"encoding": encoding, "alpha": alpha, "texels": TEXELS}
        yield {"name": name, "texture": texture, "nodes": [*nodes, emission], "pixels": render(setup, 4)}


def measure_values(graphs, side):
    for name, nodes, output in graphs:
        if not is_wanted(name):
            continue
        emission = {"type": "emission", "color": link(len(nodes) - 1, output), "strength": 1.0}
        setup = scene([*nodes, emission], [0, 0, -1], 2.0, 1, side)
        yield {"name": name, "nodes": [*nodes, emission], "pixels": render(setup, side)}


def merged(old, new):
    """The old cases with the new ones in place of those of the same names."""
    names = {case["name"] for case in new}
    return [case for case in old if case["name"] not in names] + new


def main():
    path = os.path.join(HERE, "reference.json")
    with open(path, encoding="utf-8") as file:
        known = json.load(file)
    closures = list(measure_closures())
    values = [*measure_values(value_graphs(), 4), *measure_textures(), *measure_values(procedural.graphs(), 6)]
    result = {
        "blender": known["blender"] if sys.argv[1:] else bpy.app.version_string,
        "closures": merged(known["closures"], closures),
        "values": merged(known["values"], values),
        # Measured in Blender 5.3, as the closures of metals are, new in 4.3: Huang's model is mended from 4.5 on.
        "hair": merged(known.get("hair", []), list(measure_hair())),
        "lit_hair": merged(known.get("lit_hair", []), list(measure_lit_hair())),
    }
    with open(path, "w", encoding="utf-8") as file:
        json.dump(result, file, indent=None, separators=(",", ":"))


if __name__ == "__main__":
    main()
