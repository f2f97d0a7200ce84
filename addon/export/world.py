"""The world: a colour, an environment texture, or a texture that Cycles renders of whatever its nodes do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import bpy
from mathutils import Euler, Matrix

from .images import ImageExporter, note_on
from .materials.coordinates import is_mapped
from .materials.graph import Source, is_implied, surface_socket, used_tree
from .world_graph import UnsupportedNodeError, WorldGraph, WorldReader, place_of

BLACK = [0.0, 0.0, 0.0]
HIDDEN_RAYS = ("diffuse", "glossy", "transmission", "scatter")
FORWARD = {
    *(("ShaderNodeTexCoord", output) for output in ("Generated", "Object")),
    ("ShaderNodeNewGeometry", "Position"),
}
"""Outputs that are the direction in which a ray leaves the scene."""
BACKWARD = {
    *(("ShaderNodeTexCoord", output) for output in ("Normal", "Reflection")),
    *(("ShaderNodeNewGeometry", output) for output in ("Normal", "True Normal", "Incoming")),
}
"""Outputs that are the opposite direction."""


class WorldRenderError(Exception):
    """Cycles could not render a world; the message says why."""


class Space(NamedTuple):
    """The medium that fills all space."""

    volume: int | None = None
    """Number of a material with its volume; None if there is none."""
    receiver: int = 0
    """Its number for light linking."""


NO_SPACE = Space()
TextureOf = Callable[[WorldGraph, str], Any]
"""Number of a texture of a world, rendered over all directions; the name is for messages. Raises WorldRenderError."""


def world_of(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bpy.types.World | None:
    """The world that a view layer is rendered with."""
    return (view_layer.world_override or scene.world) if view_layer.use_sky else None


def export_world(
    builder: Any,
    images: ImageExporter,
    texture_of: TextureOf,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    space: Space = NO_SPACE,
) -> None:
    """Sets the world of `builder` and warns of parts that cannot be represented."""
    world = world_of(scene, view_layer)
    if world is None:
        builder.set_world(BLACK)
        return
    exporter = _WorldExporter(builder, images, texture_of, world, scene.render.film_transparent, space)
    exporter.warn_of_settings(scene)
    exporter.run()


class _WorldExporter:
    """Exports one world: as a constant, a picture with a rotation, or rendered by Cycles."""

    def __init__(
        self,
        builder: Any,
        images: ImageExporter,
        texture_of: TextureOf,
        world: bpy.types.World,
        film_transparent: bool,
        space: Space,
    ):
        self.space = space
        self.builder = builder
        self.images = images
        self.texture_of = texture_of
        self.world = world
        self.reader = WorldReader(builder.constant_emission)
        visibility = getattr(world, "cycles_visibility", None)
        self.visible_camera = (visibility is None or visibility.camera) and not film_transparent

    def warn_of_settings(self, scene: bpy.types.Scene) -> None:
        """Warns of settings of the world that paths without lights cannot represent."""
        visibility = getattr(self.world, "cycles_visibility", None)
        for ray in HIDDEN_RAYS:
            if not getattr(visibility, ray, True):
                self._warn(f"ray visibility without {ray} is not supported yet; {ray} rays see it")
        cycles = getattr(self.world, "cycles", None)
        if cycles is None:
            return
        if cycles.max_bounces < scene.cycles.max_bounces:
            self._warn("a limit of its bounces is not supported yet; it lights along whole paths")
        if not getattr(cycles, "use_shadows", True):
            self._warn("light without shadow is not supported; objects block it")

    def run(self) -> None:
        """Exports the light of the world."""
        tree = used_tree(self.world)
        if tree is None:
            self._set(list(self.world.color))
            return
        output = surface_socket(tree)
        if output is None:
            self._set(BLACK)
            return
        surface, context = output
        source = self.reader.follow(surface, context)
        if not (isinstance(source, Source) and self._background(source)):
            emission = self.reader.emission(surface, context)
            if emission is not None or not isinstance(source, Source):
                self._set(emission or BLACK)
            else:
                self._rendered(source)
        if self.reader.uses_light_path:
            self._warn(
                "what depends on Light Path is as diffuse rays see it; to camera and reflections it may look different"
            )

    def _background(self, source: Source) -> bool:
        """Sets a colour or an environment texture, if the node is a Background that shows one."""
        if source.node.bl_idname != "ShaderNodeBackground":
            return False
        strength = self._strength(source)
        if strength is None:
            return False
        color = self.reader.constant(source.node.inputs["Color"], source.context)
        if color is not None:
            color = color if isinstance(color, list) else [color] * 3
            self._set([channel * strength for channel in color])
            return True
        texture = self.reader.follow(source.node.inputs["Color"], source.context)
        if not isinstance(texture, Source) or texture.node.bl_idname != "ShaderNodeTexEnvironment":
            return False
        mapping = None if is_mapped(texture.node) else self._direction(texture, "Vector")
        if texture.node.projection != "EQUIRECTANGULAR" or texture.node.image is None or mapping is None:
            return False
        number = self.images.number(texture.node.image, f"world '{self.world.name}'", texture.node.image_user)
        self._set([strength] * 3, texture=number, matrix=mapping)
        return True

    def _strength(self, background: Source) -> float | None:
        strength = self.reader.constant(background.node.inputs["Strength"], background.context)
        return strength if isinstance(strength, float) else None

    def _direction(self, user: Source, socket: str) -> Matrix | None:
        """The texture direction that a node gets, from the world direction; None if it is no linear map of it."""
        input_socket = user.node.inputs[socket]
        source = self.reader.follow(input_socket, user.context)
        if user.node.bl_idname != "ShaderNodeMapping" and is_implied(source, input_socket):
            return Matrix.Identity(3)
        if not isinstance(source, Source):
            return None
        node, key = source.node, (source.node.bl_idname, source.socket.identifier)
        if key == ("ShaderNodeTexCoord", "Object") and node.object is not None:
            place = Matrix(place_of(node.object))
            return None if any(place.translation) else place.to_3x3().inverted_safe()
        if key in FORWARD:
            return Matrix.Identity(3)
        if key in BACKWARD:
            return Matrix.Identity(3) * -1.0
        return self._mapping(source) if node.bl_idname == "ShaderNodeMapping" else None

    def _mapping(self, source: Source) -> Matrix | None:
        """Matrix of a Mapping node, combined with those before it."""
        node, before = source.node, self._direction(source, "Vector")
        values = {
            name: self.reader.constant(node.inputs[name], source.context) if name in node.inputs else default
            for name, default in (("Location", BLACK), ("Rotation", BLACK), ("Scale", [1.0] * 3))
        }
        if before is None or not all(isinstance(value, list) for value in values.values()):
            return None
        if values["Location"] != BLACK and node.vector_type in {"POINT", "TEXTURE"}:
            return None
        rotation = Euler(values["Rotation"], "XYZ").to_matrix()
        scale = Matrix.Diagonal(values["Scale"])
        match node.vector_type:
            case "TEXTURE":
                return scale.inverted_safe() @ rotation.transposed() @ before
            case "NORMAL":
                return rotation @ scale.inverted_safe() @ before
            case _:
                return rotation @ scale @ before

    def _rendered(self, surface: Source) -> None:
        """Sets a texture that Cycles renders; the strength of a Background node stays a factor of it."""
        strength = self._strength(surface) if surface.node.bl_idname == "ShaderNodeBackground" else None
        try:
            graph = WorldGraph(surface, self.reader)
            if strength is not None:
                graph.take_strength()
            for note in filter(None, map(note_on, graph.images.values())):
                self._warn(note)
            texture = self.texture_of(graph, self.world.name)
        except UnsupportedNodeError as error:
            self._warn(f"{error}, which is not supported yet; the world is black")
            self._set(BLACK)
        except WorldRenderError as error:
            self._warn(f"Cycles could not render it: {error}; the world is black")
            self._set(BLACK)
        else:
            self._set([1.0 if strength is None else strength] * 3, texture=texture)

    def _set(self, color: list[float], texture: Any = None, matrix: Matrix | None = None) -> None:
        rows = [list(row) for row in (matrix or Matrix.Identity(3))]
        space = {} if self.space.volume is None else self.space._asdict()
        visible = self.visible_camera
        self.builder.set_world(color, texture=texture, texture_from_world=rows, visible_camera=visible, **space)

    def _warn(self, message: str) -> None:
        self.builder.warn(f"world '{self.world.name}': {message}")
