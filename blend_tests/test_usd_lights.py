"""Lights of a look go to OpenUSD and come back, by Relume and by Blender's own exporter and importer."""

import json
import math

import bpy
import numpy as np
import pytest

from addon.commands import run
from addon.core.looks import from_json
from addon.core.rows import GROUP
from addon.live import rows
from addon.ui import looks
from helpers import add_light, add_material, add_quad, exported, render_cycles, row, update

pytestmark = pytest.mark.every_version

IS_NEW = bpy.app.version >= (4, 5, 0)


def numbers(value):
    """All numbers in a light's shape, in order."""
    if isinstance(value, dict):
        return [number for key in sorted(value) for number in numbers(value[key])]
    return [number for entry in value for number in numbers(entry)] if isinstance(value, list) else [value]


def same(found, wanted):
    """Checks that two lists of native lights shine alike."""
    assert [light["name"] for light in found] == [light["name"] for light in wanted]
    for one, other in zip(found, wanted, strict=True):
        assert one["radiance"] == pytest.approx(other["radiance"], rel=2e-5), other["name"]
        assert one["shape"]["type"] == other["shape"]["type"]
        shapes = [[value for value in numbers(light["shape"]) if not isinstance(value, str)] for light in (one, other)]
        assert shapes[0] == pytest.approx(shapes[1], abs=2e-5), other["name"]


def add_rig(scene):
    """A light of each kind, turned and scaled."""
    add_quad(scene)
    newer = {"exposure": 1.0, "normalize": False, "use_temperature": True, "temperature": 3000.0} if IS_NEW else {}
    made = [
        add_light(scene, "POINT", "Bulb", (1, 2, 3), shadow_soft_size=0.3, use_soft_falloff=False, color=(1, 0.5, 0.2)),
        add_light(scene, "POINT", "Pin", (1, 0, 3), shadow_soft_size=0.0),
        add_light(scene, "SPOT", "Spot", (0, 1, 3), spot_size=1.2, spot_blend=0.4, shadow_soft_size=0.1, **newer),
        add_light(scene, "SUN", "Sun", angle=0.2, energy=3.0, **newer),
        add_light(scene, "AREA", "Square", (2, 2, 2), shape="SQUARE", size=0.5, **newer),
        add_light(scene, "AREA", "Rectangle", (2, 1, 2), shape="RECTANGLE", size=0.5, size_y=1.5, spread=2.0),
        add_light(scene, "AREA", "Disk", (2, 0, 2), shape="DISK", size=0.5),
        add_light(scene, "AREA", "Ellipse", (2, -1, 2), shape="ELLIPSE", size=0.5, size_y=1.5, **newer),
    ]
    for obj in made:
        obj.rotation_euler = (0.3, 0.5, 0.2)
        obj.scale = (1.5, 1.5, 1.5) if obj.data.type == "SPOT" else (2.0, 0.5, 1.0)
    update()
    return made


def spoil(made):
    """Makes lights others than they were."""
    for obj in made:
        obj.matrix_world.identity()
        obj.location = (0, 0, 5)
        obj.data.type, obj.data.energy, obj.data.color = "POINT", 7.0, (0, 0, 1)
        obj.data.shadow_soft_size = 0.7
    update()


def test_lights_come_back_as_they_shone(scene, registered_for_all_files, tmp_path):
    made, path = add_rig(scene), tmp_path / "rig.usda"
    before = exported(scene)["lights"]
    assert bpy.ops.relume.export_lights(filepath=str(path)) == {"FINISHED"}
    spoil(made)
    assert bpy.ops.relume.import_lights(filepath=str(path)) == {"FINISHED"}
    looks.restore(scene, looks.active_look(scene).look(), lights=True)
    update()
    same(exported(scene)["lights"], before)
    assert made[0].scale[:] == pytest.approx((2.0, 0.5, 1.0), abs=1e-5), "an object keeps its scale"


def test_the_present_picture_is_what_is_written(rigged, tmp_path):
    row(rigged, "Key").exposure = 1.0
    row(rigged, "Key").color = (1.0, 0.5, 0.25)
    row(rigged, "Rig", GROUP).on = False
    path = tmp_path / "rig.usda"
    bpy.ops.relume.export_lights(filepath=str(path))
    bpy.ops.relume.import_lights(filepath=str(path))
    kept = {light["name"]: light["settings"]["energy"] for light in looks.active_look(rigged).look().lights}
    assert kept == pytest.approx({"Key": 200, "Fill": 100})
    looks.restore(rigged, looks.active_look(rigged).look(), lights=True)
    assert not row(rigged, "Fill").on and row(rigged, "Key").exposure == 0.0
    assert row(rigged, "Rig", GROUP).on, "only the light is off"
    assert rigged.objects["Key"].data.color[:] == pytest.approx((1.0, 0.5, 0.25))


def test_the_rig_of_another_scene_is_made_where_it_is_not(rigged, tmp_path):
    path = tmp_path / "rig.usda"
    path.write_text(
        '#usda 1.0\n( metersPerUnit = 1 upAxis = "Z" )\ndef SphereLight "Moon" { float inputs:radius = 1 }\n'
    )
    bpy.ops.relume.import_lights(filepath=str(path))
    outcome = looks.restore(rigged, looks.active_look(rigged).look(), lights=True)
    assert rigged.objects["Moon"].data.energy == pytest.approx(4 * math.pi**2)
    assert sorted(outcome.unknown) == ["Fill", "Key"] and not row(rigged, "Key").on and row(rigged, "Moon").on


