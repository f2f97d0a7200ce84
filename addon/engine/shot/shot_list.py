"""The list of a scene's shots: what is in it, what is wrong with it, and adding to it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ...core import shots
from ...core.bake_folder import camera_of, default_folder, file_name, is_bake
from ...core.shots import ListedShot, Marker
from ...export.current_shot import current_entry, entries, shot_camera
from ...export.view_layer import first_rendered
from .options import (
    SESSION,
    FolderError,
    absolute,
    bake_folder,
    cache_folder,
    options_of,
    places_of_bake,
    remember_bake,
    remembered_bake,
)

LIST_FILE = "shots.json"
"""End of the name of the file with the list."""


def listed(scene: bpy.types.Scene, entry: Any) -> ListedShot:
    """An entry as plain data. Raises FolderError."""
    camera = shot_camera(entry)
    return ListedShot(
        name=entry.name,
        camera=camera.name if camera is not None else entry.camera_name,
        folder=bake_folder(scene, entry),
        key=entry.key,
        frame=entry.frame if entry.use_frame and not entry.is_foreign else None,
        layer=entry.layer,
        size=(entry.width, entry.height) if entry.use_size else None,
        on=entry.on,
        is_foreign=entry.is_foreign,
    )


def automatic(scene: bpy.types.Scene) -> ListedShot:
    """The shot of a scene where nobody has made a list. Raises FolderError."""
    options = options_of(scene)
    camera = scene.camera.name if scene.camera is not None else ""
    return ListedShot(camera or scene.name, camera, options.folder)


def current(scene: bpy.types.Scene) -> ListedShot:
    """The current shot, or the automatic one. Raises FolderError."""
    entry = current_entry(scene)
    return listed(scene, entry) if entry is not None else automatic(scene)


def all_shots(scene: bpy.types.Scene) -> list[ListedShot]:
    """All shots of the list; the automatic one alone where there is none. Raises FolderError."""
    return [listed(scene, entry) for entry in entries(scene)] or [automatic(scene)]


def problems(scene: bpy.types.Scene, is_there: Callable[[Path], bool] = is_bake) -> dict[str, str]:
    """Reasons that keep shots of a scene from being baked, in words, by their keys. `is_there` is called like
    `is_bake`."""
    cameras = {obj.name for obj in scene.objects if obj.type == "CAMERA"}
    elsewhere: dict[Path, str] = {}
    for other in bpy.data.scenes:
        if other == scene or other.is_runtime_data:
            continue
        for entry in entries(other):
            if not entry.is_foreign:
                elsewhere.setdefault(_folder(other, entry), f"shot '{entry.name}' of scene '{other.name}'")
    layers = set(scene.view_layers.keys())
    try:
        found = [listed(scene, entry) for entry in entries(scene)]
        return shots.problems(found, cameras, layers, elsewhere, is_there)
    except FolderError as error:
        return {entry.key: str(error) for entry in entries(scene)}


def _folder(scene: bpy.types.Scene, entry: Any) -> Path:
    try:
        return bake_folder(scene, entry)
    except FolderError:
        return Path()


def baked_folder(scene: bpy.types.Scene, entry: Any) -> Path | None:
    """The folder with the bake of a shot, where the file remembers it or where it would be written; None without
    one."""
    places = [*places_of_bake(scene, entry.key), _folder(scene, entry)]
    return next((place for place in places if is_bake(place)), None)


def file_of(scene: bpy.types.Scene) -> Path:
    """The file with the list of a scene's baked shots, for other programs: beside their folders. Raises FolderError."""
    chosen = getattr(getattr(scene, "relume", None), "folder", "")
    if chosen:
        return absolute(chosen) / file_name(f"{scene.name}_{LIST_FILE}")
    unsaved = f"{SESSION}_{scene.session_uid}"
    return default_folder(bpy.data.filepath, scene.name, LIST_FILE, cache_folder(), unsaved)


def write_file(scene: bpy.types.Scene) -> tuple[Path, list[str]]:
    """Writes the list of the shots that are on and baked; its file, and their names. Raises FolderError or OSError."""
    found = [_where_baked(scene, entry) for entry in entries(scene)] or [automatic(scene)]
    file = file_of(scene)
    return file, shots.write_file(found, file, bpy.data.filepath)


def _where_baked(scene: bpy.types.Scene, entry: Any) -> ListedShot:
    shot, folder = listed(scene, entry), baked_folder(scene, entry)
    return ListedShot(**{**vars(shot), "folder": folder}) if folder is not None else shot


