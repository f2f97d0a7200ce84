"""Work in a Blender of its own, in the background: it goes on while the artist does something else, and cannot take
the open file with it."""

from __future__ import annotations

import collections
import contextlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy

from ...core.disk import free_space, in_words
from ...core.own_files import addon_folder
from ...export.stop import ExportCancelled, Stop
from . import unsaved_images

OWN_PACKAGE = "relume_addon"
"""Name of the add-on in another Blender, where it is not enabled."""
START = """
import importlib, importlib.util, os, sys
for name, folder in {folders!r}.items():
    file = os.path.join(folder, "__init__.py")
    spec = importlib.util.spec_from_file_location(name, file, submodule_search_locations=[folder])
    sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
importlib.import_module("{package}.own_process").main()
"""
OWNED = "RELUME_ENDS_WITH_STANDARD_INPUT"
"""Environment variable of a process that is to end with the one that started it. Not on Windows, where libraries that
are loaded wait while the standard input is read."""
GIVES_WAY = ["nice", "-n", "10"]
"""Command that starts a process on Unix with a lower priority than the artist's Blender. A process that lowers its own
priority on Linux does so for one thread only."""
LAST_WORDS = 20
"""Lines that are kept to say why a process failed."""
OWNER_IS_GONE = 129
"""Exit code, which nobody is left to read: as shells report SIGHUP."""
POLL_SECONDS = 0.02
LITTLE_ROOM = 2**26
"""Bytes: with less a disk counts as full, since what could not be written whole may have been removed."""
WINDOWS_EXCEPTIONS = 0xC0000000
"""Lowest exit code on Windows that is an uncaught exception."""


class NoCopyError(Exception):
    """The open file cannot be saved as a copy of what it shows; the message says why."""


class Worker:
    """A process of low priority that writes into a folder, and what it prints. Nothing here waits."""

    def __init__(self, command: list[str], folder: Path):
        self._folder = folder
        self._told = ""
        is_unix = os.name != "nt"
        # In a group of its own: a wrapper around Blender must not outlive it, and Ctrl-C is for Blender's own terminal.
        self._process = subprocess.Popen(
            [*GIVES_WAY, *command] if is_unix and shutil.which(GIVES_WAY[0]) else command,
            stdin=subprocess.PIPE if is_unix else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),  # Of Windows alone.
            env=os.environ | ({OWNED: "1"} if is_unix else {}),
        )
        self._lines: collections.deque[str] = collections.deque()
        self._last: collections.deque[str] = collections.deque(maxlen=LAST_WORDS)
        self._reader = threading.Thread(target=self._read, name="relume-worker", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        stream = self._process.stdout
        assert stream is not None
        with stream:
            for line in stream:
                self._lines.append(line)

    @property
    def ended(self) -> bool:
        """True if the process is over and all its output has arrived."""
        return self._process.poll() is not None and not self._reader.is_alive()

    @property
    def code(self) -> int | None:
        """Exit code, once it has ended."""
        return self._process.poll()

    def events(self) -> list[dict[str, Any]]:
        """JSON lines since the last call (`core.progress.Reporter`)."""
        found = []
        while self._lines:
            line = self._lines.popleft().strip()
            event = None
            if line.startswith("{"):
                with contextlib.suppress(ValueError):
                    event = json.loads(line)
            if isinstance(event, dict):
                found.append(event)
                if event.get("event") == "error":
                    self._told = event["message"]
            elif line:
                self._last.append(line)
        return found

    def failure(self) -> str:
        """Why it failed, once all events were taken: what it told, the crash that ended it, or the line that most
        probably says so."""
        lines = [line for line in self._last if "error" in line.lower()] or list(self._last)
        last_words = lines[-1] if lines else f"Blender ended with status {self.code}"
        return (self._told or _crash(self.code or 0) or last_words) + little_room(self._folder)

    def stop(self) -> None:
        """Asks the process to end; files stay whole."""
        self._signal("SIGTERM")

    def kill(self) -> None:
        """Ends the process at once, and waits for that."""
        self._signal("SIGKILL")
        self._process.wait()

    def end(self, clean_up: Callable[[], None]) -> None:
        """Kills the process, then cleans up. Does not wait for either, which can take a tenth of a second."""

        def bury() -> None:
            self.kill()
            clean_up()

        threading.Thread(target=bury, name="relume-cleanup").start()

    def _signal(self, name: str) -> None:
        if self._process.poll() is not None:
            return
        if os.name == "nt":
            self._process.terminate()
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, getattr(signal, name))


