"""Feature scenes of subsurface scattering. Needs `bpy`."""

import bpy

from . import stage

RED_FIRST = (1.0, 0.35, 0.2)


def _body(name, color, scale, method="RANDOM_WALK", radius=RED_FIRST, anisotropy=0.0, roughness=0.4):
    """A principled material that is all subsurface; `scale` in metres is that of Blender before 5.2."""
    material, tree, output = stage.hunt.new_material(name)
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    node.subsurface_method = method
    inputs = {
        "Base Color": (*color, 1.0),
        "Subsurface Weight": 1.0,
        "Subsurface Radius": radius,
        "Subsurface Scale": scale,
        "Roughness": roughness,
    }
    # Blender 4.2 has no such socket where the method does not use it.
    if anisotropy != 0.0:
        inputs["Subsurface Anisotropy"] = anisotropy
    for key, value in inputs.items():
        node.inputs[key].default_value = value
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def wax(scene):
    """A ball of wax, whose radius is a good part of its own."""
    stage.add_ball(scene, "Wax", 0.8, _body("Wax", (0.85, 0.7, 0.5), _walk_scale(0.1)))


def skin(scene):
    """A ball with the walk for skin."""
    stage.add_ball(scene, "Skin", 0.8, _body("Skin", (0.8, 0.5, 0.4), 0.1, "RANDOM_WALK_SKIN"))


def marble(scene):
    """A cube with the profile of Christensen and Burley."""
    stage.add_box(scene, "Marble", 1.2, _body("Marble", (0.85, 0.85, 0.8), 0.3, "BURLEY", (1.0, 0.8, 0.6)))


def forward_body(scene):
    """A ball that scatters forward inside."""
    stage.add_ball(scene, "Jelly", 0.8, _body("Jelly", (0.8, 0.8, 0.6), _walk_scale(0.3), anisotropy=0.8))


def two_bodies(scene):
    """Two bodies that face each other and touch."""
    for number, color in enumerate(((0.9, 0.4, 0.3), (0.3, 0.5, 0.9))):
        body = _body(f"Body {number}", color, _walk_scale(0.2))
        stage.add_ball(scene, f"Body {number}", 0.6, body, (1.2 * number - 0.6, 0.0, 0.0))


def subsurface_node(scene):
    """The Subsurface Scattering node, mixed with gloss."""
    material, tree, output = stage.hunt.new_material("Leather")
    node, gloss = tree.nodes.new("ShaderNodeSubsurfaceScattering"), tree.nodes.new("ShaderNodeBsdfAnisotropic")
    mix = tree.nodes.new("ShaderNodeMixShader")
    node.falloff = "RANDOM_WALK"
    node.inputs["Color"].default_value = (0.7, 0.4, 0.25, 1.0)
    node.inputs["Scale"].default_value = _walk_scale(0.2)
    gloss.inputs["Roughness"].default_value = 0.4
    mix.inputs[0].default_value = 0.1
    for slot, shader in ((1, node), (2, gloss)):
        tree.links.new(shader.outputs[0], mix.inputs[slot])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    stage.add_ball(scene, "Leather", 0.8, material)


def _walk_scale(scale):
    """A scale of the random walk that means one thing in all versions: from Blender 5.2 on the radius is not divided
    by 4 pi."""
    return scale / (4 * 3.14159265) if bpy.app.version >= (5, 2, 0) else scale


SCENES = {build.__name__: build for build in (wax, skin, marble, forward_body, two_bodies, subsurface_node)}
