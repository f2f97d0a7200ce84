"""Sources of sockets: follows links through groups, reroutes and muted nodes, as Cycles of this Blender does.

| feeds a socket | before Blender 5.0 | since then |
|---|---|---|
| a reroute or muted node that nothing feeds | 0 | the socket counts as not linked |
| a muted node without an input for that output, or a node that Cycles leaves out | counts as not linked | the same |
| a group without output node | 0 | 0 |
| sockets of other types on the way (groups, muted nodes) | convert what passes | convert what Blender computes |
| a node that Cycles does not have, in a group | the group's own value | counts as not linked at all |
| any of these, to a normal or texture vector | is left out | counts (`is_implied`) |
| a group's own value, to one of these | is left out if no type on the way is another | counts |
| Material Output in a group, and a muted one | counts; does not | does not; counts |
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import bpy

from ...core.blackbody import blackbody_color


class Iteration(NamedTuple):
    """A round of a repeat zone, named by the zone's output node."""

    zone: bpy.types.Node
    number: int

    def as_pointer(self) -> int:
        """Number that no other round has."""
        return hash((self.zone.as_pointer(), self.number))


class Call(NamedTuple):
    """An evaluation of a closure, whose zone is named by its output node."""

    zone: bpy.types.Node
    node: bpy.types.Node
    around: Context
    """Surroundings of the node that evaluates it."""

    def as_pointer(self) -> int:
        """Number that no other evaluation has."""
        return hash((self.node.as_pointer(), *(each.as_pointer() for each in self.around)))


Context = tuple[bpy.types.Node | Iteration | Call, ...]
"""The group nodes and rounds of zones around a node, outermost first."""

LUMINANCE = (0.2126729, 0.7151522, 0.072175)
"""Weights of linear Rec.709 as the tracer has them, Cycles' conversion from colour to float."""
LEFT_OUT = {
    "NodeUndefined",
    "ShaderNodeEeveeSpecular",
    "ShaderNodeLightAccumulation",
    "ShaderNodeLightEvaluation",
    "ShaderNodeLightInfo",
    "ShaderNodeShaderToRGB",
    "ShaderNodeShadowRaycast",
    "ShaderNodeSqueeze",
    "ShaderNodeUVAlongStroke",
}
"""Nodes that Cycles does not know, as if they were not there."""
IS_INLINED = bpy.app.version >= (5, 0, 0)
"""True if Blender itself resolves groups and muted nodes before Cycles sees them."""
CONVERTING = {"VALUE", "INT", "BOOLEAN", "RGBA", "VECTOR"}
if IS_INLINED:
    CONVERTING = {"BOOLEAN"} if bpy.app.version >= (5, 3, 0) else set()
"""Types of sockets on the way that convert what nodes compute."""
UNFOLDED = {
    "ShaderNodeBrightContrast",
    "ShaderNodeCombineColor",
    "ShaderNodeHueSaturation",
    "ShaderNodeInvert",
    "ShaderNodeRGB",
    "ShaderNodeRGBToBW",
    "ShaderNodeSeparateColor",
}
"""Nodes that Blender does not compute where it inlines, however constant they are."""
NUMBERS = {"VALUE", "INT", "BOOLEAN"}
"""Types of sockets with one number."""

Value = float | list[float]


def used_tree(block: bpy.types.ID) -> bpy.types.NodeTree | None:
    """The node tree of a material, light or world, if it counts. From Blender 5.2 on it always does, and asking
    `use_nodes` is deprecated."""
    if bpy.app.version < (5, 2, 0) and not block.use_nodes:
        return None
    return block.node_tree


def surface_socket(tree: bpy.types.NodeTree) -> tuple[bpy.types.NodeSocket, Context] | None:
    """The Surface input of the output that Cycles renders, and the groups around it; None without one."""
    if IS_INLINED and _has_cycle(tree):
        return None
    return next(_surface_sockets(tree, ()), None)


