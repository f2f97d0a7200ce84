"""Measures closures and node values in Cycles and writes them beside this file, for `cycles_reference.rs`.

Run with a Python that has the `bpy` module: `python generate.py`, or `python generate.py noise voronoi` for the cases
alone whose names begin with one of these words; the others are kept. A square of side 2 lies in the plane z = 0 about
the origin, its UV map is (x + 1) / 2, (y + 1) / 2. An orthographic camera looks at it along `direction`. For closures,
the world's radiance is a polynomial of the direction, see `WORLD`, and the mean over the square is recorded. For
values, the nodes' result is emitted and recorded at the centres of 4 x 4 pixels seen from above, of 6 x 6 for
procedural textures; some read a 4 x 4 image.
"""

import json
import math
import os
import sys
import tempfile

import bpy
import cases
import mathutils
import procedural
from nodes import build

HERE = os.path.dirname(os.path.abspath(__file__))
TEXELS = [(37 * i + 90 * (i % 4)) % 256 if i % 4 < 3 else (i * 29) % 256 for i in range(64)]


def image(encoding, alpha):
    """The 4 x 4 image `TEXELS`."""
    image = bpy.data.images.new("test", 4, 4, alpha=True)
    image.colorspace_settings.name = {"srgb": "sRGB", "linear": "Non-Color"}[encoding]
    image.alpha_mode = {"premultiplied": "PREMUL"}.get(alpha, alpha.upper())
    image.pixels = [texel / 255 for texel in TEXELS]
    image.update()
    image.pack()
    return image


def world(tree):
    """Radiance ((1 + x) / 2)^8, 1, ((1 + z) / 2)^8 in red, green, blue."""
    direction = tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]
    parts = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(direction, parts.inputs[0])
    combine = tree.nodes.new("ShaderNodeCombineXYZ")
    combine.inputs[1].default_value = 1.0
    for axis in (0, 2):
        half = tree.nodes.new("ShaderNodeMath")
        half.operation = "MULTIPLY_ADD"
        half.inputs[1].default_value = half.inputs[2].default_value = 0.5
        tree.links.new(parts.outputs[axis], half.inputs[0])
        power = tree.nodes.new("ShaderNodeMath")
        power.operation = "POWER"
        power.inputs[1].default_value = 8.0
        tree.links.new(half.outputs[0], power.inputs[0])
        tree.links.new(power.outputs[0], combine.inputs[axis])
    background = tree.nodes["Background"]
    tree.links.new(combine.outputs[0], background.inputs["Color"])


