"""Sockets take of nothing, a muted node, a group or another type what Cycles of this Blender takes."""

import bpy
import pytest

from cards import Cards, differences, node

pytestmark = pytest.mark.every_version

RED, BLUE = (0.8, 0.3, 0.1, 1.0), (0.1, 0.2, 0.9, 1.0)
TYPES = {"Color": RED, "Float": 0.4, "Vector": (0.2, 0.5, 0.9), "Int": 3, "Bool": True}


def red(tree):
    """A colour that Blender finds to be a constant."""
    return node(tree, "ShaderNodeGamma", {"Color": RED}).outputs[0]


def texture(tree, color=RED):
    """A colour that is the same everywhere, which Blender does not know."""
    return node(tree, "ShaderNodeTexChecker", {"Scale": 0.0, "Color1": color, "Color2": color}).outputs[0]


def half(tree):
    return node(tree, "ShaderNodeMath", {0: 0.3, 1: 0.2}).outputs[0]


def vector(tree):
    return node(tree, "ShaderNodeCombineXYZ", {0: 0.2, 1: 0.5, 2: 0.9}).outputs[0]


def reroute(tree, socket=None):
    made = tree.nodes.new("NodeReroute")
    if socket is not None:
        tree.links.new(socket, made.inputs[0])
    return made.outputs[0]


def glow(tree, socket=None, target="Color"):
    """An Emission shader with colours of its own that a socket feeds."""
    made = node(tree, "ShaderNodeEmission", {"Color": (0.6, 0.2, 0.4, 1.0), "Strength": 0.7})
    if socket is not None:
        tree.links.new(socket, made.inputs[target])
    return made.outputs[0]


def gradient(tree, socket):
    return node(tree, "ShaderNodeTexGradient", {"Vector": socket}).outputs[0]


def facing(tree, socket):
    return node(tree, "ShaderNodeLayerWeight", {"Normal": socket, "Blend": 0.3}).outputs[1]


def group(tree, inputs, outputs, build, linked=()):
    """A node of a new group; inputs are type, value and whether it is hidden, outputs type and value."""
    made = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    for kind, value, is_hidden in inputs:
        socket = made.interface.new_socket("In", in_out="INPUT", socket_type=f"NodeSocket{kind}")
        if value is not None:
            socket.default_value = value
        socket.hide_value = is_hidden
    for kind, value in outputs:
        socket = made.interface.new_socket("Out", in_out="OUTPUT", socket_type=f"NodeSocket{kind}")
        if value is not None:
            socket.default_value = value
    build(made, made.nodes.new("NodeGroupInput").outputs, made.nodes.new("NodeGroupOutput").inputs)
    found = tree.nodes.new("ShaderNodeGroup")
    found.node_tree = made
    for socket, target in zip(linked, found.inputs, strict=False):
        tree.links.new(socket, target)
    return found


def through(inner, inputs, outputs):
    inner.links.new(inputs[0], outputs[0])


def via(make):
    """A group's content: what is made of its input."""
    return lambda inner, inputs, outputs: inner.links.new(make(inner, inputs[0]), outputs[0])


def passed(tree, kinds, socket):
    """A value that has passed the input and output of a group."""
    return group(tree, [(kinds[0], None, False)], [(kinds[1], None)], through, [socket]).outputs[0]


def lacking_output(tree, kind, value):
    made = group(tree, [], [(kind, value)], lambda *_: None)
    made.node_tree.nodes.remove(next(n for n in made.node_tree.nodes if n.bl_idname == "NodeGroupOutput"))
    return made.outputs[0]


def muted_link(tree, target):
    shader = glow(tree, red(tree), target)
    shader.node.inputs[target].links[0].is_muted = True
    return shader


def mixed(tree, first, second, mute=False):
    made = tree.nodes.new("ShaderNodeMixShader")
    made.mute = mute
    for socket, target in ((first, made.inputs[1]), (second, made.inputs[2])):
        if socket is not None:
            tree.links.new(socket, target)
    return made.outputs[0]


