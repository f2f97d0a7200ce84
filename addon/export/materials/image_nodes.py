"""Image and environment textures of materials."""

from __future__ import annotations

from typing import Any

import bpy

from ..node_graph import WorldRenderError
from .coordinates import texture_vector
from .graph import Source
from .translation import TranslateValue, Translation
from .vectors import upright

INTERPOLATION = {"Linear": "linear", "Closest": "closest", "Cubic": "cubic", "Smart": "cubic"}


def _image_texture(t: Translation, source: Source) -> Any:
    node, user = source.node, f"{t.owner}, node '{source.node.name}'"

    def description() -> dict[str, Any]:
        return {
            "type": "image_texture",
            **_shown(t, node, user),
            "vector": texture_vector(t, source, {"type": "uv_map", "name": ""}),
            "interpolation": INTERPOLATION.get(node.interpolation, "linear"),
            "extension": node.extension.lower(),
            **_projection(node),
        }

    output = "alpha" if source.socket.identifier == "Alpha" else "color"
    return {"node": t.once(source, description), "output": output}


def _environment_texture(t: Translation, source: Source) -> Any:
    """An image over all directions, where a material looks it up."""
    node, user = source.node, f"{t.owner}, node '{source.node.name}'"

    def description() -> dict[str, Any]:
        vector = texture_vector(t, source, {"type": "geometry"})
        if vector is None:
            vector = {"node": t.emit({"type": "geometry"}), "output": "position"}
        return {
            "type": "image_texture",
            **_shown(t, node, user),
            "vector": vector,
            "interpolation": INTERPOLATION.get(node.interpolation, "linear"),
            "extension": "repeat",
            "projection": node.projection.lower(),
        }

    return {"node": t.once(source, description), "output": "color"}


def _sky_texture(t: Translation, source: Source) -> Any:
    """A sky where a material looks it up, from an image over all directions."""
    node = source.node
    try:
        image = t.images.sky(node)
    except WorldRenderError as error:
        t.warn(f"node '{node.name}': Cycles could not render the sky: {error}; black")
        return [0.0] * 3

    def description() -> dict[str, Any]:
        generated = {"type": "texture_coordinate", "kind": "generated"}
        vector = texture_vector(t, source, generated)
        if vector is None:
            vector = {"node": t.emit(generated), "output": "vector"}
        return {
            "type": "image_texture",
            "texture": image,
            "vector": upright(t, vector),
            "interpolation": "linear",
            "extension": "repeat",
            "projection": "equirectangular",
        }

    return {"node": t.once(source, description), "output": "color"}


def _shown(t: Translation, node: bpy.types.Node, user: str) -> dict[str, Any]:
    """The image of a node, or its tiles and what is shown outside of them."""
    if node.image is None:
        return {"texture": t.images.missing(user)}
    if node.image.source != "TILED":
        return {"texture": t.images.number(node.image, user, node.image_user)}
    return {"texture": t.images.missing(user), "tiles": t.images.tiles(node.image, user)}


def _projection(node: bpy.types.Node) -> dict[str, Any]:
    """The projection of an image, left out where it is flat."""
    if node.projection == "BOX":
        return {"projection": {"box": {"blend": node.projection_blend}}}
    return {} if node.projection == "FLAT" else {"projection": node.projection.lower()}


IMAGE_VALUES: dict[str, TranslateValue] = {
    "ShaderNodeTexImage": _image_texture,
    "ShaderNodeTexEnvironment": _environment_texture,
    "ShaderNodeTexSky": _sky_texture,
}