def end_with_owner() -> None:
    """Ends this process, a Worker's, as soon as the other end of the standard input is gone. That is also so where
    Blender crashed or was killed. Files are whole at every moment."""

    def wait() -> None:
        while os.read(0, 1):
            pass
        os._exit(OWNER_IS_GONE)

    if OWNED in os.environ:
        threading.Thread(target=wait, name="relume-owner", daemon=True).start()


def little_room(folder: Path) -> str:
    """Addition to the words of a failure where the disk is full, or nearly. Blender calls that "No such file or
    directory", NumPy "3072 requested and 3040 written"."""
    free = free_space(folder)
    if free is None or free >= LITTLE_ROOM:
        return ""
    return f"; only {in_words(free)} are free on the disk of '{folder}'"


@contextlib.contextmanager
def telling_little_room(folder: Path) -> Iterator[None]:
    """Writing into a folder that fails as an OSError then says so where the disk is full."""
    try:
        yield
    except OSError as error:
        raise OSError(f"{error}{little_room(folder)}") from error


def _crash(code: int) -> str:
    """Description of the exit code of a process that was killed or crashed; empty if it ended by itself."""
    if code >= WINDOWS_EXCEPTIONS:
        return f"the other Blender crashed (exception {code:#x})"
    if code >= 0:
        return ""
    name = {number.value: number.name for number in signal.Signals}.get(-code, f"signal {-code}")
    if name in ("SIGKILL", "SIGTERM"):
        return f"the other Blender was ended from outside ({name}); is there memory enough?"
    return f"the other Blender crashed ({name})"


def private_folder() -> tempfile.TemporaryDirectory[str]:
    """A new folder in Blender's own temporary one, or the system's; it goes when that is asked for. Raises OSError."""
    return tempfile.TemporaryDirectory(prefix="relume-", dir=bpy.app.tempdir or None, ignore_cleanup_errors=True)


class SavedCopy:
    """The open file as it is now, in a private folder that goes with `remove`. Raises NoCopyError, also where the copy
    would lack something that renders of the scene show."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        if words := unsaved_images.refusal(scene):
            raise NoCopyError(words)
        self._folder = private_folder()
        self.folder = Path(self._folder.name)
        self.blend = self.folder / "shot.blend"
        try:
            with _no_thumbnail():
                bpy.ops.wm.save_as_mainfile(filepath=str(self.blend), copy=True, compress=False, check_existing=False)
        except RuntimeError as error:
            reason = str(error).strip().removeprefix("Error: ") + little_room(self.folder)
            self.remove()
            raise NoCopyError(f"no copy of the file for the other Blender: {reason}") from error

    def remove(self) -> None:
        """Removes the folder with all in it."""
        self._folder.cleanup()


@contextlib.contextmanager
def _no_thumbnail() -> Iterator[None]:
    """Keeps Blender from drawing a picture of the scene into the file, which takes longer than saving it."""
    preferences = bpy.context.preferences
    before, unsaved = preferences.filepaths.file_preview_type, preferences.is_dirty
    preferences.filepaths.file_preview_type = "NONE"
    try:
        yield
    finally:
        preferences.filepaths.file_preview_type = before
        preferences.is_dirty = unsaved


def blender_command(blend: Path | None, arguments: list[str]) -> list[str]:
    """The command line of `relume ARGUMENTS` with a file, for another Blender of this version; without a window, the
    user's own start-up file and other add-ons."""
    file = [str(blend)] if blend else []
    if not bpy.app.binary_path:  # The `bpy` module.
        return [sys.executable, "-c", _start(), *file, "--", *arguments]
    scripts = bpy.context.preferences.filepaths.use_scripts_auto_execute
    drivers = ["--enable-autoexec" if scripts else "--disable-autoexec"]
    return [
        *(bpy.app.binary_path, "--background", "--factory-startup"),
        *(*drivers, *file, "--python-exit-code", "1", "--python-expr", _start(), "--", *arguments),
    ]


def run_to_end(arguments: list[str], folder: Path, stop: Stop) -> Worker:
    """Another Blender after it did a command that works in a folder. Waits; raises `ExportCancelled` soon after `stop`
    says so."""
    worker = Worker(blender_command(None, [*arguments, str(folder), "--json"]), folder)
    try:
        while not worker.ended:
            if stop():
                raise ExportCancelled("cancelled")
            time.sleep(POLL_SECONDS)
    finally:
        worker.kill()
    worker.events()
    return worker


def _start() -> str:
    """Python text by which another Blender, with factory settings, loads this add-on and its native module from where
    they are here, and runs its own command line."""
    folders = {OWN_PACKAGE: str(addon_folder())}
    native = importlib.util.find_spec("relume")
    if native is not None and native.submodule_search_locations:
        folders["relume"] = native.submodule_search_locations[0]
    return START.format(folders=folders, package=OWN_PACKAGE)