def two_outputs(inner, _inputs, outputs):
    """The second one is active."""
    inner.links.new(red(inner), outputs[0])
    second = inner.nodes.new("NodeGroupOutput")
    inner.links.new(texture(inner, BLUE), second.inputs[0])
    outputs[0].node.is_active_output, second.is_active_output = False, True


def muted_in_group(inner, _inputs, outputs):
    inner.links.new(node(inner, "ShaderNodeGamma", {"Color": BLUE}, mute=True).outputs[0], outputs[0])


def unknown(inner, _inputs, outputs):
    inner.links.new(inner.nodes.new("ShaderNodeShaderToRGB").outputs["Alpha"], outputs[0])


def plain(tree):
    made = tree.nodes.new("ShaderNodeRGB").outputs[0]
    made.default_value = RED
    return made


def vector_of_two(tree):
    return node(tree, "FunctionNodeInputVector", vector_dimensions=2, vector=(0.2, 0.5)).outputs[0]


def first(tree, socket):
    return node(tree, "ShaderNodeSeparateXYZ", {0: socket}).outputs[0]


def inverted(tree):
    return node(tree, "ShaderNodeInvert", {"Color": RED}).outputs[0]


def cycle(tree):
    first = node(tree, "ShaderNodeGamma", {"Color": RED})
    second = node(tree, "ShaderNodeInvert", {"Color": first.outputs[0]})
    tree.links.new(second.outputs[0], first.inputs["Color"])
    return glow(tree, first.outputs[0])


def muted(tree, kind, inputs=None, output=0, **settings):
    return node(tree, kind, inputs, mute=True, **settings).outputs[output]


def muted_maths(tree, socket):
    """A number on the way of a vector."""
    return node(tree, "ShaderNodeMath", {0: socket}, mute=True).outputs[0]


def combined(tree, socket):
    return node(tree, "ShaderNodeCombineXYZ", {0: socket, 2: 0.9}).outputs[0]