def _surface_sockets(tree: bpy.types.NodeTree, context: Context) -> Iterator[tuple[bpy.types.NodeSocket, Context]]:
    """Surface inputs that count; outputs within groups come first."""
    if not IS_INLINED:
        for group in filter(_is_group, tree.nodes):
            if group.node_tree is not None and not group.mute:
                sockets = _surface_sockets(group.node_tree, (*context, group))
                yield from ((socket, inner) for socket, inner in sockets if socket.is_linked)
    output = tree.get_output_node("CYCLES")
    if output is not None and (IS_INLINED or not output.mute):
        yield output.inputs["Surface"], context


def _has_cycle(tree: bpy.types.NodeTree) -> bool:
    """True if nodes feed themselves: then Blender renders nothing of a tree that it inlines."""
    links = [
        link
        for link in tree.links
        if not (link.is_muted or link.from_socket.is_unavailable or link.to_socket.is_unavailable)
    ]
    if all(link.is_valid for link in links):
        return False
    left = {(link.from_node.name, link.to_node.name) for link in links}
    while left:
        fed = {to for _, to in left}
        inner = {(source, to) for source, to in left if source in fed}
        if len(inner) == len(left):
            return True
        left = inner
    return False


class Source(NamedTuple):
    """An output socket of a node that is no reroute, group or muted node."""

    node: bpy.types.Node
    socket: bpy.types.NodeSocket
    context: Context
    passed: tuple[str, ...] = ()
    """Types of sockets between it and the input that it feeds, in the order in which its value passes them."""


class Constant(NamedTuple):
    """The value that a socket has without any node."""

    value: Value | None
    """Value; None for a shader, and where no value can be shown."""
    kind: str
    """The type of the socket that has it."""
    owner: bpy.types.NodeSocket | None
    """The input that has it: the asked socket itself or one of a group around; None of 0 in place of a link."""
    passed: tuple[str, ...] = ()
    """Passed nodes, as in `Source`."""


def trace(socket: bpy.types.NodeSocket, context: Context, first: bpy.types.NodeLink | None = None) -> Source | Constant:
    """Source of an input socket of a node in some groups: that of its `first` link where several lead to it."""
    start = socket
    owner, own_passed = socket, 0  # What counts where links lead nowhere, and how much is passed from there.
    passed: list[str] = []
    is_gap = False  # Whether `socket` is of a reroute or a muted node.
    while True:
        link, first = first or _used_link(socket), None
        inner = _inner(link.from_node, link.from_socket) if link is not None else None
        if link is None or (inner is None and _is_left_out(link.from_node, context)):
            if link is not None and IS_INLINED and _is_unknown(link.from_node):
                return Constant(_shown(start), start.type, start)
            if is_gap and not IS_INLINED:
                return _zero(socket.type, passed)
            return Constant(_shown(owner), owner.type, owner, tuple(reversed(passed[:own_passed])))
        node, output = link.from_node, link.from_socket
        if inner is not None:
            passed += [output.type, inner.type] if IS_INLINED else [output.type]
            socket, is_gap = inner, True
        elif node.bl_idname == "NodeReroute":
            socket, is_gap = node.inputs[0], True
        elif _is_group(node):
            passed.append(output.type)
            outer = _group_output(node, output.identifier)
            if outer is None:
                return _zero(output.type, passed)
            owner = socket = outer
            context, is_gap = (*context, node), False
            passed.append(socket.type)
            own_passed = len(passed)
        elif (step := _step(node, output, context)) is not None:
            passed.append(output.type)
            if step.socket is None:
                return _zero(output.type, passed)
            owner = socket = step.socket
            context, is_gap, own_passed = step.context, False, len(passed)
        elif node.bl_idname == "NodeGroupInput":
            place, group = _innermost_group(context)
            outer = _by_identifier(group.inputs, output.identifier)
            if outer is None:
                return _zero(output.type, passed)
            owner = socket = outer
            context, is_gap = context[:place], False
            passed.append(socket.type)
            own_passed = len(passed)
        else:
            if IS_INLINED and node.bl_idname in UNFOLDED:
                passed = [kind for kind in passed if kind in CONVERTING]
            return Source(node, output, context, tuple(reversed(passed)))


