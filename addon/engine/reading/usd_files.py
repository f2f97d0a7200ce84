"""Files of lights for other programs: a look with what the nodes of its lights emit, and a look from such a file."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...apply.look_lights import light_state
from ...core import whole_file
from ...core.looks import Look, from_json, to_json
from ...core.rows import LIGHT
from ...core.usd.reading import look_of
from ...core.usd.text import UsdError
from ...core.usd.writing import write
from ...export.lamp_shaders import LampShaders
from ...export.light_tree import light_objects, light_tree
from ...export.lights import name_of
from ...export.materials.constants import VaryingNodeError
from ...export.working_space import working_space
from ..native import native

SUFFIXES = (".usda", ".usd")
MOST_BYTES = 1 << 26


def present_look(scene: bpy.types.Scene) -> Look:
    """The lights as they are, without any rows."""
    return Look("", lights=tuple(map(light_state, light_objects(scene))))


def write_file(scene: bpy.types.Scene, look: Look, path: Path, for_blender: bool) -> list[str]:
    """Writes a look whole or not at all; returns what the file cannot say. Raises OSError or UsdError."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsdError(f"cannot write {path}: lights are written as text; let the name end in .usda or .usd")
    lines = {name_of(line.block): line for line in light_tree(scene) if line.kind == LIGHT}
    warnings: list[str] = []
    names = [light["name"] for light in look.lights]
    tints = {name: _tint(scene, lines[name].block, warnings) for name in names if name in lines}
    if look.shots:
        warnings.append(f"values of single shots are not written: {', '.join(look.shots)}")
    written = write(look, {name: line.groups for name, line in lines.items()}, tints, for_blender)
    whole_file.write(path, written.text)
    return warnings + written.warnings


def _tint(scene: bpy.types.Scene, obj: bpy.types.Object, warnings: list[str]) -> list[float]:
    """Light that the nodes of a light emit for a strength of 1; warns of all that cannot be written."""
    builder = native().SceneBuilder
    shaders = LampShaders(builder.constant_emission, lambda: builder(working_space()), scene.frame_current)
    lost = []
    try:
        emission = shaders.emission(obj, obj.matrix_world, warnings.append)
    except VaryingNodeError:
        emission = None
        lost.append("its nodes")
    if emission is not None and emission.table is not None:
        lost.append("what its nodes vary by direction or place")
    linking = obj.light_linking
    if linking.receiver_collection or linking.blocker_collection:
        lost.append("its light linking")
    if lost:
        warnings.append(f"light '{obj.name}' is written without {' and '.join(lost)}")
    return [1.0, 1.0, 1.0] if emission is None else emission.color


def read_file(path: Path) -> tuple[Look, list[str]]:
    """The lights of a file as a look, and what is left out of it. Raises OSError or UsdError."""
    if path.stat().st_size > MOST_BYTES:
        raise UsdError(f"{path.name} is larger than {MOST_BYTES >> 20} MB: keep its lights only")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UsdError(f"{path.name} is no text: make it so with usdcat {path.name} -o {path.stem}.usda") from error
    try:
        return look_of(text, path.stem)
    except UsdError as error:
        raise UsdError(f"{path.name}: {error}") from error


def write_look(look: Look, path: Path) -> None:
    """Writes a look in its own form. Raises OSError."""
    whole_file.write(path, to_json(look))


def read_look(path: Path) -> Look:
    """A look in its own form. Raises OSError or LookError."""
    return from_json(path.read_bytes())
