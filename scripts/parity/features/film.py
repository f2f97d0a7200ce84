"""Scenes of the film and of panoramic cameras, and a world that the camera sees otherwise. Need `bpy`."""

import math

import bpy

from . import stage


def film_glass(scene):
    """A transparent film that shows through smooth glass and not through rough glass."""
    scene.render.film_transparent = scene.cycles.film_transparent_glass = True
    grey = stage.hunt.plain_material("Grey", Color=(0.5, 0.5, 0.5, 1.0))
    for number, roughness in enumerate((0.0, 0.1, 0.3)):
        glass = stage.hunt.plain_material(f"Glass {roughness}", "ShaderNodeBsdfGlass", Roughness=roughness)
        stage.add_ball(scene, f"Glass {roughness}", 0.35, glass, (0.8 * number - 0.8, -0.4, -0.6))
    stage.add_box(scene, "Box", 0.5, grey, (0.3, 0.6, -0.7))
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    # Light that glass focuses is found by chance in both.
    scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False


def holdouts(scene):
    """A holdout object, a holdout shader and a mirror that shows both."""
    grey = stage.hunt.plain_material("Grey", Color=(0.5, 0.4, 0.3, 1.0))
    stage.add_box(scene, "Cut", 0.7, grey, (-0.8, 0.3, -0.6)).is_holdout = True
    stage.add_ball(scene, "Hole", 0.35, stage.hunt.plain_material("Hole", "ShaderNodeHoldout"), (0.8, -0.2, -0.6))
    mirror = stage.hunt.plain_material("Mirror", "ShaderNodeBsdfGlossy", Roughness=0.0)
    stage.add_ball(scene, "Mirror", 0.4, mirror, (0.0, 0.5, -0.5))


def shadow_catcher(scene):
    """A floor that catches the shadows of a ball and a box, and the light of one, before the world."""
    bpy.data.objects["Floor"].is_shadow_catcher = True
    stage.add_ball(scene, "Ball", 0.4, stage.hunt.plain_material("Red", Color=(0.8, 0.1, 0.1, 1.0)), (-0.6, 0.0, -0.6))
    glow = stage.hunt.plain_material("Glow", "ShaderNodeEmission", Strength=3.0)
    stage.add_box(scene, "Box", 0.5, glow, (0.8, 0.4, -0.7))
    scene.world = bpy.data.worlds.new("Grey")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.4, 0.5, 0.7, 1.0)


def fisheye(scene):
    """A fisheye lens near the floor."""
    _panoramic(scene, "FISHEYE_EQUISOLID", fisheye_fov=math.radians(170.0), fisheye_lens=9.0)


def equirectangular(scene):
    """The whole room around a camera in its middle."""
    _panoramic(scene, "EQUIRECTANGULAR")
    wall = bpy.data.objects["Wall"].copy()
    wall.location.y = -2.0
    scene.collection.objects.link(wall)


def _panoramic(scene, kind, **settings):
    camera = scene.camera
    camera.location, camera.rotation_euler = (0.0, 0.0, -0.2), (1.4, 0.0, 0.2)
    camera.data.type, camera.data.panorama_type = "PANO", kind
    for name, value in settings.items():
        setattr(camera.data, name, value)
    grey = stage.hunt.plain_material("Grey", Color=(0.5, 0.4, 0.3, 1.0))
    stage.add_ball(scene, "Ball", 0.4, grey, (-0.7, 1.0, -0.6))
    stage.add_box(scene, "Box", 0.5, grey, (0.8, 0.9, -0.7))


SCENES = {build.__name__: build for build in (film_glass, holdouts, shadow_catcher, fisheye, equirectangular)}
