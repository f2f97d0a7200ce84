"""Graphs with Blender's procedural textures for `generate.py`, each at points that float arithmetic gives exactly: they
are snapped to a grid, so that a texture's value is compared and not the rounding of where it is taken.

Voronoi textures have other random points from Blender 5.0 on: their cases are named "voronoi pcg", measured there with
`python generate.py voronoi`. Everything else is as in 4.2 (compared with 5.2)."""

import bpy

TEXTURES = {
    "noise": "ShaderNodeTexNoise", "checker": "ShaderNodeTexChecker", "gradient": "ShaderNodeTexGradient",
    "white_noise": "ShaderNodeTexWhiteNoise", "voronoi": "ShaderNodeTexVoronoi", "wave": "ShaderNodeTexWave",
    "magic": "ShaderNodeTexMagic", "brick": "ShaderNodeTexBrick",
}  # fmt: skip
PROPERTIES = {
    "noise": {"dimensions": "noise_dimensions", "kind": "noise_type", "normalize": "normalize"},
    "checker": {},
    "gradient": {"kind": "gradient_type"},
    "white_noise": {"dimensions": "noise_dimensions"},
    "voronoi": {
        "dimensions": "voronoi_dimensions", "feature": "feature", "metric": "distance", "normalize": "normalize",
    },
    "wave": {"kind": "wave_type", "profile": "wave_profile"},
    "magic": {"depth": "turbulence_depth"},
    "brick": {
        "offset": "offset", "offset_frequency": "offset_frequency", "squash": "squash",
        "squash_frequency": "squash_frequency",
    },
}  # fmt: skip
NOT_SOCKETS = ("type", "texture", "position", "hash", "direction")
OUTPUTS = {"factor": "Fac", "color": "Color", "value": "Value", "distance": "Distance", "vector": "Position", "w": "W",
           "radius": "Radius"}  # fmt: skip

NOISE = {"scale": 1.0, "detail": 2.0, "roughness": 0.5, "lacunarity": 2.0, "offset": 0.0, "gain": 1.0,
         "distortion": 0.0}  # fmt: skip
VORONOI = {"scale": 1.0, "detail": 0.0, "roughness": 0.5, "lacunarity": 2.0, "smoothness": 1.0, "exponent": 0.5,
           "randomness": 1.0, "metric": "EUCLIDEAN", "normalize": False, "position": False}  # fmt: skip
WAVE = {"scale": 0.3, "distortion": 0.0, "detail": 2.0, "detail_scale": 1.0, "detail_roughness": 0.5,
        "phase_offset": 0.0}  # fmt: skip
BRICK = {"scale": 1.0, "mortar_size": 0.1, "mortar_smooth": 0.1, "bias": 0.0, "brick_width": 1.1, "row_height": 0.7,
         "offset": 0.5, "offset_frequency": 2, "squash": 1.0, "squash_frequency": 2,
         "color1": [0.8, 0.3, 0.1], "color2": [0.2, 0.7, 0.9], "mortar": [0.05, 0.04, 0.5]}  # fmt: skip


def set_properties(node, spec):
    """Settings of a texture node that are no sockets; returns which fields they are."""
    names = PROPERTIES[spec["texture"]]
    for field, name in names.items():
        setattr(node, name, spec[field])
    if spec["texture"] == "wave":
        setattr(node, f"{spec['kind'].lower()}_direction", spec["direction"])
    return names


def link(node, output):
    return {"node": node, "output": output}


def points(spread, offset=(0.0, 0.0, 0.0)):
    """Nodes that spread the square's points over `spread` in each direction about the origin, on a grid of 1/64, and
    then move them by `offset`. The position is the last node's, w that of node 5."""
    x, y, z = (0.73 * spread, 0.61 * spread, 0.57 * spread)
    return [
        {"type": "uv_map", "name": "UVMap"},
        {"type": "separate_xyz", "vector": link(0, "vector")},
        {"type": "math", "operation": "MULTIPLY_ADD", "clamp": False, "a": link(1, "x"), "b": 1.7, "c": link(1, "y")},
        {"type": "combine_xyz", "x": link(1, "x"), "y": link(1, "y"), "z": link(2, "value")},
        {"type": "math", "operation": "MULTIPLY_ADD", "clamp": False, "a": link(1, "x"), "b": x, "c": -0.45 * x},
        {"type": "math", "operation": "SNAP", "clamp": False, "a": link(4, "value"), "b": 0.015625, "c": 0.0},
        {"type": "vector_math", "operation": "MULTIPLY_ADD", "a": link(3, "vector"), "b": [x, y, z],
         "c": [-0.53 * x, -0.47 * y, -1.31 * z], "scale": 1.0},
        {"type": "vector_math", "operation": "SNAP", "a": link(6, "vector"), "b": [0.015625] * 3, "c": [0.0] * 3,
         "scale": 1.0},
        {"type": "vector_math", "operation": "ADD", "a": link(7, "vector"), "b": list(offset), "c": [0.0] * 3,
         "scale": 1.0},
    ]  # fmt: skip