class _Step(NamedTuple):
    """An input that a node hands on to an output, and what is around it; no socket if the output is 0."""

    socket: bpy.types.NodeSocket | None
    context: Context


def _step(node: bpy.types.Node, output: bpy.types.NodeSocket, context: Context) -> _Step | None:
    """Where an output comes from that is an input of this or another node; None of other outputs."""
    name = output.identifier
    match node.bl_idname:
        case "GeometryNodeMenuSwitch":
            chosen = _chosen(node, output, context)
            return _Step(chosen, context) if chosen else None
        case "GeometryNodeSwitch" | "GeometryNodeIndexSwitch" | "NodeEnableOutput":
            value = constant_value(node.inputs[0], context)
            return _Step(_switched(node, value), context) if isinstance(value, float) else None
        case "NodeImplicitConversion" | "GeometryNodeWarning":
            return _Step(node.inputs[0], context)
        case "GeometryNodeRepeatOutput":
            return _after_rounds(node, name, context)
        case "GeometryNodeRepeatInput" if name != "Iteration":
            return _before_round(node, name, context)
        case "NodeEvaluateClosure":
            closure = trace(node.inputs["Closure"], context)
            if not isinstance(closure, Source) or closure.node.bl_idname != "NodeClosureOutput":
                return _Step(None, context)
            inside = (*closure.context, Call(closure.node, node, context))
            return _Step(closure.node.inputs.get(output.name), inside)
        case "NodeClosureInput":
            place = _innermost(context, node.paired_output)
            call = context[place] if place is not None else None
            return _Step(call.node.inputs.get(output.name), call.around) if isinstance(call, Call) else _Step(None, ())
        case "NodeSeparateBundle":
            return _of_bundle(trace(node.inputs[0], context), output.name) or _Step(None, context)
    return None


def _switched(node: bpy.types.Node, value: float) -> bpy.types.NodeSocket | None:
    """The input that a switch shows at a value."""
    choices = switch_choices(node)
    if node.bl_idname == "GeometryNodeIndexSwitch":
        return choices[int(value)] if 0 <= int(value) < len(choices) else None
    return choices[value > 0.0]


def switch_choices(node: bpy.types.Node) -> list[bpy.types.NodeSocket | None]:
    """Inputs that a switch shows at 0, 1 and so on."""
    inputs = [socket for socket in node.inputs[1:] if socket.identifier != "__extend__"]
    return [None, *inputs] if node.bl_idname == "NodeEnableOutput" else inputs


def _after_rounds(node: bpy.types.Node, name: str, context: Context) -> _Step | None:
    """An item of a repeat zone after all rounds; None where their number varies."""
    first = next((other for other in node.id_data.nodes if getattr(other, "paired_output", None) == node), None)
    rounds = constant_value(first.inputs[0], context) if first is not None else 0.0
    if not isinstance(rounds, float):
        return None
    if rounds < 1.0:
        return _Step(_by_identifier(first.inputs, name) if first is not None else None, context)
    return _Step(_by_identifier(node.inputs, name), (*context, Iteration(node, int(rounds) - 1)))


def _before_round(node: bpy.types.Node, name: str, context: Context) -> _Step:
    """An item of a repeat zone before the present round."""
    place = _innermost(context, node.paired_output)
    present = context[place] if place is not None else None
    if place is None or not isinstance(present, Iteration) or present.number == 0:
        return _Step(_by_identifier(node.inputs, name), context[:place])
    before = (*context[:place], Iteration(present.zone, present.number - 1))
    return _Step(_by_identifier(present.zone.inputs, name), before)


