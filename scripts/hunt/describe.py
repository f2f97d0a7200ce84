"""A node tree in words, for whoever has to build it again."""

import bpy
from trees import FREE_OF_CHANCE


def tree_lines(tree):
    """Nodes with what was set of them, then links; groups follow."""
    for node in tree.nodes:
        yield f"{node.name!r} {node.bl_idname}{' muted' if node.mute else ''} {changes(tree, node)}"
    for link in tree.links:
        start, end = (f"{s.node.name!r}.{s.identifier}" for s in (link.from_socket, link.to_socket))
        state = (" muted" if link.is_muted else "") + ("" if link.is_valid else " invalid")
        yield f"{start} -> {end}{state}"
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
            sockets = [
                (item.in_out, item.identifier, item.socket_type, "hidden" if item.hide_value else "")
                for item in node.node_tree.interface.items_tree
            ]
            yield f"inside {node.name!r}: {sockets}"
            yield from (f"  {line}" for line in tree_lines(node.node_tree))


def changes(tree, node):
    """Properties and inputs that a new node of the type does not have."""
    if node.bl_idname.startswith("NodeGroup"):
        return {}
    fresh = tree.nodes.new(node.bl_idname)
    common = {name for kind in FREE_OF_CHANCE for name in getattr(bpy.types, kind).bl_rna.properties.keys()}
    found = {}
    for prop in node.bl_rna.properties:
        value = getattr(node, prop.identifier)
        if prop.identifier not in common and plain(value) != plain(getattr(fresh, prop.identifier)):
            found[prop.identifier] = plain(value)
    for name in ("texture_mapping", "color_ramp", "mapping"):
        if hasattr(node, name) and not isinstance(getattr(node, name), str):
            found |= inner_changes(getattr(node, name), getattr(fresh, name), name)
    for sockets, others in ((node.inputs, fresh.inputs), (node.outputs, fresh.outputs)):
        for number, socket in enumerate(sockets):
            value = plain(getattr(socket, "default_value", None))
            usual = plain(getattr(others[number], "default_value", None)) if number < len(others) else None
            if value != usual:
                found[socket.identifier] = value
    tree.nodes.remove(fresh)
    return found


def inner_changes(owner, fresh, name):
    """Those of a panel: simple values, the elements of a ramp, the points of curves."""
    found = {}
    for prop in owner.bl_rna.properties:
        value = plain(getattr(owner, prop.identifier))
        if value != plain(getattr(fresh, prop.identifier)):
            found[f"{name}.{prop.identifier}"] = value
    if hasattr(owner, "elements"):
        found["elements"] = [(round(element.position, 4), plain(element.color)) for element in owner.elements]
    if hasattr(owner, "curves"):
        found["points"] = [
            [(*plain(point.location), point.handle_type) for point in curve.points] for curve in owner.curves
        ]
    return found


def plain(value):
    """A value that can be printed and compared; None for what is more than a value."""
    if isinstance(value, bpy.types.ID):
        return value.name
    if isinstance(value, bool | int | str) or value is None:
        return value
    if isinstance(value, float):
        return round(value, 4)
    if isinstance(value, bpy.types.bpy_struct | bpy.types.bpy_prop_collection):
        return None
    try:
        return [plain(one) for one in value]
    except TypeError:
        return str(value)
