"""Nodes that turn and move vectors, and look them up: each becomes a few nodes of vector maths."""

from __future__ import annotations

from typing import Any

from mathutils import Matrix

from ..object_attributes import MATRIX, MATRIX_INVERSE
from .graph import Source
from .tables import vector_curves
from .translation import TranslateValue, Translation
from .volumes import blackbody_colors

NONE = [0.0] * 3


def _vector_math(t: Translation, operation: str, a: Any, b: Any = NONE, scale: Any = 1.0) -> dict[str, Any]:
    node = {"type": "vector_math", "operation": operation, "a": a, "b": b, "c": NONE, "scale": scale}
    output = "value" if operation in {"DOT_PRODUCT", "LENGTH"} else "vector"
    return {"node": t.emit(node), "output": output}


def _math(t: Translation, operation: str, a: Any, b: Any = 0.0) -> dict[str, Any]:
    node = {"type": "math", "operation": operation, "clamp": False, "a": a, "b": b, "c": 0.0}
    return {"node": t.emit(node), "output": "value"}


def _components(t: Translation, vector: Any) -> list[Any]:
    separate = t.emit({"type": "separate_xyz", "vector": vector})
    return [{"node": separate, "output": axis} for axis in "xyz"]


def _combined(t: Translation, x: Any, y: Any, z: Any) -> dict[str, Any]:
    return {"node": t.emit({"type": "combine_xyz", "x": x, "y": y, "z": z}), "output": "vector"}


def _camera_data(t: Translation, source: Source) -> Any:
    """Place in the camera's space, which looks along +z."""
    place = {"node": t.emit({"type": "texture_coordinate", "kind": "camera"}), "output": "vector"}
    match source.socket.identifier:
        case "View Z Depth":
            return _components(t, place)[2]
        case "View Distance":
            return _vector_math(t, "LENGTH", place)
    return _vector_math(t, "NORMALIZE", place)


def _normal(t: Translation, source: Source) -> Any:
    """A direction, and its cosine with a normal."""
    given = list(source.node.outputs["Normal"].default_value)
    direction = _vector_math(t, "NORMALIZE", given)
    if source.socket.identifier == "Normal":
        return direction
    normal = t.value(source.node, "Normal", source.context, NONE)
    return _vector_math(t, "DOT_PRODUCT", direction, _vector_math(t, "NORMALIZE", normal))


def _vector_rotate(t: Translation, source: Source) -> Any:
    node, context = source.node, source.context
    vector, center = (t.value(node, socket, context, NONE) for socket in ("Vector", "Center"))
    arm = _vector_math(t, "SUBTRACT", vector, center)
    sign = -1.0 if node.invert else 1.0
    axes = {"X_AXIS": [1.0, 0.0, 0.0], "Y_AXIS": [0.0, 1.0, 0.0], "Z_AXIS": [0.0, 0.0, 1.0]}
    if node.rotation_type == "EULER_XYZ":
        angles = _components(t, t.value(node, "Rotation", context, NONE))
        turns = list(zip(axes.values(), angles, strict=True))
        for axis, angle in reversed(turns) if node.invert else turns:
            arm = _turned(t, arm, axis, _math(t, "MULTIPLY", angle, sign))
    else:
        axis = axes.get(node.rotation_type) or t.value(node, "Axis", context, NONE)
        if axis == NONE:
            return vector
        unit = _vector_math(t, "NORMALIZE", axis)
        arm = _turned(t, arm, unit, _math(t, "MULTIPLY", t.value(node, "Angle", context, 0.0), sign))
    return _vector_math(t, "ADD", arm, center)


def _turned(t: Translation, arm: Any, axis: Any, angle: Any) -> dict[str, Any]:
    """A vector turned about a unit axis, by Rodrigues' formula."""
    cosine, sine = (_math(t, operation, angle) for operation in ("COSINE", "SINE"))
    along = _math(t, "MULTIPLY", _vector_math(t, "DOT_PRODUCT", axis, arm), _math(t, "SUBTRACT", 1.0, cosine))
    across = _vector_math(t, "SCALE", _vector_math(t, "CROSS_PRODUCT", axis, arm), scale=sine)
    own = _vector_math(t, "ADD", _vector_math(t, "SCALE", arm, scale=cosine), across)
    return _vector_math(t, "ADD", own, _vector_math(t, "SCALE", axis, scale=along))


