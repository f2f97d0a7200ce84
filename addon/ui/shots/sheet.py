"""The contact sheet: all shots that are on and baked, under the present lights, as one picture in Blender."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import bpy

from ...core.progress import share_and_words
from ...core.shots import AUTOMATIC
from ...engine.native import native
from ...engine.shot import requests, shot, shot_list
from ...engine.shot.checks import ProblemError
from ...engine.workers.process import private_folder
from ...live import rows
from ...live.scheduler import scheduler
from ...viewport.views import redraw

TICK_SECONDS = 0.25
IMAGE = "Relume Contact Sheet"

_running: dict[int, Sheet] = {}
"""Sheets that are being made, by the session uids of their scenes."""
_failures: dict[int, str] = {}
"""Error of the newest sheet of a scene."""


class Sheet:
    """A sheet that is being made by the native module, on threads of its own. Raises ProblemError, FolderError or
    OSError."""

    def __init__(self, scene: bpy.types.Scene):
        opened = shot.of(scene)
        if opened is None or not opened.can_show:
            raise ProblemError("Show the bake of one shot first: the sheet has its present lights")
        self.list, names = shot_list.write_file(scene)
        if not names:
            raise ProblemError("No shot that is on has a bake yet; bake them first")
        self._folder = private_folder()
        self.file = Path(self._folder.name) / "sheet.png"
        request = Path(self._folder.name) / "request.json"
        request.write_text(requests.request_text(content_of(scene, opened)), encoding="utf-8")
        options = opened.options
        self.job = native().start(
            "relight",
            *(f"--shots={self.list}", f"--sheet={self.file}", f"--request={request}"),
            *(f"--device={options.device}", f"--threads={options.threads}"),
        )
        self.stage: dict[str, Any] = {"stage": "relight", "done": 0, "total": 0, "remaining_s": None}

    def poll(self) -> bool:
        """Takes reports; True once it has ended."""
        self.stage = self.job.progress() or self.stage
        return self.job.done

    def words(self) -> str:
        """Error for the artist; empty where all is well. The sheet is there if any shot has a picture."""
        try:
            self.job.result()
        except Exception as error:
            return " ".join(str(error).split())
        return ""

    def close(self) -> None:
        """Ends it and removes its files."""
        self.job.cancel()
        self._folder.cleanup()


def content_of(scene: bpy.types.Scene, opened: shot.Shot) -> dict[str, Any]:
    """Content of a request for the pictures of all shots, by the lights of one that is open; "shots" has, by their
    names, what rows with values of their own make different in some."""
    content = scheduler.content_of(scene, opened, AUTOMATIC)
    differing = rows.shots_with_own_values(scene, rows.present_rows(scene))
    own = {entry.name: scheduler.content_of(scene, opened, entry.key) for entry in differing}
    gains = {name: {part: found[part] for part in ("gains", "world", "static")} for name, found in own.items()}
    return content | ({"shots": gains} if gains else {})


def start(scene: bpy.types.Scene) -> Sheet:
    """Starts to make the sheet of a scene; it replaces one that is being made."""
    stop(scene.session_uid)
    sheet = _running[scene.session_uid] = Sheet(scene)
    if not bpy.app.background and not bpy.app.timers.is_registered(_timer):
        bpy.app.timers.register(_timer, first_interval=TICK_SECONDS, persistent=True)
    return sheet


def stop(scene_uid: int) -> None:
    """Ends the sheet of a scene, and forgets what went wrong with the last one."""
    _failures.pop(scene_uid, None)
    if (sheet := _running.pop(scene_uid, None)) is not None:
        sheet.close()


def progress(scene: bpy.types.Scene) -> tuple[float, str] | None:
    """Share of the present stage that is done, and words for it; None where no sheet is being made."""
    sheet = _running.get(scene.session_uid)
    return share_and_words(sheet.stage) if sheet is not None else None


def failure(scene: bpy.types.Scene) -> str:
    """Error of the newest sheet of a scene; empty where all is well."""
    return _failures.get(scene.session_uid, "")


def tick() -> bool:
    """Polls once and shows what is finished; returns True if it is to be called again."""
    for uid, sheet in list(_running.items()):
        if not sheet.poll():
            continue
        del _running[uid]
        if words := sheet.words():
            _failures[uid] = words
        if sheet.file.exists():
            show(take(sheet.file))
        sheet.close()
    redraw("UI")
    return bool(_running)


def _timer() -> float | None:
    return TICK_SECONDS if tick() else None


def take(file: Path) -> bpy.types.Image:
    """The picture of a file as the image of sheets, packed: the file goes."""
    image = bpy.data.images.get(IMAGE)
    if image is not None:
        bpy.data.images.remove(image)
    image = bpy.data.images.load(str(file))
    image.name = IMAGE
    image.pack()
    image.filepath = f"//{file.name}"
    return image


def show(image: bpy.types.Image) -> None:
    """Shows the sheet in the first image editor of the window, if there is one."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR" and area.ui_type == "IMAGE_EDITOR":
                area.spaces.active.image = image
                return


def save(image: bpy.types.Image, file: Path) -> None:
    """Writes the sheet as it was made. Raises OSError."""
    packed = image.packed_file
    if packed is None:
        shutil.copyfile(bpy.path.abspath(image.filepath), file)
    else:
        file.write_bytes(packed.data)


def close_all() -> None:
    """Ends everything."""
    for uid in list(_running):
        stop(uid)
    _failures.clear()
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
