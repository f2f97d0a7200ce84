"""Random mixtures of closures under a sky and a sun."""

import trees

import stage

MIXES = ("ShaderNodeMixShader", "ShaderNodeMixShader", "ShaderNodeAddShader")


def prepare(rng, width, height):
    """A grey floor, a sky and a sun; bounces and caustics by chance."""
    scene = stage.empty_scene(width, height)
    floor = stage.add(
        scene, "Floor", stage.square("Floor", 40.0, stage.plain_material("Floor", Color=(0.3, 0.3, 0.3, 1)))
    )
    floor.location.z = -0.6
    stage.background(scene).inputs["Color"].default_value = (0.4, 0.5, 0.6, 1)
    sun = stage.add(scene, "Sun", stage.bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler, sun.data.energy, sun.data.angle = (0.5, 0.3, 0), 2.0, 0.3
    cycles = scene.cycles
    cycles.max_bounces, cycles.blur_glossy = rng.choice([1, 3, 4]), rng.choice([0.0, 0.0, 1.0])
    cycles.caustics_reflective, cycles.caustics_refractive = rng.random() < 0.7, rng.random() < 0.7
    return scene


def add(scene, rng, palette, name, x, y):
    """A thing of one material at a place."""
    material, tree, output = stage.new_material(name)
    closure = mixture(rng, tree, palette, 2)
    tree.links.new(closure, output.inputs["Surface"])
    kind = rng.choice(["ball", "ball", "ball", "box", "square"])
    if kind == "ball":
        mesh = stage.ball(name, 0.42, material, smooth=rng.random() < 0.8)
    else:
        mesh = stage.box(name, 0.6, material) if kind == "box" else stage.square(name, 0.85, material)
    stage.random_attributes(rng, mesh)
    obj = stage.add(scene, name, mesh)
    obj.location = (x, y, 0.0)
    if kind != "ball" or rng.random() < 0.3:
        obj.rotation_euler = [rng.uniform(-0.6, 0.6) for _ in range(3)]
    obj.scale = [rng.choice([1.0, 1.0, 1.0, -1.0]) for _ in range(3)]


def mixture(rng, tree, palette, depth):
    """The output of closures that are mixed and added at random."""
    if depth and rng.random() < 0.45:
        node = tree.nodes.new(rng.choice(MIXES))
        for socket in node.inputs:
            if socket.type == "SHADER" and rng.random() < 0.93:
                tree.links.new(mixture(rng, tree, palette, depth - 1), socket)
    else:
        node = tree.nodes.new(palette["closures"].draw(rng))
        trees.set_properties(rng, node)
    for socket in node.inputs:
        if socket.type in {"VALUE", "RGBA"} and rng.random() < 0.5:
            socket.default_value = likely(rng, socket)
        if socket.type in {"VALUE", "RGBA", "VECTOR"} and rng.random() < 0.12:
            feed(rng, tree, palette, socket)
    node.mute = rng.random() < trees.CHANCE["mute"] / 2
    return node.outputs[0]


def likely(rng, socket):
    """A value as artists set it: within 0 to 1, but for strengths, distances and indices of refraction."""
    if socket.type == "RGBA":
        return [rng.choice([rng.random(), 0.8]) for _ in range(3)] + [1.0]
    if socket.name == "IOR":
        return rng.choice([1.0, 1.2, 1.45, 1.9, 0.7])
    if "Thickness" in socket.name:
        return rng.choice([0.0, 0.0, 400.0])
    if socket.name == "Emission Strength":
        return rng.choice([0.0, 0.0, 0.5])
    return rng.choice([0.0, 1.0, rng.random(), rng.random()])


def feed(rng, tree, palette, socket):
    """Links a small graph to an input: bumps and normal maps to normals, values to others."""
    if socket.name in {"Normal", "Coat Normal", "Tangent"}:
        kind = (
            "ShaderNodeTangent" if socket.name == "Tangent" else rng.choice(["ShaderNodeBump", "ShaderNodeNormalMap"])
        )
        node = tree.nodes.new(kind)
        trees.set_properties(rng, node)
        nodes = trees.grow(rng, tree, palette["values"], 1)
        for name in ("Height", "Color"):
            if name in node.inputs:
                trees.link_output(rng, tree, nodes, node.inputs[name])
        tree.links.new(node.outputs[0], socket)
    else:
        nodes = trees.grow(rng, tree, palette["values"], rng.randint(1, 2))
        clamp = tree.nodes.new("ShaderNodeClamp")
        trees.link_output(rng, tree, nodes, clamp.inputs["Value"])
        tree.links.new(clamp.outputs[0], socket)
