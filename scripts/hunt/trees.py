"""Random node trees: any node of the running Blender, with any of its settings, linked in any way that files hold."""

import math

import bpy

NAMES = ("", "Col", "f", "vec", "UVMap", "Second", "prop", "missing")
"""Names of attributes, UV maps and custom properties; `stage.card_mesh` makes all but `missing`."""

GROUP_SOCKETS = ("Float", "Float", "Color", "Color", "Vector", "Vector", "Int", "Bool")
CHANCE = {
    "mute": 0.07,
    "muted_link": 0.03,
    "group": 0.1,
    "hidden_value": 0.25,
    "reroute": 0.15,
    "panel": 0.2,
    "odd_link": 0.03,
    "loud": 0.05,
}
"""How often what files hold is in a tree; `--without` of `run.py` sets some to 0 while they are known to fail."""

DIVISORS = {"Lacunarity", "Brick Width", "Row Height", "Filter Width"}
"""Inputs that the panels of Blender do not let be 0 or less."""

VALUES = {"VALUE", "INT", "BOOLEAN", "VECTOR", "RGBA", "ROTATION"}
"""Types of sockets that convert to each other."""

FREE_OF_CHANCE = {"Node", "NodeInternal", "ShaderNode"}
"""Types whose properties are about the editor."""


class Palette:
    """Kinds of nodes to choose from. Those that the exporter warns about whatever they do are loud: they are drawn
    seldom, since a warning excuses a difference."""

    def __init__(self, quiet, loud=()):
        self.quiet, self.loud = sorted(quiet), sorted(loud)

    def draw(self, rng):
        """The type of a node."""
        return rng.choice(self.loud if self.loud and rng.random() < CHANCE["loud"] else self.quiet)


def node_kinds():
    """Every node type that a material can hold, with the types of its outputs."""
    found = {}
    tree = bpy.data.node_groups.new("kinds", "ShaderNodeTree")
    for kind in dir(bpy.types):
        if not kind.startswith(("ShaderNode", "FunctionNode", "GeometryNodeMenu")) or kind == "ShaderNodeGroup":
            continue
        try:
            node = tree.nodes.new(kind)
        except RuntimeError:
            continue
        found[kind] = {socket.type for socket in node.outputs if socket.enabled}
    bpy.data.node_groups.remove(tree)
    return found


def grow(rng, tree, palette, count, earlier=(), depth=0):
    """Adds `count` random nodes; each is fed by those before it. Returns all, `earlier` ones first."""
    nodes = list(earlier)
    for _ in range(count):
        node = _new_node(rng, tree, palette, depth)
        set_inputs(rng, node)
        for socket in node.inputs:
            _feed(rng, tree, socket, nodes)
        node.mute = rng.random() < CHANCE["mute"]
        nodes.append(node)
    return nodes


def link_output(rng, tree, nodes, socket):
    """Links a random output of the last node that has one to `socket`."""
    for node in reversed(nodes):
        outputs = _outputs(rng, node)
        if outputs:
            _link(rng, tree, rng.choice(outputs), socket)
            return


def _new_node(rng, tree, palette, depth):
    if rng.random() < CHANCE["group"] and depth < 2:
        return _new_group(rng, tree, palette, depth)
    if rng.random() < CHANCE["reroute"] / 5:
        return tree.nodes.new("NodeReroute")
    node = tree.nodes.new(palette.draw(rng))
    set_properties(rng, node)
    return node


def _new_group(rng, tree, palette, depth):
    """A group with a random inside; now and then without a tree, or with an output that nothing feeds."""
    node = tree.nodes.new("ShaderNodeGroup")
    if rng.random() < 0.04:
        return node
    inside = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    for in_out, count in (("INPUT", rng.randint(0, 4)), ("OUTPUT", rng.randint(1, 3))):
        for number in range(count):
            _new_socket(rng, inside, f"{in_out} {number}", in_out)
    start, end = inside.nodes.new("NodeGroupInput"), inside.nodes.new("NodeGroupOutput")
    nodes = grow(rng, inside, palette, rng.randint(1, 3), [start], depth + 1)
    for socket in list(end.inputs)[:-1]:
        if rng.random() < 0.9:
            link_output(rng, inside, nodes if rng.random() < 0.8 else [start], socket)
    node.node_tree = inside
    return node


def _new_socket(rng, group, name, in_out):
    kind = rng.choice(GROUP_SOCKETS)
    socket = group.interface.new_socket(name, in_out=in_out, socket_type=f"NodeSocket{kind}")
    socket.hide_value = rng.random() < CHANCE["hidden_value"]
    socket.default_value = _value_like(rng, socket.default_value)


def _outputs(rng, node):
    """Outputs that a link may start at: as a rule those that are shown and give a value."""
    some = [socket for socket in node.outputs if socket.enabled and socket.type in VALUES]
    odd = [socket for socket in node.outputs if socket.bl_idname != "NodeSocketVirtual"]
    return odd if rng.random() < CHANCE["odd_link"] else some


def _feed(rng, tree, socket, nodes):
    """Links an input to an earlier node, or leaves it alone."""
    chance = 0.5 if socket.enabled and socket.name not in {"Normal", "Tangent"} else 0.06
    if socket.node.bl_idname == "ShaderNodeTexWhiteNoise" or socket.name in DIVISORS:
        return  # The last bit of what comes decides what they give, or 0 is divided by.
    if not nodes or socket.type not in VALUES or rng.random() > chance:
        return
    outputs = _outputs(rng, rng.choice(nodes))
    if outputs:
        _link(rng, tree, rng.choice(outputs), socket)


