"""The listed shot that a camera shows, and what keeps its bake from being shown beside the current one."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.bake_folder import size_of
from ...core.disk import memory
from ...export.current_shot import active_entry, entries, shot_camera
from . import open_shots, shot_list

PIXEL_BYTES = 1200
"""Memory of an open bake for each pixel: surfaces, their sums, features, vertices that lights are connected to, unit
images of a few lights, the newest pictures. Measured: 1,010 to 1,280 bytes with four lights, at 640 x 360 and more."""
MOST_BYTES = max(4 * 2**30, memory() // 4)
"""Memory for all bakes that are open beside the current ones: a quarter of the machine's, and 4 GiB where it is less or
not known."""

_refusals: dict[tuple[int, str], str] = {}
"""Why shots that views ask for are not shown, by the scene's session uid and the shot's key."""


def entry_of(scene: bpy.types.Scene, camera: bpy.types.Object | None) -> Any:
    """The listed shot of a camera: of several the one of the present frame, and of these the chosen one."""
    chosen = active_entry(scene)
    found = [entry for entry in entries(scene) if not entry.is_foreign and camera is not None]
    found = [entry for entry in found if shot_camera(entry) == camera]
    return min(found, key=lambda entry: (bool(_other_frame(scene, entry)), entry != chosen), default=None)


def _other_frame(scene: bpy.types.Scene, entry: Any) -> str:
    if not entry.use_frame or entry.frame == scene.frame_current:
        return ""
    return f"is of frame {entry.frame}; go there to see it"


def other_state(scene: bpy.types.Scene, entry: Any, layer: str) -> str:
    """Why a shot is of another state than a window with a view layer has, in words that follow its name; empty if it
    is of the same."""
    if words := _other_frame(scene, entry):
        return words
    return "" if entry.layer in {"", layer} else f"is of view layer '{entry.layer}', and this window shows '{layer}'"


def why_not(scene: bpy.types.Scene, entry: Any, layer: str) -> str:
    """Reason why a shot cannot be shown beside the current one in such a window; empty if it can. Looks at the
    disk."""
    if words := other_state(scene, entry, layer):
        return words
    folder = shot_list.baked_folder(scene, entry)
    if folder is None:
        return "has no bake yet; press Bake All in the panel Shots"
    shown = {shot.folder for shot in open_shots.all_open() if shot.is_seen_beside}
    if sum(map(_bytes_of, shown | {folder})) > MOST_BYTES:
        return "does not fit in memory with the others that are shown; close some of the views"
    return ""


def _bytes_of(folder: Any) -> int:
    width, height = size_of(folder) or (0, 0)
    return PIXEL_BYTES * width * height


def refuse(scene: bpy.types.Scene, entry: Any, words: str) -> bool:
    """Notes why a shot is not shown, or with empty words that it may be; returns True if that is news."""
    key = scene.session_uid, entry.key
    before = _refusals.pop(key, "")
    if words:
        _refusals[key] = words
    return words != before


def refusal(scene: bpy.types.Scene, camera: bpy.types.Object | None) -> str:
    """Why the listed shot of a camera is not shown, in words; empty if there is none, or nothing is known."""
    entry = entry_of(scene, camera)
    words = _refusals.get((scene.session_uid, entry.key), "") if entry is not None else ""
    return f"Shot '{entry.name}' {words}" if words else ""


def forget() -> None:
    """Forgets all refusals."""
    _refusals.clear()
