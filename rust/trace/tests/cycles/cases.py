"""Graphs that `generate.py` measures, by name: closures, hair, values of nodes, and images."""

import bpy

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


def principled(**changes):
    return [{**PRINCIPLED, **changes}]


def link(node, output):
    return {"node": node, "output": output}


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
        # Cycles' rays find other light than its samples of lamps where scales are tilted.
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
