"""Shader nodes and settings as Blender itself lists them."""

import contextlib
import os
import sys

import bpy


@contextlib.contextmanager
def _quiet():
    """Blender prints a line for each node that does not fit a tree."""
    sys.stdout.flush()
    sys.stderr.flush()
    with open(os.devnull, "w") as nowhere:
        kept = os.dup(1), os.dup(2)
        try:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            for number, handle in enumerate(kept, start=1):
                os.dup2(handle, number)
                os.close(handle)


def shader_nodes():
    """Nodes that can be in a shader tree, by `bl_idname`: name for artists, items of their own enumerations, and all
    sockets."""
    general = {prop.identifier for prop in bpy.types.ShaderNode.bl_rna.properties}
    tree = bpy.data.node_groups.new("All nodes", "ShaderNodeTree")
    found = {}
    with _quiet():
        for kind in sorted(dir(bpy.types)):
            cls = getattr(bpy.types, kind)
            if not (isinstance(cls, type) and issubclass(cls, bpy.types.Node)):
                continue
            try:
                node = tree.nodes.new(kind)
            except RuntimeError:
                continue
            enums = [prop for prop in cls.bl_rna.properties if prop.type == "ENUM" and prop.identifier not in general]
            found[kind] = {
                "name": node.bl_label,
                "inputs": list(dict.fromkeys(socket.identifier for socket in node.inputs)),
                "outputs": list(dict.fromkeys(socket.identifier for socket in node.outputs)),
                "options": {prop.identifier: _items(node, prop) for prop in enums},
            }
    bpy.data.node_groups.remove(tree)
    return found


def _items(node, prop):
    """Items of an enumeration that the node takes in a shader tree."""
    taken = []
    for item in prop.enum_items:
        with contextlib.suppress(TypeError):
            setattr(node, prop.identifier, item.identifier)
            taken.append(item.identifier)
    return taken


def structure(name):
    """Blender's description of a structure; those of Cycles are its add-on's classes."""
    found = getattr(bpy.types, name, None)
    return found or next(cls for cls in bpy.types.PropertyGroup.__subclasses__() if cls.__name__ == name)


def own_properties(name):
    """Properties that can be set, and what a structure owns."""
    rna = structure(name).bl_rna
    general = {prop.identifier for prop in bpy.types.ID.bl_rna.properties} | {"rna_type"}
    return [
        prop.identifier
        for prop in rna.properties
        if prop.identifier not in general and (not prop.is_readonly or prop.type in {"POINTER", "COLLECTION"})
    ]
