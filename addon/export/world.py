"""The world: a colour or one environment texture."""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Euler, Matrix

from .images import ImageExporter
from .materials.graph import Source, constant_value, resolve, used_tree

BLACK = [0.0, 0.0, 0.0]


def export_world(builder: Any, images: ImageExporter, scene: bpy.types.Scene) -> None:
    """Sets the world of `builder`; what cannot be represented is named and black."""
    world = scene.world
    if world is None:
        builder.set_world(BLACK)
        return
    _WorldExporter(builder, images, world, scene.render.film_transparent).run()


class _WorldExporter:
    def __init__(self, builder: Any, images: ImageExporter, world: bpy.types.World, film_transparent: bool):
        self.builder = builder
        self.images = images
        self.world = world
        visibility = getattr(world, "cycles_visibility", None)
        self.visible_camera = (visibility is None or visibility.camera) and not film_transparent

    def run(self) -> None:
        tree = used_tree(self.world)
        if tree is None:
            self._set(list(self.world.color))
            return
        output = tree.get_output_node("CYCLES")
        if output and output.inputs["Volume"].is_linked:
            self._name("its volume is not supported yet; left out")
        source = resolve(output.inputs["Surface"], ()) if output else None
        if source is None:
            self._set(BLACK)
        elif source.node.bl_idname != "ShaderNodeBackground":
            self._name(f"node '{source.node.name}' is not supported yet; the world is black")
            self._set(BLACK)
        else:
            self._background(source)

    def _background(self, source: Source) -> None:
        strength = constant_value(source.node.inputs["Strength"], source.context)
        if not isinstance(strength, float):
            self._name(f"node '{source.node.name}' has a strength that is not constant; taken as 1")
            strength = 1.0
        color = constant_value(source.node.inputs["Color"], source.context)
        if color is not None:
            color = color if isinstance(color, list) else [color] * 3
            self._set([channel * strength for channel in color])
            return
        texture = resolve(source.node.inputs["Color"], source.context)
        if texture is not None and texture.node.bl_idname == "ShaderNodeTexEnvironment" and texture.node.image:
            self._texture(texture, strength)
            return
        name = texture.node.name if texture else source.node.name
        self._name(f"node '{name}' is not supported yet; the world is black")
        self._set(BLACK)

    def _texture(self, source: Source, strength: float) -> None:
        node = source.node
        if node.projection != "EQUIRECTANGULAR":
            self._name(f"node '{node.name}' has a mirror ball projection, taken as equirectangular")
        number = self.images.number(node.image, f"world '{self.world.name}'")
        self._set([strength] * 3, texture=number, matrix=self._mapping(source))

    def _mapping(self, source: Source) -> Matrix:
        """Texture direction from world direction."""
        vector = resolve(source.node.inputs["Vector"], source.context)
        if vector is None or _is_direction(vector):
            return Matrix.Identity(3)
        mapping = vector.node
        before = resolve(mapping.inputs["Vector"], vector.context) if mapping.bl_idname == "ShaderNodeMapping" else None
        if before is None or not _is_direction(before):
            self._name(f"node '{mapping.name}' is not supported before an environment texture; ignored")
            return Matrix.Identity(3)
        values = {
            name: constant_value(mapping.inputs[name], vector.context) if name in mapping.inputs else None
            for name in ("Location", "Rotation", "Scale")
        }
        rotation = Euler(values["Rotation"] or BLACK, "XYZ").to_matrix()
        scale = Matrix.Diagonal(values["Scale"] or (1.0, 1.0, 1.0))
        moves = values["Location"] not in (None, BLACK)
        if moves and mapping.vector_type in {"POINT", "TEXTURE"}:
            self._name(f"node '{mapping.name}' moves the environment texture; only its rotation and scale are used")
        match mapping.vector_type:
            case "TEXTURE":
                return scale.inverted_safe() @ rotation.transposed()
            case "NORMAL":
                return rotation @ scale.inverted_safe()
            case _:
                return rotation @ scale

    def _set(self, color: list[float], texture: int | None = None, matrix: Matrix | None = None) -> None:
        rows = [list(row) for row in (matrix or Matrix.Identity(3))]
        self.builder.set_world(color, texture=texture, texture_from_world=rows, visible_camera=self.visible_camera)

    def _name(self, what: str) -> None:
        self.builder.warn(f"world '{self.world.name}': {what}")


def _is_direction(source: Source) -> bool:
    """Whether a texture vector is the world direction of the ray."""
    node, socket = source.node, source.socket.identifier
    return (node.bl_idname == "ShaderNodeTexCoord" and socket in {"Generated", "Object", "Normal"}) or (
        node.bl_idname == "ShaderNodeNewGeometry" and socket in {"Position"}
    )
