"""Seeded random lights of every type, in free space that the camera sees. Needs `bpy`."""

import math
import random

import bpy
from mathutils import Vector

RULES = ("no shadow", "linked shadow", "no bounces", "sampled only")
"""Rules of lights in scenes that have them."""
SMALL_RADII = 0.01, 0.05
"""Metres."""
SMALL_SUN = math.radians(0.5)
KINDS = ("POINT", "POINT_HARD", "SPOT", "RECTANGLE", "ELLIPSE", "SUN")


def visible_points(scene, rng, count):
    """(position, depth) on random camera rays, between the camera and what they hit."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    camera = scene.camera
    corners = camera.data.view_frame(scene=scene)
    top_right, bottom_right, bottom_left, top_left = (camera.matrix_world @ corner for corner in corners)
    origin = camera.matrix_world.translation
    points = []
    while len(points) < count:
        u, v = rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9)
        target = bottom_left + (bottom_right - bottom_left) * u + (top_left - bottom_left) * v
        direction = (target - origin).normalized()
        hit, location, *_ = scene.ray_cast(depsgraph, origin, direction)
        if hit:
            depth = (location - origin).length
            points.append((origin + direction * depth * rng.uniform(0.35, 0.85), depth))
    return points


def random_rotation(rng):
    """Euler angles of a uniformly random direction for -z."""
    z = rng.uniform(-1.0, 1.0)
    phi = rng.uniform(0.0, 2.0 * math.pi)
    side = math.sqrt(1.0 - z * z)
    return Vector((side * math.cos(phi), side * math.sin(phi), z)).to_track_quat("-Z", "Y").to_euler()


def downward_rotation(rng):
    """Euler angles of a random direction in the lower hemisphere, for suns."""
    tilt, phi = math.radians(rng.uniform(10.0, 60.0)), rng.uniform(0.0, 2.0 * math.pi)
    direction = Vector((math.sin(tilt) * math.cos(phi), math.sin(tilt) * math.sin(phi), -math.cos(tilt)))
    return direction.to_track_quat("-Z", "Y").to_euler()


def add_light(scene, kind, position, depth, rng, is_small):
    """One light of `kind`; its size, unless that is small, and its power follow the distance it was placed at."""
    blender_type = {"POINT_HARD": "POINT", "RECTANGLE": "AREA", "ELLIPSE": "AREA"}.get(kind, kind)
    data = bpy.data.lights.new(f"parity {kind.lower()}", blender_type)
    data.color = tuple(rng.uniform(0.4, 1.0) for _ in range(3))
    data.energy = 8.0 * depth * depth * rng.uniform(0.5, 2.0)
    size = rng.uniform(*SMALL_RADII) if is_small else depth * rng.uniform(0.08, 0.16)
    rotation = random_rotation(rng)
    if blender_type in ("POINT", "SPOT"):
        data.shadow_soft_size = size
        data.use_soft_falloff = kind != "POINT_HARD"
    if kind == "SPOT":
        data.spot_size = math.radians(rng.uniform(50.0, 120.0))
        data.spot_blend = rng.uniform(0.1, 0.8)
        data.energy *= 2.0
    elif blender_type == "AREA":
        data.shape = kind
        data.size, data.size_y = 2.0 * size, 2.0 * size * rng.uniform(0.5, 1.0)
        data.spread = math.radians(rng.choice((180.0, 140.0, 90.0)))
    elif kind == "SUN":
        data.angle = SMALL_SUN if is_small else math.radians(rng.uniform(15.0, 40.0))
        data.energy = rng.uniform(0.5, 2.0)
        rotation = downward_rotation(rng)
    light = bpy.data.objects.new(data.name, data)
    light.location, light.rotation_euler = position, rotation
    light.visible_camera = False
    if scene.get("parity_single_importance"):
        data.cycles.use_multiple_importance_sampling = False
    scene.collection.objects.link(light)
    if scene.get("parity_light_rules"):
        set_rule(light, RULES[KINDS.index(kind) % len(RULES)])
    return light


def set_rule(light, rule):
    """Gives a light one of `RULES`."""
    if rule == "no shadow":
        light.data.use_shadow = False
    elif rule == "linked shadow":
        light.light_linking.blocker_collection = bpy.data.collections["Blockers"]
    elif rule == "no bounces":
        light.data.cycles.max_bounces = 0
    elif rule == "sampled only":
        light.data.cycles.use_multiple_importance_sampling = False


def add_light_set(scene, seed, are_small=False):
    """One light of every kind; returns the new objects."""
    rng = random.Random(seed)
    places = visible_points(scene, rng, len(KINDS))
    return [add_light(scene, kind, *place, rng, are_small) for kind, place in zip(KINDS, places, strict=True)]


def remove(objects):
    """Takes lights out of the file again."""
    for light in objects:
        data = light.data
        bpy.data.objects.remove(light)
        bpy.data.lights.remove(data)