CASES = {
    "vector of a color as a number": lambda t: glow(t, muted_maths(t, combined(t, plain(t)))),
    "color of numbers as a number": lambda t: glow(
        t, muted_maths(t, node(t, "ShaderNodeCombineColor", {0: half(t), 1: 0.1, 2: 0.9}).outputs[0])
    ),
    "vector as a truth": lambda t: glow(
        t,
        passed(
            t, ("Bool", "Bool"), node(t, "ShaderNodeVectorMath", {0: (0.2, -0.9, 0.1), 1: (0.1, 0.0, 0.0)}).outputs[0]
        ),
    ),
    "vector of a constant as a number": lambda t: glow(t, muted_maths(t, combined(t, red(t)))),
    "reroute to color": lambda t: glow(t, reroute(t)),
    "reroute to number": lambda t: glow(t, reroute(t), "Strength"),
    "two reroutes": lambda t: glow(t, reroute(t, reroute(t))),
    "reroute to vector": lambda t: gradient(t, reroute(t)),
    "reroute to normal": lambda t: facing(t, reroute(t)),
    "reroute to shader": lambda t: mixed(t, reroute(t), glow(t)),
    "reroute to group": lambda t: glow(
        t, group(t, [("Color", RED, False)], [("Color", None)], through, [reroute(t)]).outputs[0]
    ),
    "muted link to color": lambda t: muted_link(t, "Color"),
    "muted link to number": lambda t: muted_link(t, "Strength"),
    "muted blackbody": lambda t: glow(t, muted(t, "ShaderNodeBlackbody")),
    "muted blackbody, linked": lambda t: glow(t, muted(t, "ShaderNodeBlackbody", {0: half(t)})),
    "muted noise": lambda t: glow(t, muted(t, "ShaderNodeTexNoise", {"Vector": vector(t)})),
    "muted image": lambda t: glow(t, muted(t, "ShaderNodeTexImage")),
    "muted ramp": lambda t: glow(t, muted(t, "ShaderNodeValToRGB", {0: 0.3})),
    "muted ramp, linked": lambda t: glow(t, muted(t, "ShaderNodeValToRGB", {0: red(t)})),
    "muted ramp's alpha": lambda t: glow(t, muted(t, "ShaderNodeValToRGB", {0: red(t)}, output=1)),
    "muted checker": lambda t: glow(t, muted(t, "ShaderNodeTexChecker", {"Color1": RED})),
    "muted checker's second color": lambda t: glow(t, muted(t, "ShaderNodeTexChecker", {"Color2": red(t)})),
    "muted checker's factor": lambda t: glow(t, muted(t, "ShaderNodeTexChecker", {"Color2": red(t)}, output=1)),
    "muted hue": lambda t: glow(t, muted(t, "ShaderNodeHueSaturation", {"Color": RED})),
    "muted hue, linked": lambda t: glow(t, muted(t, "ShaderNodeHueSaturation", {"Color": texture(t)})),
    "muted hue, hue linked": lambda t: glow(t, muted(t, "ShaderNodeHueSaturation", {"Hue": half(t)})),
    "muted maths": lambda t: glow(t, muted(t, "ShaderNodeMath", {0: 0.3}), "Strength"),
    "muted maths of color": lambda t: glow(t, muted(t, "ShaderNodeMath", {0: red(t)})),
    "muted mix": lambda t: glow(t, muted(t, "ShaderNodeMix", {"A_Color": RED}, output=2, data_type="RGBA")),
    "muted mix of second": lambda t: glow(t, muted(t, "ShaderNodeMix", {"B_Color": red(t)}, 2, data_type="RGBA")),
    "muted separate": lambda t: glow(t, muted(t, "ShaderNodeSeparateXYZ", {0: vector(t)}, output=1)),
    "muted grey": lambda t: glow(t, muted(t, "ShaderNodeRGBToBW", {0: red(t)})),
    "muted value": lambda t: glow(t, muted(t, "ShaderNodeValue"), "Strength"),
    "muted geometry": lambda t: glow(t, muted(t, "ShaderNodeNewGeometry")),
    "muted coordinates": lambda t: gradient(t, muted(t, "ShaderNodeTexCoord", output=2)),
    "muted mapping": lambda t: gradient(t, muted(t, "ShaderNodeMapping", {"Vector": (0.2, 0.0, 0.0)})),
    "muted mapping, linked": lambda t: gradient(t, muted(t, "ShaderNodeMapping", {"Vector": vector(t)})),
    "muted normal map": lambda t: facing(t, muted(t, "ShaderNodeNormalMap")),
    "muted emission": lambda t: mixed(t, muted(t, "ShaderNodeEmission", {"Color": red(t)}), glow(t)),
    "muted mix shader": lambda t: mixed(t, glow(t, red(t)), glow(t), mute=True),
    "muted mix shader of second": lambda t: mixed(t, None, glow(t), mute=True),
    "muted behind muted": lambda t: glow(t, muted(t, "ShaderNodeGamma", {0: muted(t, "ShaderNodeInvert")})),
    "muted group": lambda t: glow(t, muted_group(t, None)),
    "muted group, number linked": lambda t: glow(t, muted_group(t, 0)),
    "muted group, color linked": lambda t: glow(t, muted_group(t, 1)),
    "muted group's number": lambda t: glow(t, muted_group(t, 1, output=1), "Strength"),
    "number as surface": half,
    "color as surface": red,
    "vector as surface": vector,
    "texture as surface": texture,
    "color and number in mix shader": lambda t: mixed(t, texture(t), half(t)),
    "color through shader": lambda t: passed(t, ("Shader", "Shader"), texture(t)),
    "group color as shader": lambda t: group(t, [("Color", RED, False)], [("Shader", None)], through).outputs[0],
    "group shader, not linked": lambda t: group(t, [("Shader", None, False)], [("Shader", None)], through).outputs[0],
    "node of EEVEE": lambda t: glow(t, t.nodes.new("ShaderNodeShaderToRGB").outputs[0]),
    "node of an add-on": lambda t: glow(t, t.nodes.new("ShaderNodeForeign").outputs[0]),
    "vector of node of an add-on": lambda t: gradient(t, t.nodes.new("ShaderNodeForeign").outputs[0]),
    "node of EEVEE in a group": lambda t: glow(t, group(t, [], [("Float", 0.4)], unknown).outputs[0]),
    "plain color through a number": lambda t: glow(t, passed(t, ("Float", "Float"), plain(t))),
    "inverted color through a number": lambda t: glow(t, passed(t, ("Float", "Color"), inverted(t))),
    "group of an add-on": lambda t: glow(t, custom_group(t)),
    "group output, not linked": lambda t: glow(t, group(t, [], [("Color", RED)], lambda *_: None).outputs[0]),
    "group output to vector": lambda t: gradient(
        t, group(t, [], [("Vector", (0.3, 0, 0))], lambda *_: None).outputs[0]
    ),
    "group output of reroute": lambda t: glow(
        t, group(t, [], [("Color", RED)], lambda g, _, outputs: g.links.new(reroute(g), outputs[0])).outputs[0]
    ),
    "group output of muted": lambda t: glow(t, group(t, [], [("Color", RED)], muted_in_group).outputs[0]),
    "group without output": lambda t: glow(t, lacking_output(t, "Float", 0.4), "Strength"),
    "group without output to vector": lambda t: gradient(t, lacking_output(t, "Vector", (0.3, 0.0, 0.0))),
    "group with two outputs": lambda t: glow(t, group(t, [], [("Color", None)], two_outputs).outputs[0]),
    "group in group": lambda t: glow(t, group(t, [("Color", RED, False)], [("Color", None)], via(nested)).outputs[0]),
    "cycle": cycle,
}
for name, value in TYPES.items():
    for is_hidden in (False, True):
        inputs = [(name, value, is_hidden)]
        suffix = ", hidden" if is_hidden else ""
        CASES |= {
            f"group {name} to number{suffix}": lambda t, i=inputs: glow(
                t, group(t, i, [("Float", None)], through).outputs[0]
            ),
            f"group {name} to color{suffix}": lambda t, i=inputs: glow(
                t,
                group(t, i, [("Color", None)], via(lambda g, s: node(g, "ShaderNodeGamma", {0: s}).outputs[0])).outputs[
                    0
                ],
            ),
            f"group {name} to vector{suffix}": lambda t, i=inputs: group(
                t, i, [("Color", None)], via(gradient)
            ).outputs[0],
            f"group {name} to normal{suffix}": lambda t, i=inputs: group(t, i, [("Float", None)], via(facing)).outputs[
                0
            ],
        }
    for other in TYPES:
        for what in (texture, red, vector):
            CASES[f"{what.__name__} through {name} and {other}"] = lambda t, k=(name, other), w=what: passed(t, k, w(t))


