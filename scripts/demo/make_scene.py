"""Makes the demo's .blend: a small still life in a corner of a room, lit by three lights of different types.

Runs in a Python that has `bpy`: `python make_scene.py demo.blend`.
"""

import math
import sys

import bpy
from mathutils import Vector


def material(name, **inputs):
    """A Principled material; keyword names are socket names with underscores for spaces."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    principled = made.node_tree.nodes["Principled BSDF"]
    for socket, value in inputs.items():
        principled.inputs[socket.replace("_", " ")].default_value = value
    return made


def checker(name, size, dark, light):
    """A packed checker image for the floor."""
    image = bpy.data.images.new(name, size, size)
    pixels = []
    for y in range(size):
        for x in range(size):
            pixels += [*(light if (x * 8 // size + y * 8 // size) % 2 else dark), 1.0]
    image.pixels[:] = pixels
    image.pack()
    return image


def textured(name, image, **inputs):
    """A Principled material whose base colour is `image`."""
    made = material(name, **inputs)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image
    links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


def add(operator, name, look, smooth=True, **arguments):
    """Adds a primitive with a material."""
    operator(**arguments)
    made = bpy.context.object
    made.name = name
    made.data.materials.append(look)
    if smooth:
        made.data.polygons.foreach_set("use_smooth", [True] * len(made.data.polygons))
    return made


def add_light(name, kind, location, target, energy, color, **settings):
    """Adds a light that looks at `target`."""
    data = bpy.data.lights.new(name, kind)
    data.energy, data.color = energy, color
    for key, value in settings.items():
        setattr(data, key, value)
    light = bpy.data.objects.new(name, data)
    light.location = location
    light.rotation_euler = (Vector(target) - Vector(location)).to_track_quat("-Z", "Y").to_euler()
    light.visible_camera = False
    bpy.context.collection.objects.link(light)
    return light


def add_materials():
    """Adds all materials; those of the room, and those of the still life."""
    plaster = material("Plaster", Base_Color=(0.72, 0.69, 0.64, 1.0), Roughness=0.9)
    blue = material("Blue wall", Base_Color=(0.12, 0.22, 0.42, 1.0), Roughness=0.8)
    floor = textured("Floor", checker("Checker", 64, (0.10, 0.07, 0.05), (0.55, 0.46, 0.36)), Roughness=0.35)
    clay = material("Clay", Base_Color=(0.75, 0.25, 0.12, 1.0), Roughness=0.6)
    brass = material("Brass", Base_Color=(0.9, 0.62, 0.25, 1.0), Metallic=1.0, Roughness=0.22)
    glass = material("Glass", Base_Color=(0.95, 0.98, 1.0, 1.0), Roughness=0.02, IOR=1.45, Transmission_Weight=1.0)
    jade = material("Jade", Base_Color=(0.1, 0.5, 0.25, 1.0), Roughness=0.3, Coat_Weight=0.6)
    return (floor, plaster, blue), (clay, glass, brass, jade)


def add_room(floor, plaster, blue):
    """Adds the floor and two walls."""
    primitives = bpy.ops.mesh
    add(primitives.primitive_plane_add, "Floor", floor, smooth=False, size=6.0)
    add(
        primitives.primitive_plane_add,
        "Back wall",
        plaster,
        smooth=False,
        size=6.0,
        location=(0, 2.2, 2.9),
        rotation=(math.pi / 2, 0, 0),
    )
    add(
        primitives.primitive_plane_add,
        "Side wall",
        blue,
        smooth=False,
        size=6.0,
        location=(-2.6, 0, 2.9),
        rotation=(0, math.pi / 2, 0),
    )


def add_still_life(clay, glass, brass, jade):
    """Adds what stands on the floor."""
    primitives = bpy.ops.mesh
    monkey = add(
        primitives.primitive_monkey_add,
        "Suzanne",
        clay,
        size=1.3,
        location=(0.1, 0.6, 0.62),
        rotation=(math.radians(-22), 0, math.radians(18)),
    )
    monkey.modifiers.new("Subdivision", "SUBSURF").render_levels = 2
    add(
        primitives.primitive_uv_sphere_add,
        "Glass ball",
        glass,
        segments=64,
        ring_count=32,
        radius=0.38,
        location=(1.15, -0.25, 0.39),
    )
    add(
        primitives.primitive_torus_add,
        "Brass ring",
        brass,
        major_radius=0.36,
        minor_radius=0.1,
        major_segments=96,
        minor_segments=32,
        location=(-1.05, -0.2, 0.42),
        rotation=(math.radians(72), 0, 0.5),
    )
    add(
        primitives.primitive_cylinder_add,
        "Jade column",
        jade,
        smooth=False,
        vertices=6,
        radius=0.3,
        depth=1.5,
        location=(-1.5, 1.2, 0.75),
    )


def add_lights():
    """Adds three lights of different types."""
    add_light(
        "Key", "AREA", (2.2, -2.0, 3.0), (0, 0.3, 0.6), 160, (1.0, 0.86, 0.7), shape="RECTANGLE", size=1.4, size_y=0.8
    )
    add_light(
        "Lamp",
        "POINT",
        (-1.2, -1.2, 1.9),
        (0, 0, 0),
        40,
        (0.55, 0.7, 1.0),
        shadow_soft_size=0.25,
        use_soft_falloff=False,
    )
    add_light(
        "Spot",
        "SPOT",
        (0.2, 1.4, 3.2),
        (0.1, 0.5, 0.6),
        110,
        (1.0, 0.4, 0.3),
        shadow_soft_size=0.15,
        spot_size=math.radians(50),
        spot_blend=0.4,
    )


def add_camera():
    """Adds the camera."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (1.3, -4.6, 2.0)
    camera.rotation_euler = (Vector((-0.1, 0.3, 0.7)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    camera.data.lens = 40
    bpy.context.collection.objects.link(camera)
    return camera


def set_up(camera):
    """Sets the scene up: its camera, render settings and world."""
    scene = bpy.context.scene
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 480, 270
    scene.view_settings.view_transform = "AgX"
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.02, 0.025, 0.035, 1.0)
    scene.cycles.max_bounces = 8
    scene.cycles.sample_clamp_indirect = 0.0


def build():
    """Builds the scene in the file that is open. Its bytes depend on the order."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    of_room, of_still_life = add_materials()
    add_room(*of_room)
    add_still_life(*of_still_life)
    add_lights()
    set_up(add_camera())


def main():
    build()
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1], compress=True)


if __name__ == "__main__":
    main()
