"""Random graphs of values, shown by Emission on cards, balls and boxes."""

import trees

import stage


def prepare(rng, width, height):
    """A scene that shows only what shines."""
    scene = stage.empty_scene(width, height)
    scene.cycles.max_bounces = 0
    scene.frame_set(rng.randint(1, 40))
    return scene


def add(scene, rng, palette, name, x, y):
    """A thing of one material at a place."""
    material, tree, output = stage.new_material(name)
    nodes = trees.grow(rng, tree, palette["values"], rng.randint(2, 7))
    show(rng, tree, nodes, output)
    obj = stage.add(scene, name, shape(rng, name, material))
    obj.location = (x, y, 0.2 * rng.random())
    if rng.random() < 0.5:
        obj.rotation_euler = [rng.uniform(-0.4, 0.4) for _ in range(3)]
    obj.scale = [rng.choice([1.0, 1.0, -1.0, 0.8]) for _ in range(3)]
    obj.pass_index, material.pass_index = rng.randint(0, 9), rng.randint(0, 9)
    obj.color = [rng.random() for _ in range(4)]
    obj["prop"] = rng.random()


def shape(rng, name, material):
    """A mesh of about a metre with random attributes."""
    kind = rng.choice(["square", "square", "ball", "ball", "box"])
    if kind == "square":
        mesh = stage.square(name, 0.95, material, with_uv=rng.random() < 0.9)
    elif kind == "ball":
        mesh = stage.ball(name, 0.47, material, smooth=rng.random() < 0.7, rings=12)
    else:
        mesh = stage.box(name, 0.6, material)
    stage.random_attributes(rng, mesh)
    return mesh


def show(rng, tree, nodes, output):
    """Leads the last of the nodes to the surface: as the colour or strength of an emission, or as it is."""
    chance = rng.random()
    if chance < 0.1:
        trees.link_output(rng, tree, nodes, output.inputs["Surface"])
    else:
        emission = tree.nodes.new("ShaderNodeEmission")
        trees.link_output(rng, tree, nodes, emission.inputs["Color" if chance < 0.85 else "Strength"])
        tree.links.new(emission.outputs[0], output.inputs["Surface"])
    if rng.random() < 0.05:
        other = tree.nodes.new("ShaderNodeOutputMaterial")
        other.target = rng.choice(["ALL", "CYCLES", "EEVEE"])
        trees.link_output(rng, tree, nodes, other.inputs["Surface"])
        other.is_active_output = rng.random() < 0.5
