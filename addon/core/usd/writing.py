"""Lights of a look to UsdLux."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..blackbody import blackbody_color
from ..looks import Look
from ..rows import GROUP, LIGHT, STATIC, WORLD, Row, is_neutral, mix
from .places import Matrix, lengths, scaled, without_scale
from .text import MAGIC, NAME, quoted


@dataclass
class Written:
    """A file of lights, and what it cannot say."""

    text: str
    warnings: list[str] = field(default_factory=list)


def write(
    look: Look,
    memberships: Mapping[str, Iterable[str]],
    tints: Mapping[str, Iterable[float]],
    for_blender: bool = False,
) -> Written:
    """Lights as they are seen in a look, with the gains of its rows. `tints` is what the nodes of lights emit, by name;
    `for_blender` writes suns as Blender's own importer takes them."""
    rows = [row for row in look.rows if row.kind != GROUP]
    known = {row.name for row in rows if row.kind == LIGHT}
    rows += [Row(light["name"]) for light in look.lights if light["name"] not in known]
    gains = mix(rows, [row for row in look.rows if row.kind == GROUP], memberships)
    out = Written("")
    taken: set[str] = set()
    prims = [_prim(light, gains["gains"][light["name"]], tints, for_blender, taken, out) for light in look.lights]
    for kind, words in ((WORLD, "the world"), (STATIC, "emissive materials")):
        if any(row.kind == kind and not is_neutral(row) for row in rows):
            out.warnings.append(f"the row of {words} is not written: the file holds lights only")
    suns = "blender" if for_blender else "physical"
    out.text = f"""{MAGIC}
(
    customLayerData = {{
        string relumeLook = {quoted(look.name)}
        string relumeSuns = "{suns}"
    }}
    defaultPrim = "lights"
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "lights"
{{
{"".join(prims)}}}
"""
    return out


def _prim(
    light: Mapping[str, Any],
    gain: list[float],
    tints: Mapping[str, Iterable[float]],
    for_blender: bool,
    taken: set[str],
    out: Written,
) -> str:
    """Text of one light."""
    name, settings, kind = light["name"], light["settings"], light["type"]
    power = _power(light, gain, tints.get(name, (1.0, 1.0, 1.0)))
    strength = max(power, key=abs)
    color = [channel / strength for channel in power] if strength else settings.get("color", [1.0] * 3)
    values: dict[str, tuple[str, Any]] = {"inputs:color": ("color3f", color)}
    is_seen = any(gain) and not light["hidden"]
    matrix = light["matrix"]
    if kind == "AREA":
        prim, matrix, shape = _area(matrix, settings)
        values |= shape
        if settings["spread"] < math.pi - 1e-4:
            values["custom relume:spread"] = ("float", settings["spread"])
            out.warnings.append(f"light '{name}': other programs show it without its spread")
    elif kind == "SUN":
        prim, angle = "DistantLight", math.degrees(settings["angle"])
        values["inputs:angle"] = ("float", angle / 2 if for_blender else angle)
    else:
        prim = "SphereLight"
        values["inputs:radius"] = ("float", settings["shadow_soft_size"])
        values["custom relume:softFalloff"] = ("bool", settings["use_soft_falloff"])
        if settings["shadow_soft_size"] == 0.0:
            values["treatAsPoint"] = ("bool", True)
        if kind == "SPOT":
            values["inputs:shaping:cone:angle"] = ("float", math.degrees(settings["spot_size"]) / 2)
            values["inputs:shaping:cone:softness"] = ("float", settings["spot_blend"])
    if kind != "AREA":
        matrix, scale = without_scale(matrix)
        values["custom relume:scale"] = ("double3", scale)
        if kind == "SPOT" and max(scale) - min(scale) > 1e-3 * max(scale):
            out.warnings.append(f"light '{name}': its scale stretches its cone, which is written round")
    if light["hidden"]:
        values["custom relume:hidden"] = ("bool", True)
    per_unit = (0.25 if for_blender else 1.0) if kind == "SUN" else 1.0 / math.pi
    values["inputs:intensity"] = ("float", strength * per_unit)
    values["inputs:normalize"] = ("bool", True)
    values["visibility"] = ("token", "inherited" if is_seen else "invisible")
    values[f"custom {NAME}"] = ("string", name)
    values["xformOp:transform"] = ("matrix4d", [list(column) for column in zip(*matrix, strict=True)])
    values["uniform xformOpOrder"] = ("token[]", '["xformOp:transform"]')
    lines = "".join(f"        {_attribute(key, *value)}\n" for key, value in values.items())
    shaping = '\n        prepend apiSchemas = ["ShapingAPI"]' if kind == "SPOT" else ""
    head = f'    def {prim} "{_identifier(name, taken)}" (\n        displayName = {quoted(name)}{shaping}\n    )'
    return f"{head}\n    {{\n{lines}    }}\n"


