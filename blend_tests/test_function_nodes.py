"""Nodes that Blender's shaders share with its other trees from 5.0 on give what they give in Cycles."""

import bpy
import pytest

from cards import Cards, differences, node

pytestmark = [
    pytest.mark.every_version,
    pytest.mark.skipif(bpy.app.version < (5, 3, 0), reason="shaders have these nodes from Blender 5.3 on"),
]


def ramp(tree, start=-3.0, end=5.0):
    """A number that grows along a card."""
    u = node(tree, "ShaderNodeSeparateXYZ", {0: tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]}).outputs[0]
    return node(tree, "ShaderNodeMath", {0: u, 1: end - start, 2: start}, operation="MULTIPLY_ADD").outputs[0]


def half(tree):
    """1 on the right half of a card, else 0."""
    return node(tree, "ShaderNodeMath", {0: ramp(tree), 1: 1.0}, operation="GREATER_THAN").outputs[0]


def shown(tree, number):
    """A number moved to where cards can show it."""
    return node(tree, "ShaderNodeMath", {0: number, 1: 0.1, 2: 3.0}, operation="MULTIPLY_ADD").outputs[0]


def compare(cards, tmp_path):
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


def operations_of(kind):
    tree = bpy.data.node_groups.new("Probe", "ShaderNodeTree")
    return tree.nodes.new(kind).bl_rna.properties["operation"].enum_items.keys()


def test_whole_numbers_and_truth(scene, tmp_path):
    cards = Cards(scene)
    for operation in operations_of("FunctionNodeIntegerMath"):
        tree, output = cards.add(operation)
        inputs = {"Value": ramp(tree), "Value_001": 2, "Value_002": 3}
        made = node(tree, "FunctionNodeIntegerMath", inputs, operation=operation)
        cards.show(tree, output, shown(tree, made.outputs[0]))
    for operation in operations_of("FunctionNodeBooleanMath"):
        for second in (False, True):
            tree, output = cards.add(f"{operation} {second}")
            inputs = {} if operation == "NOT" else {"Boolean_001": second}
            made = node(tree, "FunctionNodeBooleanMath", inputs, operation=operation)
            tree.links.new(half(tree), made.inputs[0])
            cards.show(tree, output, made.outputs[0])
    compare(cards, tmp_path)


def test_switches_show_one_of_their_inputs(scene, tmp_path):
    cards = Cards(scene)
    red, green, blue = (0.8, 0.1, 0.1, 1.0), (0.1, 0.7, 0.1, 1.0), (0.1, 0.1, 0.9, 1.0)
    for name, condition in (("true", lambda _: True), ("false", lambda _: False), ("half", half)):
        tree, output = cards.add(f"switch {name}")
        inputs = {"Switch": condition(tree), "False": red, "True": green}
        cards.show(tree, output, node(tree, "GeometryNodeSwitch", inputs, input_type="RGBA").outputs[0])
        tree, output = cards.add(f"shader {name}")
        shaders = [node(tree, "ShaderNodeEmission", {0: color}).outputs[0] for color in (red, green)]
        inputs = {"Switch": condition(tree), "False": shaders[0], "True": shaders[1]}
        cards.show(tree, output, node(tree, "GeometryNodeSwitch", inputs, input_type="SHADER").outputs[0])
        tree, output = cards.add(f"enabled {name}")
        cards.show(tree, output, node(tree, "NodeEnableOutput", {"Enable": condition(tree), "Value": 0.6}).outputs[0])
    for name, index in (("second", lambda _: 1), ("beyond", lambda _: 7), ("varies", ramp)):
        tree, output = cards.add(f"index {name}")
        switch = tree.nodes.new("GeometryNodeIndexSwitch")
        switch.index_switch_items.new()
        for socket, color in zip(switch.inputs[1:4], (red, green, blue), strict=True):
            socket.default_value = color
        chosen = index(tree)
        if isinstance(chosen, int):
            switch.inputs["Index"].default_value = chosen
        else:
            tree.links.new(chosen, switch.inputs["Index"])
        cards.show(tree, output, switch.outputs[0])
    for index in (0, 2, 4):
        tree, output = cards.add(f"component {index}")
        inputs = {"Vector": (0.2, 0.5, 0.7), "Index": index}
        cards.show(tree, output, node(tree, "FunctionNodeGetVectorComponent", inputs).outputs[0])
    compare(cards, tmp_path)


