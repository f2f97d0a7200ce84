"""Messages about what Blender itself does to a render, which a picture by Relume alone does not have."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..core.words import listed
from .camera import film_border, film_size

WITHOUT_EFFECTS = {"use_sequencer": False, "use_compositing": False, "use_freestyle": False}
"""Render settings without what Blender does to a picture once it is rendered. Freestyle would crash where there is
none, and file output nodes would write over the artist's files."""


def left_to_blender(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> list[str]:
    """Sentences about the steps of Blender's own renders, before or after a layer's picture, that are left out."""
    sentences = []
    others = [other.name for other in scene.view_layers if other.use and other != layer]
    if others and not scene.render.use_single_layer:
        sentences.append(
            f"scene '{scene.name}': of its view layers only '{layer.name}' is in the picture, not {listed(others)}"
        )
    for stage, is_used in {
        "the cut of the render region": film_border(scene.render) != (0, 0, *film_size(scene.render)),
        "Freestyle's lines": scene.render.use_freestyle and layer.use_freestyle,
        "the compositor": scene.render.use_compositing and any(map(_changes_picture, _compositors(scene))),
        "the video sequencer": scene.render.use_sequencer and _has_strips(scene),
    }.items():
        if is_used:
            words = f"{stage}: only in renders with Relume as render engine, not in this picture"
            sentences.append(f"scene '{scene.name}': {words}")
    return sentences


def _has_strips(scene: bpy.types.Scene) -> bool:
    """True if the sequencer shows something of its own."""
    editor = scene.sequence_editor
    if editor is None:
        return False
    strips = editor.strips_all if hasattr(editor, "strips_all") else editor.sequences_all  # Before Blender 4.4.
    return any(strip.type != "SOUND" and not strip.mute for strip in strips)


def _compositors(scene: bpy.types.Scene) -> Iterator[bpy.types.NodeTree]:
    """Trees that Blender sends a render through."""
    if bpy.app.version < (5, 0, 0):
        trees = [scene.node_tree if scene.use_nodes else None]
    elif hasattr(scene, "compositor_effects"):  # From Blender 5.3 on.
        trees = [effect.node_group for effect in scene.compositor_effects if effect.enable_for_render]
    else:
        trees = [scene.compositing_node_group]
    yield from (tree for tree in trees if tree is not None)


def _changes_picture(tree: bpy.types.NodeTree) -> bool:
    """True if a compositor gives anything but the picture that comes in."""
    outputs = [node for node in tree.nodes if node.type in {"COMPOSITE", "GROUP_OUTPUT"} and not node.mute]
    return any(output.inputs and _comes_from_elsewhere(output.inputs[0]) for output in outputs)


def _comes_from_elsewhere(socket: bpy.types.NodeSocket) -> bool:
    """True if something else than a render's own picture is linked to a socket."""
    while socket.is_linked:
        link = socket.links[0]
        if link.from_node.type != "REROUTE" and not link.from_node.mute:
            return not (link.from_node.type in {"R_LAYERS", "GROUP_INPUT"} and link.from_socket.name == "Image")
        socket = link.from_node.inputs[0]
    return False
