"""Scenes and disks that are not as they should be: one clear message, an exit code, and nothing half-written."""

import json
import subprocess
import sys
from pathlib import Path

import bpy
import pytest
import relume

from addon.commands import run
from addon.engine.reading.scene import load_scene
from helpers import add_light, add_material, add_quad, add_world, render_cycles

pytestmark = pytest.mark.oldest_and_newest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture
def shot(scene):
    """A lit plane, small and quick to bake."""
    add_quad(scene, size=4.0)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 16, 12, 2
    return scene


def bake(folder, capsys):
    """Exit code of a bake, and its events."""
    code = run(["bake", "--out", str(folder), "--json"])
    lines = capsys.readouterr().out.splitlines()
    return code, [json.loads(line) for line in lines if line.startswith("{")]


def spoil_all(scene):
    scene.objects["Plane"].location.x = float("nan")


def remove_camera(scene):
    bpy.data.objects.remove(scene.camera)


def remove_surfaces(scene):
    bpy.data.objects.remove(scene.objects["Plane"])


def hide_all_from_renders(scene):
    scene.objects["Plane"].hide_render = True


def empty_region(scene):
    scene.render.use_border, scene.render.border_max_y = True, 0.0


def spoil_camera(scene):
    scene.camera.location.x = float("nan")


@pytest.mark.parametrize(
    "spoil, word",
    [
        (spoil_all, "nothing to render"),
        (empty_region, "The render region of scene 'Scene' is empty; draw it anew"),
        (spoil_camera, "camera 'Camera': one of its values is not a finite number"),
        (remove_camera, "camera"),
        (remove_surfaces, "nothing to render"),
        (hide_all_from_renders, "nothing to render"),
    ],
)
def test_scenes_that_cannot_be_baked_are_refused_once(shot, tmp_path, capsys, spoil, word):
    spoil(shot)
    code, events = bake(tmp_path / "bake", capsys)
    errors = [event["message"] for event in events if event["event"] == "error"]
    assert code == 1 and len(errors) == 1 and word in errors[0]
    assert not (tmp_path / "bake").exists()


def lose_texture(scene):
    material, tree, output = add_material("Lost")
    texture, diffuse = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    image = bpy.data.images.new("wood", 4, 4)
    image.source, image.filepath = "FILE", "//nowhere/wood.png"
    texture.image = image
    tree.links.new(texture.outputs[0], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    scene.objects["Plane"].data.materials.append(material)


def spoil_material(scene):
    material, tree, output = add_material("Spoilt")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (float("nan"), 0.0, 0.0, 1.0)
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    scene.objects["Plane"].data.materials.append(material)


def spoil_vertex(scene):
    scene.objects["Plane"].data.vertices[1].co.x = float("nan")


def flatten_object(scene):
    add_quad(scene, "Gone").scale = (0.0, 0.0, 0.0)


def collapse_triangle(scene):
    mesh = bpy.data.meshes.new("Needle")
    mesh.from_pydata([(0, 0, 1), (1, 0, 1), (1, 0, 1), (0, 1, 1)], [], [(0, 1, 2), (0, 1, 3)])
    scene.collection.objects.link(bpy.data.objects.new("Needle", mesh))


@pytest.mark.parametrize(
    "spoil, word",
    [
        (lose_texture, "wood.png"),
        (flatten_object, "Gone"),
        (spoil_vertex, "object 'Plane': 1 of its vertices have no finite place"),
        (collapse_triangle, ""),
        (spoil_material, "material 'Spoilt': one of its values is not a finite number; taken as grey diffuse"),
    ],
)
def test_small_damage_is_named_and_the_rest_is_baked(shot, tmp_path, capsys, spoil, word):
    spoil(shot)
    code, events = bake(tmp_path / "bake", capsys)
    assert code == 0
    assert any(word in event["message"] for event in events if event["event"] == "warning") or not word
    relume.validate(tmp_path / "bake")


@pytest.mark.parametrize("fast_gi", [False, True])
def test_where_nothing_but_the_world_is_left_it_is_rendered_as_by_cycles(shot, tmp_path, capsys, fast_gi):
    add_world(shot)
    bpy.data.objects.remove(shot.objects["Key"])
    shot.view_layers[0].use_solid, shot.cycles.use_fast_gi = False, fast_gi
    code, events = bake(tmp_path / "bake", capsys)
    warnings = [event["message"] for event in events if event["event"] == "warning"]
    assert code == 0 and any("nothing to render but its world" in warning for warning in warnings)
    lights = load_scene(shot).lights()
    ours = relume.Relighter(tmp_path / "bake").relight(lights, denoise=False)["combined"]
    assert ours.shape[:2] == (12, 16) and abs(ours - render_cycles(shot, 1)).max() < 1e-3


@pytest.mark.parametrize(
    "view, size, samples, limit",
    [
        ("Standard", 64, 64, 200_000),  # in the middle of the shards
        ("AgX", 16, 2, 60_000),  # at the view transform's table, behind them
    ],
)
def test_full_disk_keeps_whole_files_and_the_bake_goes_on(shot, tmp_path, view, size, samples, limit):
    resource = pytest.importorskip("resource", reason="Windows has no limit on the size of a process's files")
    shot.render.resolution_x = shot.render.resolution_y = size
    shot.view_settings.view_transform = view
    blend, folder = tmp_path / "shot.blend", tmp_path / "bake"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    command = [sys.executable, REPOSITORY / "relume_bake.py", blend, "--", "bake", "--out", folder]
    command += ["--samples", str(samples)]

    def limit_files():
        # A write beyond the limit fails half-way, as on a full disk.
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    full = subprocess.run(command, capture_output=True, text=True, timeout=120, preexec_fn=limit_files)
    errors = [line for line in full.stderr.splitlines() if line.startswith("Error")]
    assert full.returncode == 1 and len(errors) == 1, full.stderr
    assert folder.exists() and not [path for path in folder.iterdir() if path.name.startswith(".")]
    assert not (folder / "view.png").exists()
    subprocess.run([*command, "--resume", "--quiet"], check=True, timeout=120)
    assert (folder / "view.png").exists() == (view != "Standard")
    relume.validate(folder)
