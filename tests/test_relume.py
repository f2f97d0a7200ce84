"""The built wheel without Blender: scenes from numpy, errors by name, and the whole chain."""

import json
import struct
import subprocess
import sys
import threading
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
import relume

IDENTITY = np.eye(4).tolist()
CAMERA = {
    "name": "Camera",
    "world_from_object": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]],
    "projection": "perspective",
    "resolution": [24, 16],
    "pixel_aspect": [1, 1],
    "sensor_fit": "AUTO",
    "sensor": [36, 24],
    "lens": 50,
    "ortho_scale": 6,
    "shift": [0, 0],
    "clip_start": 0.1,
    "clip_end": 100,
}
LIGHT = {
    "name": "Key",
    "world_from_object": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]],
    "kind": {"type": "POINT", "radius": 0.5},
    "energy": 100,
}
DIFFUSE = {
    "name": "White",
    "nodes": [{"type": "diffuse", "color": [0.8, 0.8, 0.8], "roughness": 0, "normal": None}],
    "surface": 0,
}


def quad(size=4.0):
    """Positions, corners and faces of a square at z = 0."""
    half = size / 2
    positions = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]], np.float32)
    return positions, np.arange(4, dtype=np.int32), np.zeros(1, np.int32)


def lit_plane():
    """A plane under a light."""
    builder = relume.SceneBuilder()
    builder.set_camera(json.dumps(CAMERA))
    material = builder.add_material(json.dumps(DIFFUSE))
    builder.add_instance("Plane", builder.add_mesh("Plane", *quad()), IDENTITY, [material])
    builder.add_light(json.dumps(LIGHT))
    return builder.build()


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    """A bake of the plane."""
    folder = tmp_path_factory.mktemp("bake")
    relume.bake(lit_plane(), folder, {"samples": 256, "tile_size": 8}).wait()
    return folder


def test_relit_pictures_add_up_and_are_right(bake):
    pictures = relume.Relighter(bake).relight(denoise=False)
    combined = pictures["combined"]
    assert combined.shape == (16, 24, 3) and combined.dtype == np.float32
    assert combined == pytest.approx(pictures["lights"]["Key"] + pictures["static"] + pictures["world"], abs=1e-6)
    # Below the light: albedo * P / (4 pi^2 (h^2 + r^2)), see rust/scene/src/blender_light.rs.
    expected = 0.8 * 100 / (4 * np.pi**2 * (2.0**2 + 0.5**2))
    assert combined[7:9, 11:13].mean() == pytest.approx(expected, rel=0.1)
    assert pictures["depth"][8, 12, 0] == pytest.approx(5.0, rel=0.01)


def test_denoising_keeps_the_picture(bake):
    relighter = relume.Relighter(bake)
    noisy, denoised = (relighter.relight(denoise=flag)["combined"] for flag in (False, True))
    assert not np.array_equal(noisy, denoised)
    assert denoised.mean() == pytest.approx(noisy.mean(), rel=0.05)


def test_the_gpu_gives_the_same_picture_in_any_memory(bake):
    """On whatever GPU there is, a software driver included; a budget below the size of the dump makes it stream."""
    cpu = relume.Relighter(bake, device="cpu").relight(denoise=False)["combined"]
    for gpu_memory in (None, 1_000_000):
        gpu = relume.Relighter(bake, device="gpu", gpu_memory=gpu_memory).relight(denoise=False)["combined"]
        assert gpu == pytest.approx(cpu, rel=1e-4, abs=1e-5)
    with pytest.raises(relume.RelumeError, match="no such card"):
        relume.Relighter(bake, device="no such card")


def test_lights_are_linear(bake):
    relighter = relume.Relighter(bake)
    once = relighter.relight(json.dumps([LIGHT]), denoise=False)["combined"]
    twice = relighter.relight(json.dumps([LIGHT, LIGHT | {"name": "Fill"}]), denoise=False)["combined"]
    assert twice == pytest.approx(2 * once, rel=1e-5)
    assert relighter.relight("[]")["combined"].max() == 0.0


def test_lights_are_solved_from_an_array(bake):
    relighter = relume.Relighter(bake)
    shape = {"type": "sphere", "center": [0.4, 0.2, 1.5], "radius": 0.5}
    hidden = [{"name": "Hidden", "shape": shape, "radiance": [5, 4, 2]}]
    target = relighter.relight(json.dumps(hidden), maker="gather")["combined"]
    request = {"add": {"count": 1}, "goals": [{"goal": "target", "image": "hidden"}], "starts": 2, "steps": 100}
    request["bounds"] = {"min": [-1.5, -1.5, 0.5], "max": [1.5, 1.5, 3], "size": [0.05, 1]}
    job = relume.solve([bake], request, {"hidden": target})
    previews = []
    while not job.done:
        preview = job.preview()
        previews += [preview] if preview else []
        time.sleep(0.001)
    solved = job.result()
    assert previews and len(previews[-1]["lights"]["lights"]) == 1 and len(previews[-1]["world"]) == 3
    assert solved["through"] == "gather" and solved["loss"] < 0.01 * solved["start_loss"]
    found = relighter.relight(json.dumps(solved["lights"]), maker="gather")["combined"]
    assert found.mean() == pytest.approx(target.mean(), rel=0.05)
    assert solved["added"] == ["Relume Light"] and solved["blender"][0]["type"] == "POINT"
    with pytest.raises(ValueError, match=r"\[height, width, 1, 3 or 4\]"):
        relume.solve([bake], request, {"hidden": target[:, :, :2].copy()})
    with pytest.raises(relume.RelumeError, match="same aspect"):
        relume.solve([bake], request, {"hidden": target[:4].copy()}).result()
    with pytest.raises(ValueError, match="gaols"):
        relume.solve([bake], request | {"gaols": []})


