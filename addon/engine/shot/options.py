"""Choices of the artist, from the scene and from the preferences, as one plain value."""

from __future__ import annotations

import dataclasses
import os
import uuid
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy

from ...core.bake_folder import default_folder, file_name, is_bake
from ...core.shots import AUTOMATIC
from ...export.current_shot import current_entry, entries

PACKAGE = __package__.removesuffix(".engine.shot")
"""Name of the add-on: Blender renames the package of an extension."""


class FolderError(ValueError):
    """A scene's bake folder cannot be told; the message says why and what to do."""


QUALITIES = {
    "DRAFT": ("Draft", 16, "for a first look"),
    "GOOD": ("Good", 64, "for daily work"),
    "FINAL": ("Final", 256, "for finished pictures"),
}
OF_SCENE = "SCENE"
"""Quality of a listed shot that has none of its own."""
MIB = 2**20
SESSION = uuid.uuid4().hex[:8]
"""Tells the unsaved files of this run of Blender from those of others."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of a shot's bake."""

    folder: Path
    samples: int = 64
    device: str = "auto"
    gpu_memory: int | None = None
    """Bytes; None for what the driver offers."""
    threads: int = 0
    train_seconds: float = 60.0
    shot: str = AUTOMATIC
    """Key of the listed shot."""
    resolution: tuple[int, int] | None = None
    """Width and height in pixels; None for the scene's."""


def options_of(scene: bpy.types.Scene, entry: Any = None) -> Options:
    """Options of a listed shot, by default the current one, or the automatic one where there is none; defaults where
    the panel or the preferences are not registered. Raises FolderError."""
    entry = entry or current_entry(scene)
    settings, chosen = getattr(scene, "relume", None), preferences()
    samples = _samples(settings) if settings else Options.samples
    folder, key, size = bake_folder(scene, entry), AUTOMATIC, None
    if entry is not None:
        samples = samples if entry.quality == OF_SCENE else _samples(entry)
        key, size = entry.key, (entry.width, entry.height) if entry.use_size else None
    if chosen is None:
        return Options(folder, samples, shot=key, resolution=size)
    return Options(
        folder,
        samples,
        shot=key,
        resolution=size,
        device=chosen.device or "auto",
        gpu_memory=chosen.gpu_memory * MIB if chosen.limit_gpu_memory else None,
        threads=chosen.threads,
        train_seconds=chosen.train_seconds,
    )


def _samples(settings: Any) -> int:
    return settings.samples if settings.quality == "CUSTOM" else QUALITIES[settings.quality][1]


def bake_folder(scene: bpy.types.Scene, entry: Any = None) -> Path:
    """Absolute path of the folder that a bake of a listed shot is written to, by default of the current one, or of the
    automatic one where there is none. Raises FolderError."""
    entry = entry or current_entry(scene)
    if entry is not None and entry.folder:
        return _chosen_folder(entry.folder)
    chosen = getattr(getattr(scene, "relume", None), "folder", "")
    if chosen:
        folder = _chosen_folder(chosen)
        # With the scene's name: a full copy of a scene has the same choice and the same list.
        return folder if entry is None else folder / file_name(f"{scene.name}_{entry.key}")
    camera = scene.camera.name if scene.camera else "camera"
    unsaved = f"{SESSION}_{scene.session_uid}"
    shot = entry.key if entry is not None else camera
    return default_folder(bpy.data.filepath, scene.name, shot, cache_folder(), unsaved)


def _chosen_folder(chosen: str) -> Path:
    if chosen.startswith("//") and not bpy.data.filepath:
        raise FolderError("The bake folder is beside a file that is not saved; save it, or choose another folder")
    return absolute(chosen)


def _memory(scene: bpy.types.Scene, shot: str | None) -> Any:
    """Settings in which the file says where the bake of a shot is: by its key, by default of the current one. None if
    there is no such shot any more, or no panel."""
    settings = getattr(scene, "relume", None)
    if shot is None:
        return current_entry(scene) or settings
    return settings if shot == AUTOMATIC else next((entry for entry in entries(scene) if entry.key == shot), None)


def remember_bake(scene: bpy.types.Scene, folder: Path, shot: str | None = None) -> None:
    """Notes in the file where the bake of a shot is: relative to the file, which may be moved with it, and absolute,
    for a file that is saved elsewhere. `shot` is its key; the current one's by default."""
    settings = _memory(scene, shot)
    if settings is None:
        return
    settings.baked_absolute = settings.baked_folder = str(folder)
    if bpy.data.filepath:
        with suppress(ValueError):  # Another drive of Windows.
            settings.baked_folder = bpy.path.relpath(str(folder))


def places_of_bake(scene: bpy.types.Scene, shot: str | None = None) -> tuple[Path, ...]:
    """Possible locations of a shot's bake by what the file says, the likelier first; none if it says nothing. `shot` is
    its key; the current one's by default."""
    settings = _memory(scene, shot)
    if settings is None or not settings.baked_folder:
        return ()
    return absolute(settings.baked_folder), absolute(settings.baked_absolute or settings.baked_folder)


def remembered_bake(scene: bpy.types.Scene, shot: str | None = None) -> Path | None:
    """Location of a shot's bake by what the file says, whether it is there or not; None if it says nothing."""
    places = places_of_bake(scene, shot)
    return next((place for place in places if is_bake(place)), places[0] if places else None)


def cache_folder() -> Path:
    """Folder for bakes of files that were never saved."""
    chosen = preferences()
    if chosen is not None and chosen.cache_folder:
        return absolute(chosen.cache_folder)
    return user_folder("bakes")


def user_folder(name: str) -> Path:
    """A folder for files of the add-on that belong to the user, which may not be there yet."""
    if PACKAGE.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(PACKAGE, path=name))
    return Path(bpy.utils.user_resource("DATAFILES", path="relume")) / name


def absolute(path: str) -> Path:
    """The place of a path that may begin with `//`, the folder of the .blend file."""
    return Path(os.path.abspath(bpy.path.abspath(path)))


def preferences() -> Any:
    """The add-on's preferences; None where it is not enabled."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return addon.preferences if addon else None
