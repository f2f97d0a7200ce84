"""Apply to lights: the gains of the mix become energies and colours of the scene's own lights."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace

import bpy

from ..core.rows import LIGHT, NEUTRAL, WORLD, Row, mix
from .world import WorldWrite
from .writable import RefusedError, why_not

NOT_HIDDEN = "is off, and geometry nodes or particles show it even where it is hidden: dim its row instead"


@dataclass(frozen=True)
class _LightWrite:
    """Values that one light object's data get."""

    owner: bpy.types.Object
    gain: list[float]
    kelvin: float | None
    """Written as the light's own temperature, where its Blender has one and it is not in use."""

    @property
    def changes(self) -> bool:
        """True if the data gets other values."""
        return self.gain != NEUTRAL or self.kelvin is not None

    def refusal(self) -> str | None:
        """Reason why the data cannot be written; None if it can."""
        paths = ("energy", "color") if self.kelvin is None else ("energy", "color", "use_temperature", "temperature")
        reason = why_not(self.owner.data, *paths) if self.changes else None
        return f"light '{self.owner.name}' {reason}" if reason else None

    def write(self) -> None:
        """Writes energy, colour and temperature."""
        if not self.changes:
            return
        light = self.owner.data
        light.energy, light.color = scaled(light.energy, light.color, self.gain)
        if self.kelvin is not None:
            light.use_temperature, light.temperature = True, self.kelvin


def apply_mix(
    scene: bpy.types.Scene,
    lights: Mapping[str, bpy.types.Object],
    rows: Iterable[Row],
    groups: Iterable[Row],
    memberships: Mapping[str, Iterable[str]],
    shown_anyway: Container[str] = (),
    kept: Container[Row] = (),
) -> None:
    """Writes the mix into the light objects and the world; what emissive materials have is still to be kept as a row.
    A light without any gain keeps its energy and is hidden from render and viewport; one of `shown_anyway` cannot be,
    as nodes or particles instance it. What rows of `kept` are about stays as it is.
    Raises RefusedError, and has then written nothing."""
    rows = list(rows)
    kept_lights = {row.name for row in rows if row.kind == LIGHT and row in kept}
    kelvins = {
        row.name: row.kelvin
        for row in rows
        if row.kind == LIGHT
        and row.use_kelvin
        and row not in kept
        and not getattr(lights[row.name].data, "use_temperature", True)
    }
    applied = mix(rows, groups, memberships)
    without = [replace(row, use_kelvin=row.use_kelvin and row.name not in kelvins) for row in rows]
    gains = mix(without, groups, memberships)["gains"] | dict.fromkeys(kept_lights, NEUTRAL)
    silent = {name: obj for name, obj in lights.items() if not any(gains[name])}
    hidden = [obj for obj in silent.values() if not _is_hidden(obj)]
    writes = [_LightWrite(obj, gains[name], kelvins.get(name)) for name, obj in lights.items() if any(gains[name])]
    keeps_world = any(row.kind == WORLD and row in kept for row in rows)
    world = WorldWrite(scene.world, NEUTRAL if keeps_world else applied["world"])
    refusals = [*(write.refusal() for write in writes), *map(_hide_refusal, hidden), world.refusal()]
    reasons = [reason for reason in refusals if reason] + _quarrels(writes)
    reasons += [f"light '{name}' {NOT_HIDDEN}" for name in silent if name in shown_anyway]
    if reasons:
        raise RefusedError(reasons)
    for write in {write.owner.data: write for write in writes}.values():
        write.write()
    for obj in hidden:
        obj.hide_render = obj.hide_viewport = True
    world.write()


def show(obj: bpy.types.Object, view_layer: bpy.types.ViewLayer) -> None:
    """Shows a light again that was hidden. Raises RefusedError."""
    reason = why_not(obj, "hide_render", "hide_viewport")
    if reason:
        raise RefusedError([f"light '{obj.name}' {reason}"])
    obj.hide_render = obj.hide_viewport = False
    if view_layer.objects.get(obj.name) is obj:
        obj.hide_set(False, view_layer=view_layer)


def scaled(energy: float, color: Iterable[float], gain: Iterable[float]) -> tuple[float, list[float]]:
    """Energy and colour of a light times a gain. The colour's largest channel stays what it is, so that brightness
    ends up in the energy."""
    before = list(color)
    after = [channel * factor for channel, factor in zip(before, gain, strict=True)]
    if max(after) <= 0.0:
        return energy * max(gain), before
    factor = max(after) / max(before)
    return energy * factor, [channel / factor for channel in after]


def _is_hidden(obj: bpy.types.Object) -> bool:
    return obj.hide_render and obj.hide_viewport


def _hide_refusal(obj: bpy.types.Object) -> str | None:
    reason = why_not(obj, "hide_render", "hide_viewport")
    return f"light '{obj.name}' {reason}, and would have to be hidden" if reason else None


def _quarrels(writes: list[_LightWrite]) -> list[str]:
    """Lights that share their data and would become different."""
    first: dict[bpy.types.Light, _LightWrite] = {}
    return [
        f"lights '{other.owner.name}' and '{write.owner.name}' share the data '{write.owner.data.name}' and have "
        "different rows: make the data single-user"
        for write in writes
        if (other := first.setdefault(write.owner.data, write)) is not write
        and (other.gain, other.kelvin) != (write.gain, write.kelvin)
    ]