def test_a_look_of_the_list_is_written_by_name_and_by_file(rigged, tmp_path, capsys):
    row(rigged, "Key").on = False
    looks.snapshot(rigged, "Night")
    row(rigged, "Key").on = True
    looks.export_file(looks.active_look(rigged).look(), tmp_path / "night.json")
    for source in ("Night", str(tmp_path / "night.json")):
        out, back = tmp_path / "out.usda", tmp_path / "back.json"
        assert run(["export-lights", "--look", source, "--out", str(out), "--quiet"]) == 0
        assert run(["import-lights", str(out), "--out", str(back), "--json"]) == 0
        found = from_json(back.read_text())
        assert found.name == "Night" and {one.name: one.on for one in found.rows} == {"Key": False, "Fill": True}
        assert json.loads(capsys.readouterr().out.splitlines()[-1])["lights"] == 2
    for words, says in (
        (["export-lights", "--look", "Noon", "--out", str(out)], "'Night'"),
        (["export-lights", "--out", str(tmp_path / "out.usdc")], ".usda"),
        (["import-lights", str(tmp_path / "none.usda"), "--out", "x.json"], "none.usda"),
    ):
        assert run(words) == 1 and says in capsys.readouterr().err


def test_what_the_file_cannot_say_is_named(scene, registered_for_all_files, tmp_path, capsys):
    add_quad(scene)
    lamp = add_light(scene, "AREA", "Soft", spread=1.0)
    lamp.light_linking.receiver_collection = bpy.data.collections.new("Lit")
    lit = add_light(scene, "POINT", "Lit")
    lit.data.use_nodes = True
    emission = next(node for node in lit.data.node_tree.nodes if node.type == "EMISSION")
    emission.inputs["Strength"].default_value = 2.0
    update()
    assert run(["export-lights", "--out", str(tmp_path / "out.usda")]) == 0
    told = capsys.readouterr().out
    assert "'Soft' is written without its light linking" in told and "'Soft': other programs" in told
    assert run(["import-lights", str(tmp_path / "out.usda"), "--out", str(tmp_path / "look.json")]) == 0
    kept = {light["name"]: light["settings"] for light in from_json((tmp_path / "look.json").read_text()).lights}
    assert kept["Soft"]["spread"] == pytest.approx(1.0) and kept["Lit"]["energy"] == pytest.approx(200)


def test_blenders_own_files_are_read(scene, registered_for_all_files, tmp_path):
    made = [obj for obj in add_rig(scene) if obj.name not in {"Ellipse", "Rectangle"}]
    for name in ("Ellipse", "Rectangle"):  # Blender writes neither an ellipse nor a spread.
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.data.objects["Bulb"].data.use_soft_falloff = True
    for obj in made:
        obj.scale = (1.0, 1.0, 1.0)
        if IS_NEW:  # Nor a size that power depends on. Up to 5.0 it writes temperatures as on even where they are off.
            obj.data.normalize, obj.data.use_temperature = True, True
    update()
    before = exported(scene)["lights"]
    bpy.ops.wm.usd_export(filepath=str(tmp_path / "own.usda"))
    spoil(made)
    bpy.ops.relume.import_lights(filepath=str(tmp_path / "own.usda"))
    looks.restore(scene, looks.active_look(scene).look(), lights=True)
    update()
    same(exported(scene)["lights"], before)


def test_blenders_own_importer_shows_the_same_light(scene, registered_for_all_files, tmp_path):
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    for obj in add_rig(scene):
        obj.data.energy = 0.2 if obj.data.type == "SUN" else obj.data.energy / 10
        if obj.name == "Bulb":
            obj.data.use_soft_falloff = True
        if obj.name == "Rectangle":
            obj.data.spread = math.pi
    scene.objects["Plane"].data.materials.append(material)
    scene.objects["Plane"].scale = (5, 5, 1)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 6.0
    scene.camera.location, scene.camera.rotation_euler = (0, 0, 20), (0, 0, 0)
    scene.render.resolution_x = scene.render.resolution_y = 16
    row(scene, "Square").on = False
    rows.sync(scene)
    path = tmp_path / "rig.usda"
    bpy.ops.relume.export_lights(filepath=str(path), for_blender=True)
    scene.objects["Square"].hide_render = True
    before = render_cycles(scene, samples=400, max_bounces=0)
    for obj in [obj for obj in scene.objects if obj.type == "LIGHT"]:
        bpy.data.objects.remove(obj)
    bpy.ops.wm.usd_import(filepath=str(path))
    after = render_cycles(scene, samples=400, max_bounces=0)
    assert len([obj for obj in scene.objects if obj.type == "LIGHT"]) == 7
    blocks = [picture.reshape(4, 4, 4, 4, 3).mean(axis=(1, 3)) for picture in (before, after)]
    assert blocks[1] == pytest.approx(blocks[0], rel=0.02)
    assert np.ptp(blocks[0]) > 0.1
