"""Point Density: points of an object as a 3D image, which media alone see."""

from __future__ import annotations

from typing import Any

from ..point_images import MOST_VOXELS
from .graph import Source
from .image_nodes import INTERPOLATION
from .translation import TranslateValue, Translation
from .vectors import transformed

OUTPUTS = {"Color": "color", "Density": "alpha"}


def _point_density(t: Translation, source: Source) -> Any:
    output = OUTPUTS[source.socket.identifier]
    number = t.value_once(source, lambda: _image(t, source))
    if number is None:
        return 0.0 if output == "alpha" else [0.0] * 3
    return {"node": number, "output": output}


def _image(t: Translation, source: Source) -> int | None:
    """The node of a 3D image; None where all is 0, as Cycles has it outside of media."""
    node = source.node
    if not t.in_medium or node.object is None:
        return None
    if node.resolution > MOST_VOXELS:
        words = f"a resolution above {MOST_VOXELS} is not supported; its points are left out, lower it"
        t.warn(f"node '{node.name}': {words}")
        return None
    image = t.images.points(node)
    position = t.value(node, "Vector", source.context, None)
    if position is None:
        position = {"node": t.emit({"type": "geometry"}), "output": "position"}
    of_object = node.space == "OBJECT"
    description = {
        "type": "image_texture",
        "texture": image.texture,
        "vector": position if of_object else transformed(t, position, image.unit_from_world),
        "interpolation": INTERPOLATION[node.interpolation],
        "extension": "clip",
        "projection": {"layers": {"count": image.layers, "of_object": of_object}},
    }
    return t.emit(description)


POINT_VALUES: dict[str, TranslateValue] = {"ShaderNodeTexPointDensity": _point_density}