def muted_group(tree, linked, output=0):
    made = group(
        tree, [("Float", 0.3, False), ("Color", RED, False)], [("Color", None), ("Float", None)], lambda *_: None
    )
    if linked is not None:
        tree.links.new(texture(tree, BLUE), made.inputs[linked])
    made.mute = True
    return made.outputs[output]


def nested(inner, socket):
    return group(inner, [("Color", BLUE, True)], [("Color", None)], through, [socket]).outputs[0]


def custom_group(tree):
    made = tree.nodes.new("ShaderNodeCards")
    made.node_tree = group(tree, [("Color", RED, False)], [("Color", None)], through).node_tree
    return made.outputs[0]


def menu(tree):
    made = tree.nodes.new("GeometryNodeMenuSwitch")
    made.data_type = "RGBA"
    made.enum_items.clear()
    for name in ("One", "Two"):
        made.enum_items.new(name)
    made.inputs[1].default_value, made.inputs[2].default_value = BLUE, RED
    return made


def grouped_menu(tree):
    inner = group(
        tree, [("Menu", None, False)], [("Color", None)], lambda g, i, o: g.links.new(via_menu(g, i[0]), o[0])
    )
    bpy.context.view_layer.update()
    inner.inputs[0].default_value = "Two"
    return inner.outputs[0]