def texture(name, /, **fields):
    return {"type": "procedural", "texture": name, "vector": link(8, "vector"), **fields}


def shown(start, spec, output):
    """A graph that shows a texture's output as a colour without negative components, and that graph's output."""
    at = len(start)
    show = {"type": "vector_math", "operation": "MULTIPLY_ADD", "a": link(at, output), "b": [0.25] * 3, "c": [0.5] * 3,
            "scale": 1.0}  # fmt: skip
    return [*start, spec, show], "vector"


def noise_graphs():
    start = points(9.0)
    kinds = ("FBM", "MULTIFRACTAL", "RIDGED_MULTIFRACTAL", "HYBRID_MULTIFRACTAL", "HETERO_TERRAIN")

    def noise(name, /, start=start, output="factor", dimensions="3D", kind="FBM", normalize=True, **fields):
        spec = texture("noise", dimensions=dimensions, kind=kind, normalize=normalize, w=link(5, "value"))
        return f"noise {name}", *shown(start, {**spec, **NOISE, **fields}, output)

    for dimensions in ("1D", "2D", "3D", "4D"):
        yield noise(f"{dimensions} one octave", dimensions=dimensions, detail=0.0, normalize=False)
        yield noise(f"{dimensions} detail", dimensions=dimensions, detail=3.4, roughness=0.6, lacunarity=2.3)
        yield noise(f"{dimensions} color", output="color", dimensions=dimensions)
        yield noise(f"{dimensions} distorted", output="color", dimensions=dimensions, distortion=0.7, scale=0.6)
        for kind in kinds:
            fields = {"kind": kind, "detail": 2.6, "roughness": 0.7, "offset": 0.4, "gain": 1.8}
            yield noise(f"{dimensions} {kind}", dimensions=dimensions, **fields)
    for kind in kinds:
        yield noise(f"{kind} whole detail", kind=kind, detail=3.0, normalize=False, offset=0.8, gain=2.5)
        yield noise(f"{kind} rough", kind=kind, detail=1.5, roughness=1.4, lacunarity=1.7, offset=1.2, gain=0.6)
    yield noise("FBM detail not normalised", detail=2.6, normalize=False, roughness=0.7)
    yield noise("FBM much detail", detail=20.0, roughness=0.8)
    yield noise("negative scale and roughness", detail=1.3, scale=-2.7, roughness=-0.4)
    for offset in ((1000.25, -2000.5, 3000.75), (-99998.5, 99997.25, 5.0), (1.5e6, -2.5e5, 3.3e6)):
        yield noise(f"far {offset}", start=points(9.0, offset), detail=0.0)
        yield noise(f"far {offset} 2D", start=points(9.0, offset), dimensions="2D", detail=0.0)


def simple_graphs():
    start, far = points(9.0), points(9.0, (1000.25, -2000.5, 3000.75))
    checker = texture("checker", color1=[0.8, 0.3, 0.1], color2=[0.2, 0.7, 0.9], scale=1.7)
    for name, begin in (("", start), (" far", far)):
        yield f"checker{name}", [*begin, checker], "color"
    yield "checker whole", [*points(64.0), {**checker, "scale": 1.0}], "factor"
    for kind in ("LINEAR", "QUADRATIC", "EASING", "DIAGONAL", "SPHERICAL", "QUADRATIC_SPHERE", "RADIAL"):
        yield f"gradient {kind}", [*points(2.2), texture("gradient", kind=kind)], "color"
        yield f"gradient {kind} factor", [*points(1.2), texture("gradient", kind=kind)], "factor"
    for dimensions in ("1D", "2D", "3D", "4D"):
        for name, begin in (("", start), (" far", far)):
            spec = texture("white_noise", dimensions=dimensions, w=link(5, "value"))
            yield f"white noise {dimensions}{name}", [*begin, spec], "color"
            yield f"white noise {dimensions} value{name}", [*begin, spec], "value"