def test_a_written_scene_is_traced_to_the_same_bake(tmp_path):
    scene, settings = lit_plane(), {"samples": 4, "seed": 3}
    scene.write(tmp_path / "plane.scene", json.dumps(settings))
    relume.bake(scene, tmp_path / "own", settings).result()
    relume.start("trace", tmp_path / "plane.scene", out=tmp_path / "traced").result()
    contents = [{p.name: p.read_bytes() for p in (tmp_path / name).iterdir()} for name in ("own", "traced")]
    assert contents[0] == contents[1] and len(contents[0]) > 3
    assert relume.info(tmp_path / "plane.scene")["scene_hash"] == scene.hash
    with pytest.raises(relume.RelumeError, match="gone"):
        scene.write(tmp_path / "gone/plane.scene")


def test_jobs_report_and_stop(tmp_path):
    job = relume.bake(lit_plane(), tmp_path / "bake", {"samples": 1 << 20, "passes": {"first": 1, "largest": 4}})
    reports = []
    while not reports and not job.done:
        report = job.progress()
        reports += [report] if report and report["stage"] == "trace" else []
        time.sleep(0.01)
    job.cancel()
    with pytest.raises(relume.RelumeError, match="stopped"):
        job.result()
    assert {"stage", "done", "total", "elapsed_s", "remaining_s", "message"} <= reports[0].keys()


def test_an_interrupted_wait_leaves_nothing_running(tmp_path):
    def interrupt(report):
        if report["stage"] == "trace":
            raise KeyboardInterrupt

    job = relume.bake(lit_plane(), tmp_path, {"samples": 1_000_000, "tile_size": 8})
    with pytest.raises(KeyboardInterrupt):
        job.wait(interrupt)
    assert job.done
    # No file is half-written at the moment when a program may exit.
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_work_runs_without_the_gil(tmp_path):
    ticks = []
    stop = threading.Event()

    def tick():
        while not stop.wait(0.001):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    relume.bake(lit_plane(), tmp_path / "bake", {"samples": 512}).result()
    stop.set()
    thread.join()
    assert len(ticks) > 5


def test_mistakes_name_their_object(tmp_path):
    builder = relume.SceneBuilder()
    positions, corners, faces = quad()
    with pytest.raises(ValueError, match="mesh 'Bad': corner vertex 3 is 9"):
        builder.add_mesh("Bad", positions, np.array([0, 1, 2, 9], np.int32), faces)
    with pytest.raises(ValueError, match="positions must be a C-contiguous numpy array of f32"):
        builder.add_mesh("Bad", positions.astype(np.float64), corners, faces)
    with pytest.raises(ValueError, match="positions has shape"):
        builder.add_mesh("Bad", positions.reshape(-1)[:7].copy(), corners, faces)
    with pytest.raises(ValueError, match="light 'Key': a value is not a finite number"):
        builder.add_light(json.dumps(LIGHT | {"exposure": 1e9}))
    with pytest.raises(ValueError, match="unknown field `enregy`"):
        builder.add_light(json.dumps(LIGHT | {"enregy": 1}))
    with pytest.raises(ValueError, match="no camera"):
        builder.build()
    with pytest.raises(relume.RelumeError):
        relume.Relighter(tmp_path)
    with pytest.raises(ValueError, match="unknown field"):
        relume.bake(lit_plane(), tmp_path / "bake", {"sample": 1})


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_textures_take_bytes_and_floats(dtype):
    builder = relume.SceneBuilder()
    assert builder.add_texture("Brick", np.zeros((2, 3, 4), dtype), encoding="linear", alpha="none") == 0
    with pytest.raises(ValueError, match="image 'Brick'"):
        builder.add_texture("Brick", np.zeros((2, 3, 3), dtype))
    with pytest.raises(ValueError, match="encoding 'rec2020' is not known"):
        builder.add_texture("Brick", np.zeros((2, 3, 4), dtype), encoding="rec2020")


def test_texture_files_are_read_where_they_can_be(tmp_path):
    builder = relume.SceneBuilder()
    rows = zlib.compress(b"".join(b"\0" + bytes(3 * 4) for _ in range(2)))
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", 4, 2, 8, 2, 0, 0, 0)), (b"IDAT", rows), (b"IEND", b""))
    with (tmp_path / "brick.png").open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in chunks:
            file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))
    (tmp_path / "words.png").write_text("no picture")
    assert builder.add_texture_file("Words", tmp_path / "words.png") is None
    assert builder.add_texture_file("Missing", tmp_path / "missing.jpg") is None
    assert builder.add_texture_file("Brick", tmp_path / "brick.png", colors="linear") == 0
    assert builder.add_texture_file("Packed", (tmp_path / "brick.png").read_bytes(), alpha="none") == 1
    with pytest.raises(ValueError, match="rec2020"):
        builder.add_texture_file("Brick", tmp_path / "brick.png", colors="rec2020")