def upright(t: Translation, vector: Any) -> dict[str, Any]:
    """The direction whose height is the vector's z, of any length, and whose bearing is that of x and y."""
    x, y, z = _components(t, vector)
    x = _math(t, "ADD", x, 1e-12)  # What points straight up without being as long counts as towards +x.
    height = _math(t, "MAXIMUM", _math(t, "MINIMUM", z, 1.0), -1.0)
    away = _math(t, "SQRT", _math(t, "SUBTRACT", 1.0, _math(t, "MULTIPLY", height, height)))
    level = _vector_math(t, "NORMALIZE", _combined(t, x, y, 0.0))
    x, y, _ = _components(t, _vector_math(t, "SCALE", level, scale=away))
    return _combined(t, x, y, height)


Rows = list[tuple[Any, Any]]
"""Rows of a matrix: three numbers each and the fourth."""


def _vector_transform(t: Translation, source: Source) -> Any:
    node = source.node
    vector = t.value(node, "Vector", source.context, NONE)
    spaces = node.convert_from, node.convert_to
    if spaces[0] == spaces[1] or not set(spaces) <= {"WORLD", "OBJECT", "CAMERA"}:
        return vector
    for space, is_inverse in ((spaces[0], False), (spaces[1], True)):
        if space == "WORLD":
            continue
        if node.vector_type == "NORMAL":
            vector = _normal_by(t, vector, _rows(t, source, space, not is_inverse))
        else:
            vector = _moved(t, vector, _rows(t, source, space, is_inverse), node.vector_type == "POINT")
    return vector


def _rows(t: Translation, source: Source, space: str, is_inverse: bool) -> Rows:
    """Rows of the matrix from a space to the world, or of its inverse."""
    if space == "CAMERA":
        matrix = t.surroundings.world_from_camera()
        matrix = matrix.inverted_safe() if is_inverse else matrix
        return [(list(row[:3]), row[3]) for row in matrix[:3]]
    names = [f"{MATRIX_INVERSE if is_inverse else MATRIX}{axis}" for axis in "xyz"]
    return [(t.of_object(source, name, "vector"), t.of_object(source, name, "alpha")) for name in names]


def _moved(t: Translation, vector: Any, rows: Rows, is_place: bool) -> dict[str, Any]:
    products = [_vector_math(t, "DOT_PRODUCT", row, vector) for row, _ in rows]
    if is_place:
        products = [_math(t, "ADD", product, shift) for product, (_, shift) in zip(products, rows, strict=True)]
    return _combined(t, *products)


def _normal_by(t: Translation, normal: Any, rows: Rows) -> dict[str, Any]:
    """A normal by the transposed matrix of these rows, of unit length."""
    parts = _components(t, normal)
    x, y, z = (_vector_math(t, "SCALE", row, scale=part) for (row, _), part in zip(rows, parts, strict=True))
    return _vector_math(t, "NORMALIZE", _vector_math(t, "ADD", _vector_math(t, "ADD", x, y), z))


def transformed(t: Translation, vector: Any, matrix: Matrix) -> Any:
    """A place moved by a matrix."""
    return _moved(t, vector, [(list(row[:3]), row[3]) for row in matrix[:3]], True)


def _vector_curves(t: Translation, source: Source) -> Any:
    node = source.node
    factor, vector = t.value(node, 0, source.context, 1.0), t.value(node, 1, source.context, NONE)
    curves = {"type": "rgb_curves", "factor": factor, "color": vector, "curves": vector_curves(node.mapping)}
    return _vector_math(t, "ADD", {"node": t.emit(curves), "output": "color"})


def _blackbody(t: Translation, source: Source) -> Any:
    """A black body whose temperature varies."""
    kelvin = t.number(source.node, "Temperature", source.context, 0.0)
    ramp = blackbody_colors()
    ramp["table"] = [[max(0.0, value) for value in entry] for entry in ramp["table"]]
    curves = {"type": "rgb_curves", "factor": 1.0, "color": kelvin, "curves": ramp}
    return {"node": t.emit(curves), "output": "color"}


def _once(translate: TranslateValue) -> TranslateValue:
    """Translation of each output once, however many inputs it feeds."""

    def remembered(t: Translation, source: Source) -> Any:
        return t.value_once(source, lambda: translate(t, source), source.socket.identifier)

    return remembered


VECTOR_VALUES: dict[str, TranslateValue] = {
    "ShaderNodeCameraData": _once(_camera_data),
    "ShaderNodeNormal": _once(_normal),
    "ShaderNodeVectorRotate": _once(_vector_rotate),
    "ShaderNodeVectorTransform": _once(_vector_transform),
    "ShaderNodeVectorCurve": _once(_vector_curves),
    "ShaderNodeBlackbody": _once(_blackbody),
}
