"""Long work: started by the native module on a thread of its own, watched from Python by polling."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native

POLL_SECONDS = 0.05
Reporter = Callable[[dict[str, Any]], None]


class Job:
    """Running work. Ends by itself; `wait` shows it to a user."""

    def __init__(self, internal: _native.Job):
        self._internal = internal

    @property
    def done(self) -> bool:
        """True once the work has ended, well or not."""
        return self._internal.done

    def cancel(self) -> None:
        """Asks the work to stop after its current unit; all complete units are kept."""
        self._internal.cancel()

    def progress(self) -> dict[str, Any] | None:
        """The newest report since the last call: stage, done, total, elapsed_s, remaining_s, message."""
        report = self._internal.progress()
        return json.loads(report) if report else None

    def preview(self) -> dict[str, Any] | None:
        """Interim result, if newer than at the last call: of `solve` "lights", a light set, and "world"."""
        text = self._internal.preview()
        return json.loads(text) if text else None

    def warnings(self) -> list[str]:
        """Warnings for the user since the last call."""
        return self._internal.warnings()

    def result(self) -> Any:
        """Waits for the end. Raises RelumeError if the work failed or was stopped."""
        return json.loads(self._internal.result())

    def wait(self, on_progress: Reporter | None = None, on_warning: Callable[[str], None] | None = None) -> Any:
        """The result; reports to the callbacks meanwhile. Whatever is raised meanwhile, such as Ctrl-C, first stops
        the work and waits for its end, so that a program may exit at once."""
        try:
            while not self.done:
                self._report(on_progress, on_warning)
                time.sleep(POLL_SECONDS)
        except BaseException:
            self.cancel()
            with suppress(_native.RelumeError):
                self.result()
            raise
        self._report(on_progress, on_warning)
        return self.result()

    def _report(self, on_progress: Reporter | None, on_warning: Callable[[str], None] | None) -> None:
        if on_warning is not None:
            for warning in self.warnings():
                on_warning(warning)
        if on_progress is not None and (report := self.progress()) is not None:
            on_progress(report)


def start(command: str, *arguments: str | os.PathLike[str], **options: Any) -> Job:
    """Starts a command of the command line (`relume COMMAND --help` lists them): `start("train", folder,
    seconds=60, resume=True)`. Results are what `--json` prints."""
    return Job(_native.start_command([command, *(os.fspath(argument) for argument in arguments), *_flags(options)]))


def _flags(options: dict[str, Any]) -> list[str]:
    flags = []
    for name, value in options.items():
        flag = f"--{name.rstrip('_').replace('_', '-')}"
        if value is True:
            flags.append(flag)
        elif value is not None and value is not False:
            flags.append(f"{flag}={value}")
    return flags


def bake(
    scene: _native.Scene,
    folder: str | os.PathLike[str],
    settings: dict[str, Any] | None = None,
    *,
    resume: bool = False,
) -> Job:
    """Traces the paths of a scene into a folder; `settings` is the JSON form of `relume_trace::TraceSettings`."""
    return Job(scene.bake(Path(folder), json.dumps(settings or {}), resume=resume))


def train(folder: str | os.PathLike[str], **options: Any) -> Job:
    """Trains a proxy on a bake; options as of `relume train`, for example `type="quad"`, `seconds=60`."""
    return start("train", folder, **options)


def solve(
    folders: Iterable[str | os.PathLike[str]],
    request: dict[str, Any] | str,
    images: dict[str, NDArray[np.float32]] | None = None,
    *,
    shots: Sequence[_native.Live] = (),
    device: str = "auto",
    gpu_memory: int | None = None,
    threads: int = 0,
) -> Job:
    """Finds lights for what the picture should do, as seen from one or several bake folders of one scene. `request`
    is the JSON of `relume_session::SolveRequest`; `images` are scene-linear arrays [height, width, 1 or 3], top row
    first, that it refers to by name. The result is the JSON form of `relume_session::Solved`. Raises ValueError for a
    request that cannot be read. Of live `shots`, those that have the scene of a folder in memory lend it."""
    text = request if isinstance(request, str) else json.dumps(request)
    paths = [Path(folder) for folder in folders]
    machine: dict[str, Any] = {"device": device, "gpu_memory": gpu_memory, "threads": threads}
    return Job(_native.solve(paths, text, images or {}, shots=shots, **machine))


def info(path: str | os.PathLike[str]) -> Any:
    """Description of a bake folder, proxy, light set or scene file."""
    return start("info", path).result()


def validate(path: str | os.PathLike[str]) -> Any:
    """Checks a bake folder, proxy, light set or scene file for damage; raises RelumeError if there is any."""
    return start("validate", path).result()
