"""The shots that are open: the current one of each scene, and those that 3D views show beside it through cameras of
their own. All take turns on one device, within one budget of memory."""

from __future__ import annotations

from typing import Any, TypeAlias

import bpy

from ..native import native
from ..reading.scene_lights import SceneLights

Shot: TypeAlias = Any
"""A `shot.Shot`, of a module that imports this one."""

_current: dict[int, Shot] = {}
"""The current shot of each scene, by its session uid."""
_beside: dict[int, list[Shot]] = {}
_boards: list[Any] = []
"""The `relume.Board` that open shots take turns on, if there are any."""


def board() -> Any:
    """The board of all shots that are open, and of the next one."""
    if not all_open():
        _boards[:] = [native().Board()]
    return _boards[0]


def of(scene: bpy.types.Scene) -> Shot | None:
    """The current shot of a scene, if it is open."""
    return _current.get(scene.session_uid)


def beside(scene: bpy.types.Scene) -> list[Shot]:
    """The shots of a scene that are open beside its current one."""
    return list(_beside.get(scene.session_uid, ()))


def all_of(scene: bpy.types.Scene) -> list[Shot]:
    """All open shots of a scene, the current one first."""
    return [shot for shot in (of(scene), *beside(scene)) if shot is not None]


def all_open() -> list[Shot]:
    """All open shots, the current ones first."""
    return [*_current.values(), *(shot for found in _beside.values() for shot in found)]


def natives() -> list[Any]:
    """The `relume.Live` of all open shots, which lend what they have in memory."""
    return [shot.live for shot in all_open()]


def by_key(scene: bpy.types.Scene, key: str) -> Shot | None:
    """The open shot of a listed one, by its key."""
    return next((shot for shot in all_of(scene) if shot.key == key), None)


def lights_of(scene: bpy.types.Scene) -> list[SceneLights]:
    """Readings of the lights of a scene by its open shots, each once."""
    return list({id(shot.lights): shot.lights for shot in all_of(scene)}.values())


def showing(scene: bpy.types.Scene, camera: bpy.types.Object | None) -> Shot | None:
    """The open shot whose bake is of a camera."""
    if camera is None:
        return None
    return next((shot for shot in all_of(scene) if shot.recognises(camera)), None)


def same_lights(shot: Shot) -> SceneLights | None:
    """Reading of the lights by another open shot of the scene, if it is the same: lights are read once for all."""
    others = [other for other in all_open() if other.scene_uid == shot.scene_uid and other is not shot]
    own = shot.lights.view_layer, shot.lights.receivers
    return next((found.lights for found in others if (found.lights.view_layer, found.lights.receivers) == own), None)


def add_current(shot: Shot) -> None:
    """Makes a shot the current one of its scene. The one before stays beside it as long as a view shows it."""
    before = _current.pop(shot.scene_uid, None)
    remove(shot)
    _current[shot.scene_uid] = shot
    if before is None or before is shot:
        return
    if before.is_seen_beside and before.key != shot.key:
        add_beside(before)
    else:
        before.close()


def add_beside(shot: Shot) -> None:
    """Has a shot open beside the current one of its scene."""
    _beside.setdefault(shot.scene_uid, []).append(shot)


def remove(shot: Shot) -> None:
    """Forgets a shot that is closed."""
    uid = shot.scene_uid
    if _current.get(uid) is shot:
        del _current[uid]
    left = [other for other in _beside.pop(uid, ()) if other is not shot]
    if left:
        _beside[uid] = left
