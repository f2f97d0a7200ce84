#!/usr/bin/env python3
"""Plays scenarios in a real Blender with its window, on a virtual display: scripts/window/run.py [SCENARIO...]

Each scenario of blend_tests/window/scenarios (those of every merge, if none is named; --all: all that test) runs in a
Blender of its own in the tree that scripts/window/setup makes, on OpenGL; where none is named, those that say so also
on Vulkan. The extension is installed from its zip in build/extension, for a user of its own. Files are copied into the
tree and out of it; nothing is mounted from the checkout. Leaves photographs and logs in out/window, and figures in
out/window.json. Takes about 10 s more than the scenarios. What this machine lacks is skipped and said; where CI is
set, a scene that is missing is a failure, unless there is no folder of scenes at all and RELUME_WITHOUT_SCENES=1 says
that this is meant.
"""

import argparse
import ast
import contextlib
import functools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
HARNESS = REPOSITORY / "blend_tests" / "window"
OUT = REPOSITORY / "out" / "window"
FIGURES = OUT.with_suffix(".json")
PYTHON = REPOSITORY / ".venv-4.2" / "bin" / "python"
SCREEN = "1280x720"
"""Size of scenarios that do not say their own. To draw a view on software OpenGL takes as long as it has pixels: half a
second in a window of 1920 x 1080."""
SMALL_DISK = "4m"
MAPS = Path("/proc/sys/vm/max_map_count")
MAPS_NEEDED = 2**22
"""Memory maps of a process: Mesa's Vulkan on the processor makes one for every set of descriptors, of which Blender
takes hundreds a redraw and gives none back while it runs."""
NEWEST = "sid"  # Debian unstable
OLDEST_BLENDER = (5, 2)
OLDEST_SUPPORTED = (4, 2)
OLDEST_ON_VULKAN = (4, 5)
"""Before, Blender's own Vulkan was a trial."""
MADE = {"demo.blend": "make_scene.py", "creature.blend": "make_creature.py", "stage.blend": "make_stage.py"}
"""Scenes that a script of the demo makes."""
SCENES = Path(os.environ.get("RELUME_SCENES") or REPOSITORY.parent / "shared" / "scenes")

sys.path[:0] = [str(HARNESS), str(REPOSITORY / "scripts")]
from extension_zip import zip_for_this_machine  # noqa: E402
from judge import failures  # noqa: E402


@dataclass(frozen=True)
class Part:
    """A scenario, and the graphics library that Blender plays it with."""

    scenario: Path
    library: str = "opengl"

    @property
    def name(self):
        """Start of the names of its files and figures."""
        return self.scenario.stem + (f"-{self.library}" if self.library != "opengl" else "")

    def constant(self, name, otherwise):
        """Value of a constant of the scenario: NEEDS, the scenes; EVERY_TIME, if it is played where none is named;
        BY_NAME, if it measures and is played only when it is named; FIRST, if it takes longest, so that others are
        played beside it; ON_VULKAN, if it is played there too; SCREEN, its size; SIMULATES_EVENTS, without which
        Blender takes those of the X server."""
        for node in ast.parse(self.scenario.read_text()).body:
            if isinstance(node, ast.Assign) and node.targets[0].id == name:
                return ast.literal_eval(node.value)
        return otherwise


