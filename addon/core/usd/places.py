"""Places of prims: matrices that multiply columns, by rows."""

from __future__ import annotations

import math
from typing import Any

from .text import Prim, UsdError

Matrix = list[list[float]]
FLAT = 1e-12
"""Length or pivot from which on a matrix is not flat."""
IDENTITY: Matrix = [[float(row == column) for column in range(4)] for row in range(4)]


def lengths(matrix: Matrix) -> list[float]:
    return [math.sqrt(sum(matrix[row][column] ** 2 for row in range(3))) for column in range(3)]


def scaled(matrix: Matrix, factors: list[float]) -> Matrix:
    return [[value * factor for value, factor in zip(row, [*factors, 1.0], strict=True)] for row in matrix]


def without_scale(matrix: Matrix) -> tuple[Matrix, list[float]]:
    """A matrix with axes of length 1, and their lengths."""
    factors = [length if length > FLAT else 1.0 for length in lengths(matrix)]
    return scaled(matrix, [1.0 / factor for factor in factors]), factors


def order_of(prim: Prim) -> list[str]:
    return prim.values.get("xformOpOrder") or []


def placed(prim: Prim) -> Matrix:
    """Parent's space from a prim's: the product of its operations."""
    out = IDENTITY
    for operation in order_of(prim):
        is_inverse = operation.startswith("!invert!")
        name = operation.removeprefix("!invert!")
        value = prim.values.get(name)
        if value is None:
            continue
        matrix = _operation(name.split(":")[1], value)
        out = product(out, _inverse(matrix) if is_inverse else matrix)
    return out


def _operation(kind: str, value: Any) -> Matrix:
    """Matrix of one operation of `xformOpOrder`."""
    if kind == "transform":
        return [list(row) for row in zip(*value, strict=True)]
    if kind == "translate":
        return [[*IDENTITY[row][:3], value[row]] for row in range(3)] + [IDENTITY[3]]
    if kind == "scale":
        return scaled(IDENTITY, value)
    if kind == "orient":
        return _from_quaternion(value)
    if kind.startswith("rotate") and kind[6:].strip("XYZ") == "":
        axes = kind[6:]
        out = IDENTITY
        # The first axis is turned about first.
        for axis, degrees in zip(axes, value if len(axes) > 1 else [value], strict=True):
            order = "XYZ".index(axis)
            out = product(_rotation(order, math.radians(degrees if len(axes) == 1 else value[order])), out)
        return out
    raise UsdError(f"its operation {kind} on places is not known")


def _rotation(axis: int, angle: float) -> Matrix:
    u, v = (axis + 1) % 3, (axis + 2) % 3
    out = [list(row) for row in IDENTITY]
    out[u][u] = out[v][v] = math.cos(angle)
    out[u][v], out[v][u] = -math.sin(angle), math.sin(angle)
    return out


def _from_quaternion(value: list[float]) -> Matrix:
    length = math.sqrt(sum(part * part for part in value)) or 1.0
    w, x, y, z = (part / length for part in value)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 0.0],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 0.0],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ]


def product(a: Matrix, b: Matrix) -> Matrix:
    columns = list(zip(*b, strict=True))
    return [[sum(x * y for x, y in zip(row, column, strict=True)) for column in columns] for row in a]


def _inverse(matrix: Matrix) -> Matrix:
    """By elimination; raises UsdError for a flat one."""
    rows = [[*row, *unit] for row, unit in zip(matrix, IDENTITY, strict=True)]
    for column in range(4):
        pivot = max(range(column, 4), key=lambda row: abs(rows[row][column]))
        if abs(rows[pivot][column]) < FLAT:
            raise UsdError("one of its places is flat")
        rows[column], rows[pivot] = rows[pivot], rows[column]
        rows[column] = [value / rows[column][column] for value in rows[column]]
        for row in range(4):
            if row != column:
                factor = rows[row][column]
                rows[row] = [a - factor * b for a, b in zip(rows[row], rows[column], strict=True)]
    return [row[4:] for row in rows]