def via_menu(inner, socket):
    made = menu(inner)
    inner.links.new(socket, made.inputs[0])
    return made.outputs[0]


def chosen_menu(tree):
    made = menu(tree)
    made.inputs[0].default_value = "Two"
    return made.outputs[0]


if bpy.app.version >= (5, 0, 0):
    CASES["menu"] = lambda t: glow(t, chosen_menu(t))
    CASES["menu of a group"] = lambda t: glow(t, grouped_menu(t))
for own in ("Color", "Float", "Vector"):
    for to in ("Color", "Float", "Vector"):
        CASES[f"own {own} as {to} to vector"] = lambda t, own=own, to=to: gradient(
            t, group(t, [(own, TYPES[own], False)], [(to, None)], through).outputs[0]
        )
if bpy.app.version >= (5, 2, 0):
    CASES["bool"] = lambda t: glow(t, node(t, "FunctionNodeInputBool", boolean=True).outputs[0])
    CASES["integer"] = lambda t: glow(t, node(t, "FunctionNodeInputInt", integer=3).outputs[0])
    CASES["vector"] = lambda t: glow(t, node(t, "FunctionNodeInputVector", vector=(0.2, 0.5, 0.9)).outputs[0])
    CASES["vector of 4"] = lambda t: glow(
        t, node(t, "FunctionNodeInputVector", vector_dimensions=4, vector=(0.2, 0.5, 0.9, 0.4)).outputs[0]
    )
    # The third component of two is whatever lies in memory there.
    CASES["vector of 2"] = lambda t: glow(t, first(t, vector_of_two(t)))


@pytest.fixture(scope="module")
def node_types():
    """Types of nodes of an add-on: a group, and one that Cycles does not know. They stay: some Blenders crash where
    nodes of types that are gone are freed."""

    class Group(bpy.types.ShaderNodeCustomGroup):
        bl_idname, bl_label = "ShaderNodeCards", "Cards"

    class Foreign(bpy.types.ShaderNode):
        bl_idname, bl_label = "ShaderNodeForeign", "Foreign"

        def init(self, _context):
            self.outputs.new("NodeSocketColor", "Color")

    bpy.utils.register_class(Group)
    bpy.utils.register_class(Foreign)


def test_sockets_take_what_they_take_in_cycles(scene, node_types, tmp_path):
    cards = Cards(scene, columns=16)
    for name, build in CASES.items():
        tree, output = cards.add(name)
        tree.links.new(build(tree), output.inputs["Surface"])
    means, warnings = cards.means(tmp_path)
    assert differences(means) == {}
    assert warnings == []


def outputs_of(tree, targets, active):
    """Material outputs of these targets, in red and blue."""
    for index, (target, color) in enumerate(zip(targets, (RED, BLUE), strict=False)):
        output = node(tree, "ShaderNodeOutputMaterial", {0: texture(tree, color)}, target=target)
        output.is_active_output = index == active


def test_outputs_count_as_in_cycles(scene, tmp_path):
    cards = Cards(scene)
    for targets in (("ALL", "ALL"), ("ALL", "CYCLES"), ("CYCLES", "EEVEE"), ("EEVEE", "ALL"), ("EEVEE", "EEVEE")):
        for active in range(2):
            tree, output = cards.add(f"{targets} {active}")
            tree.nodes.remove(output)
            outputs_of(tree, targets, active)
    tree, output = cards.add("muted")
    tree.links.new(texture(tree), output.inputs["Surface"])
    output.mute = True
    tree, _ = cards.add("in a group")
    group(tree, [], [], lambda inner, *_: node(inner, "ShaderNodeOutputMaterial", {0: texture(inner)}))
    assert differences(cards.means(tmp_path)[0]) == {}
