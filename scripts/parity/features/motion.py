"""Scenes in which things move while the shutter is open. Need `bpy`."""

import bpy
import numpy as np

from . import stage

FRAME = 10


def turning_scaling_and_panning(scene):
    """A bar that turns, a cube that grows, and a camera that pans and zooms."""
    _blur(scene, 0.8)
    bar = stage.add_box(scene, "Bar", 1.0, _grey(), (-0.6, 0.0, 0.2))
    bar.scale = (1.2, 0.12, 0.12)
    _animate(bar, "rotation_euler", (0.2, -1.2, 0.1), (0.4, 1.2, 0.3))
    bar.cycles.motion_steps = 3
    cube = stage.add_box(scene, "Cube", 0.5, _grey(), (0.9, 0.2, -0.3))
    _animate(cube, "scale", (0.4, 0.8, 1.0), (1.6, 1.2, 1.0))
    _animate(scene.camera, "rotation_euler", (1.35, 0.0, -0.06), (1.35, 0.02, 0.06))
    _animate(scene.camera.data, "lens", scene.camera.data.lens * 0.94, scene.camera.data.lens * 1.06)


def shutter_that_starts_at_the_frame(scene):
    """A shutter that opens at the frame and is open longest at the end; a ball in a shot that speeds up."""
    _blur(scene, 1.0, "START")
    curve = scene.render.motion_blur_shutter_curve.curves[0]
    curve.points[0].location, curve.points[-1].location = (0.0, 0.1), (1.0, 1.0)
    scene.render.motion_blur_shutter_curve.update()
    _add_speeding_ball(scene)


def shutter_that_ends_at_the_frame(scene):
    """A shutter that closes at the frame, with a ball in a shot that speeds up."""
    _blur(scene, 0.7, "END")
    _add_speeding_ball(scene)


def rolling_shutter(scene):
    """Lines of the film that are exposed one after the other, before a bar that moves sideways."""
    _blur(scene, 1.0)
    scene.cycles.rolling_shutter_type, scene.cycles.rolling_shutter_duration = "TOP", 0.3
    bar = stage.add_box(scene, "Bar", 1.0, _grey(), (0.0, 0.2, 0.0))
    bar.scale = (0.3, 0.3, 1.8)
    _animate(bar, "location", (-1.0, 0.2, 0.0), (1.0, 0.2, 0.0))


def shapes_that_move(scene):
    """A smooth ball that a shape key bends, and a mesh and strands with velocities."""
    _blur(scene, 0.9)
    ball = stage.add_ball(scene, "Bent", 0.45, _grey(), (-0.9, 0.0, -0.2))
    ball.shape_key_add(name="Basis")
    key = ball.shape_key_add(name="Bent")
    for point in key.data:
        point.co.x += 1.2 * point.co.z**2
        point.co.z *= 0.6
    _animate(key, "value", 0.0, 1.0)
    thrown = stage.add_box(scene, "Thrown", 0.4, _grey(), (0.4, 0.3, -0.4))
    _give_velocity(thrown.data, (6.0, 0.0, 14.0))
    hair = bpy.data.hair_curves.new("Strands")
    hair.add_curves([4] * 12)
    places = [(0.1 * n - 0.5 + 0.05 * step, -0.3, -0.9 + 0.25 * step) for n in range(12) for step in range(4)]
    hair.attributes["position"].data.foreach_set("vector", np.array(places, np.float32).ravel())
    radius = hair.attributes.get("radius") or hair.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", [0.02] * len(places))
    _give_velocity(hair, (5.0, 0.0, 0.0))
    hair.materials.append(_grey())
    scene.collection.objects.link(bpy.data.objects.new("Strands", hair))


def lamps_and_lit_meshes_that_move(scene):
    """A lamp that crosses the shot, which Cycles shows at the frame, and a glowing mesh that it blurs."""
    _blur(scene, 1.0)
    stage.add_ball(scene, "Ball", 0.4, _grey(), (0.0, 0.2, -0.5))
    glow = stage.hunt.plain_material("Glow", "ShaderNodeEmission", Color=(1.0, 0.6, 0.3, 1.0), Strength=3.0)
    plate = stage.add_box(scene, "Glow", 0.25, glow, (0.0, 0.0, 0.9))
    _animate(plate, "location", (-1.2, 0.0, 0.9), (1.2, 0.4, 0.7))
    light = bpy.data.lights.new("Lamp", "POINT")
    light.energy, light.shadow_soft_size = 60.0, 0.1
    lamp = bpy.data.objects.new("Lamp", light)
    scene.collection.objects.link(lamp)
    _animate(lamp, "location", (-2.0, -2.0, 1.5), (2.0, -1.0, 1.5))


def _grey():
    return stage.hunt.plain_material("Grey", Color=(0.6, 0.5, 0.4, 1.0))


def _blur(scene, shutter, position="CENTER"):
    scene.frame_set(FRAME)
    render = scene.render
    render.use_motion_blur, render.motion_blur_shutter, render.motion_blur_position = True, shutter, position


def _add_speeding_ball(scene):
    ball = stage.add_ball(scene, "Ball", 0.35, _grey())
    for frame in range(-2, 3):
        ball.location = (0.5 * frame + 0.2 * frame**2, 0.0, -0.2 - 0.3 * frame)
        ball.keyframe_insert("location", frame=FRAME + frame)
    ball.cycles.motion_steps = 2
    scene.frame_set(FRAME)


def _animate(block, path, before, after):
    """Values half a frame before and after the frame."""
    for frame, value in ((FRAME - 0.5, before), (FRAME + 0.5, after)):
        setattr(block, path, value)
        block.keyframe_insert(path, frame=frame)
    bpy.context.scene.frame_set(FRAME)


def _give_velocity(data, velocity):
    count = len(data.attributes["position"].data)
    attribute = data.attributes.new("velocity", "FLOAT_VECTOR", "POINT")
    attribute.data.foreach_set("vector", np.tile(velocity, count).astype(np.float32))


SCENES = {
    "motion_of_objects": turning_scaling_and_panning,
    "motion_from_start": shutter_that_starts_at_the_frame,
    "motion_to_end": shutter_that_ends_at_the_frame,
    "rolling_shutter": rolling_shutter,
    "motion_of_shapes": shapes_that_move,
    "motion_of_lamps": lamps_and_lit_meshes_that_move,
}
"""Builders by the names of their scenes."""