def test_texts_become_numbers(scene, tmp_path):
    cards = Cards(scene)

    def add(name, kind, inputs, output=0, **settings):
        tree, card = cards.add(name)
        made = node(
            tree, kind, {key: value(tree) if callable(value) else value for key, value in inputs.items()}, **settings
        )
        cards.show(tree, card, shown(tree, made.outputs[output]))

    def text(kind, inputs, **settings):
        return lambda tree: node(tree, kind, inputs, **settings).outputs[0]

    add("length", "FunctionNodeStringLength", {0: "h\u00e9llo"})
    add("find", "FunctionNodeFindInString", {"String": "abcabc", "Search": "c"})
    add("count", "FunctionNodeFindInString", {"String": "abcabc", "Search": "bc"}, 1)
    add("missing", "FunctionNodeFindInString", {"String": "abcabc", "Search": "x"})
    for operation in ("Starts With", "Ends With", "Contains"):
        add(operation, "FunctionNodeMatchString", {"String": "abcde", "Operation": operation, "Key": "cde"})
    add("number", "FunctionNodeStringToValue", {0: "-0.25e1abc"})
    add("number's length", "FunctionNodeStringToValue", {0: "0.25abc"}, 1)
    add("replaced", "FunctionNodeStringLength", {0: text("FunctionNodeReplaceString", {0: "abab", 1: "b", 2: "xyz"})})
    add("sliced", "FunctionNodeStringToValue", {0: text("FunctionNodeSliceString", {0: "12345", 1: 1, 2: 2})})
    add("reversed", "FunctionNodeStringToValue", {0: text("FunctionNodeReverseString", {0: "12"})})
    add("trimmed", "FunctionNodeStringLength", {0: text("FunctionNodeTrimString", {0: "  xx a xx ", 1: "x"})})
    add("written", "FunctionNodeStringLength", {0: text("FunctionNodeValueToString", {0: 3.14159, 1: 3})})
    add("case", "FunctionNodeFindInString", {0: text("FunctionNodeSetStringCase", {0: "abc"}), 1: "C"})
    compare(cards, tmp_path)


FORMATS = {
    "as they come": "{}{}",
    "by number": "{1}{0}",
    "by name": "{Number}.{Count}",
    "digits": "{:.2f}{:03}",
    "width": "{:9}{:>4}",
    "zeros": "{:07}{:x}",
    "general": "{:.3}{:+}",
    "signed": "{:+}",
    "braces": "1{{}}{}{}",
    "a whole number as broken": "{}{:f}",
    "unknown name": "{Other}",
    "too many": "{}{}{}",
    "attribute": "{0.real}",
}


@pytest.mark.parametrize("number", [3.0, 0.1, -2.5])
def test_formats_become_numbers(scene, tmp_path, number):
    """The length of each text, and the number that it begins with."""
    cards = Cards(scene)
    for name, text in FORMATS.items():
        for kind in ("FunctionNodeStringLength", "FunctionNodeStringToValue"):
            tree, out = cards.add(f"{name} {kind}")
            formatted = tree.nodes.new("FunctionNodeFormatString")
            formatted.format_items.new("FLOAT", "Number")
            formatted.format_items.new("INT", "Count")
            formatted.inputs["Format"].default_value = text
            formatted.inputs["Number"].default_value, formatted.inputs["Count"].default_value = number, 17
            value = node(tree, kind, {0: formatted.outputs[0]}).outputs[0]
            cards.show(tree, out, shown(tree, value))
    compare(cards, tmp_path)


