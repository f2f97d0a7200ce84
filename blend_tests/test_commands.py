"""The command line in Blender: baking, relighting, resuming, stopping, and what goes wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
import relume

from addon.commands import run
from addon.core.progress import Reporter
from addon.export import trace_settings, write_view_table
from addon.export.view_transform import is_standard
from helpers import add_light, add_material, add_quad, add_sky, add_world, render_cycles, sky_file

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture
def shot(scene):
    """A lit plane, small and quick to bake."""
    scene.view_settings.view_transform = "Standard"
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=4.0, material=material)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    scene.cycles.samples = 16
    return scene


def results(capsys):
    """JSON lines of standard output."""
    return [json.loads(line) for line in capsys.readouterr().out.splitlines() if line.startswith("{")]


def test_bake_then_relight_agrees_with_cycles(shot, tmp_path, capsys):
    bake = tmp_path / "bake"
    assert run(["bake", "--out", str(bake), "--samples", "512", "--json"]) == 0
    report = next(line for line in results(capsys) if line["event"] == "result")
    assert (report["width"], report["height"], report["samples"]) == (32, 24, 512)
    ours = relume.Relighter(bake).relight(denoise=False)["combined"]
    cycles = render_cycles(shot, samples=256, max_bounces=12)
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.02)
    halves = [image[:12].mean() for image in (ours, cycles[::-1])]
    assert halves[0] == pytest.approx(halves[1], rel=0.03)


def test_relight_uses_the_present_lights(shot, tmp_path):
    bake = tmp_path / "bake"
    assert run(["bake", "--out", str(bake), "--quiet"]) == 0
    before = relume.Relighter(bake).relight(denoise=False)["combined"]
    bpy.data.lights["Key"].energy *= 3.0
    out = tmp_path / "relit.exr"
    assert run(["relight", str(bake), "--out", str(out), "--quiet", "--float", "--no-denoise"]) == 0
    assert b"Combined_Key" in out.read_bytes()[:65536]
    assert out.with_suffix(".png").exists()
    lights = json.loads(relume.Relighter(bake).scene_lights())
    lights[0]["radiance"] = [3.0 * channel for channel in lights[0]["radiance"]]
    after = relume.Relighter(bake).relight(json.dumps(lights), denoise=False)["combined"]
    assert after == pytest.approx(3.0 * before, rel=1e-5)


def test_options_override_the_scene(shot, tmp_path, capsys):
    bake = tmp_path / "bake"
    options = ["--samples", "4", "--resolution-percentage", "50", "--bounces", "2", "--tile", "8", "--threads", "1"]
    assert run(["bake", "--out", str(bake), "--json", *options]) == 0
    report = next(line for line in results(capsys) if line["event"] == "result")
    assert (report["width"], report["height"], report["samples"]) == (16, 12, 4)
    assert run(["bake", "--out", str(tmp_path / "wide"), "--json", "--samples", "1", "--resolution", "20x5"]) == 0
    report = next(line for line in results(capsys) if line["event"] == "result")
    assert (report["width"], report["height"]) == (20, 5)


def test_resume_of_a_complete_bake_changes_nothing(shot, tmp_path):
    bake = tmp_path / "bake"
    assert run(["bake", "--out", str(bake), "--quiet"]) == 0
    before = {path: path.read_bytes() for path in bake.rglob("*.safetensors")}
    assert before
    assert run(["bake", "--out", str(bake), "--quiet", "--resume"]) == 0
    assert {path: path.read_bytes() for path in bake.rglob("*.safetensors")} == before


def manifest(bake):
    """Manifest of a bake."""
    return json.loads((bake / "manifest.json").read_text())


def test_more_samples_under_another_world_keep_the_proxies(shot, tmp_path):
    _, mapping = add_sky(add_world(shot), sky_file(tmp_path))
    bake, again = tmp_path / "bake", ["--quiet", "--resume", "--replace"]
    assert run(["bake", "--out", str(bake), "--samples", "4", *again]) == 0
    learnt, old = [bake / f"proxy_sphere.{end}" for end in ("safetensors", "json")], manifest(bake)
    for file in learnt:
        file.write_text("learnt")
    mapping.inputs["Rotation"].default_value.z = 2.0
    assert run(["bake", "--out", str(bake), "--samples", "8", *again]) == 0
    assert manifest(bake)["world_map"] != old["world_map"], "paths of two worlds in one bake"
    assert all(file.read_text() == "learnt" for file in learnt)
    shot.camera.location.x += 1.0
    assert run(["bake", "--out", str(bake), "--samples", "8", *again]) == 0
    assert not any(file.exists() for file in learnt), "proxies of another camera"


def test_an_exported_scene_is_traced_to_the_same_bake(shot, tmp_path, capsys):
    add_sky(add_world(shot), sky_file(tmp_path))
    shot.view_settings.exposure, shot.cycles.seed, shot.cycles.diffuse_bounces = 1.0, 5, 2
    file, bake, traced = tmp_path / "shot.scene", tmp_path / "bake", tmp_path / "traced"
    assert run(["export", "--out", str(file), "--resolution", "20x15", "--json"]) == 0
    assert results(capsys)[-1]["width"] == 20
    assert run(["bake", "--out", str(bake), "--resolution", "20x15", "--quiet"]) == 0
    relume.start("trace", file, out=traced).result()
    files = {path.name: path.read_bytes() for path in traced.iterdir()}
    assert {"manifest.json", "lights.json", "guided.json", "view.png"} < files.keys()
    assert files == {path.name: path.read_bytes() for path in bake.iterdir() if path.name != "shot.json"}
    assert relume.info(file)["lights"] == ["Key"] and manifest(traced)["seed"] == 5


def test_paths_look_for_the_lights_of_a_set(shot, tmp_path, capsys):
    lamp = {"name": "Lamp", "shape": {"type": "sphere", "center": [1, 0, 1], "radius": 0.01}, "radiance": [9, 9, 9]}
    found = tmp_path / "found.json"
    found.write_text(json.dumps({"format": "relume-lights", "version": 1, "name": "Found", "lights": [lamp]}))
    bake = tmp_path / "bake"
    assert run(["bake", "--out", str(bake), "--quiet", "--towards", str(found)]) == 0
    (since,) = json.loads((bake / "guided.json").read_text())["since"]
    assert [light["name"] for light in since["lights"]["lights"]] == ["Key", "Lamp"]
    found.write_text("{}")
    assert run(["bake", "--out", str(tmp_path / "other"), "--quiet", "--towards", str(found)]) == 1
    assert "found.json cannot be read as a light set" in capsys.readouterr().err


def test_native_commands_are_forwarded(shot, tmp_path, capfd):
    bake = tmp_path / "bake"
    assert run(["bake", "--out", str(bake), "--quiet"]) == 0
    assert run(["info", str(bake)]) == 0
    assert "32" in capfd.readouterr().out
    assert run(["validate", str(bake)]) == 0
    assert run(["info", str(tmp_path / "nothing")]) == 1


@pytest.mark.parametrize(
    "arguments, code",
    [
        (["bake"], 2),
        (["bake", "--out", "x", "--samples", "0"], 2),
        (["bake", "--out", "x", "--unknown"], 2),
        (["bake", "--out", "x", "--camera", "Nope"], 1),
        (["bake", "--out", "x", "--resolution", "64"], 2),
        (["export"], 2),
        (["export", "--out", "gone/x.scene"], 2),
        (["explode"], 2),
        ([], 2),
        (["--help"], 0),
    ],
)
def test_mistakes_have_an_exit_code(shot, tmp_path, monkeypatch, arguments, code):
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == code
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["bake"], ["bake", "--out", "x", "--nope"], ["relight", "x"], ["explode"]])
def test_mistakes_are_one_line_for_people_and_for_machines(shot, arguments, capsys):
    assert run(arguments) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.startswith("Error: ") and told.err.count("\n") == 1
    assert run([*arguments, "--json"]) == 2
    (line,) = results(capsys)
    assert line["event"] == "error" and line["message"] in told.err


@pytest.mark.parametrize("way", ["gone.blend --command relume", "gone.BLEND1 -P relume_bake.py --"])
def test_file_that_was_not_opened_is_not_replaced_by_the_default_scene(shot, tmp_path, monkeypatch, capsys, way):
    monkeypatch.setattr(sys, "argv", ["blender", "-b", *way.split(), "bake", "--out", "x"])
    assert run(["bake", "--out", str(tmp_path / "bake")]) == 1
    assert way.split()[0] in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_unwritable_folder_is_one_clear_error(shot, tmp_path, capsys):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    assert run(["bake", "--out", str(blocked), "--quiet"]) == 1
    assert capsys.readouterr().err.startswith("Error: ")


def test_settings_are_those_of_cycles(shot):
    shot.cycles.max_bounces, shot.cycles.blur_glossy, shot.cycles.pixel_filter_type = 7, 0.5, "BOX"
    shot.cycles.caustics_reflective, shot.cycles.film_exposure = False, 2.5
    settings = trace_settings(shot, pytest.fail)
    assert settings["paths"]["bounces"]["total"] == 7
    assert settings["paths"]["filter_glossy"] == 0.5
    assert settings["paths"]["filter"] == {"type": "box"}
    assert settings["paths"]["caustics_reflective"] is False
    assert settings["paths"]["film_exposure"] == 2.5
    shot.cycles.sample_clamp_indirect = 10.0
    warnings = []
    trace_settings(shot, warnings.append)
    assert len(warnings) == 1 and "clamping" in warnings[0]


@pytest.mark.parametrize("method", ["REPLACE", "ADD"])
def test_fast_gi_is_read_as_cycles_heeds_it(shot, method):
    warnings, lamp = [], shot.objects["Key"].data.cycles
    lamp.use_multiple_importance_sampling = False

    def found():
        return trace_settings(shot, warnings.append)["paths"].get("fast_gi")

    add_world(shot)
    assert found() is None
    light = shot.world.light_settings
    light.distance, light.ao_factor = 0.5, 0.25
    shot.cycles.use_fast_gi, shot.cycles.fast_gi_method, shot.cycles.ao_bounces_render = True, method, 2
    shared = {"distance": 0.5, "factor": 0.25}
    replaced = {"method": "replace", "bounces": 2, **shared}
    assert found() == (replaced if method == "REPLACE" else {"method": "add", **shared}) and not warnings
    lamp.use_multiple_importance_sampling = True
    assert found() and any("large lamps" in warning for warning in warnings) == (method == "REPLACE")
    shot.cycles.ao_bounces_render = 0
    assert (found() is None) == (method == "REPLACE")
    shot.cycles.ao_bounces_render, light.ao_factor = 2, 0.0
    assert found() is None
    light.ao_factor, shot.world = 0.25, None
    assert found() is None


def test_view_table_holds_the_view_transform(shot, tmp_path):
    assert is_standard(shot)
    shot.view_settings.exposure = 1.0
    assert not is_standard(shot)
    path = tmp_path / "view.png"
    before = shot.render.image_settings.file_format
    write_view_table(shot, path)
    assert shot.render.image_settings.file_format == before
    table = bpy.data.images.load(str(path))
    table.colorspace_settings.name = "Non-Color"
    size = table.size[1]
    assert table.size[0] == size * size
    pixels = np.array(table.pixels[:]).reshape(size, size, size, 4)[::-1]  # [green, blue, red]
    red = size // 2
    linear = 2 * (2.0 ** (-12 + 19 * red / (size - 1)) - 2.0**-12)
    srgb = 1.055 * linear ** (1 / 2.4) - 0.055
    assert pixels[0, 0, red, 0] == pytest.approx(srgb, abs=2e-3)
    assert pixels[red, 0, 0, 1] == pytest.approx(srgb, abs=2e-3)
    assert pixels[0, red, 0, 2] == pytest.approx(srgb, abs=2e-3)


def script(blend, *arguments):
    """`relume_bake.py` in a process of its own."""
    return [sys.executable, str(REPOSITORY / "relume_bake.py"), str(blend), "--", *map(str, arguments)]


@pytest.fixture
def saved(shot, tmp_path):
    """The shot as a file."""
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_script_bakes_without_the_extension(saved, tmp_path):
    command = script(saved, "bake", "--out", tmp_path / "bake", "--json")
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert '"event": "result"' in done.stdout
    assert (tmp_path / "bake" / "lights.json").exists()


def test_script_reports_mistakes_by_its_exit_code(saved, tmp_path):
    done = subprocess.run(script(saved, "bake"), capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and "--out" in done.stderr
    missing = subprocess.run(script(tmp_path / "none.blend", "info"), capture_output=True, text=True, timeout=120)
    assert missing.returncode == 1 and "there is no file" in missing.stderr
    command = [word for word in script(saved, "bake", "--out", "x") if word != "--"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1 and "shot.blend -- bake --out x" in done.stderr


def test_a_terminated_bake_resumes_to_the_same_result(saved, tmp_path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    arguments = ["--samples", "4096", "--quiet", "--threads", "1", "--tile", "8"]
    subprocess.run(script(saved, "bake", "--out", whole, *arguments), check=True, timeout=120)
    process = subprocess.Popen(script(saved, "bake", "--out", broken, *arguments), stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not list(broken.rglob("*.safetensors")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    code = process.wait(timeout=60)
    assert code in {0, 130}  # 0 if it was quicker than the signal
    left = os.listdir(broken)
    assert left and not [name for name in left if name.startswith(".")]
    subprocess.run(script(saved, "bake", "--out", broken, "--resume", *arguments), check=True, timeout=120)
    files = sorted(path.relative_to(whole) for path in whole.rglob("*.safetensors"))
    assert files == sorted(path.relative_to(broken) for path in broken.rglob("*.safetensors"))
    for file in files:
        assert (whole / file).read_bytes() == (broken / file).read_bytes()


def warnings(capsys):
    return [line["message"] for line in results(capsys) if line["event"] == "warning"]


def move_camera(scene):
    scene.camera.location.x += 0.5
    return "The camera moved"


def edit_material(scene):
    diffuse = next(node for node in bpy.data.materials["White"].node_tree.nodes if node.type == "BSDF_DIFFUSE")
    diffuse.inputs["Color"].default_value = (0.2, 0.1, 0.1, 1.0)
    return "Material 'White' changed"


def edit_geometry(scene):
    scene.objects["Plane"].data.vertices[0].co.z += 0.1
    return "Geometry 'Plane' changed"


def enlarge_picture(scene):
    scene.render.resolution_x = 40
    return "The picture has 40 x 24 pixels now; the bake has 32 x 24"


def brighten_world(scene):
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Strength"].default_value = 2.0
    return "The world became brighter"


def change_nothing_but_the_light(scene):
    bpy.data.lights["Key"].energy *= 2.0
    return ""


STATES = [
    *(move_camera, edit_material, edit_geometry, enlarge_picture, brighten_world),
    change_nothing_but_the_light,
]


def test_a_black_world_is_no_other_one(shot, tmp_path, capsys):
    add_world(shot, strength=0.0)
    bake = tmp_path / "bake"
    assert run(["bake", "--out", str(bake), "--samples", "1", "--quiet"]) == 0
    assert run(["relight", str(bake), "--out", str(tmp_path / "relit.exr"), "--json", "--no-denoise"]) == 0
    assert not any("not as it was baked" in message for message in warnings(capsys))


def test_a_bake_of_another_state_of_the_scene_is_said(shot, tmp_path, capsys):
    add_world(shot)
    bake, blend = tmp_path / "bake", str(tmp_path / "shot.blend")
    assert run(["bake", "--out", str(bake), "--samples", "1", "--quiet"]) == 0
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    relit = ["relight", str(bake), "--out", str(tmp_path / "relit.exr"), "--json", "--no-denoise"]
    for change in STATES:
        bpy.ops.wm.open_mainfile(filepath=blend)
        said = change(bpy.context.scene)
        bpy.context.view_layer.update()
        assert run(relit) == 0
        found = [message for message in warnings(capsys) if "not as it was baked" in message]
        assert (said in found[0] and len(found) == 1) if said else found == [], (change, found)
    bpy.ops.wm.open_mainfile(filepath=blend)
    brighten_world(bpy.context.scene)
    assert run([*relit, "--world", "1,1,1"]) == 0 and not warnings(capsys), "the picture has another world anyway"
    (bake / "shot.json").unlink()
    move_camera(bpy.context.scene)
    assert run(relit) == 0
    assert any("something that is not told apart" in message for message in warnings(capsys))


def test_another_picture_than_the_baked_one_is_refused_where_it_is_asked_for(shot, tmp_path, capsys):
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    shot.collection.objects.link(other)
    bake, lights = tmp_path / "bake", tmp_path / "bake" / "lights.json"
    assert run(["bake", "--out", str(bake), "--samples", "1", "--quiet"]) == 0
    relit = ["relight", str(bake), "--out", str(tmp_path / "relit.exr"), "--no-denoise"]
    for options, code, said in [
        (["--resolution", "16x12"], 1, "a bake of 32 x 24 pixels, not 16 x 12"),
        (["--camera", "Other"], 1, "a bake of camera 'Camera'"),
        (["--camera", "Nope"], 1, "has no camera 'Nope'; it has 'Camera', 'Other'"),
        (["--scene", "Nope"], 1, "no scene 'Nope'; it has 'Scene'"),
        (["--lights", str(lights), "--frame", "3"], 2, "--frame"),
        (["--resolution", "32x24", "--camera", "Camera"], 0, ""),
    ]:
        assert run([*relit, *options]) == code, options
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "command, name, said",
    [
        ("relight bake", "relit.jpg", "let the name end in .exr"),
        ("relight bake", "relit.png", "let the name end in .exr"),
        ("relight bake", "relit", "let the name end in .exr"),
        ("relight bake", "folder", "is a folder; name a file in it"),
        ("relight bake", "gone/relit.exr", "its folder does not exist"),
        ("relight bake", "relit.EXR", "there is no bake folder bake"),
        ("export", "shot.blend", "let the name end in .scene"),
        ("export", "gone/shot.scene", "its folder does not exist"),
    ],
)
def test_files_that_would_not_be_written_are_refused_first(shot, tmp_path, monkeypatch, capsys, command, name, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    assert run([*command.split(), "--out", name]) != 0
    assert said in capsys.readouterr().err and [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_what_is_said_of_many_lamps_is_said_once(shot, tmp_path, capsys):
    for number in range(5):
        add_light(shot, "POINT", name=f"Lamp {number}").data.cycles.is_caustics_light = True
    assert run(["bake", "--out", str(tmp_path / "bake"), "--samples", "1", "--json"]) == 0
    (said,) = [message for message in warnings(capsys) if "shadow caustics" in message]
    assert all(name in said for name in ("'Lamp 0'", "'Lamp 1'", "and 1 more"))


def test_what_is_said_in_one_stage_is_said_together(capsys):
    reporter = Reporter(as_json=True)
    for done, stage in enumerate(["gather", "gather", "gather", "write"]):
        reporter.progress({"stage": stage, "done": done, "total": 3})
        reporter.warning(f"light 'Lamp {done}': one path in {done + 10} pixels")
    reporter.flush()
    assert warnings(capsys) == [
        "light 'Lamp 0', and likewise 'Lamp 1' and 'Lamp 2': one path in 10 to 12 pixels",
        "light 'Lamp 3': one path in 13 pixels",
    ]


def test_files_that_are_no_blend_files_are_one_clear_error(saved, tmp_path):
    good, damaged = saved.read_bytes(), tmp_path / "damaged.blend"
    for content in (b"", good[: len(good) // 2], b"not a blend file" * 100):
        damaged.write_bytes(content)
        done = subprocess.run(
            script(damaged, "bake", "--out", tmp_path / "x"), capture_output=True, text=True, timeout=60
        )
        errors = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
        assert done.returncode == 1 and "Traceback" not in done.stderr, (content[:20], done.stderr)
        assert "damaged.blend cannot be opened: " in errors[-1] and not (tmp_path / "x").exists()
