"""Random settings of the scene, its view layer and its objects over a scene that has something of each."""

import bpy
import lamps

import stage

BOUNCES = ("max", "diffuse", "glossy", "transmission")


def prepare(rng):
    """The room of lamps with glass, a mirror, three films, two lamps, a sky; two collections."""
    scene = lamps.prepare(rng)
    glass = stage.plain_material("Glass", "ShaderNodeBsdfGlass", Roughness=rng.choice([0.0, 0.2]))
    mirror = stage.plain_material("Mirror", "ShaderNodeBsdfAnisotropic", Roughness=rng.choice([0.0, 0.15]))
    things = bpy.data.collections.new("Things")
    scene.collection.children.link(things)
    for name, material, x in (("Glass", glass, -1.4), ("Mirror", mirror, 1.5)):
        obj = bpy.data.objects.new(name, stage.ball(name, 0.5, material))
        obj.location = (x, 0.3, 0.7)
        things.objects.link(obj)
    add_films(scene)
    for name, kind, energy, location in (("Key", "POINT", 300, (1.5, -1.5, 3)), ("Fill", "AREA", 60, (-2, -2, 2.5))):
        data = bpy.data.lights.new(name, kind)
        data.energy = energy
        if kind == "POINT":
            data.shadow_soft_size = 0.3
        obj = stage.add(scene, name, data)
        obj.location, obj.rotation_euler = location, (0.5, -0.5, 0)
    stage.background(scene).inputs["Color"].default_value = (0.2, 0.25, 0.3, 1)
    return scene


def add_films(scene):
    """Half transparent sheets, one behind the other."""
    material, tree, output = stage.new_material("Film")
    kinds = ("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTransparent", "ShaderNodeMixShader")
    diffuse, transparent, mix = (tree.nodes.new(kind) for kind in kinds)
    tree.links.new(transparent.outputs[0], mix.inputs[1])
    tree.links.new(diffuse.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    for number in range(3):
        film = stage.add(scene, f"Film {number}", stage.square("Film", 1.4, material))
        film.location, film.rotation_euler = (0.9, -0.6 + 0.2 * number, 0.9), (1.4, 0, 0.1 * number)


def choices(scene, rng, palette):
    """Settings in words, and what sets them. Those that are only named are rare: a warning excuses a difference."""
    yield from properties(scene.cycles, "cycles", rng, 0.4, cycles_values(rng))
    yield from properties(scene.render, "render", rng, 0.03, render_values(rng))
    yield from properties(scene.render, "render", rng, 0.15, {"film_transparent": True, "use_border": True})
    layer = scene.view_layers[0]
    yield from properties(layer, "view_layer", rng, 0.06, layer_values(rng))
    collection = layer.layer_collection.children[0]
    for name in ("exclude", "holdout", "indirect_only", "hide_viewport"):
        yield from properties(collection, "layer_collection", rng, 0.05, {name: True})
    for obj in scene.objects:
        yield from properties(obj, f"object '{obj.name}'", rng, 0.05, object_values())
    yield from linking(scene, rng)


def properties(owner, label, rng, share, values):
    """Each value with its chance."""
    for name, value in values.items():
        if rng.random() < share and hasattr(owner, name):
            yield f"{label}.{name} = {value!r}", lambda name=name, value=value: setattr(owner, name, value)


def cycles_values(rng):
    """Bounces, caustics, filters, film."""
    found = {f"{name}_bounces": rng.choice([0, 1, 2, 4]) for name in BOUNCES}
    found |= {
        "transparent_max_bounces": rng.choice([0, 1, 2, 8]),
        "min_light_bounces": rng.choice([0, 2]),
        "min_transparent_bounces": rng.choice([0, 2]),
        "blur_glossy": rng.choice([0.0, 1.0, 10.0]),
        "caustics_reflective": rng.random() < 0.5,
        "caustics_refractive": rng.random() < 0.5,
        "film_exposure": rng.choice([0.5, 2.0]),
        "pixel_filter_type": rng.choice(["BOX", "GAUSSIAN", "BLACKMAN_HARRIS"]),
        "filter_width": rng.choice([0.5, 1.5, 3.0]),
    }
    if rng.random() < 0.1:
        found |= {
            "sample_clamp_direct": rng.choice([0.0, 0.5]),
            "sample_clamp_indirect": rng.choice([0.0, 0.5]),
            "film_transparent_glass": rng.random() < 0.5,
            "use_fast_gi": rng.random() < 0.5,
            "use_light_tree": rng.random() < 0.5,
            "use_guiding": rng.random() < 0.5,
            "use_denoising": rng.random() < 0.5,
            "sampling_pattern": rng.choice(["TABULATED_SOBOL", "BLUE_NOISE"]),
        }
    return found


def render_values(rng):
    """Settings of Blender's work around a render."""
    return {
        "use_freestyle": True,
        "use_compositing": True,
        "use_simplify": True,
        "use_motion_blur": True,
        "use_multiview": True,
        "use_sequencer": True,
        "use_crop_to_border": True,
        "resolution_percentage": 50,
        "pixel_aspect_x": rng.choice([1.5, 2.0]),
        "dither_intensity": 2.0,
    }


def layer_values(rng):
    """Filters and overrides of a view layer."""
    names = ("solid", "sky", "hair", "strand", "volumes", "motion_blur")
    found = {f"use_{name}": False for name in names} | {"samples": rng.choice([1, 16])}
    clay = stage.plain_material("Clay", Color=(0.5, 0.4, 0.6, 1))
    return found | {"material_override": clay, "world_override": bpy.data.worlds.new("Other")}


def object_values():
    """Whom an object is shown to."""
    rays = ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow")
    found = {f"visible_{name}": False for name in rays}
    return found | {"hide_render": True, "is_holdout": True, "is_shadow_catcher": True}


def linking(scene, rng):
    """Lamps that light one collection only, or whose light one collection only blocks."""
    for name in ("Key", "Fill"):
        for field in ("receiver_collection", "blocker_collection"):
            if rng.random() < 0.08:
                owner, value = scene.objects[name].light_linking, bpy.data.collections["Things"]
                yield f"{name}.{field}", lambda owner=owner, field=field, value=value: setattr(owner, field, value)