def add(scene: bpy.types.Scene, name: str, camera: bpy.types.Object | None, frame: int | None = None) -> Any:
    """Adds a shot at the end of the list, and returns its entry."""
    state = scene.relume_shots
    names, keys = {entry.name for entry in state.items}, {LIST_FILE, *(entry.key for entry in state.items)}
    bake = _bake_of_automatic(scene, camera) if not state.items else None
    entry = state.items.add()
    entry.name, entry.key = shots.free_name(name, names), shots.free_key(name, keys)
    entry.camera = camera
    entry.camera_name = camera.name if camera is not None else ""
    entry.use_frame, entry.frame = frame is not None, frame if frame is not None else scene.frame_current
    entry.width, entry.height = scene.render.resolution_x, scene.render.resolution_y
    if bake is not None:
        remember_bake(scene, bake, entry.key)
    return entry


def _bake_of_automatic(scene: bpy.types.Scene, camera: bpy.types.Object | None) -> Path | None:
    """The bake that a scene had before it got a list, if it is of this camera."""
    bake = remembered_bake(scene)
    return bake if bake is not None and camera is not None and camera_of(bake) == camera.name else None


def add_cameras(scene: bpy.types.Scene) -> list[Any]:
    """Adds a shot for each camera of the scene that no shot has. Cameras come from the scene: a file also keeps those
    that were deleted."""
    known = {shot_camera(entry) for entry in scene.relume_shots.items if not entry.is_foreign}
    cameras = [obj for obj in scene.objects if obj.type == "CAMERA" and obj not in known]
    # First the one that the scene has: the bake that is there is of it.
    cameras.sort(key=lambda camera: (camera != scene.camera, camera.name))
    return _entries(scene, [add(scene, camera.name, camera).key for camera in cameras])


def _entries(scene: bpy.types.Scene, keys: list[str]) -> list[Any]:
    """The entries of keys. Adding moves entries in memory, so that those before are no longer what `add` returned."""
    return [entry for entry in entries(scene) if entry.key in keys]


def add_from_markers(scene: bpy.types.Scene) -> list[Any]:
    """Adds a shot for each marker that a camera of the scene is bound to, at its frame."""
    cameras = {obj.name: obj for obj in scene.objects if obj.type == "CAMERA"}
    bound = [marker for marker in scene.timeline_markers if marker.camera is not None]
    markers = [Marker(marker.name, marker.frame, marker.camera.name) for marker in bound]
    fixed = [(shot_camera(entry), entry.frame) for entry in scene.relume_shots.items if entry.use_frame]
    known = {(camera.name, frame) for camera, frame in fixed if camera is not None}
    found = shots.shots_of_markers([marker for marker in markers if marker.camera in cameras], known)
    keys = [add(scene, marker.name or marker.camera, cameras[marker.camera], marker.frame).key for marker in found]
    return _entries(scene, keys)


def add_view_layers(scene: bpy.types.Scene) -> list[Any]:
    """Adds a shot of the scene's camera for each view layer that is rendered and that none has."""
    layers = [layer.name for layer in scene.view_layers if layer.use]
    camera, first = scene.camera, first_rendered(scene).name
    own = [entry for entry in entries(scene) if not entry.is_foreign and shot_camera(entry) == camera]
    known = {entry.layer or first for entry in own}
    # First the one that is rendered without a list: the bake that is there is of it.
    layers.sort(key=lambda layer: layer != first)
    added = []
    for layer in layers if camera is not None else ():
        if layer not in known:
            entry = add(scene, layer, camera)
            entry.layer = layer
            added.append(entry.key)
    return _entries(scene, added)


def add_bake(scene: bpy.types.Scene, folder: Path) -> Any:
    """Adds a bake of another scene or file, which is relit with the others and never written. Raises ValueError."""
    if not is_bake(folder):
        raise ValueError(f"'{folder}' is no bake of Relume; choose the folder with its manifest.json")
    taken = [entry.name for entry in entries(scene) if _folder(scene, entry) == folder]
    if taken:
        raise ValueError(f"'{folder}' is the folder of shot '{taken[0]}' already")
    entry = add(scene, folder.name, None)
    entry.is_foreign, entry.folder, entry.camera_name = True, str(folder), camera_of(folder)
    return entry


def arguments(shot: ListedShot) -> list[str]:
    """Options of the command line in Blender for what a shot shows."""
    found = ["--camera", shot.camera]
    if shot.frame is not None:
        found += ["--frame", str(shot.frame)]
    if shot.layer:
        found += ["--layer", shot.layer]
    if shot.size is not None:
        found += ["--resolution", f"{shot.size[0]}x{shot.size[1]}"]
    return found
