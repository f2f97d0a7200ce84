"""Feature scenes of hair and points. Needs `bpy`."""

import math
import random

import bpy

from . import stage

STRANDS, KEYS = 1500, 6


def ribbon_hair(scene):
    """A patch of diffuse ribbons."""
    scene.cycles_curves.shape = "RIBBONS"
    _patch(scene, stage.hunt.plain_material("Grass", Color=(0.3, 0.6, 0.2, 1.0)), 0.012)


def round_hair(scene):
    """A patch of diffuse round strands."""
    scene.cycles_curves.shape = "THICK"
    _patch(scene, stage.hunt.plain_material("Grass", Color=(0.6, 0.4, 0.2, 1.0)), 0.012)


def tuft_chiang(scene):
    """A tuft with melanin in the model of Chiang."""
    _patch(scene, _melanin("CHIANG"), 0.006)


def tuft_huang(scene):
    """A tuft with melanin in the model of Huang."""
    _patch(scene, _melanin("HUANG"), 0.006)


def tuft_color(scene):
    """A tuft whose absorption is told by a colour, on round strands."""
    scene.cycles_curves.shape = "THICK"
    material, node = _principled_hair("CHIANG")
    node.parametrization = "COLOR"
    node.inputs["Color"].default_value = (0.7, 0.35, 0.15, 1.0)
    _patch(scene, material, 0.006)


def hair_bsdf(scene):
    """A tuft of the plain hair shaders, reflection and transmission."""
    material, tree, output = stage.hunt.new_material("Hair")
    both = tree.nodes.new("ShaderNodeAddShader")
    for slot, component in enumerate(("Reflection", "Transmission")):
        node = tree.nodes.new("ShaderNodeBsdfHair")
        node.component = component
        node.inputs["Color"].default_value = (0.5, 0.3, 0.15, 1.0)
        node.inputs["RoughnessU"].default_value = 0.3
        node.inputs["RoughnessV"].default_value = 0.6
        tree.links.new(node.outputs[0], both.inputs[slot])
    tree.links.new(both.outputs[0], output.inputs["Surface"])
    _patch(scene, material, 0.006)


def particle_hair(scene):
    """Particle hair with children on a ball."""
    material = stage.hunt.plain_material("Fur", Color=(0.5, 0.35, 0.2, 1.0))
    ball = stage.add_ball(scene, "Animal", 0.6, material)
    ball.modifiers.new("Fur", "PARTICLE_SYSTEM")
    settings = ball.particle_systems[0].settings
    settings.type, settings.count, settings.hair_length = "HAIR", 200, 0.3
    settings.child_type, settings.rendered_child_count = "INTERPOLATED", 8
    settings.root_radius, settings.tip_radius, settings.radius_scale = 1.0, 0.1, 0.02
    settings.material = 1


def points(scene):
    """A cloud of points as spheres, made by geometry nodes."""
    tree = bpy.data.node_groups.new("Points", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    ball, spread = tree.nodes.new("GeometryNodeMeshIcoSphere"), tree.nodes.new("GeometryNodeMeshToPoints")
    paint, output = tree.nodes.new("GeometryNodeSetMaterial"), tree.nodes.new("NodeGroupOutput")
    ball.inputs["Radius"].default_value, ball.inputs["Subdivisions"].default_value = 0.8, 4
    spread.inputs["Radius"].default_value = 0.06
    material = stage.hunt.plain_material("Beads", Color=(0.3, 0.5, 0.8, 1.0))
    paint.inputs["Material"].default_value = material
    tree.links.new(ball.outputs[0], spread.inputs[0])
    tree.links.new(spread.outputs[0], paint.inputs["Geometry"])
    tree.links.new(paint.outputs[0], output.inputs[0])
    holder = stage.hunt.add(scene, "Beads", bpy.data.meshes.new("Beads"))
    holder.data.materials.append(material)
    holder.modifiers.new("Points", "NODES").node_group = tree


def _principled_hair(model):
    material, tree, output = stage.hunt.new_material(f"Hair {model.title()}")
    node = tree.nodes.new("ShaderNodeBsdfHairPrincipled")
    node.model = model
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material, node


def _melanin(model):
    material, node = _principled_hair(model)
    node.parametrization = "MELANIN"
    node.inputs["Melanin"].default_value = 0.5
    node.inputs["Melanin Redness"].default_value = 0.6
    return material


def _patch(scene, material, radius):
    """Curves that stand on a disk and bend outwards; Catmull-Rom in all versions."""
    rng = random.Random(1)
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([KEYS] * STRANDS)
    places, radii = [], []
    for _ in range(STRANDS):
        turn, away = rng.uniform(0.0, 2.0 * math.pi), 0.8 * math.sqrt(rng.random())
        lean, height = rng.uniform(-0.3, 0.3), rng.uniform(0.8, 1.3)
        for key in range(KEYS):
            share = key / (KEYS - 1)
            out = away + 0.5 * share * share * away
            places += [out * math.cos(turn) + lean * share * share, out * math.sin(turn), -0.8 + height * share]
            radii.append(radius * (1.0 - 0.8 * share))
    curves.attributes["position"].data.foreach_set("vector", places)
    curves.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", radii)
    curves.materials.append(material)
    stage.hunt.add(scene, "Hair", curves)


SCENES = {
    build.__name__: build
    for build in (
        ribbon_hair,
        round_hair,
        tuft_chiang,
        tuft_huang,
        tuft_color,
        hair_bsdf,
        particle_hair,
        points,
    )
}
