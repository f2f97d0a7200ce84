"""Motion blur: what moves is read at keys, and is seen as Cycles sees it."""

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.engine.staleness import fingerprints
from addon.export import trace_settings
from helpers import add, add_material, add_quad, exported, render_cycles

FRAME = 10


@pytest.fixture
def blurred(scene):
    """A scene with motion blur and a floor that stands still."""
    scene.render.use_motion_blur = True
    scene.frame_set(FRAME)
    add_quad(scene, "Floor", size=6.0).location.z = -1.0
    return scene


def animate(block, path, before, after, frames=(FRAME - 1, FRAME + 1)):
    """Motion between two frames, through the one that is shown."""
    for frame, value in zip(frames, (before, after), strict=True):
        setattr(block, path, value)
        block.keyframe_insert(path, frame=frame)
    bpy.context.scene.frame_set(FRAME)


def glowing(name="Glow"):
    material, tree, output = add_material(name)
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def keys_of(found, kind="instances"):
    return {part["name"]: part["motion_keys"] for part in found[kind]}


def test_what_moves_has_keys_and_the_frame_is_kept(blurred):
    turning = add_quad(blurred, "Turning")
    turning.cycles.motion_steps = 2
    animate(turning, "rotation_euler", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    still = add_quad(blurred, "Unblurred")
    still.cycles.use_motion_blur = False
    animate(still, "location", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    animate(blurred.camera, "location", (0.0, 0.0, 5.0), (0.2, 0.0, 5.0))
    animate(blurred.camera.data, "lens", 50.0, 60.0)
    blurred.frame_set(FRAME, subframe=0.25)
    found = exported(blurred)
    assert keys_of(found) == {"Floor": 0, "Turning": 5, "Unblurred": 0}
    camera = found["camera"]
    assert len(camera["motion"]) == 3 and set(camera["shutter"]["curve"]) == {1.0}
    assert (blurred.frame_current, blurred.frame_subframe) == (FRAME, 0.25)
    lenses = []
    for part in (0.0, 0.25, 0.5):
        blurred.frame_set(FRAME, subframe=part)
        lenses.append(blurred.camera.data.lens)
    opening, middle, closing = lenses
    assert camera["zoom"] == pytest.approx([middle / opening, middle / closing], rel=1e-5)


def test_orthographic_cameras_move_from_blender_5_2_on(blurred):
    blurred.camera.data.type = "ORTHO"
    animate(blurred.camera, "location", (0.0, 0.0, 5.0), (0.2, 0.0, 5.0))
    assert ("motion" in exported(blurred)["camera"]) == (bpy.app.version >= (5, 2, 0))


def test_scenes_in_which_nothing_moves_are_those_without_blur(blurred):
    before = exported(blurred)
    blurred.render.use_motion_blur = False
    assert exported(blurred) == before and "shutter" not in before["camera"]


def test_shapes_are_followed_where_objects_allow_it(blurred):
    names = ("Bent", "Stiff", "Thrown")
    for name in names:
        quad = add_quad(blurred, name)
        quad.cycles.use_deform_motion = name != "Stiff"
        if name == "Thrown":
            quad.data.attributes.new("velocity", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", [1.0] * 12)
            continue
        quad.shape_key_add(name="Basis")
        key = quad.shape_key_add(name="Up")
        key.data[0].co.z = 1.0
        animate(key, "value", 0.0, 1.0)
    found = exported(blurred)
    assert keys_of(found, "meshes") == {"Floor": 0, "Bent": 3, "Stiff": 0, "Thrown": 3}
    assert set(keys_of(found).values()) == {0}


def test_vertices_that_come_and_go_leave_the_shape_of_the_frame(blurred):
    mesh = bpy.data.meshes.new("Growing")
    corners = [(x, y, 0) for x in range(4) for y in range(2)]
    mesh.from_pydata(corners, [], [(0, 2, 3, 1), (2, 4, 5, 3), (4, 6, 7, 5)])
    build = add(blurred, "Growing", mesh).modifiers.new("Build", "BUILD")
    build.frame_start, build.frame_duration = FRAME - 1, 2
    assert all(keys == 0 for keys in keys_of(exported(blurred), "meshes").values())


def test_strands_move_by_velocity(blurred):
    hair = bpy.data.hair_curves.new("Tuft")
    hair.add_curves([3, 3])
    hair.attributes["position"].data.foreach_set("vector", np.arange(18, dtype=np.float32) * 0.1)
    hair.attributes.new("velocity", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", [1.0] * 18)
    add(blurred, "Tuft", hair)
    assert keys_of(exported(blurred), "curves") == {"Tuft": 3}


@pytest.mark.parametrize("position", ["CENTER", "START", "END"])
def test_a_plate_is_blurred_as_in_cycles(scene, position, tmp_path):
    """It speeds up, grows and turns; the shutter is open longest at the end. Light comes from nothing else."""
    scene.render.use_motion_blur, scene.render.motion_blur_position = True, position
    scene.render.motion_blur_shutter = 1.0
    points = scene.render.motion_blur_shutter_curve.curves[0].points
    points[0].location, points[-1].location = (0.0, 0.1), (1.0, 1.0)
    scene.render.motion_blur_shutter_curve.update()
    plate = add_quad(scene, "Plate", size=1.2, material=glowing())
    plate.cycles.motion_steps = 3
    for frame, x, angle, scale in (
        (8, -2.5, -0.5, 0.5),
        (9, -1.8, -0.3, 0.8),
        (10, -0.5, 0.0, 1.0),
        (12, 2.0, 1.0, 1.4),
    ):
        plate.location.x, plate.rotation_euler.z, plate.scale = x, angle, (scale, 1.0, 1.0)
        for path in ("location", "rotation_euler", "scale"):
            plate.keyframe_insert(path, frame=frame)
    scene.frame_set(FRAME)
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    scene.render.resolution_x, scene.render.resolution_y = 32, 16
    settings = trace_settings(scene, lambda _: None) | {"samples": 512}
    exported = load_scene(scene)
    relume.bake(exported, tmp_path / "bake", settings).wait()
    ours = relume.Relighter(tmp_path / "bake").relight(exported.lights(), denoise=False)["combined"]
    cycles = render_cycles(scene, samples=512)[::-1]
    # Of 16 pixels of a column 6 at most are covered for a part of the time: four standard errors of the difference.
    assert np.abs((ours - cycles).mean(axis=(0, 2))).max() < 4.0 * np.sqrt(2.0 * 6 / 16 * 0.25 / (16 * 512))
    assert cycles.max() > 0.3


@pytest.mark.parametrize("birth, lifetime, is_there", [(9.6, 50.0, True), (9.9, 50.0, False), (1.0, 9.1, False)])
def test_particles_that_do_not_live_all_the_while_are_left_out_as_by_cycles(blurred, birth, lifetime, is_there):
    shown = add_quad(blurred, "Shown", 1.0, glowing())
    shown.location.x = 100.0
    emitter = add_quad(blurred, "Emitter", size=0.01)
    emitter.show_instancer_for_render = False
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.count, settings.lifetime, settings.frame_start, settings.frame_end = 1, lifetime, birth, birth
    settings.normal_factor = settings.effector_weights.gravity = 0.0
    settings.render_type, settings.instance_object, settings.particle_size = "OBJECT", shown, 1.0
    for frame in range(1, FRAME + 1):
        blurred.frame_set(frame)
    names = [instance["name"] for instance in exported(blurred)["instances"]]
    assert names.count("Shown") == 1 + is_there
    assert (render_cycles(blurred, 16).max() > 0.1) == is_there


def test_particle_hair_with_other_keys_in_the_interval_is_named(blurred):
    emitter = add_quad(blurred, "Furry")
    emitter.modifiers.new("Hair", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.type, settings.count = "HAIR", 3
    assert not any("Furry" in warning for warning in load_scene(blurred).warnings)
    for frame, steps in ((FRAME, 2), (FRAME + 0.1, 3)):
        settings.render_step = steps
        settings.keyframe_insert("render_step", frame=frame)
    blurred.frame_set(FRAME)
    assert any("Furry" in warning and "number of keys" in warning for warning in load_scene(blurred).warnings)


def test_changes_of_the_motion_are_noticed(blurred):
    quad = add_quad(blurred, "Quad")
    animate(quad, "location", (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0))

    def taken():
        return fingerprints.all_fingerprints(blurred, blurred.camera)

    before = taken()
    blurred.render.motion_blur_shutter = 0.25
    assert taken()["motion"]["shutter"] != before["motion"]["shutter"]
    blurred.render.motion_blur_shutter = 0.5
    assert taken() == before
    quad.keyframe_insert("location", frame=FRAME + 2)
    assert taken()["motion"]["animation"] != before["motion"]["animation"]
    quad.cycles.motion_steps = 3
    assert taken()["object Quad"]["motion"] != before["object Quad"].get("motion")
    blurred.render.use_motion_blur = False
    assert set(taken()["motion"]) == {"shutter"}
