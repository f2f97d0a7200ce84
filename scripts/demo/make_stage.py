"""Makes a .blend of a moving shot: a fan that turns, a ball that flies, displaced rock, and a spot with a gobo.

Runs in a Python that has `bpy`: `python make_stage.py stage.blend`.
"""

import math
import sys

import bpy
from mathutils import Vector

from make_scene import add, add_camera, add_light, add_room, material, set_up

FRAME = 12
"""Frame of the picture; the animation goes on before and after it."""


def add_rock():
    """A slab whose surface is truly displaced."""
    rock = material("Rock", Base_Color=(0.36, 0.31, 0.27, 1.0), Roughness=0.8)
    tree = rock.node_tree
    noise, displacement = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeDisplacement")
    noise.inputs["Scale"].default_value = 2.2
    displacement.inputs["Scale"].default_value = 0.55
    tree.links.new(noise.outputs["Fac"], displacement.inputs["Height"])
    tree.links.new(displacement.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    rock.displacement_method = "BOTH"
    slab = add(bpy.ops.mesh.primitive_grid_add, "Rock", rock, x_subdivisions=192, y_subdivisions=192, size=2.6)
    slab.location = (-0.2, 0.5, 0.05)


def add_fan(look):
    """Three blades on a hub, which turn by an eighth of a circle a frame."""
    hub = bpy.data.objects.new("Hub", None)
    bpy.context.collection.objects.link(hub)
    hub.rotation_mode = "ZYX"  # Its own axis first.
    hub.location, hub.rotation_euler = (-0.9, 1.2, 1.5), (math.radians(80), 0.0, 0.0)
    for number in range(3):
        blade = add(bpy.ops.mesh.primitive_cube_add, f"Blade {number}", look, smooth=False, size=1.0)
        blade.parent, blade.scale = hub, (0.16, 0.62, 0.02)
        angle = number * math.tau / 3
        blade.location, blade.rotation_euler = (-0.36 * math.sin(angle), 0.36 * math.cos(angle), 0.0), (0.0, 0.3, angle)
    move(hub, "rotation_euler", 2, 0.0, math.tau / 8)


def add_ball(look):
    """A ball that flies through the picture."""
    ball = add(bpy.ops.mesh.primitive_uv_sphere_add, "Ball", look, radius=0.22, segments=48, ring_count=24)
    ball.location = (0.55, 0.1, 1.15)
    move(ball, "location", 0, 0.55, 0.5)


def move(obj, path, index, value, step):
    """Animates one channel in a straight line, with a value in the frame of the picture and a step for each frame."""
    for frame in (FRAME - 4, FRAME + 4):
        getattr(obj, path)[index] = value + step * (frame - FRAME)
        obj.keyframe_insert(path, index=index, frame=frame)
    slots = obj.animation_data.action
    curves = slots.fcurves if hasattr(slots, "fcurves") else slots.layers[0].strips[0].channelbags[0].fcurves
    for key in (key for curve in curves for key in curve.keyframe_points):
        key.interpolation = "LINEAR"


def add_gobo(spot):
    """Leaves before a spot: spots of a noise by the direction of its light."""
    spot.data.use_nodes = True
    tree = spot.data.node_tree
    emission = next(node for node in tree.nodes if node.type == "EMISSION")
    coordinates, noise, ramp = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "TexVoronoi", "ValToRGB"))
    noise.inputs["Scale"].default_value = 9.0
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.38, 0.46
    tree.links.new(coordinates.outputs["Normal"], noise.inputs["Vector"])
    tree.links.new(noise.outputs["Distance"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], emission.inputs["Strength"])


def build():
    """Builds the scene in the file that is open."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    plaster = material("Plaster", Base_Color=(0.42, 0.43, 0.45, 1.0), Roughness=0.9)
    add_room(plaster, plaster, plaster)
    add_rock()
    add_fan(material("Blade", Base_Color=(0.75, 0.6, 0.3, 1.0), Metallic=1.0, Roughness=0.35))
    add_ball(material("Ball", Base_Color=(0.7, 0.08, 0.05, 1.0), Roughness=0.3))
    target = Vector((0.0, 0.6, 0.7))
    leaves = add_light(
        "Leaves", "SPOT", (1.5, -1.3, 2.9), target, 900, (1.0, 0.86, 0.66), shadow_soft_size=0.02, spot_size=0.9
    )
    add_gobo(leaves)
    add_light("Sky", "AREA", (-1.6, -0.8, 2.7), target, 60, (0.6, 0.75, 1.0), shape="RECTANGLE", size=1.2, size_y=1.2)
    add_light("Glow", "POINT", (0.9, 1.5, 0.6), target, 18, (1.0, 0.45, 0.2), shadow_soft_size=0.12)
    camera = add_camera()
    camera.location = (0.7, -4.2, 1.6)
    camera.rotation_euler = (target - camera.location).to_track_quat("-Z", "Y").to_euler()
    camera.data.lens = 40
    set_up(camera)
    scene = bpy.context.scene
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.6
    scene.frame_set(FRAME)


if __name__ == "__main__":
    build()
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1], compress=True)