def _link(rng, tree, output, socket):
    """A link, now and then muted, by way of reroutes, or from a reroute that nothing feeds."""
    for _ in range(rng.choice([1, 2]) if rng.random() < CHANCE["reroute"] else 0):
        reroute = tree.nodes.new("NodeReroute")
        if rng.random() < 0.9:
            tree.links.new(output, reroute.inputs[0])
        output = reroute.outputs[0]
    link = tree.links.new(output, socket)
    link.is_muted = rng.random() < CHANCE["muted_link"]


def set_inputs(rng, node, share=0.5):
    """Random values of unlinked inputs, hidden ones too, as a file may hold them."""
    for socket in node.inputs:
        if rng.random() < share and socket.name not in DIVISORS and hasattr(socket, "default_value"):
            _try_set(socket, "default_value", _value_like(rng, socket.default_value))


def _value_like(rng, value):
    """A random value of the type of `value`."""
    if isinstance(value, bool):
        return rng.random() < 0.5
    if isinstance(value, int):
        return rng.randint(-1, 4)
    if isinstance(value, float):
        return rng.choice([0.0, 1.0, -0.5, 0.5, 2.0, rng.random(), rng.uniform(-3.0, 10.0)])
    if isinstance(value, str):
        return rng.choice(NAMES)
    if value is None or not hasattr(value, "__len__"):
        return value
    if len(value) == 4:
        return [rng.random() * rng.choice([1.0, 1.0, 1.0, 3.0]) for _ in range(3)] + [rng.choice([1.0, rng.random()])]
    return [rng.uniform(-1.5, 2.5) for _ in value]


def set_properties(rng, node):
    """Random settings of a node, its ramp, its curves, its mapping panel and its image."""
    for prop in node.bl_rna.properties:
        if _is_about_editor(prop.identifier):
            continue
        if prop.type == "ENUM" and not prop.is_enum_flag and rng.random() < 0.5:
            _try_set(node, prop.identifier, rng.choice([item.identifier for item in prop.enum_items] or [""]))
        elif prop.type == "BOOLEAN" and not prop.is_array and rng.random() < 0.3:
            _try_set(node, prop.identifier, rng.random() < 0.5)
        elif prop.type in {"FLOAT", "INT"} and not prop.is_array and rng.random() < 0.3:
            value = rng.uniform(max(prop.soft_min, -10.0), min(prop.soft_max, 10.0))
            _try_set(node, prop.identifier, value if prop.type == "FLOAT" else round(value))
        elif prop.type == "STRING" and prop.identifier in {"uv_map", "layer_name", "attribute_name"}:
            _try_set(node, prop.identifier, rng.choice(NAMES))
    for output in node.outputs:
        if node.bl_idname in {"ShaderNodeValue", "ShaderNodeRGB", "ShaderNodeNormal"} and rng.random() < 0.9:
            _try_set(output, "default_value", _value_like(rng, output.default_value))
    if hasattr(node, "image"):
        node.image = rng.choice([*sorted(bpy.data.images, key=lambda image: image.name), None])
    if hasattr(node, "color_ramp"):
        _set_ramp(rng, node.color_ramp)
    if hasattr(node, "mapping") and hasattr(node.mapping, "curves"):
        _set_curves(rng, node.mapping)
    if hasattr(node, "texture_mapping") and rng.random() < CHANCE["panel"]:
        _set_mapping(rng, node.texture_mapping)


def _is_about_editor(name):
    return any(name in getattr(bpy.types, kind).bl_rna.properties for kind in FREE_OF_CHANCE)


def _set_ramp(rng, ramp):
    for name in ("color_mode", "interpolation", "hue_interpolation"):
        if rng.random() < 0.5:
            _try_set(ramp, name, rng.choice([item.identifier for item in ramp.bl_rna.properties[name].enum_items]))
    for _ in range(rng.randint(0, 3)):
        ramp.elements.new(rng.random())
    for element in ramp.elements:
        if rng.random() < 0.7:
            element.color = [rng.random() for _ in range(4)]


def _set_curves(rng, mapping):
    mapping.use_clip = rng.random() < 0.6
    mapping.extend = rng.choice(["HORIZONTAL", "EXTRAPOLATED"])
    for curve in mapping.curves:
        for _ in range(rng.randint(0, 3)):
            curve.points.new(rng.random(), rng.random())
        for point in curve.points:
            point.handle_type = rng.choice(["AUTO", "AUTO_CLAMPED", "VECTOR"])
    if rng.random() < 0.2:
        mapping.black_level, mapping.white_level = [rng.uniform(0, 0.3)] * 3, [rng.uniform(0.7, 1.5)] * 3
    mapping.update()


def _set_mapping(rng, mapping):
    """The mapping panel of a texture node."""
    mapping.vector_type = rng.choice(["POINT", "TEXTURE", "VECTOR", "NORMAL"])
    mapping.translation = [rng.uniform(-1, 1) for _ in range(3)]
    mapping.rotation = [rng.uniform(-math.pi, math.pi) for _ in range(3)]
    mapping.scale = [rng.choice([1.0, -1.0, rng.uniform(0.3, 3.0)]) for _ in range(3)]
    for axis in "xyz":
        if rng.random() < 0.2:
            setattr(mapping, f"mapping_{axis}", rng.choice(["NONE", "X", "Y", "Z"]))
    mapping.use_min, mapping.use_max = rng.random() < 0.2, rng.random() < 0.2


def _try_set(owner, name, value):
    """Sets a property where Blender allows it."""
    try:
        setattr(owner, name, value)
    except (AttributeError, TypeError, ValueError):
        pass