def test_zones_closures_and_bundles_are_followed(scene, tmp_path):
    cards = Cards(scene)
    tree, output = cards.add("repeat")
    first, last = tree.nodes.new("GeometryNodeRepeatInput"), tree.nodes.new("GeometryNodeRepeatOutput")
    first.pair_with_output(last)
    last.repeat_items.clear()
    last.repeat_items.new("FLOAT", "v")
    first.inputs["Iterations"].default_value = 3
    tree.links.new(ramp(tree, 0.1, 0.3), first.inputs["v"])
    doubled = node(tree, "ShaderNodeMath", {0: first.outputs["v"], 1: 1.5}, operation="MULTIPLY").outputs[0]
    counted = node(
        tree, "ShaderNodeMath", {0: first.outputs["Iteration"], 1: 0.1, 2: doubled}, operation="MULTIPLY_ADD"
    )
    tree.links.new(counted.outputs[0], last.inputs["v"])
    cards.show(tree, output, last.outputs["v"])

    tree, output = cards.add("closure")
    start, end = tree.nodes.new("NodeClosureInput"), tree.nodes.new("NodeClosureOutput")
    start.pair_with_output(end)
    end.input_items.new("FLOAT", "x")
    end.output_items.new("FLOAT", "y")
    squared = node(tree, "ShaderNodeMath", {0: start.outputs["x"], 1: 2.0}, operation="POWER")
    tree.links.new(squared.outputs[0], end.inputs["y"])
    values = []
    for argument in (0.5, ramp(tree, 0.2, 0.8)):
        call = tree.nodes.new("NodeEvaluateClosure")
        call.input_items.new("FLOAT", "x")
        call.output_items.new("FLOAT", "y")
        tree.links.new(end.outputs[0], call.inputs[0])
        if isinstance(argument, float):
            call.inputs["x"].default_value = argument
        else:
            tree.links.new(argument, call.inputs["x"])
        values.append(call.outputs["y"])
    cards.show(tree, output, node(tree, "ShaderNodeMath", dict(enumerate(values)), operation="ADD").outputs[0])

    tree, output = cards.add("bundle")
    combined, separate = tree.nodes.new("NodeCombineBundle"), tree.nodes.new("NodeSeparateBundle")
    for made in (combined, separate):
        made.bundle_items.new("RGBA", "Tint")
        made.bundle_items.new("FLOAT", "Strength")
    combined.inputs["Tint"].default_value = (0.1, 0.6, 0.3, 1.0)
    tree.links.new(ramp(tree, 0.2, 0.8), combined.inputs["Strength"])
    tree.links.new(combined.outputs[0], separate.inputs[0])
    emission = node(tree, "ShaderNodeEmission", {0: separate.outputs["Tint"], 1: separate.outputs["Strength"]})
    cards.show(tree, output, emission.outputs[0])

    tree, output = cards.add("joined bundles")
    joined, separate = tree.nodes.new("NodeJoinBundle"), tree.nodes.new("NodeSeparateBundle")
    first, other, again = (
        ("Tint", (0.1, 0.6, 0.3, 1.0)),
        ("Shade", (0.5, 0.1, 0.2, 1.0)),
        ("Tint", (0.9, 0.2, 0.7, 1.0)),
    )
    for name, color in (first, other, again):
        combined, reroute = tree.nodes.new("NodeCombineBundle"), tree.nodes.new("NodeReroute")
        combined.bundle_items.new("RGBA", name)
        combined.inputs[name].default_value = color
        tree.links.new(combined.outputs[0], reroute.inputs[0])
        tree.links.new(reroute.outputs[0], joined.inputs[0])
    for name in ("Tint", "Shade"):
        separate.bundle_items.new("RGBA", name)
    tree.links.new(joined.outputs[0], separate.inputs[0])
    mixed = node(tree, "ShaderNodeVectorMath", {0: separate.outputs["Tint"], 1: separate.outputs["Shade"]})
    cards.show(tree, output, mixed.outputs[0])

    tree, output = cards.add("time")
    time = tree.nodes.new("GeometryNodeInputSceneTime")
    scaled = node(tree, "ShaderNodeMath", {0: time.outputs["Frame"], 1: 0.05, 2: time.outputs["Seconds"]})
    scaled.operation = "MULTIPLY_ADD"
    cards.show(tree, output, scaled.outputs[0])
    scene.frame_set(7)
    compare(cards, tmp_path)
