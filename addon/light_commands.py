"""The command line in Blender for files of lights that other programs read."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import bpy

from .core.looks import Look
from .core.progress import Reporter
from .engine.reading import usd_files
from .export import ExportError

OpenScene = Callable[[argparse.Namespace, Reporter], bpy.types.Scene]


def export_lights(options: argparse.Namespace, reporter: Reporter, open_scene: OpenScene) -> int:
    """Writes the lights of the open scene, or of a look, as UsdLux. Returns the exit code."""
    scene, file = open_scene(options, reporter), Path(options.out)
    look = usd_files.present_look(scene) if options.look is None else _look(scene, options.look)
    for words in usd_files.write_file(scene, look, file, options.suns_for_blender):
        reporter.warning(words)
    reporter.result({"file": str(file), "lights": len(look.lights)}, f"{file}: {len(look.lights)} lights")
    return 0


def import_lights(options: argparse.Namespace, reporter: Reporter) -> int:
    """Makes a look of the lights of a file. Returns the exit code."""
    look, warnings = usd_files.read_file(Path(options.file))
    for words in warnings:
        reporter.warning(words)
    usd_files.write_look(look, Path(options.out))
    reporter.result({"look": options.out, "lights": len(look.lights)}, f"{options.out}: {len(look.lights)} lights")
    return 0


def _look(scene: bpy.types.Scene, asked: str) -> Look:
    """A look by its file, or by its name in the scene."""
    if Path(asked).is_file():
        return usd_files.read_look(Path(asked))
    kept = scene.relume_looks.items if hasattr(scene, "relume_looks") else {}
    if asked not in kept:
        names = ", ".join(f"'{name}'" for name in kept.keys()) or "none"
        raise ExportError(f"there is neither a file nor a look '{asked}'; the scene has {names}")
    return kept[asked].look()
