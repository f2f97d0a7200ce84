"""Lights of UsdLux as a look."""

from __future__ import annotations

import math
import re
from typing import Any

from ..blackbody import blackbody_color
from ..looks import Look
from ..rows import Row
from .places import IDENTITY, Matrix, lengths, order_of, placed, product, scaled, without_scale
from .text import COMPOSED, NAME, Prim, UsdError, read

TYPES = {"SphereLight", "DistantLight", "RectLight", "DiskLight"}
"""Lights of UsdLux that Blender has."""
OTHER_LIGHTS = re.compile(r"(Light|LightFilter)(_\d+)?$")


def look_of(text: str, name: str) -> tuple[Look, list[str]]:
    """The lights of a file as a look, and what is left out of it, in words. Raises UsdError."""
    root = read(text)
    try:
        reader = _Lights(root)
        reader.enter(root, reader.from_layer(), True)
    except (ArithmeticError, AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise UsdError(f"a value is not of the kind that UsdLux gives it ({error})") from error
    if not reader.lights:
        raise UsdError("it has no light that Blender knows" + "".join(f"; {words}" for words in reader.warnings))
    rows = tuple(Row(light["name"], on=on) for light, on in zip(reader.lights, reader.on, strict=True))
    own_name = root.metadata.get("customLayerData", {}).get("relumeLook")
    return Look(own_name or name, rows, tuple(reader.lights)), reader.warnings


class _Lights:
    """Walk through the prims of a layer."""

    def __init__(self, root: Prim) -> None:
        """Takes units and conventions from the layer."""
        own = root.metadata.get("customLayerData", {})
        self.is_by_blender = str(root.metadata.get("doc", "")).startswith("Blender v")
        self.has_blender_suns = self.is_by_blender or own.get("relumeSuns") == "blender"
        self.metres = float(root.metadata.get("metersPerUnit", 0.01))
        self.is_y_up = str(root.metadata.get("upAxis", "Y")).upper() == "Y"
        self.lights: list[dict[str, Any]] = []
        self.on: list[bool] = []
        self.warnings: list[str] = []
        self._note_composition(root, "the file")

    def from_layer(self) -> Matrix:
        """Blender's space from that of the layer."""
        up: Matrix = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]] if self.is_y_up else IDENTITY
        scale = self.metres
        return [[value * (scale if row < 3 else 1.0) for value in values] for row, values in enumerate(up)]

    def enter(self, prim: Prim, world: Matrix, is_seen: bool, name: str = "") -> None:
        """Reads a prim and those below it; `name` is that of the object it belongs to in Blender."""
        for child in prim.children:
            inside = product(world if "!resetXformStack!" not in order_of(child) else self.from_layer(), placed(child))
            seen = is_seen and child.get("visibility") != "invisible"
            named = str(child.get(NAME) or "") or name
            self._note_composition(child, f"'{child.name}'")
            if child.kind in TYPES:
                self._read(child, inside, seen, named or child.metadata.get("displayName") or child.name)
            elif OTHER_LIGHTS.search(child.kind):
                self.warnings.append(f"'{child.name}' is left out: Blender has no {child.kind} among its lights")
            self.enter(child, inside, seen, str(child.get(NAME) or ""))

    def _note_composition(self, prim: Prim, subject: str) -> None:
        if COMPOSED & prim.metadata.keys():
            self.warnings.append(
                f"{subject} refers to other files or has variants, which are not followed: write it flat first, by "
                "usdcat --flatten"
            )

    def _read(self, prim: Prim, matrix: Matrix, seen: bool, name: str) -> None:
        """One light of a look."""
        self._note_losses(prim, name)
        kind, settings, area = self._shape(prim, matrix)
        if kind != "AREA":
            matrix, _ = without_scale(matrix)
            matrix = scaled(matrix, prim.get("relume:scale") or [1.0] * 3)
        elif (sides := prim.get("relume:ellipse")) and all(sides):
            matrix = scaled(matrix, [1.0 / side for side in sides])
            settings |= {"shape": "ELLIPSE", "size": sides[0], "size_y": sides[1]}
        power = self._power(prim, kind, area)
        strength = max(power, key=abs)
        color = [abs(channel / strength) for channel in power] if strength else prim.get("color", [1.0] * 3)
        settings |= {"energy": strength, "color": color, "exposure": 0.0, "normalize": True, "use_temperature": False}
        is_hidden = bool(prim.get("relume:hidden")) and not seen
        light = {"name": self._free(name), "type": kind, "matrix": matrix, "hidden": is_hidden, "settings": settings}
        if not all(map(math.isfinite, [*power, *(value for row in matrix for value in row)])):
            self.warnings.append(f"'{name}' is left out: one of its values is not a number")
            return
        self.lights.append(light | {"added": True})
        self.on.append(seen or is_hidden)

    def _free(self, name: str) -> str:
        taken = {light["name"] for light in self.lights}
        numbers = (f"{name}.{number:03}" for number in range(1, len(taken) + 2))
        return name if name not in taken else next(numbered for numbered in numbers if numbered not in taken)

    def _shape(self, prim: Prim, matrix: Matrix) -> tuple[str, dict[str, Any], float]:
        """Type in Blender, settings of its shape, and its area as UsdLux normalises by it, in units of the layer."""
        x, y, z = lengths(matrix)
        units = self.metres**2 or 1.0
        if prim.kind == "DistantLight":
            angle = math.radians(prim.get("angle", 0.53)) * (2.0 if self.has_blender_suns else 1.0)
            return "SUN", {"angle": min(max(angle, 0.0), math.pi)}, math.pi * math.sin(angle / 2) ** 2 or 1.0
        if prim.kind == "SphereLight":
            radius = 0.0 if prim.get("treatAsPoint") else prim.get("radius", 0.5) * (x + y + z) / 3
            settings: dict[str, Any] = {"shadow_soft_size": radius}
            settings["use_soft_falloff"] = bool(prim.get("relume:softFalloff", self.is_by_blender))
            area = 4.0 * math.pi * radius**2 / units or 1.0
            angle = math.radians(prim.get("shaping:cone:angle", 180.0))
            if angle >= math.pi:
                return "POINT", settings, area
            blend = min(max(prim.get("shaping:cone:softness", 0.0), 0.0), 1.0)
            return "SPOT", settings | {"spot_size": min(2.0 * angle, math.pi), "spot_blend": blend}, area
        settings = {"spread": prim.get("relume:spread", math.pi)}
        if prim.kind == "DiskLight":
            size = 2.0 * prim.get("radius", 0.5)
            settings |= {"shape": "DISK", "size": size, "size_y": size}
            return "AREA", settings, 0.25 * math.pi * size * x * size * y / units
        width, height = prim.get("width", 1.0), prim.get("height", 1.0)
        shape = "SQUARE" if width == height and prim.get("relume:shape") != "RECTANGLE" else "RECTANGLE"
        return "AREA", settings | {"shape": shape, "size": width, "size_y": height}, width * x * height * y / units

    def _power(self, prim: Prim, kind: str, area: float) -> list[float]:
        """Energy in Blender times colour. Radiance is the same in every unit of length; power is not."""
        strength = prim.get("intensity", 50000.0 if kind == "SUN" else 1.0) * 2.0 ** prim.get("exposure", 0.0)
        is_normalized = bool(prim.get("normalize", False))
        if kind == "SUN":
            strength *= (1.0 if is_normalized else area) * (4.0 if self.has_blender_suns else 1.0)
        else:
            strength *= math.pi * self.metres**2 * (1.0 if is_normalized else area)
        is_warm = prim.get("enableColorTemperature")
        warm = blackbody_color(prim.get("colorTemperature", 6500.0)) if is_warm else [1.0] * 3
        return [strength * color * warmth for color, warmth in zip(prim.get("color", [1.0] * 3), warm, strict=True)]

    def _note_losses(self, prim: Prim, name: str) -> None:
        """Names what Blender's lights have no place for."""
        losses = [
            (prim.get("shaping:ies:file"), "its IES profile"),
            (prim.get("texture:file"), "its texture"),
            (prim.get("shaping:focus"), "its focus"),
            (prim.get("diffuse", 1.0) != 1.0 or prim.get("specular", 1.0) != 1.0, "its factors on lobes"),
            (prim.get("light:filters"), "its filters"),
        ]
        lost = [words for is_lost, words in losses if is_lost]
        if prim.animated:
            lost.append("its movement in time but for the first frame")
        if lost:
            self.warnings.append(f"'{name}' is read without {', '.join(lost)}")
