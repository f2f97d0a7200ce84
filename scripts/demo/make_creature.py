"""Makes a .blend with what a character's shot has: skin, hair and fog, lit by three lights.

Runs in a Python that has `bpy`: `python make_creature.py creature.blend`.
"""

import math
import random
import sys

import bpy
from mathutils import Vector

from make_scene import add, add_camera, add_light, add_room, material, set_up

STRANDS, KEYS = 12000, 8
EYE_VERTICES = 200
"""Each eye is a part of the head's mesh with fewer vertices than this."""


def add_skin():
    """Material of the head: a random walk beneath a faint gloss."""
    skin = material("Skin", Base_Color=(0.8, 0.47, 0.36, 1.0), Roughness=0.45, Subsurface_Weight=1.0)
    principled = skin.node_tree.nodes["Principled BSDF"]
    principled.subsurface_method = "RANDOM_WALK"
    principled.inputs["Subsurface Radius"].default_value = (1.0, 0.35, 0.2)
    # From Blender 5.2 on the radius is no more divided by 4 pi.
    principled.inputs["Subsurface Scale"].default_value = 0.02 if bpy.app.version >= (5, 2, 0) else 0.25
    return skin


def paint_eyes(mesh, look):
    """Gives the loose parts of a head that are its eyes another material."""
    mesh.materials.append(look)
    part = {vertex.index: {vertex.index} for vertex in mesh.vertices}
    for one, other in (edge.vertices for edge in mesh.edges):
        if part[one] is not part[other]:
            part[one] |= part[other]
            part.update(dict.fromkeys(part[other], part[one]))
    for face in mesh.polygons:
        face.material_index = int(len(part[face.vertices[0]]) < EYE_VERTICES)


def add_hair_material():
    """Brown hair by its melanin."""
    hair = bpy.data.materials.new("Hair")
    hair.use_nodes = True
    tree = hair.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeBsdfHairPrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.model, shader.parametrization = "CHIANG", "MELANIN"
    shader.inputs["Melanin"].default_value = 0.45
    shader.inputs["Melanin Redness"].default_value = 0.9
    shader.inputs["Random Color"].default_value = 0.3
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return hair


def add_hair(head, look):
    """Curves that grow from the scalp, bend over and fall."""
    rng = random.Random(7)
    mesh = head.data
    scalp = [face for face in mesh.polygons if face.normal.z > 0.25 and face.center.z > 0.25 and face.center.y > -0.35]
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([KEYS] * STRANDS)
    places, radii = [], []
    weights = [face.area for face in scalp]
    for face in rng.choices(scalp, weights, k=STRANDS):
        corners = [mesh.vertices[index].co for index in face.vertices]
        shares = [rng.random() ** 2 for _ in corners]
        root = sum((corner * share for corner, share in zip(corners, shares, strict=True)), Vector()) / sum(shares)
        along = (face.normal + 0.35 * Vector((rng.gauss(0, 1), rng.gauss(0, 1), rng.gauss(0, 1)))).normalized()
        step = rng.uniform(0.35, 0.55) / (KEYS - 1)
        for key in range(KEYS):
            places.extend(root)
            radii.append(0.003 * (1.0 - 0.7 * key / (KEYS - 1)))
            root = root + along * step
            along = (along + Vector((0.0, 0.05, -0.28))).normalized()
    curves.attributes["position"].data.foreach_set("vector", places)
    curves.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", radii)
    curves.materials.append(look)
    hair = bpy.data.objects.new("Hair", curves)
    hair.matrix_world = head.matrix_world
    bpy.context.collection.objects.link(hair)


def add_fog():
    """A box of thin fog around the set."""
    fog = bpy.data.materials.new("Fog")
    fog.use_nodes = True
    tree = fog.node_tree
    tree.nodes.clear()
    scatter, output = tree.nodes.new("ShaderNodeVolumeScatter"), tree.nodes.new("ShaderNodeOutputMaterial")
    scatter.inputs["Color"].default_value = (0.9, 0.92, 0.95, 1.0)
    scatter.inputs["Density"].default_value = 0.07
    scatter.inputs["Anisotropy"].default_value = 0.3
    tree.links.new(scatter.outputs[0], output.inputs["Volume"])
    add(bpy.ops.mesh.primitive_cube_add, "Fog", fog, smooth=False, size=4.4, location=(-0.2, 0.0, 2.0))


def build():
    """Builds the scene in the file that is open."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    stone = material("Stone", Base_Color=(0.2, 0.19, 0.18, 1.0), Roughness=0.7)
    add_room(stone, material("Plaster", Base_Color=(0.16, 0.17, 0.19, 1.0), Roughness=0.9), stone)
    head = add(
        bpy.ops.mesh.primitive_monkey_add,
        "Head",
        add_skin(),
        size=1.7,
        location=(0.0, 0.5, 0.95),
        rotation=(math.radians(-8), 0.0, math.radians(14)),
    )
    paint_eyes(head.data, material("Eye", Base_Color=(0.03, 0.015, 0.01, 1.0), Roughness=0.08))
    head.modifiers.new("Subdivision", "SUBSURF").render_levels = 2
    bpy.context.view_layer.update()
    add_hair(head, add_hair_material())
    add_fog()
    target = Vector((0.05, 0.45, 1.05))
    add_light("Key", "AREA", (1.9, -1.5, 2.4), target, 130, (1.0, 0.85, 0.7), shape="RECTANGLE", size=1.2, size_y=0.7)
    add_light("Rim", "SPOT", (-1.2, 1.7, 2.9), target, 900, (0.55, 0.72, 1.0), shadow_soft_size=0.12, spot_size=0.6)
    add_light("Fill", "POINT", (-1.7, -1.2, 0.9), target, 7, (1.0, 0.5, 0.35), shadow_soft_size=0.3)
    camera = add_camera()
    camera.location = (0.9, -4.3, 1.45)
    camera.rotation_euler = (target - camera.location).to_track_quat("-Z", "Y").to_euler()
    camera.data.lens = 45
    set_up(camera)
    bpy.context.scene.cycles.volume_bounces = 2


if __name__ == "__main__":
    build()
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1], compress=True)
