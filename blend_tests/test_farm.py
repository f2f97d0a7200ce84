"""Bakes for a farm: the job of frames, its parts without Blender, and the panel that writes it and brings it home."""

import bpy
import pytest

import addon
from addon.commands import run
from addon.core.command_line import UsageError, parse
from addon.engine.shot import shot
from addon.engine.shot.background import BackgroundError
from addon.engine.shot.checks import ProblemError
from addon.engine.shot.farm import FARMS, job_folder
from addon.engine.shot.options import remembered_bake
from addon.ui import background, farm
from helpers import add_light, add_material, add_quad, ended


@pytest.fixture
def room(scene, tmp_path):
    """A lit plane that rises from frame to frame, in a saved file; small."""
    addon.register()
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    plane = add_quad(scene, size=4.0, material=material)
    for frame, height in ((1, 0.0), (2, 0.5)):
        plane.location.z = height
        plane.keyframe_insert("location", frame=frame)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    scene.frame_set(1)
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    scene.cycles.samples = 4
    scene.relume.quality, scene.relume.samples = "CUSTOM", 4
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    yield bpy.context.scene
    addon.unregister()
    shot.close_all()


def contents(folder):
    """Names and bytes of a folder's files."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.every_version
def test_frames_that_parts_have_traced_are_the_bakes_of_one_machine(room, tmp_path):
    job, tile = tmp_path / "job", ["--tile", "16"]
    assert run(["farm", "--out", str(job), "--frames", "1-2", "--parts", "3", "--emit", "openjd", *tile]) == 0
    assert {path.name for path in job.iterdir()} == {"plan.json", "template.json", "0001", "0002"}
    for parts in ("4-6", "2", "1", "3"):
        assert run(["work", str(job), "--part", parts, "--quiet"]) == 0
    assert run(["collect", str(job), "--quiet"]) == 0
    for frame in ("1", "2"):
        assert run(["bake", "--out", str(tmp_path / frame), "--frame", frame, "--quiet", *tile]) == 0
        assert contents(job / f"000{frame}") == contents(tmp_path / frame)
    assert contents(tmp_path / "1") != contents(tmp_path / "2")


def test_the_panel_writes_the_job_beside_the_file_and_brings_it_home(room, tmp_path):
    room.relume.farm_kind, room.relume.farm_parts = "slurm", 2
    assert bpy.ops.relume.farm_write() == {"FINISHED"}
    with pytest.raises(BackgroundError, match="another job"):
        farm.bring_home(room)
    written = ended(background.background.of(room))
    folder = job_folder(room)
    assert written.done and "2 parts" in written.done_words, written.error
    assert folder.is_relative_to(tmp_path) and (folder / "slurm.sh").exists()
    assert shot.of(room) is None, "there is nothing to show yet"

    assert run(["work", str(folder), "--part", "1", "--quiet"]) == 0
    assert bpy.ops.relume.farm_collect() == {"FINISHED"}
    incomplete = ended(background.background.of(room))
    assert "parts 2 are missing" in incomplete.error and shot.of(room) is None
    assert run(["work", str(folder), "--part", "2", "--quiet"]) == 0
    home = ended(farm.bring_home(room))
    assert home.done and "All 1 bakes" in home.done_words, home.error
    found = shot.of(room)
    assert found.folder == folder / "0001" == remembered_bake(room)
    assert found.changes.sentences == [] and not found.warnings


def test_every_farm_of_the_panel_is_one_that_the_program_writes_for(room, tmp_path):
    emitted = [f"--emit={kind}" for kind in FARMS]
    assert run(["farm", "--out", str(tmp_path / "job"), "--quiet", *emitted]) == 0
    assert run(["farm", "--out", str(tmp_path / "job"), "--quiet", "--emit", "tractor"]) == 1


def test_what_cannot_be_written_or_brought_home_is_said(room):
    with pytest.raises(BackgroundError, match="there is no job in"):
        farm.bring_home(room)
    room.camera = None
    with pytest.raises(RuntimeError, match="has no camera"):
        bpy.ops.relume.farm_write()
    bpy.ops.wm.read_homefile(use_empty=True)
    with pytest.raises(ProblemError, match="save the file first"):
        farm.write(bpy.context.scene)


def test_frames_are_numbers_and_ranges():
    words = ["farm", "--out", "job"]
    assert parse([*words, "--frames", "10, 1-3,2"])[0].frames == [1, 2, 3, 10]
    assert parse([*words, "--frames=-2--1"])[0].frames == [-2, -1]
    for wrong in ("", "a", "3-1", "1-", "1,,2", "1-99999999"):
        with pytest.raises(UsageError, match="names no frames"):
            parse([*words, "--frames", wrong])
