"""Scenes in which rays of different kinds see different things. Lamps that rules or shadow rays decide about have
*Multiple Importance* off: with it, Cycles finds some of the light of large lamps otherwise. Need `bpy`."""

import bpy

import light_sets

from . import stage


def shadow_rays(scene):
    """Objects without shadow, or hidden from diffuse rays; glass that is clear to shadow rays; a pane that is not."""
    grey = stage.hunt.plain_material("Grey", Color=(0.5, 0.5, 0.5, 1.0))
    unshadowed = stage.add_ball(scene, "Without shadow", 0.35, grey, (-0.9, 0.2, -0.3))
    unshadowed.visible_shadow = False
    hidden = stage.add_box(scene, "Hidden", 0.6, grey, (-0.1, 0.5, -0.5))
    hidden.visible_diffuse = False
    glass = _mixed("Glass", "Is Shadow Ray", "ShaderNodeBsdfGlass", "ShaderNodeBsdfTransparent")
    stage.add_ball(scene, "Glass", 0.35, glass, (0.7, -0.2, -0.4))
    pane = stage.hunt.plain_material("Pane", "ShaderNodeBsdfTransparent", Color=(0.8, 0.9, 0.8, 1.0))
    pane.use_transparent_shadow = False
    stage.add_box(scene, "Pane", 0.4, pane, (0.3, 0.9, 0.6))
    # Light that glass focuses is found by chance in both.
    scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False
    stage.keep_lamps_out_of_forward_hits(scene)
    _add_lamp(scene, "sampled only", 0)


def light_path(scene):
    """Surfaces that the camera, diffuse and glossy rays, and rays of different depth, see in colours of their own."""
    for number, socket in enumerate(("Is Camera Ray", "Is Diffuse Ray", "Is Glossy Ray", "Ray Depth")):
        material, tree, output = stage.hunt.new_material(socket)
        path, mix = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMix")
        mix.data_type = "RGBA"
        shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
        shader.inputs["Roughness"].default_value = 0.3
        mix.inputs[6].default_value, mix.inputs[7].default_value = (0.9, 0.2, 0.1, 1.0), (0.1, 0.3, 0.9, 1.0)
        tree.links.new(path.outputs[socket], mix.inputs[0])
        tree.links.new(mix.outputs[2], shader.inputs["Base Color"])
        tree.links.new(shader.outputs[0], output.inputs["Surface"])
        stage.add_ball(scene, socket, 0.32, material, (0.7 * number - 1.05, 0.0, -0.68))


def light_rules(scene):
    """Lights without shadow, with shadow linking, without bounces and with no other rule, in turn."""
    grey = stage.hunt.plain_material("Grey", Color=(0.6, 0.5, 0.4, 1.0))
    stage.add_ball(scene, "Ball", 0.4, grey, (-0.6, 0.0, -0.6))
    box = stage.add_box(scene, "Box", 0.6, grey, (0.5, 0.3, -0.5))
    mirror = stage.hunt.plain_material("Mirror", "ShaderNodeBsdfGlossy", Roughness=0.0)
    stage.add_ball(scene, "Mirror", 0.3, mirror, (0.0, -0.6, -0.7))
    blockers = bpy.data.collections.new("Blockers")
    blockers.objects.link(box)
    scene["parity_light_rules"] = True
    stage.keep_lamps_out_of_forward_hits(scene)
    for number, rule in enumerate(light_sets.RULES):
        _add_lamp(scene, rule, number)


def linked_meshes(scene):
    """A tube that shines on one ball alone, one on all but the box, and one whose light passes the box."""
    grey = stage.hunt.plain_material("Grey", Color=(0.6, 0.6, 0.6, 1.0))
    chosen = stage.add_ball(scene, "Ball", 0.35, grey, (-0.5, 0.0, -0.6))
    stage.add_ball(scene, "Other ball", 0.35, grey, (0.3, 0.4, -0.6))
    box = stage.add_box(scene, "Box", 0.5, grey, (0.9, -0.2, -0.7))
    for number, (color, kind, obj, state) in enumerate(
        (
            ((1.0, 0.3, 0.1, 1.0), "receiver_collection", chosen, "INCLUDE"),
            ((0.2, 0.9, 0.3, 1.0), "receiver_collection", box, "EXCLUDE"),
            ((0.2, 0.4, 1.0, 1.0), "blocker_collection", box, "EXCLUDE"),
        )
    ):
        glow = stage.hunt.plain_material(f"Tube {number}", "ShaderNodeEmission", Color=color, Strength=150.0)
        tube = stage.add_box(scene, f"Tube {number}", 0.25, glow, (0.9 * number - 0.9, -0.6, 0.5))
        linked = bpy.data.collections.new(f"Linked {number}")
        linked.objects.link(obj)
        linked.collection_objects[0].light_linking.link_state = state
        setattr(tube.light_linking, kind, linked)


def _add_lamp(scene, rule, number):
    """A lamp from which the bake learns a rule."""
    light = stage.hunt.add(scene, rule, bpy.data.lights.new(rule, "POINT"))
    light.location, light.data.energy = (0.4 * number - 0.6, -1.0, 0.8), 10.0
    light.data.shadow_soft_size = 0.1
    light.data.cycles.use_multiple_importance_sampling = False
    light_sets.set_rule(light, rule)


def _mixed(name, socket, first, second):
    """A material of two shaders, the second of them for some rays."""
    material, tree, output = stage.hunt.new_material(name)
    path, mix = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(path.outputs[socket], mix.inputs[0])
    for place, kind in ((1, first), (2, second)):
        tree.links.new(tree.nodes.new(kind).outputs[0], mix.inputs[place])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return material


SCENES = {build.__name__: build for build in (shadow_rays, light_path, light_rules, linked_meshes)}
