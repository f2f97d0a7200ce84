"""The list of shots as plain data: names, folders, problems, and the file for other programs."""

import json
from pathlib import Path

import pytest

from addon.core.shots import (
    ListedShot,
    Marker,
    ShotsError,
    chosen,
    free_key,
    free_name,
    problems,
    relative,
    shots_of_markers,
    write_file,
)

HERE = Path("/shots").absolute()


def shot(name, camera="Camera", **values):
    """A shot in the folder of its name."""
    return ListedShot(name, camera, values.pop("folder", HERE / name), key=name, **values)


def test_names_are_numbered_as_blender_does():
    assert free_name("Wide", set()) == "Wide"
    assert free_name("Wide", {"Wide", "Wide.001"}) == "Wide.002"


def test_folders_of_shots_differ_on_every_file_system():
    keys = []
    for name in ("a/b", "a_b", "A:B", "..", "C.001", "C.001", "shots.json"):
        keys.append(free_key(name, {"shots.json", *keys}))
    assert keys == ["a_b", "a_b_2", "A_B_3", "shot", "C.001", "C.001_2", "shots.json_2"]
    assert not any(set(key) & set('/\\:*?"<>|') for key in keys)


def test_markers_become_shots_in_the_order_of_frames_and_only_once():
    markers = [Marker("Late", 40, "B"), Marker("Early", 1, "A"), Marker("Again", 1, "A"), Marker("Known", 20, "A")]
    found = shots_of_markers(markers, known={("A", 20)})
    assert [(marker.name, marker.frame) for marker in found] == [("Early", 1), ("Late", 40)]


def test_what_keeps_a_shot_from_being_baked_is_said_of_each():
    listed = [
        shot("Good", layer="Hero"),
        shot("Gone", camera="Deleted"),
        shot("None", camera=""),
        shot("Layer", layer="Renamed"),
        shot("Same", folder=HERE / "Good"),
        shot("Other", folder=HERE / "copy"),
        shot("Foreign", camera="", is_foreign=True),
    ]
    said = problems(listed, {"Camera"}, {"Hero"}, {HERE / "copy": "shot 'A' of scene 'B'"}, lambda _folder: False)
    assert said.keys() == {"Gone", "None", "Layer", "Same", "Other", "Foreign"}
    assert "'Deleted' is not in the scene" in said["Gone"] and "no camera" in said["None"]
    assert "'Renamed'" in said["Layer"] and "shot 'Good'" in said["Same"] and "scene 'B'" in said["Other"]
    assert "no bake" in said["Foreign"]
    assert problems(listed[:1], {"Camera"}, {"Hero"}, {}) == {}


def test_shots_are_chosen_by_name_or_all_that_are_on():
    listed = [shot("A"), shot("B", on=False), shot("Hall, night")]
    assert [found.name for found in chosen(listed, "all")] == ["A", "Hall, night"]
    assert [found.name for found in chosen(listed, "B, A,B")] == ["B", "A"]
    assert [found.name for found in chosen(listed, "Hall, night")] == ["Hall, night"]
    with pytest.raises(ShotsError, match="no shot 'C'; there are 'A', 'B'"):
        chosen(listed, "A,C")
    with pytest.raises(ShotsError, match="no shot is named"):
        chosen(listed, " , ")
    with pytest.raises(ShotsError, match="switched on"):
        chosen([shot("B", on=False)], "all")


def baked(folder):
    """A folder that holds a bake, as far as its manifest goes."""
    folder.mkdir(parents=True)
    manifest = {"scene_hash": "", "passes": [], "tile_size": 64, "width": 64, "height": 48}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def test_the_file_lists_what_is_baked_with_paths_from_its_own_folder(tmp_path):
    folder, elsewhere = baked(tmp_path / "relume" / "wide"), baked(tmp_path / "elsewhere")
    listed = [
        shot("Wide", folder=folder, frame=12, layer="Hero"),
        shot("Empty", folder=tmp_path / "relume" / "none"),
        shot("Off", folder=folder, on=False),
        shot("Foreign", folder=elsewhere, is_foreign=True),
    ]
    file = tmp_path / "relume" / "shots.json"
    assert write_file(listed, file, str(tmp_path / "file.blend")) == ["Wide", "Foreign"]
    content = json.loads(file.read_text())
    assert (content["format"], content["version"]) == ("relume-shots", 1)
    wide, foreign = content["shots"]
    assert wide == {
        "name": "Wide",
        "bake": "wide",
        "camera": "Camera",
        "frame": 12,
        "layer": "Hero",
        "size": [64, 48],
        "source": "../file.blend",
    }
    assert (foreign["bake"], foreign["source"], foreign["frame"]) == ("../elsewhere", "", None)
    assert write_file(listed[1:3], file, "") == [] and not file.exists()


def test_relative_paths_have_forward_slashes():
    assert relative(HERE / "a" / "b", HERE) == "a/b"
