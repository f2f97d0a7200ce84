"""View layers whose names have dots and slashes: their folders, files, passes and mattes."""

import bpy
import numpy as np
import pytest
import relume

from addon.commands import run
from addon.core.bake_folder import is_bake
from addon.engine.shot import background, shot, shot_list
from addon.export.current_shot import entries
from exr import read_exr, read_fields
from helpers import write_multilayer

pytestmark = pytest.mark.every_version

NAME, OTHER = "fg.v2/hero", "fg.v2_hero"
"""Names of layers that would be the same as names of files."""


@pytest.fixture
def layered(studio):
    """A scene with two layers, each with a shot of its name."""
    studio.relume.samples = studio.cycles.samples = 4
    studio.view_layers[0].name = NAME
    studio.view_layers.new(OTHER).use = False
    for name in (NAME, OTHER):
        shot_list.add(studio, name, studio.camera, frame=1).layer = name
    yield studio
    background.close_all()
    shot.close_all()


def test_each_layer_has_a_folder_and_files_of_its_own(layered, tmp_path):
    assert run(["bake", "--shots", "all", "--samples", "1", "--quiet"]) == 0
    folders = [listed.folder for listed in shot_list.all_shots(layered)]
    assert [folder.name for folder in folders] == ["Scene_fg.v2_hero", "Scene_fg.v2_hero_2"]
    assert all(folder.parent == tmp_path / "bake" and is_bake(folder) for folder in folders)
    listed, names = shot_list.write_file(layered)
    assert names == [NAME, OTHER]
    assert run(["relight", "--shots", str(listed), "--out", str(tmp_path / "{shot}.exr"), "--quiet"]) == 0
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["fg.v2_hero.exr", "fg.v2_hero_2.exr"]
    assert [entry.layer for entry in entries(layered)] == [NAME, OTHER]
    assert run(["bake", "--layer", NAME, "--out", str(tmp_path / "one"), "--samples", "1", "--quiet"]) == 0
    assert relume.info(tmp_path / "one") is not None


def test_the_file_of_a_render_names_passes_as_that_of_cycles(layered, tmp_path):
    layer = layered.view_layers[NAME]
    layer.use_pass_cryptomatte_object = layer.use_pass_z = layer.use_pass_position = True
    layered.cycles.use_denoising = False
    write_multilayer(layered, tmp_path / "f12.exr")
    found = {}
    for engine in ("RELUME", "CYCLES"):
        layered.render.engine = engine
        bpy.ops.render.render(write_still=True)
        found[engine] = read_exr(tmp_path / "f12.exr"), read_fields(tmp_path / "f12.exr")
    (ours, fields), (theirs, their_fields) = found["RELUME"], found["CYCLES"]
    assert {f"{NAME}.Combined.R", f"{NAME}.Depth.Z", f"{NAME}.Position.X", f"{NAME}.CryptoObject00.r"} <= set(theirs)
    assert set(theirs) - set(ours) == set() and f"{NAME}.Combined_Key.R" in ours
    mattes = [{name for name in each if name.startswith("cryptomatte/")} for each in (fields, their_fields)]
    assert mattes[0] == mattes[1] and f"{NAME}.CryptoObject" in fields.values()
    np.testing.assert_array_equal(ours[f"{NAME}.CryptoObject00.r"], theirs[f"{NAME}.CryptoObject00.r"])