def _attribute(key: str, kind: str, value: Any) -> str:
    prefix, _, name = key.rpartition(" ")
    if kind in {"string", "token"}:
        text = quoted(value)
    elif kind == "bool":
        text = str(int(value))
    elif isinstance(value, list):
        text = _tuple(value)
    else:
        text = str(value)
    return f"{prefix + ' ' if prefix else ''}{kind} {name} = {text}"


def _tuple(value: list[Any]) -> str:
    return f"({', '.join(_tuple(entry) if isinstance(entry, list) else repr(float(entry)) for entry in value)})"


def _identifier(name: str, taken: set[str]) -> str:
    """A name as prims may have it: letters and digits of ASCII."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII) or "Light"
    plain = f"_{plain}" if plain[0].isdigit() else plain
    numbers = (f"{plain}_{number}" for number in range(1, len(taken) + 2))
    found = plain if plain not in taken else next(one for one in numbers if one not in taken)
    taken.add(found)
    return found


def _power(light: Mapping[str, Any], gain: Iterable[float], tint: Iterable[float]) -> list[float]:
    """Power of a light by channel as if it were normalised: watts, of a sun W / m2. One without any gain keeps its own,
    since it is written as invisible."""
    settings = light["settings"]
    gain = list(gain) if any(gain) else [1.0, 1.0, 1.0]
    energy = settings["energy"] * 2.0 ** settings.get("exposure", 0.0)
    if not settings.get("normalize", True):
        energy *= _size_of(light)
    is_warm = settings.get("use_temperature", False)
    warmth = blackbody_color(settings["temperature"]) if is_warm else (1.0, 1.0, 1.0)
    channels = zip(settings["color"], gain, tint, warmth, strict=True)
    return [energy * color * factor * emitted * warm for color, factor, emitted, warm in channels]


def _size_of(light: Mapping[str, Any]) -> float:
    """Factor from the energy of a light that is not normalised to that of the same light normalised."""
    kind, settings = light["type"], light["settings"]
    if kind == "SUN":
        return math.pi * math.sin(settings["angle"] / 2) ** 2 or 1.0
    if kind == "AREA":
        width, height = _sides(settings)
        round_part = math.pi / 4 if settings["shape"] in {"DISK", "ELLIPSE"} else 1.0
        x, y, _ = lengths(light["matrix"])
        return width * x * height * y * round_part
    radius = settings["shadow_soft_size"]
    return 4.0 * math.pi * radius**2 if radius else 4.0


def _sides(settings: Mapping[str, Any]) -> tuple[float, float]:
    is_uneven = settings["shape"] in {"RECTANGLE", "ELLIPSE"}
    return settings["size"], settings["size_y"] if is_uneven else settings["size"]


def _area(matrix: Matrix, settings: Mapping[str, Any]) -> tuple[str, Matrix, dict[str, tuple[str, Any]]]:
    """Type, place and size of an area light. An ellipse is a disk that is stretched."""
    width, height = _sides(settings)
    shape = {"custom relume:shape": ("token", settings["shape"])}
    if settings["shape"] in {"SQUARE", "RECTANGLE"}:
        return "RectLight", matrix, shape | {"inputs:width": ("float", width), "inputs:height": ("float", height)}
    if settings["shape"] == "DISK":
        return "DiskLight", matrix, shape | {"inputs:radius": ("float", width / 2)}
    shape |= {"custom relume:ellipse": ("double3", [width, height, 1.0]), "inputs:radius": ("float", 0.5)}
    return "DiskLight", scaled(matrix, [width, height, 1.0]), shape
