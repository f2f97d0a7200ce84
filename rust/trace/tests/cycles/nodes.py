"""Blender's nodes for the graphs of `generate.py`, whose fields are those of `relume_scene::Node`."""

import procedural

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
