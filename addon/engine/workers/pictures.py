"""Reads targets and masks in a Blender of its own: to decode, scale and undo the view of a large picture would hold up
this one's window for a second."""

from __future__ import annotations

import json
import threading
from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.background_call import run_in_thread
from ...export.target import Picture, TargetError, pixels_of, read_mask, read_target
from ...export.view_transform import set_view, view_settings
from .process import Worker, blender_command, private_folder, telling_little_room

COMMAND = "read-picture"
JOB, PIXELS, PACKED, RESULT = "job.json", "pixels.npy", "packed", "result.npy"


@dataclass(frozen=True)
class Read:
    """A picture that was read."""

    pixels: np.ndarray
    """Pixels as returned by `export.target.read_target` or `read_mask`."""
    words: str = ""
    """Description of how its colours were understood."""
    is_doubtful: bool = False


class Reading:
    """One picture being read; to be stepped until it ends, or closed."""

    def __init__(self, scene: bpy.types.Scene, image: bpy.types.Image, size: tuple[int, int], colors: str | None):
        """`colors` as `RelumeSolve.target_colors`; None for a mask."""
        self.found: Read | None = None
        self.error = ""
        """Why it cannot be used, one line for the artist."""
        self._worker: Worker | None = None
        self._folder = private_folder()
        self._place = Path(self._folder.name)
        job = {"name": image.name, "size": size, "colors": colors, "view": view_settings(scene)}
        self._work = self._run(job | _described(image, self._place), image.session_uid)

    @property
    def is_done(self) -> bool:
        """True if reading has ended, with success or not."""
        return self.found is not None or bool(self.error)

    def step(self) -> bool:
        """Continues for a moment; returns True if more is to be done."""
        try:
            next(self._work)
            return True
        except StopIteration:
            pass
        except (TargetError, OSError, ValueError) as error:
            self.error = " ".join(str(error).split()) or repr(error)
        self.close()
        return False

    def close(self) -> None:
        """Ends it; nothing stays behind."""
        self._work.close()
        if self._worker is not None:
            self._worker.end(self._folder.cleanup)
        else:  # To remove large files takes a while.
            threading.Thread(target=self._folder.cleanup, name="relume-cleanup").start()

    def _run(self, job: dict[str, Any], uid: int) -> Generator[None, None, None]:
        contents = yield from _contents(uid)
        with telling_little_room(self._place):
            yield from run_in_thread(partial(_prepare, self._place, job, contents))
        worker = self._worker = Worker(blender_command(None, [COMMAND, str(self._place), "--json"]), self._place)
        while not worker.ended:
            yield
        events = {event.get("event"): event for event in worker.events()}
        if worker.code != 0:
            raise TargetError(worker.failure())
        pixels = yield from run_in_thread(lambda: np.load(self._place / RESULT))
        self.found = Read(pixels, events["result"]["words"], events["result"]["is_doubtful"])


def is_in_memory(image: bpy.types.Image) -> bool:
    """True if Blender holds pixels of the image in memory, which may differ from those of its file."""
    return image.has_data or image.source != "FILE"


def _described(image: bpy.types.Image, place: Path) -> dict[str, Any]:
    """Settings of an image that the other Blender needs besides its pixels."""
    if is_in_memory(image):
        return {}
    path = str(place / PACKED) if image.packed_file else bpy.path.abspath(image.filepath, library=image.library)
    return {"file": path, "space": image.colorspace_settings.name, "alpha": image.alpha_mode}


def _contents(uid: int) -> Generator[None, None, Picture | bytes | None]:
    """Contents of an image to pass on: pixels, or a packed file; None if the other Blender can read its file."""
    image = _image(uid)
    if not is_in_memory(image):
        return image.packed_file.data if image.packed_file else None
    count = image.size[0] * image.size[1] * image.channels
    # Written to once: to give a program memory takes the system longer than Blender needs to fill it.
    room = yield from run_in_thread(lambda: np.ones(count, np.float32))
    return pixels_of(_image(uid), room)


def _image(uid: int) -> bpy.types.Image:
    """The image, which undo may have replaced."""
    found = next((image for image in bpy.data.images if image.session_uid == uid), None)
    if found is None:
        raise TargetError("the image was deleted while it was read")
    return found


def _prepare(place: Path, job: dict[str, Any], contents: Picture | bytes | None) -> None:
    if isinstance(contents, Picture):
        values = dict(vars(contents))
        np.save(place / PIXELS, values.pop("pixels"))
        job["picture"] = values
    elif contents is not None:
        (place / PACKED).write_bytes(contents)
    (place / JOB).write_text(json.dumps(job), encoding="utf-8")


def read(place: Path) -> tuple[str, bool]:
    """Body of `relume read-picture`, which runs in the other Blender: does the job of a folder. Returns how the colours
    were understood, and True if that is doubtful. Raises TargetError."""
    job = json.loads((place / JOB).read_text(encoding="utf-8"))
    scene = bpy.context.scene
    set_view(scene, job["view"])
    picture = _picture(place, job)
    words, is_doubtful = "", False
    if job["colors"] is None:
        pixels = read_mask(picture, tuple(job["size"]))
    else:
        pixels, words, is_doubtful = read_target(scene, picture, job["colors"], tuple(job["size"]))
    np.save(place / RESULT, pixels)
    return words, is_doubtful


def _picture(place: Path, job: dict[str, Any]) -> Picture:
    if "picture" in job:
        return Picture(pixels=np.load(place / PIXELS), **job["picture"])
    try:
        image = bpy.data.images.load(job["file"])
    except RuntimeError as error:
        raise TargetError(f"image '{job['name']}' has no pixels: is its file still there?") from error
    if job["space"]:  # Nobody has chosen one before the file is read.
        image.colorspace_settings.name = job["space"]
    image.alpha_mode = job["alpha"]
    return replace(pixels_of(image), name=job["name"])
