"""Differences between a scene and a bake, found at once, for scenes that no `StalenessTracker` watches."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy

from ...core.bake_folder import MANIFEST, is_bake, size_of
from ...core.diff import sentences, world_gain
from ..staleness import fingerprints
from . import record

MOST_SENTENCES = 8
UNNAMED = "something that is not told apart (a simulation, combed hair, the version of Blender)"


def difference(
    scene: bpy.types.Scene, exported: Any, folder: Path, camera: str | None, has_own_world: bool
) -> str | None:
    """Differences between the scene, seen by a camera of this name, and the one that was baked into a folder, in words
    for the user; None if there are none. Worlds do not count where the picture gets one of its own."""
    if not is_bake(folder):
        return None
    found = _sentences(scene, exported, folder, camera, has_own_world)
    if not found and exported.hash != _manifest(folder)["scene_hash"]:
        found = [UNNAMED]
    if not found:
        return None
    shown, more = "; ".join(found[:MOST_SENTENCES]), len(found) - MOST_SENTENCES
    rest = f"; and {more} more" if more > 0 else ""
    return f"the scene is not as it was baked in {folder}: {shown}{rest}. The picture shows what was baked; bake again"


def _sentences(
    scene: bpy.types.Scene, exported: Any, folder: Path, camera: str | None, has_own_world: bool
) -> list[str]:
    baked = record.read(folder)
    if baked is None:
        (width, height), size = exported.resolution, size_of(folder)
        other = f"The picture has {width} x {height} pixels now; the bake has {size[0]} x {size[1]}" if size else ""
        return [other] if size not in {None, (width, height)} else []
    present = fingerprints.all_fingerprints(scene, scene.objects.get(camera or "") or scene.camera, exported.resolution)
    keys = {**baked.fingerprints, **present}.keys() - ({"world"} if has_own_world else set())
    different = [key for key in keys if baked.fingerprints.get(key) != present.get(key)]
    words = sentences(different, baked.fingerprints, present)
    worlds = [taken.get("world", {}) for taken in (baked.fingerprints, present)]
    colors = {world.get("color") for world in worlds}
    if "world" in keys and len(colors) > 1 and world_gain(*worlds) is not None:
        words.append("The world became brighter, darker or of another tint")
    return words


def _manifest(folder: Path) -> dict[str, Any]:
    return json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
