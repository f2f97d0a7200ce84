"""The world: a colour, an environment texture, or a texture that Cycles renders of whatever its nodes do."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
from mathutils import Euler, Matrix

from .images import ImageExporter, has_tile_files, note_on
from .materials.coordinates import is_mapped
from .materials.graph import Source, is_implied, surface_socket, used_tree
from .node_graph import TextureOf, WorldRenderError
from .world_graph import KINDS_ALONE, LIGHT_PATHS, UnsupportedNodeError, WorldGraph, WorldReader, place_of

BLACK = [0.0, 0.0, 0.0]
BOUNCED = tuple(rays for rays in LIGHT_PATHS if rays != "camera")
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


class Space(NamedTuple):
    """The medium that fills all space."""

    volume: int | None = None
    """Number of a material with its volume; None if there is none."""
    receiver: int = 0
    """Its number for light linking."""


NO_SPACE = Space()


class Seen(NamedTuple):
    """Light of a world as rays of one kind see it."""

    color: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Radiance, or factor on the texture."""
    texture: Any = None
    """Number of its texture."""
    matrix: tuple[tuple[float, ...], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """Rows: texture direction from world direction."""


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
    """Exports one world: as a constant, a picture with a rotation, or rendered by Cycles, for each kind of ray."""

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
        """Reader of the world for rays of the kind in hand."""
        self.rendered: dict[str, Any] = {}
        """Textures that Cycles renders, by what they show."""
        visibility = getattr(world, "cycles_visibility", None)
        self.visible_camera = (visibility is None or visibility.camera) and not film_transparent

    def warn_of_settings(self, scene: bpy.types.Scene) -> None:
        """Warns of settings of the world that paths without lights cannot represent."""
        cycles = getattr(self.world, "cycles", None)
        if cycles is None:
            return
        if cycles.max_bounces < scene.cycles.max_bounces:
            self._warn("a limit of its bounces is not supported yet; it lights along whole paths")
        if not getattr(cycles, "use_shadows", True):
            self._warn("light without shadow is not supported; objects block it")

    def run(self) -> None:
        """Exports the light of the world."""
        seen = dict.fromkeys(LIGHT_PATHS, self._seen())
        asked = set(self.reader.asked)
        for rays in LIGHT_PATHS if asked else ():
            if rays != "diffuse" and (rays != "camera" or self.visible_camera):
                self.reader = WorldReader(self.builder.constant_emission, rays)
                seen[rays] = self._seen()
        self._warn_of_light_path(asked, [light for rays, light in seen.items() if rays != "camera"])
        visibility = getattr(self.world, "cycles_visibility", None)
        seen |= {rays: Seen() for rays in LIGHT_PATHS if rays != "camera" and not getattr(visibility, rays, True)}
        self._set(seen)

    def _warn_of_light_path(self, asked: set[str], bounced: list[Seen]) -> None:
        """Warns of what rays of one kind may see differently, of rays after a bounce."""
        if asked - KINDS_ALONE:
            self._warn("depth, length and sharpness of rays (Light Path) are those after one bounce")
        if len(set(bounced)) > 1 and any(light.texture is not None for light in bounced):
            self._warn(
                "of what depends on Light Path, dull surfaces see what paths find; Cycles' light samples have no kind"
            )

    def _seen(self) -> Seen:
        """The light of the world to the rays in hand."""
        tree = used_tree(self.world)
        if tree is None:
            return Seen(tuple(self.world.color))
        output = surface_socket(tree)
        if output is None:
            return Seen()
        surface, context = output
        source = self.reader.follow(surface, context)
        if isinstance(source, Source) and (background := self._background(source)) is not None:
            return background
        emission = self.reader.emission(surface, context)
        if emission is not None or not isinstance(source, Source):
            return Seen(tuple(emission or BLACK))
        return self._rendered(source)

    def _background(self, source: Source) -> Seen | None:
        """A colour or an environment texture, if the node is a Background that shows one."""
        if source.node.bl_idname != "ShaderNodeBackground":
            return None
        strength = self._strength(source)
        if strength is None:
            return None
        color = self.reader.constant(source.node.inputs["Color"], source.context)
        if color is not None:
            color = color if isinstance(color, list) else [color] * 3
            return Seen(tuple(channel * strength for channel in color))
        texture = self.reader.follow(source.node.inputs["Color"], source.context)
        if not isinstance(texture, Source) or texture.node.bl_idname != "ShaderNodeTexEnvironment":
            return None
        mapping = None if is_mapped(texture.node) else self._direction(texture, "Vector")
        image = texture.node.image
        if texture.node.projection != "EQUIRECTANGULAR" or image is None or mapping is None or image.source == "TILED":
            return None
        number = self.images.number(image, f"world '{self.world.name}'", texture.node.image_user)
        return Seen((strength,) * 3, number, tuple(tuple(row) for row in mapping))

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

    def _rendered(self, surface: Source) -> Seen:
        """A texture that Cycles renders; the strength of a Background node stays a factor of it."""
        strength = self._strength(surface) if surface.node.bl_idname == "ShaderNodeBackground" else None
        try:
            graph = WorldGraph(surface, self.reader)
            if strength is not None:
                graph.take_strength()
            rest = (image for image in graph.images.values() if not has_tile_files(image))
            for note in filter(None, map(note_on, rest)):
                self._warn(note)
            if graph.text not in self.rendered:
                self.rendered[graph.text] = self.texture_of(graph, self.world.name)
        except UnsupportedNodeError as error:
            self._warn(f"{error}, which is not supported yet; the world is black")
            return Seen()
        except WorldRenderError as error:
            self._warn(f"Cycles could not render it: {error}; the world is black")
            return Seen()
        return Seen((1.0 if strength is None else strength,) * 3, self.rendered[graph.text])

    def _set(self, seen: dict[str, Seen]) -> None:
        """Sets what rays of each kind see: the world is what most see that light anything, the rest are parts of it."""
        seeing = (*BOUNCED, "camera") if self.visible_camera else BOUNCED
        own = next((seen[rays] for rays in seeing if any(seen[rays].color)), seen["diffuse"])
        if not self.visible_camera:
            seen["camera"] = own
        others = dict.fromkeys(light for light in seen.values() if light != own)
        parts = [([light == other for light in seen.values()], *other) for other in others]
        more = {"parts": parts} if parts else {}
        if self.space.volume is not None:
            more |= self.space._asdict()
        rows = [list(row) for row in own.matrix]
        self.builder.set_world(
            list(own.color), texture=own.texture, texture_from_world=rows, visible_camera=self.visible_camera, **more
        )

    def _warn(self, message: str) -> None:
        self.builder.warn(f"world '{self.world.name}': {message}")