def scene(nodes, direction, extent, samples, pixels):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("square")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    uv = mesh.uv_layers.new(name="UVMap")
    for loop, coords in zip(uv.data, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
        loop.uv = coords
    square = bpy.data.objects.new("square", mesh)
    scene.collection.objects.link(square)
    material = bpy.data.materials.new("test")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(build(material.node_tree, nodes).outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    camera = bpy.data.cameras.new("camera")
    camera.type = "ORTHO"
    camera.ortho_scale = extent
    view = bpy.data.objects.new("camera", camera)
    direction = mathutils.Vector(direction)
    view.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    view.location = -3 * direction
    scene.collection.objects.link(view)
    scene.camera = view
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.render.engine = "CYCLES"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.blur_glossy = 0.0
    scene.cycles.sample_clamp_indirect = 0.0
    scene.cycles.filter_width = 0.01
    scene.render.resolution_x = scene.render.resolution_y = pixels
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Raw"
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


def render(scene, pixels):
    path = os.path.join(tempfile.mkdtemp(), "out.exr")
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    values = list(image.pixels)
    # Six digits are what single precision has.
    return [[float(f"{value:.6g}") for value in values[4 * i : 4 * i + 3]] for i in range(pixels * pixels)]


def views():
    for theta in (0.3, 1.2):
        yield [-math.sin(theta) * 0.96, -math.sin(theta) * 0.28, -math.cos(theta)]


def is_wanted(name):
    """True if a case is among those that the command line names."""
    wanted = tuple(sys.argv[1:])
    return not wanted or name.startswith(wanted)


def measure_closures():
    metals = cases.metal_graphs() if bpy.app.version >= (4, 3, 0) else ()
    for name, nodes in (*cases.closure_graphs(), *metals, *cases.cloth_and_toon_graphs()):
        if not is_wanted(name):
            continue
        transmits = any(n["type"] in ("glass", "refraction") or n.get("transmission_weight") for n in nodes)
        for direction in views():
            for z in (1, -1) if transmits or "bent" in name else (1,):
                seen = [*direction[:2], z * direction[2]]
                setup = scene(nodes, seen, 0.2, 4096, 8)
                world(setup.world.node_tree)
                values = render(setup, 8)
                mean = [sum(v[i] for v in values) / len(values) for i in range(3)]
                yield {"name": name, "nodes": nodes, "direction": seen, "mean": mean}


def measure_hair():
    """As `measure_closures`, within the triangle below the diagonal alone."""
    for name, nodes in cases.hair_graphs():
        if not is_wanted(name):
            continue
        for direction in views():
            target = [0.4, -0.4]
            setup = scene(nodes, direction, 0.2, 4096, 8)
            setup.camera.location += mathutils.Vector((*target, 0.0))
            world(setup.world.node_tree)
            # Where it samples light for hair on meshes, Cycles leaves some of it out.
            setup.world.cycles.sampling_method = "NONE"
            values = render(setup, 8)
            mean = [sum(v[i] for v in values) / len(values) for i in range(3)]
            yield {"name": name, "nodes": nodes, "direction": direction, "target": target, "mean": mean}


# Reflected at the edges of the fibre, which Cycles' quadrature of Huang's model resolves too coarsely.
GRAZING = ([-0.3, 0.9, -0.4], [0.1, -0.9, 0.2], [-0.6, 0.4, -0.7])
SUNS = ([0, 0, 1], [-0.8, -0.1, 0.6], [0, 0, -1])


def measure_lit_hair():
    """Light of suns of irradiance 1 that hair on a mesh scatters."""
    for name, nodes in cases.lit_hair_graphs():
        if not is_wanted(name):
            continue
        for direction in views():
            target = [0.4, -0.4]
            for towards in (*SUNS, *GRAZING):
                # Huang's model is an estimate in itself.
                setup = scene(nodes, direction, 0.2, 2048 if "huang" in name else 64, 8)
                setup.camera.location += mathutils.Vector((*target, 0.0))
                setup.cycles.light_sampling_threshold = 0.0
                sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
                sun.data.energy, sun.data.angle = 1.0, 0.0
                sun.rotation_euler = mathutils.Vector(towards).to_track_quat("Z", "Y").to_euler()
                setup.collection.objects.link(sun)
                values = render(setup, 8)
                mean = [sum(v[i] for v in values) / len(values) for i in range(3)]
                case = {"name": name, "nodes": nodes, "direction": direction, "target": target}
                yield {**case, "towards": towards, "mean": mean}


def measure_textures():
    for name, encoding, alpha, nodes, output in cases.texture_graphs():
        if not is_wanted(name):
            continue
        emission = {"type": "emission", "color": cases.link(len(nodes) - 1, output), "strength": 1.0}
        setup = scene([*nodes, emission], [0, 0, -1], 2.0, 1, 4)
        for node in bpy.data.materials["test"].node_tree.nodes:
            if node.bl_idname == "ShaderNodeTexImage":
                node.image = image(encoding, alpha)
        texture = {"encoding": encoding, "alpha": alpha, "texels": TEXELS}
        yield {"name": name, "texture": texture, "nodes": [*nodes, emission], "pixels": render(setup, 4)}


def measure_values(graphs, side):
    for name, nodes, output in graphs:
        if not is_wanted(name):
            continue
        emission = {"type": "emission", "color": cases.link(len(nodes) - 1, output), "strength": 1.0}
        setup = scene([*nodes, emission], [0, 0, -1], 2.0, 1, side)
        yield {"name": name, "nodes": [*nodes, emission], "pixels": render(setup, side)}


def merged(old, new):
    """The old cases with the new ones in place of those of the same names."""
    names = {case["name"] for case in new}
    return [case for case in old if case["name"] not in names] + new


def main():
    path = os.path.join(HERE, "reference.json")
    with open(path, encoding="utf-8") as file:
        known = json.load(file)
    closures = list(measure_closures())
    values = [*measure_values(cases.value_graphs(), 4), *measure_textures(), *measure_values(procedural.graphs(), 6)]
    result = {
        "blender": known["blender"] if sys.argv[1:] else bpy.app.version_string,
        "closures": merged(known["closures"], closures),
        "values": merged(known["values"], values),
        # Measured in Blender 5.3, as the closures of metals are, new in 4.3: Huang's model is mended from 4.5 on.
        "hair": merged(known.get("hair", []), list(measure_hair())),
        "lit_hair": merged(known.get("lit_hair", []), list(measure_lit_hair())),
    }
    with open(path, "w", encoding="utf-8") as file:
        json.dump(result, file, indent=None, separators=(",", ":"))


if __name__ == "__main__":
    main()
