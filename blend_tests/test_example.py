"""The example script as a user runs it: a file, a picture that another program made, and lights in a new file."""

import subprocess
import sys
from pathlib import Path

import bpy
import pytest
import relume

from addon.commands import run
from helpers import add_light, add_material, add_quad

SCRIPT = Path(__file__).resolve().parents[1] / "examples" / "solve_from_png.py"


@pytest.fixture
def shot(scene, tmp_path):
    """A file with a lit plane, its bake, and a picture in which the plane has twice the light."""
    scene.view_settings.view_transform = "Standard"
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=4.0, material=material)
    key = add_light(scene, "POINT", name="Key", shadow_soft_size=0.5).data
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 32, 24, 64
    blend, bake, picture = (tmp_path / name for name in ("shot.blend", "bake", "edited.exr"))
    assert run(["bake", "--out", str(bake), "--quiet"]) == 0
    key.energy = 40.0
    assert run(["relight", str(bake), "--out", str(picture), "--quiet"]) == 0
    key.energy = 20.0
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    return blend, bake, picture.with_suffix(".png")


def solved(shot, *options, says=()):
    """Runs the script, which is to say some lines, and opens what it has written."""
    out = shot[0].with_name("solved.blend")
    command = [sys.executable, SCRIPT, *shot, "--out", out, "--starts", "2", *options]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0 and f"Wrote {out}" in done.stdout, done.stdout + done.stderr
    assert "Target read as this scene displays it" in done.stdout and "reached" in done.stdout
    assert all(line in done.stdout for line in says), done.stdout
    bpy.ops.wm.open_mainfile(filepath=str(out))
    return bpy.data.objects


def test_the_lights_of_the_file_are_given_the_strength_of_the_picture(shot):
    key = solved(shot, "--free", "strength")["Key"]
    # The picture has 8 bits, and both pictures the noise of the same 64 samples.
    assert key.data.energy == pytest.approx(40.0, rel=0.02)
    assert tuple(key.location) == (0.0, 0.0, 2.0), "its place was not free"


def test_a_light_can_be_added(shot):
    objects = solved(shot, "--free", "color", "--add", "1")
    assert [obj.name for obj in bpy.data.collections["Relume"].objects] == ["Relume Light"]
    key = objects["Key"].data
    luminance = sum(weight * channel for weight, channel in zip((0.2126, 0.7152, 0.0722), key.color, strict=True))
    assert luminance * key.energy == pytest.approx(20.0, rel=1e-3), "its strength was not free"


def test_linked_lights_shine_and_what_cannot_be_written_is_said(shot):
    key = bpy.data.objects["Key"]
    key.light_linking.receiver_collection = bpy.data.collections.new("Receivers")
    key.light_linking.receiver_collection.objects.link(bpy.data.objects["Plane"])
    fill = add_light(bpy.context.scene, "POINT", name="Fill", shadow_soft_size=0.1).data
    fill.cycles.is_caustics_light = True
    fill.energy = 0.0
    fill.driver_add("energy")
    bpy.ops.wm.save_as_mainfile(filepath=str(shot[0]))
    says = (
        "Warning: light 'Fill': shadow caustics",
        "Warning: light 'Fill' has a driver on its energy: that stays",
    )
    key = solved(shot, "--free", "strength", says=says)["Key"]
    assert key.data.energy == pytest.approx(40.0, rel=0.02)


def test_a_bake_that_was_stopped_is_made_whole(shot):
    bake = shot[1]
    next(bake.rglob("*.safetensors")).unlink()
    done, wanted = relume.info(bake)["shards"]
    assert done < wanted
    solved(shot, "--free", "strength")
    assert relume.info(bake)["shards"] == [wanted, wanted]


@pytest.mark.parametrize(
    ("picture", "options", "says"),
    [
        ("missing.png", (), "missing.png"),
        ("black.png", (), "is all black"),
        (None, ("--lights", "Kye"), "the shot has no light Kye; there are Key"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(shot, picture, options, says):
    blend, bake, edited = shot
    if picture == "black.png":
        black = bpy.data.images.new("Black", 32, 24)
        black.filepath_raw, black.file_format = str(blend.with_name(picture)), "PNG"
        black.save()
    out = blend.with_name("solved.blend")
    command = [sys.executable, SCRIPT, blend, bake, blend.with_name(picture) if picture else edited, "--out", out]
    command += options
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1 and says in done.stderr and "Traceback" not in done.stderr, done.stdout + done.stderr
    assert not out.exists()
