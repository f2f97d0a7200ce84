"""Blender ends while Relume works, of itself or not: nothing half-written is left, no other Blender stays behind, and
the next one opens what is there and says what is missing."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest

from addon.core import status
from addon.engine.shot import options, shot
from addon.live import handlers
from helpers import SECONDS, settled, until

HERE = Path(__file__).resolve().parent
SCRIPT = """
import sys, time
import bpy

blend, work, way = sys.argv[1:]
for module in ("cycles", "addon"):
    bpy.ops.preferences.addon_enable(module=module)
bpy.ops.wm.open_mainfile(filepath=blend)

from addon.engine.shot import options
from addon.live import handlers
from addon.ui import background, verify
from addon.ui.start import start
from helpers import settled, until

scene, kept = bpy.context.scene, options.preferences()
kept.train_seconds = 600.0 if "training" in work else 0.0
if "baking" in work:
    scene.relume.samples = 60_000
if work in {"baking", "training"}:
    start(scene)
    until(scene, lambda found: found.status.phase == work and found.status.live.samples, work)
elif work == "verifying":
    start(scene)
    until(scene, settled, "a picture")
    scene.relume_verify.samples = 60_000
    worker = verify.start(scene)._worker
    time.sleep(1.0)
else:
    job = background.start(scene)
    stage = {"baking": "trace", "training": "train"}[work.split()[-1]]
    while job.stage["stage"] != stage:
        background.tick()
        time.sleep(0.01)
    worker = job._worker
print("AT WORK", worker._process.pid if "worker" in globals() else 0, flush=True)
if way == "killed":
    time.sleep(600)
"""
OLD_SECONDS = 15.0
"""Longer than Relume has to end in (`EXIT_SECONDS` in `addon/live/handlers.py`)."""
WORK = ("baking", "training", "background baking", "background training", "verifying")


def is_alive(pid):
    """True if a process still runs."""
    try:
        # Nobody waits for a process whose parent is gone, but what adopts it.
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in {"Z", "X"}
    except OSError:
        return False


def is_whole(path):
    """True if a file of a bake is as long as it says, or can be read as JSON."""
    content = path.read_bytes()
    if path.suffix == ".json":
        return isinstance(json.loads(content), dict)
    if path.suffix == ".safetensors":
        start = 8 + int.from_bytes(content[:8], "little")
        tensors = json.loads(content[8:start])
        ends = [tensor["data_offsets"][1] for name, tensor in tensors.items() if name != "__metadata__"]
        return len(content) == start + max(ends)
    return len(content) > 0


def last_words(process):
    """Output of a process until it ends. Before 5.0 the `bpy` module may crash or wait for ever when all is done, with
    nothing registered but an operator."""
    is_old = bpy.app.version < (5, 0, 0)
    try:
        return process.communicate(timeout=OLD_SECONDS if is_old else SECONDS)[0]
    except subprocess.TimeoutExpired:
        assert is_old, "it does not end"
        process.kill()
        return process.communicate()[0]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks for processes in /proc")
@pytest.mark.parametrize("way", ["quits", "killed"])
@pytest.mark.parametrize("work", WORK)
def test_blender_ends_while_relume_works(studio, tmp_path, work, way):
    blend, folder = tmp_path / "shot.blend", tmp_path / "bake"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE.parent), str(HERE)])}
    command = [sys.executable, "-c", SCRIPT, str(blend), work, way]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    said = []
    for line in process.stdout:
        said.append(line)
        if line.startswith("AT WORK"):
            break
    assert said[-1].startswith("AT WORK"), "".join(said)
    worker = int(said[-1].split()[-1])
    assert not worker or is_alive(worker) or way == "quits", "it has not ended of itself"
    if way == "killed":
        process.send_signal(signal.SIGKILL)
    rest = last_words(process)
    assert way == "killed" or process.returncode == 0 or bpy.app.version < (5, 0, 0), "".join(said) + rest
    deadline = time.monotonic() + 10.0
    while worker and is_alive(worker):
        assert time.monotonic() < deadline, "the other Blender has stayed behind"
        time.sleep(0.05)
    files = [path for path in folder.iterdir() if not path.name.startswith(".")]
    assert files and [path.name for path in files if not is_whole(path)] == []
    # A process that is killed in the middle of a file, as other Blenders are, leaves a temporary one.
    assert way == "killed" or worker or len(files) == len(list(folder.iterdir())), "no temporary files"
    options.preferences().train_seconds = 0.0
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    handlers.open_bakes()
    found = until(bpy.context.scene, settled, "what is there")
    if work != "verifying":
        assert status.is_unfinished(found.status), "what is missing is said, with a button to go on"
    assert found.status.error is None and 0 < found.status.live.samples
    shot.close_all(SECONDS)