def voronoi_graphs():
    start = points(5.0)
    is_pcg = bpy.app.version >= (5, 0, 0)
    hashing = {"hash": "pcg" if is_pcg else "jenkins"}

    def voronoi(name, /, start=start, output="distance", dimensions="3D", feature="F1", **fields):
        spec = texture("voronoi", dimensions=dimensions, feature=feature, w=link(5, "value"))
        spec = {**spec, **VORONOI, **hashing, **fields, "position": output in ("vector", "w")}
        return f"voronoi {'pcg ' if is_pcg else ''}{name}", *shown(start, spec, output)

    for dimensions in ("2D", "3D", "4D") if is_pcg else ("1D", "2D", "3D", "4D"):
        for feature in ("F1", "F2", "SMOOTH_F1"):
            name = f"{dimensions} {feature}"
            fields = {"dimensions": dimensions, "feature": feature, "smoothness": 0.7}
            yield voronoi(name, **fields)
            yield voronoi(f"{name} color", output="color", **fields, randomness=0.8)
            if dimensions != "1D":
                yield voronoi(f"{name} position", output="vector", **fields, scale=1.4)
            if dimensions in ("1D", "4D"):
                yield voronoi(f"{name} w", output="w", **fields, scale=1.4)
            fractal = {"detail": 2.3, "roughness": 0.6, "lacunarity": 2.2, "normalize": True}
            for output in ("distance", "color", "w" if dimensions == "1D" else "vector"):
                yield voronoi(f"{name} fractal {output}", output=output, **fields, **fractal, randomness=0.9)
        edge = {"dimensions": dimensions, "feature": "DISTANCE_TO_EDGE"}
        yield voronoi(f"{dimensions} edge", **edge)
        yield voronoi(f"{dimensions} edge fractal", **edge, **fractal, randomness=0.7)
        sphere = {"dimensions": dimensions, "feature": "N_SPHERE_RADIUS", "output": "radius"}
        yield voronoi(f"{dimensions} radius", **sphere, randomness=0.9)
    if is_pcg:
        return
    for metric in ("MANHATTAN", "CHEBYCHEV", "MINKOWSKI"):
        for feature in ("F1", "F2", "SMOOTH_F1"):
            fields = {"metric": metric, "feature": feature, "exponent": 2.7, "detail": 1.0, "normalize": True}
            yield voronoi(f"{metric} {feature}", **fields)
            yield voronoi(f"{metric} {feature} 2D", **fields, dimensions="2D", output="color")
    yield voronoi("no smoothness", feature="SMOOTH_F1", smoothness=0.0)
    yield voronoi("full smoothness", feature="SMOOTH_F1", smoothness=1.5, detail=1.0)
    yield voronoi("no roughness", detail=3.0, roughness=0.0, normalize=True)
    yield voronoi("no randomness", randomness=0.0, output="color")
    yield voronoi("edge without randomness", feature="DISTANCE_TO_EDGE", randomness=0.0, dimensions="2D")
    yield voronoi("far", start=points(5.0, (1000.25, -2000.5, 3000.75)), output="color")


def pattern_graphs():
    start = points(9.0)
    bands = [("BANDS", direction) for direction in ("X", "Y", "Z", "DIAGONAL")]
    rings = [("RINGS", direction) for direction in ("X", "Y", "Z", "SPHERICAL")]
    for kind, direction in bands + rings:
        for profile in ("SIN", "SAW", "TRI"):
            spec = texture("wave", kind=kind, direction=direction, profile=profile)
            yield f"wave {kind} {direction} {profile}", [*start, {**spec, **WAVE, "phase_offset": 0.4}], "color"
        distorted = {**spec, **WAVE, "distortion": 1.7, "detail": 2.4, "detail_scale": 1.6, "detail_roughness": 0.7}
        yield f"wave {kind} {direction} distorted", [*start, distorted], "factor"
    for depth in range(11):
        spec = texture("magic", depth=depth, scale=0.4, distortion=1.3)
        yield f"magic {depth}", *shown(start, spec, "color")
    yield "magic factor", *shown(start, texture("magic", depth=3, scale=-0.7, distortion=0.6), "factor")
    yield "magic undistorted", *shown(start, texture("magic", depth=2, scale=0.7, distortion=0.0), "color")
    for name, fields in {
        "": {},
        " sharp": {"mortar_smooth": 0.0, "mortar_size": 0.2, "bias": -0.3},
        " soft": {"mortar_smooth": 0.8, "mortar_size": 0.3, "bias": 0.4, "scale": 0.8},
        " shifted": {"offset": 0.3, "offset_frequency": 3, "squash": 1.7, "squash_frequency": 2, "row_height": 0.4},
        " large": {"scale": 40.0, "mortar_size": 0.05},
    }.items():
        spec = {**texture("brick"), **BRICK, **fields}
        yield f"brick{name}", [*start, spec], "color"
        yield f"brick{name} factor", [*start, spec], "factor"


def coordinate_graphs():
    """Textures without a vector are taken at generated coordinates; heights for bumps at shifted points."""
    noise = {"dimensions": "3D", "kind": "FBM", "normalize": True, "w": 0.0, **NOISE, "scale": 7.3}
    yield "noise generated", [{**texture("noise"), **noise, "vector": None}], "factor"
    voronoi = {"dimensions": "3D", "feature": "F1", "hash": "jenkins", "w": 0.0, **VORONOI, "scale": 1.3}
    for name, spec, output in (
        ("noise", {**texture("noise"), **noise, "scale": 1.3}, "factor"),
        ("voronoi", {**texture("voronoi"), **voronoi}, "distance"),
    ):
        bump = {"type": "bump", "invert": False, "strength": 0.8, "distance": 0.3, "normal": None}
        graph = [{**spec, "vector": None}, {**bump, "height": link(0, output)}]
        yield f"bump of {name}", [*graph], "normal"


def graphs():
    """Name, nodes and output of each graph."""
    for graphs in (noise_graphs, simple_graphs, voronoi_graphs, pattern_graphs, coordinate_graphs):
        yield from graphs()
