"""Scenes with Fast GI Approximation, by both methods. Need `bpy`."""

from . import stage


def fast_gi(scene):
    """Bounces that are replaced, between objects of many kinds; one has a distance of its own."""
    _set_up(scene, "REPLACE", distance=0.6, factor=0.7)
    box = stage.add_box(scene, "Own distance", 0.5, stage.hunt.plain_material("Red", Color=(0.8, 0.2, 0.1, 1.0)))
    box.location, box.cycles.ao_distance = (-0.2, 0.5, -0.75), 0.1
    # Its cut rays find a large lamp within their reach alone; those of the others have shadow rays beside them.
    stage.keep_lamps_out_of_forward_hits(scene)


def fast_gi_added(scene):
    """Light that is added as far as nothing nearby blocks it."""
    _set_up(scene, "ADD", distance=0.6, factor=0.3)


def _set_up(scene, method, distance, factor):
    scene.cycles.use_fast_gi, scene.cycles.fast_gi_method = True, method
    stage.hunt.background(scene).inputs["Color"].default_value = (0.4, 0.5, 0.7, 1.0)
    scene.world.light_settings.distance, scene.world.light_settings.ao_factor = distance, factor
    kinds = {
        "Grey": ("ShaderNodeBsdfDiffuse", {}),
        "Glossy": ("ShaderNodeBsdfGlossy", {"Roughness": 0.3}),
        "Glass": ("ShaderNodeBsdfGlass", {"Roughness": 0.0}),
        "Clear": ("ShaderNodeBsdfTransparent", {"Color": (0.9, 0.6, 0.3, 1.0)}),
        "Leaf": ("ShaderNodeBsdfTranslucent", {}),
    }
    for number, (name, (shader, inputs)) in enumerate(kinds.items()):
        material = stage.hunt.plain_material(name, shader, **inputs)
        stage.add_ball(scene, name, 0.3, material, (0.65 * number - 1.3, -0.3, -0.68))
    glow = stage.hunt.plain_material("Glow", "ShaderNodeEmission", Strength=4.0)
    stage.add_box(scene, "Glow", 0.2, glow, (0.9, 0.5, -0.9))
    # Light that glass focuses is found by chance in both.
    scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False


SCENES = {build.__name__: build for build in (fast_gi, fast_gi_added)}