def _innermost(context: Context, zone: bpy.types.Node | None) -> int | None:
    """Place of the innermost round or evaluation of a zone."""
    return next((i for i in reversed(range(len(context))) if getattr(context[i], "zone", None) == zone), None)


def _innermost_group(context: Context) -> tuple[int, bpy.types.Node]:
    groups = [(i, each) for i, each in enumerate(context) if not isinstance(each, Iteration | Call)]
    return groups[-1]


def _of_bundle(bundle: Source | Constant, name: str) -> _Step | None:
    """The input that feeds an item of a bundle; None if it has no such item."""
    if not isinstance(bundle, Source):
        return None
    node, context = bundle.node, bundle.context
    if node.bl_idname == "NodeCombineBundle" and name in node.inputs:
        return _Step(node.inputs[name], context)
    if node.bl_idname == "NodeJoinBundle":
        joined = (trace(node.inputs[0], context, link) for link in _used_links(node.inputs[0]))
        return next((found for each in joined if (found := _of_bundle(each, name)) is not None), None)
    return None


def _chosen(switch: bpy.types.Node, output: bpy.types.NodeSocket, context: Context) -> bpy.types.NodeSocket | None:
    """The input that a Menu Switch shows; None where its menu is not known, and of its other outputs."""
    menu = trace(switch.inputs[0], context)
    if output != switch.outputs[0]:
        return None
    if isinstance(menu, Source):
        name = menu.node.value if menu.node.bl_idname == "FunctionNodeInputMenu" else None
    else:
        name = menu.owner.default_value if menu.owner is not None else None
    return next((socket for socket in switch.inputs[1:] if socket.name == name), None)


def _used_links(socket: bpy.types.NodeSocket) -> list[bpy.types.NodeLink]:
    links = socket.links
    return [link for link in links if not link.is_muted and link.is_valid and not link.from_socket.is_unavailable]


def _used_link(socket: bpy.types.NodeSocket) -> bpy.types.NodeLink | None:
    return next(iter(_used_links(socket)), None)