class Room:
    """A private folder in the tree, gone at the end, and programs that see it as `inside`."""

    def __init__(self, tree, driver=None):
        self.tree = tree
        self.folder = Path(tempfile.mkdtemp(prefix="relume-", dir=tree / "tmp"))
        self.inside = Path("/") / self.folder.relative_to(tree)
        for name in ("home", "user", "screen", "scenes", "scratch", "pictures", "tmp", "small", "read_only"):
            (self.folder / name).mkdir()
        shutil.copytree(HARNESS, self.folder / "window")
        self.graphics = self.bring_driver(driver) if driver else {"LIBGL_ALWAYS_SOFTWARE": 1}

    def bring_driver(self, driver):
        """Copies NVIDIA's driver from a folder of this machine; what makes programs use it."""
        copy = self.folder / "driver"
        copy.mkdir()
        for library in driver.glob("lib*.so*"):
            if re.match(r"lib(.*nvidia|cuda)", library.name):
                shutil.copy(library, copy)
        # This library, unlike the other of Vulkan, needs none of a display.
        library, inside = {"library_path": "libEGL_nvidia.so.0"}, self.inside / copy.name
        for name, about in (("vulkan", {"api_version": "1.3.0"}), ("egl", {})):
            (copy / f"{name}.json").write_text(json.dumps({"file_format_version": "1.0.0", "ICD": library | about}))
        return {
            "LD_LIBRARY_PATH": inside,
            "__GLX_VENDOR_LIBRARY_NAME": "nvidia",
            "__EGL_VENDOR_LIBRARY_FILENAMES": inside / "egl.json",
            "VK_DRIVER_FILES": inside / "vulkan.json",
        }

    def command(self, *command, **environment):
        """A command in the tree; where mounting is allowed, with the machine's devices and processes, a small disk and
        one that cannot be written to."""
        variables = {
            "PATH": "/usr/bin:/bin",
            "LANG": "C.UTF-8",
            "HOME": self.inside / "home",
            "TMPDIR": self.inside / "tmp",
            "BLENDER_USER_RESOURCES": self.inside / "user",
            "NODEVICE_SELECT": 1,
            **(self.graphics | environment),
        }
        chroot = ["chroot", self.tree, "env", "-i", *(f"{name}={value}" for name, value in variables.items()), *command]
        if may_mount():
            mounts = ["mount --rbind /dev dev", "mount -t proc proc proc"]
            for name, options in (("small", f"size={SMALL_DISK}"), ("read_only", "ro")):
                mounts.append(f"mount -t tmpfs -o {options} tmpfs .{self.inside / name}")
            script = f'cd "$0" && {" && ".join(mounts)} && exec "$@"'
            chroot = ["unshare", "--mount", "sh", "-c", script, self.tree, *chroot]
        return [str(part) for part in chroot]

    def call(self, *command, log, seconds, **environment):
        """Runs a command to its end; returns its status, None if it was killed because time was up."""
        with log.open("wb") as output:
            process = subprocess.Popen(
                self.command(*command, **environment), stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
            try:
                return process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                return None
            finally:
                kill_group(process)


@functools.cache
def may_mount():
    """True if this process may make a mount namespace; many containers may not."""
    trial = ["unshare", "--mount", "mount", "-t", "proc", "proc", "/proc"]
    return subprocess.run(trial, stderr=subprocess.DEVNULL).returncode == 0


def kill_group(process):
    """Ends a process that leads a session, and its children."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@contextlib.contextmanager
def display(room, size):
    """A virtual screen of a size, "1280x720", that keeps its pixels in a file of the room; its name, ":1"."""
    options = f"-displayfd 1 -screen 0 {size}x24 -nocursor -nolisten tcp -fbdir"
    command = room.command("Xvfb", *options.split(), room.inside / "screen")
    with (room.folder / "Xvfb.log").open("wb") as log:
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True)
    try:
        number = server.stdout.readline().strip()
        if not number:
            sys.exit("window: no virtual display: " + (room.folder / "Xvfb.log").read_text()[-500:])
        yield f":{number}"
    finally:
        kill_group(server)


def tell_versions(tree, release):
    """Prints what the tree is made of, and when: Debian unstable has other versions every week."""
    query = ["dpkg-query", f"--admindir={tree / 'var/lib/dpkg'}", "--show", "--showformat=${Package} ${Version}, "]
    versions = subprocess.check_output([*query, "blender", "mesa-vulkan-drivers", "libgl1-mesa-dri"], text=True)
    made = time.strftime("%Y-%m-%d", time.gmtime((tree / ".relume-setup").stat().st_mtime))
    print(f"window: {versions}Debian {release} of {made}", flush=True)


def check_blender(room, oldest):
    """The tree's Blender is said, and must be new enough for what is tested here; its version."""
    log = OUT / "version.log"
    room.call("blender", "--background", "--version", log=log, seconds=60)
    found = re.search(r"^Blender (\d+)\.(\d+).*", log.read_text(errors="replace"), re.M)
    if not found:
        sys.exit(f"window: the Blender of {room.tree} does not say its version:\n{log.read_text()[-2000:]}")
    print(f"window: {found[0]}", flush=True)
    version = tuple(map(int, found.groups()))
    if version < oldest:
        sys.exit(f"window: needs Blender {'.'.join(map(str, oldest))}; delete {room.tree} for a newer one")
    return version


def install_extension(room):
    """Installs the extension from the zip, as an artist does; the user's settings are kept for the next windows."""
    extension = zip_for_this_machine(REPOSITORY / "build" / "extension")
    if extension is None:
        sys.exit("window: build/extension has no zip for this machine; run make extension-linux")
    shutil.copy(extension, room.folder)
    log = OUT / "install.log"
    script = [room.inside / "window" / "install.py", "--", room.inside / extension.name]
    status = room.call("blender", "--background", "--python-exit-code", "1", "--python", *script, log=log, seconds=120)
    if status != 0:
        sys.exit(f"window: the extension cannot be installed (status {status}):\n{log.read_text()[-2000:]}")
    # Settings that a person's Blender starts with.
    shutil.copytree(room.folder / "user", room.folder / "installed")


def fetch_scene(room, name):
    """Copies a scene into the room; False if it is not on this machine."""
    target = room.folder / "scenes" / name
    if target.exists():
        return True
    if name in MADE:
        maker = REPOSITORY / "scripts" / "demo" / MADE[name]
        subprocess.run([PYTHON, maker, target], check=True, stdout=subprocess.DEVNULL)
        return True
    source = SCENES / name
    if source.exists():
        shutil.copyfile(source, target)
    return source.exists()


def may_lack_scenes():
    """True if scenarios may be skipped because their scenes are not on this machine."""
    is_meant = os.environ.get("RELUME_WITHOUT_SCENES") == "1" and not SCENES.is_dir()
    return not os.environ.get("CI") or is_meant


def play(room, part, seconds):
    """Plays one part on a screen of its own; returns what went wrong, what was skipped, and its figures."""
    for name, source in (("user", "installed"), ("scratch", None), ("pictures", None), ("tmp", None)):
        shutil.rmtree(room.folder / name)
        shutil.copytree(room.folder / source, room.folder / name) if source else (room.folder / name).mkdir()
    result_file = room.folder / "result.json"
    result_file.unlink(missing_ok=True)
    log = OUT / f"{part.name}.log"
    size = part.constant("SCREEN", SCREEN)
    window = ["--window-geometry", "0", "0", *size.split("x"), "--python-exit-code", "1"]
    window += ["--gpu-backend", part.library]
    window += ["--enable-event-simulate"] * part.constant("SIMULATES_EVENTS", True)
    scenario_inside = room.inside / "window" / "scenarios" / part.scenario.name
    script = ["--python", room.inside / "window" / "play.py", "--", part.name, scenario_inside, room.inside]
    with display(room, size) as screen:
        status = room.call("blender", *window, *script, log=log, seconds=seconds, DISPLAY=screen)
    for left in (*(room.folder / "pictures").iterdir(), *(room.folder / "tmp").glob("*.crash.txt")):
        shutil.copy(left, OUT)
    result = json.loads(result_file.read_text()) if result_file.exists() else None
    problems = failures(result, status, log.read_text(errors="replace"))
    skipped = result["skipped"] if result else []
    if may_mount():
        problems += [f"skipped, although this machine may mount: {what}" for what in skipped]
    return problems, skipped, result["figures"] if result else []


def play_all(room, parts, seconds):
    """Plays parts of a list until none is left in it; returns their figures and whether all went well."""
    figures, well = [], True
    while parts:
        part = parts.pop(0)
        if missing := [name for name in part.constant("NEEDS", []) if not fetch_scene(room, name)]:
            verdict = "skipped" if may_lack_scenes() else "FAILED"
            print(f"window: {part.name}: {verdict}, {', '.join(missing)} is not in {SCENES}", flush=True)
            well = well and may_lack_scenes()
            continue
        begun = time.monotonic()
        problems, skipped, measured = play(room, part, seconds)
        verdict = "FAILED" if problems else "passed"
        notes = [*problems, *(f"skipped: {what}" for what in skipped)]
        took = time.monotonic() - begun
        print(f"window: {part.name}: {verdict} in {took:.0f} s", *notes, sep="\n  ", flush=True)
        figures += measured
        well = well and not problems
    return figures, well


def play_at_once(rooms, parts, seconds):
    """Plays parts, as many at a time as there are rooms; returns as `play_all` does."""
    with ThreadPoolExecutor(len(rooms)) as players:
        played = list(players.map(lambda room: play_all(room, parts, seconds), rooms))
    return sum((figures for figures, _ in played), []), all(well for _, well in played)


def chosen_parts(scenarios, names, on_vulkan, takes_all=False):
    """The scenarios to be played: those of these names, or else those of every merge or all that test, and, where one
    says so, on Vulkan too."""
    if names:
        return [Part(scenarios[name], "vulkan" if on_vulkan else "opengl") for name in names]
    tests = [part for part in map(Part, scenarios.values()) if not part.constant("BY_NAME", False)]
    tests = [part for part in tests if takes_all or part.constant("EVERY_TIME", False)]
    vulkan = [Part(part.scenario, "vulkan") for part in tests if on_vulkan or part.constant("ON_VULKAN", False)]
    return sorted(vulkan if on_vulkan else tests + vulkan, key=lambda part: not part.constant("FIRST", False))


@contextlib.contextmanager
def enough_maps(parts):
    """Lets processes have as many maps of memory as Vulkan on the processor takes, while these parts are played; yields
    those that can be."""
    before = MAPS.read_text()
    if int(before) >= MAPS_NEEDED or all(part.library != "vulkan" for part in parts):
        yield parts
        return
    try:
        MAPS.write_text(str(MAPS_NEEDED))
    except OSError as error:
        print(f"window: Vulkan is skipped, as it needs {MAPS} to be {MAPS_NEEDED}: {error}", flush=True)
        yield [part for part in parts if part.library != "vulkan"]
        return
    try:
        yield parts
    finally:
        MAPS.write_text(before)


def main():
    """See the first lines of this file."""
    scenarios = {path.stem: path for path in sorted((HARNESS / "scenarios").glob("*.py"))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"of {', '.join(scenarios)}")
    parser.add_argument(
        "--vulkan", action="store_true", help="play all of them on Vulkan, which Blender takes by itself from 5.3 on"
    )
    parser.add_argument("--all", action="store_true", help="play all that test, as before a release")
    parser.add_argument("--seconds", type=float, default=1200, help="time limit of a scenario")
    parser.add_argument(
        "--at-once", type=int, choices=(1, 2, 3, 4), default=1, help="how many are played at a time; disturbs times"
    )
    parser.add_argument(
        "--nvidia",
        type=Path,
        metavar="FOLDER",
        help="draw and compute on the card whose driver, libGLX_nvidia.so.0 and others, is there",
    )
    parser.add_argument("--debian", metavar="RELEASE", default=NEWEST, help="whose Blender: trixie has 4.3")
    options = parser.parse_args()
    if unknown := set(options.scenarios) - set(scenarios):
        parser.error(f"no such scenario: {', '.join(sorted(unknown))}")
    if options.nvidia and not (options.nvidia / "libGLX_nvidia.so.0").exists():
        parser.error(f"no libGLX_nvidia.so.0 in {options.nvidia}; ldconfig -p tells where it is")
    if os.geteuid() != 0:
        sys.exit("window: needs root, for chroot; run it as root or in a container")
    setup = subprocess.run([Path(__file__).with_name("setup"), options.debian], stdout=subprocess.PIPE, text=True)
    if setup.returncode != 0:
        sys.exit(1)
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    tree = Path(setup.stdout.strip())
    tell_versions(tree, options.debian)
    rooms = [Room(tree, options.nvidia) for _ in range(options.at_once)]
    try:
        version = check_blender(rooms[0], OLDEST_BLENDER if options.debian == NEWEST else OLDEST_SUPPORTED)
        for room in rooms:
            install_extension(room)
        chosen = chosen_parts(scenarios, options.scenarios, options.vulkan, options.all)
        chosen = [part for part in chosen if part.library != "vulkan" or version >= OLDEST_ON_VULKAN]
        with enough_maps(chosen) as parts:
            if not parts:
                sys.exit("window: there is nothing to play")
            figures, well = play_at_once(rooms, parts, options.seconds)
    finally:
        for room in rooms:
            shutil.rmtree(room.folder)
    FIGURES.write_text(json.dumps(figures, indent=1) + "\n")
    sys.exit(0 if well else 1)


if __name__ == "__main__":
    main()
