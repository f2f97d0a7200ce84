"""A shot that a farm bakes: its job is written beside the file, and what the machines have made is brought home."""

from __future__ import annotations

import json
from pathlib import Path

import bpy

from ..workers.process import SavedCopy
from .background import BackgroundError, BackgroundJob, batch_of, of
from .options import bake_folder, options_of

FARMS = {
    "openjd": ("Open Job Description", "template.json, for Deadline Cloud and others"),
    "openjd-chunks": ("Open Job Description, Chunked", "template.json that gives a machine several parts at a time"),
    "flamenco": ("Flamenco", "A job type for Flamenco 3, which plans by itself from the file that you submit"),
    "slurm": ("Slurm", "slurm.sh, which submits the job"),
    "make": ("Make", "A Makefile, for this machine"),
}
"""Files for farms: name and description, by the native module's word."""
PLAN = "plan.json"


def job_folder(scene: bpy.types.Scene) -> Path:
    """Folder of a scene's job, beside its bake. Raises FolderError."""
    folder = bake_folder(scene)
    return folder.with_name(f"{folder.name}_farm")


class FarmWriting(BackgroundJob):
    """Writes the job of a scene."""

    def __init__(self, scene: bpy.types.Scene):
        _check_free(scene)
        settings, folder = scene.relume, job_folder(scene)
        words = ["farm", "--out", str(folder), "--scene", scene.name, "--samples", str(options_of(scene).samples)]
        words += ["--parts", str(settings.farm_parts), "--emit", settings.farm_kind, "--json"]
        frames = settings.farm_frames.strip() or str(scene.frame_current)
        self._file = SavedCopy(scene)
        try:
            super().__init__(scene.session_uid, scene.name, folder, [[*words, "--frames", frames]], self._file)
        except OSError:
            self._file.remove()
            raise

    def poll(self) -> bool:
        """See `BackgroundJob`."""
        has_news = super().poll()
        if not self.is_running:
            self._file.remove()
        return has_news

    def close(self) -> None:
        """See `BackgroundJob`."""
        super().close()
        self._file.remove()

    @property
    def done_words(self) -> str:
        """Words that say where the job is."""
        return f"The job of {self.result.get('parts', 0)} parts is in '{self.folder}'"


class FarmCollecting(BackgroundJob):
    """Checks what the machines have made of a scene's job."""

    def __init__(self, scene: bpy.types.Scene):
        _check_free(scene)
        folder = job_folder(scene)
        if not (folder / PLAN).exists():
            raise BackgroundError(f"there is no job in '{folder}'; write it first")
        self._frame = scene.frame_current
        super().__init__(scene.session_uid, scene.name, folder, [["collect", str(folder), "--json"]])

    @property
    def bake(self) -> Path | None:
        """Bake of the frame that the scene was at, or the job's first one."""
        planned = [self.folder / bake["folder"] for bake in json.loads((self.folder / PLAN).read_text())["bakes"]]
        present = self.folder / frame_name(self._frame)
        return present if present in planned else planned[0]

    @property
    def done_words(self) -> str:
        """Words that say what has come home."""
        return f"All {len(self.result.get('bakes', ()))} bakes in '{self.folder}' are complete"


def frame_name(frame: int) -> str:
    """Name of the bake folder of a frame in a job."""
    return f"{frame:04d}"


def _check_free(scene: bpy.types.Scene) -> None:
    others = (of(scene), batch_of(scene))
    if any(job is not None and job.is_running for job in others):
        raise BackgroundError("another job of this scene runs in the background; wait for its end, or stop it there")