def _inner(node: bpy.types.Node, output: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """The input that a muted node passes on to an output."""
    if not node.mute:
        return None
    return next((link.from_socket for link in node.internal_links if link.to_socket == output), None)


def _is_left_out(node: bpy.types.Node, context: Context) -> bool:
    if node.bl_idname == "NodeGroupInput":
        return all(isinstance(each, Iteration | Call) for each in context)
    return node.mute or _is_unknown(node)


def _is_unknown(node: bpy.types.Node) -> bool:
    """True if Cycles has no such node, so that a link from it is as none."""
    return node.bl_idname in LEFT_OUT or (node.type == "CUSTOM" and not _is_group(node))


def _is_group(node: bpy.types.Node) -> bool:
    return hasattr(node, "node_tree")  # Those of add-ons have it too.


def _group_output(group: bpy.types.Node, identifier: str) -> bpy.types.NodeSocket | None:
    """The socket inside a group that gives one of its outputs."""
    nodes = group.node_tree.nodes if group.node_tree is not None else ()
    outputs = [node for node in nodes if node.bl_idname == "NodeGroupOutput"]
    active = next((node for node in outputs if node.is_active_output), outputs[0] if outputs else None)
    return _by_identifier(active.inputs, identifier) if active is not None else None


def _by_identifier(sockets: Any, identifier: str) -> Any:
    return next((socket for socket in sockets if socket.identifier == identifier), None)


def _zero(kind: str, passed: list[str]) -> Constant:
    return Constant(None if kind == "SHADER" else 0.0, kind, None, tuple(reversed(passed)))


def _shown(socket: bpy.types.NodeSocket) -> Value | None:
    """The value of a socket that is not linked."""
    value = getattr(socket, "default_value", None)
    if isinstance(value, bool | int | float):
        return float(value)
    return None if value is None or isinstance(value, str | bpy.types.ID) else list(value)[:3]


def resolve(socket: bpy.types.NodeSocket, context: Context) -> Source | None:
    """The node that feeds `socket`, or None if none does."""
    source = trace(socket, context)
    return source if isinstance(source, Source) else None


def has_volume(block: bpy.types.ID) -> bool:
    """True if a material or world has a medium."""
    tree = used_tree(block)
    output = surface_socket(tree) if tree is not None else None
    if output is None:
        return False
    surface, context = output
    volume = surface.node.inputs.get("Volume")
    return volume is not None and resolve(volume, context) is not None


def is_implied(source: Source | Constant, socket: bpy.types.NodeSocket) -> bool:
    """True if a socket for a normal, tangent or texture vector has its default without a link."""
    if isinstance(source, Source):
        return False
    if source.owner == socket:
        return True
    if not IS_INLINED:
        return source.owner is None or all(kind == source.kind for kind in source.passed)
    is_alike = source.owner is not None and source.owner.hide_value and source.kind == socket.type
    return is_alike and socket.identifier != "Vector"


def constant_value(socket: bpy.types.NodeSocket, context: Context) -> Value | None:
    """The value of a socket that nothing but a constant feeds, as this socket sees it; None otherwise."""
    return constant_of(trace(socket, context), socket)


def constant_of(source: Source | Constant, socket: bpy.types.NodeSocket) -> Value | None:
    """Value of the constant that feeds `socket` (as `trace` finds it), as `socket` sees it; None if it is no
    constant."""
    if isinstance(source, Constant):
        value, kind = source.value, source.kind
    else:
        value, kind = node_constant(source), source.socket.type
    return None if value is None else passed_on(value, kind, (*source.passed, socket.type))


def node_constant(source: Source) -> Value | None:
    """The output of a node that is a constant by itself."""
    node = source.node
    match node.bl_idname:
        case "ShaderNodeRGB":
            return list(source.socket.default_value)[:3]
        case "ShaderNodeValue":
            return float(source.socket.default_value)
        case "ShaderNodeBlackbody":
            kelvin = constant_value(node.inputs["Temperature"], source.context)
            return blackbody_color(kelvin) if isinstance(kelvin, float) else None
        case "FunctionNodeInputBool":
            return float(node.boolean)
        case "FunctionNodeInputInt":
            return float(node.integer)
        case "GeometryNodeRepeatInput":
            place = _innermost(source.context, node.paired_output)
            present = source.context[place] if place is not None else None
            return float(present.number) if isinstance(present, Iteration) else 0.0
        case "GeometryNodeInputSceneTime":
            scene = bpy.context.scene
            seconds = scene.frame_current_final * scene.render.fps_base / scene.render.fps
            return seconds if source.socket.identifier == "Seconds" else float(scene.frame_current_final)
        case "FunctionNodeInputVector":
            return [*node.vector, 0.0][:3]  # It has two to four components.
    return None


def passed_on(value: Value, kind: str, types: tuple[str, ...]) -> Value:
    """A value of a type of socket after it has passed sockets of these types."""
    for to in types:
        value, kind = convert(value, kind, to), to
    return value


def convert(value: Value, kind: str, to: str) -> Value:
    """Blender's implicit conversion between types of sockets."""
    if to in {"RGBA", "VECTOR", "SHADER"}:
        return value if isinstance(value, list) else [value] * 3
    if to == "BOOLEAN" and IS_INLINED and isinstance(value, list) and kind == "VECTOR":
        return float(any(value))
    if isinstance(value, list):
        weights = LUMINANCE if kind == "RGBA" else (1.0 / 3.0,) * 3
        value = sum(weight * channel for weight, channel in zip(weights, value, strict=True))
    if to == "BOOLEAN" and IS_INLINED:
        return float(value > 0.0)
    return float(math.trunc(value)) if to in {"INT", "BOOLEAN"} and math.isfinite(value) else value