def test_an_answer_is_polished_further(bake, tmp_path):
    relighter = relume.Relighter(bake)
    shape = {"type": "sphere", "center": [0.4, 0.2, 1.5], "radius": 0.3}
    lamp = {"name": "Lamp", "shape": shape, "radiance": [5, 4, 2]}
    target = relighter.relight(json.dumps([lamp]), maker="gather")["combined"]
    near = lamp | {"shape": shape | {"center": [0.3, 0.3, 1.5]}}
    request = {"add": {"count": 1}, "goals": [{"goal": "target", "image": "target"}], "steps": 0}
    request["bounds"] = {"min": [-1.5, -1.5, 0.5], "max": [1.5, 1.5, 3], "size": [0.05, 1]}
    solved = relume.solve([bake], request | {"from": {"lights": [near]}}, {"target": target}).result()
    assert solved["loss"] < 0.1 * solved["start_loss"] and solved["added"] == ["Relume Light"]
    with pytest.raises(ValueError, match='"from"'):
        relume.solve([bake], request | {"from": {"lights": [{"name": "Lamp"}]}})

    picture, answer, out = tmp_path / "target.exr", tmp_path / "near.json", tmp_path / "found.json"
    relume.start("relight", bake, lights=write(answer, [lamp]), out=picture).result()
    write(answer, [near])
    short = {"target": picture, "from_": answer, "iterations": 500, "out": out}
    found = relume.start("optimise", bake, **short).result()["solved"]
    assert found["loss"] < 0.1 * found["start_loss"] and found["start"] == 0


def write(path, lights):
    """A light set's file."""
    path.write_text(json.dumps({"format": "relume-lights", "version": 1, "name": path.stem, "lights": lights}))
    return path


def test_commands_give_their_json_result(bake):
    assert relume.info(bake)["lights"] == ["Key"]
    relume.validate(bake)
    with pytest.raises(relume.RelumeError, match="unexpected argument"):
        relume.start("info", bake, unknown=1).result()


def test_module_runs_as_a_command_line(bake):
    command = [sys.executable, "-m", "relume", "--json", "info", str(bake)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1])["event"] == "result"
    assert subprocess.run([sys.executable, "-m", "relume", "explode"], capture_output=True).returncode == 2


FULL_DISK = """
import json, resource, sys, time
from test_relume import SETTINGS_OF_FULL_DISK, lit_plane
import relume

folder, limit = sys.argv[1], int(sys.argv[2])
# A file-size limit fails a write half-way, like a full disk.
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
live = relume.Live(folder, device="cpu")
scene = lit_plane()
lights = json.loads(scene.lights())
lights = [relume.Light(light) for light in lights]
live.relight(relume.Request(lights))
live.bake(scene, SETTINGS_OF_FULL_DISK, train_seconds=0.0)
while live.status().state not in ("failed", "ready"):
    time.sleep(0.01)
number = live.relight(relume.Request(lights, gains={"Key": [2, 2, 2]}))
end, frame = time.monotonic() + 60, None
while (frame is None or frame.request != number) and time.monotonic() < end:
    frame = live.frame(0)
    time.sleep(0.01)
status = {name: getattr(live.status(), name) for name in ("state", "error", "samples", "warnings")}
status["relit"] = frame is not None and frame.request == number and float(frame.image.max()) > 0.0
live.close(wait_seconds=20)
print(json.dumps(status))
"""
SETTINGS_OF_FULL_DISK = {"samples": 64, "tile_size": 24}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of a process's files")
def test_a_disk_that_is_full_in_the_middle_of_a_live_bake_loses_nothing(tmp_path):
    relume.bake(lit_plane(), tmp_path / "whole", SETTINGS_OF_FULL_DISK).wait()
    shards = sorted(path.stat().st_size for path in (tmp_path / "whole").glob("tile_*"))
    command = [sys.executable, "-c", FULL_DISK, tmp_path / "cut", str(shards[-1] - 1)]
    done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    status = json.loads(done.stdout.splitlines()[-1])
    assert status["state"] == "failed" and 0 < status["samples"] < 64 and status["relit"], status
    assert str(tmp_path / "cut") in status["error"] and "too large" in status["error"], status
    assert not list((tmp_path / "cut").glob("**/*.part"))
    # Once there is room it goes on from there, to the same bake.
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cut").glob("tile_*")}
    relume.bake(lit_plane(), tmp_path / "cut", SETTINGS_OF_FULL_DISK, resume=True).wait()
    assert kept and all(path.stat().st_mtime_ns == time_ns for path, time_ns in kept.items())
    for path in (tmp_path / "whole").glob("tile_*"):
        assert (tmp_path / "cut" / path.name).read_bytes() == path.read_bytes()
