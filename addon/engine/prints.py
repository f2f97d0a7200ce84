"""Prints of what a bake depends on, cheap enough to be taken while the artist works.

They see transforms, data and its attributes, modifiers and their inputs, poses, material and world nodes, visibility
of objects and collections, objects of instanced collections, camera and render settings, and size and time of image
files. They do not see simulation caches, and what node groups of modifiers do beyond their inputs."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable, Generator, Iterator
from functools import partial
from typing import Any

import bpy
import numpy as np

from ..core.differences import Print, color_text
from ..export import trace_settings
from ..export.camera import UnsupportedCameraError, camera_json, film_size
from ..export.materials.graph import used_tree
from ..export.plain import SIMPLE, effective_properties, plain
from ..export.working_space import working_space
from ..export.world import export_world, world_of
from ..export.world_graph import WorldGraph
from .render_depsgraph import render_layer

Steps = Generator[None, None, Print | None]
"""Takes a print, in steps of a few milliseconds; those of large meshes are many."""
Take = Callable[[], Steps]

GEOMETRY = {"MESH", "CURVE", "SURFACE", "FONT", "META", "CURVES", "POINTCLOUD", "VOLUME"}
SLICE_BYTES = 2**22
"""Of a mesh, that are looked at in one step."""
DATA = (bpy.types.Mesh, bpy.types.Curve, bpy.types.MetaBall)


def keys_of(found: bpy.types.ID, scene: bpy.types.Scene) -> list[str]:
    """The prints that an edited data-block is part of."""
    if isinstance(found, bpy.types.Object):
        return ["camera"] if found == scene.camera else [f"object {found.name_full}"] if _counts(found) else []
    if isinstance(found, bpy.types.Camera):
        return ["camera"]
    if isinstance(found, bpy.types.Material):
        return [f"material {found.name_full}"]
    if isinstance(found, bpy.types.Image):
        return [f"image {found.name_full}", "world"]
    if isinstance(found, bpy.types.World):
        return ["world"]
    if isinstance(found, bpy.types.Scene):
        return ["camera", "film", "settings", "collections", "world"]
    if isinstance(found, bpy.types.Collection):
        return ["collections"]
    return [f"data {found.name_full}"] if isinstance(found, DATA) else []


def _counts(obj: bpy.types.Object) -> bool:
    """Whether the object can be seen in a render, or moves what can."""
    shown = not obj.hide_render
    return shown and (obj.type in GEOMETRY or obj.type == "ARMATURE" or obj.instance_type != "NONE")


def walk(scene: bpy.types.Scene) -> Iterator[tuple[str, Take]]:
    """Every key with what takes its print, meshes last as they take longest, in steps of microseconds: steps without a
    key are there to be interrupted.
    Between steps it holds data-blocks, and nothing inside of them that an edit could free. Where one was deleted a step
    raises ReferenceError; after undo it is to be thrown away."""
    for kind, take in ONE_OF_A_KIND.items():
        yield kind, partial(_at_once, take, scene)
    walked: set[int] = set()
    shapes: dict[int, bpy.types.ID] = {}
    yield from _images(world_of(scene, render_layer(scene)), walked)
    for obj in [*scene.objects, *_instanced(scene)]:
        if not _counts(obj):
            yield "", _nothing
            continue
        yield f"object {obj.name_full}", partial(_at_once, _object, obj)
        if obj.type in GEOMETRY and obj.data is not None:
            shapes[obj.data.session_uid] = obj.data
        for material in [slot.material for slot in obj.material_slots]:
            if material is not None and material.session_uid not in walked:
                walked.add(material.session_uid)
                yield f"material {material.name_full}", partial(_at_once, _material, material)
                yield from _images(material, walked)
    for data in shapes.values():
        yield f"data {data.name_full}", partial(_data, data)


def _instanced(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of instanced collections that are not in the scene themselves."""
    todo = [obj.instance_collection for obj in scene.objects if _counts(obj)]
    seen: set[int] = set()
    found: dict[str, bpy.types.Object] = {}
    while todo:
        collection = todo.pop()
        if collection is None or collection.session_uid in seen:
            continue
        seen.add(collection.session_uid)
        found |= {obj.name_full: obj for obj in collection.all_objects}
        todo += [obj.instance_collection for obj in collection.all_objects]
    return [obj for name, obj in found.items() if _by_full_name(scene.objects, name) is None]


def _images(owner: bpy.types.Material | bpy.types.World | None, walked: set[int]) -> Iterator[tuple[str, Take]]:
    """What takes the prints of the images in the nodes of a material or world, of each once."""
    tree = used_tree(owner) if owner else None
    for image in list(_images_of(tree)) if tree else ():
        if image.session_uid not in walked:
            walked.add(image.session_uid)
            yield f"image {image.name_full}", partial(_at_once, _image, image)


def _images_of(tree: bpy.types.NodeTree) -> Iterator[bpy.types.Image]:
    for node in tree.nodes:
        if (image := getattr(node, "image", None)) is not None:
            yield image
        if (inner := getattr(node, "node_tree", None)) is not None:
            yield from _images_of(inner)


def _nothing() -> Steps:
    return _at_once(lambda: None)


def _at_once(of: Callable[..., Print | None], *arguments: Any) -> Steps:
    """A print that takes no time."""
    return of(*arguments)
    yield


def take(scene: bpy.types.Scene, key: str) -> Steps:
    """Takes the print of a key; None of what is not there, or cannot be seen any more."""
    kind, _, name = key.partition(" ")
    if kind in ONE_OF_A_KIND:
        return _at_once(ONE_OF_A_KIND[kind], scene)
    if kind == "data":
        block = _first(name, bpy.data.meshes, bpy.data.curves, bpy.data.metaballs)
        return _data(block) if block is not None else _nothing()
    place, of = {
        "object": (scene.objects, _object),
        "material": (bpy.data.materials, _material),
        "image": (bpy.data.images, _image),
    }[kind]
    block = _first(name, place)
    if block is None and kind == "object":
        block = next((obj for obj in _instanced(scene) if obj.name_full == name), None)
    return _at_once(of, block) if block is not None else _nothing()


def _first(name: str, *places: Any) -> Any:
    return next((block for place in places if (block := _by_full_name(place, name)) is not None), None)


def _by_full_name(place: Any, name: str) -> Any:
    """A data-block; those of libraries have the library in their full name."""
    found = place.get(name)
    if found is not None and found.name_full == name:
        return found
    return next((block for block in place if block.name_full == name), None) if "[" in name else None


def take_all(scene: bpy.types.Scene, camera: bpy.types.Object, size: tuple[int, int] | None = None) -> dict[str, Print]:
    """All prints at once, of a camera and a picture size; takes long for a large scene."""
    found = {key: taken for key, take in walk(scene) if (taken := _all_of(take())) is not None}
    return found | {"camera": _camera_print(scene, camera), "film": _film(scene, size)}


def _all_of(steps: Steps) -> Print | None:
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def _hash(value: Any) -> str:
    return f"{zlib.crc32(value if isinstance(value, bytes) else repr(value).encode()):08x}"


def _matrix(matrix: Any) -> str:
    """Exact to six digits: evaluating a file again may differ by a rounding."""
    return _hash([f"{value:.6g}" for row in matrix for value in row])


def _object(obj: bpy.types.Object) -> Print | None:
    if not _counts(obj):
        return None
    visible = ("camera", "diffuse", "glossy", "transmission", "shadow")
    found = {
        "place": _matrix(obj.matrix_world),
        "visibility": _hash([getattr(obj, f"visible_{name}") for name in visible]),
    }
    if obj.data is not None:
        found["data"] = obj.data.name_full
    elif obj.instance_collection is not None:
        found["data"] = obj.instance_collection.name_full
    if obj.material_slots:
        found["materials"] = _hash([slot.material.name_full if slot.material else "" for slot in obj.material_slots])
    if obj.modifiers:
        found["modifiers"] = _hash([_modifier(modifier) for modifier in obj.modifiers])
    if obj.pose:
        found["pose"] = _hash([_matrix(bone.matrix) for bone in obj.pose.bones])
    return found


def _modifier(modifier: bpy.types.Modifier) -> list:
    inputs = [(name, plain(value)) for name, value in modifier.items()] if modifier.type == "NODES" else []
    return [modifier.type, modifier.show_render, _values(modifier), inputs]


def _data(data: bpy.types.ID) -> Steps:
    if getattr(data, "is_editmode", False):  # Its arrays are empty then.
        return None
    shapes = [(block.value, block.mute) for block in data.shape_keys.key_blocks] if _shape_keys(data) else []
    if not isinstance(data, bpy.types.Mesh):
        return {"shape": _hash([_values(data), shapes, _points(data)])}
    arrays = []
    for name in sorted(data.attributes.keys()):
        # A dot begins what is Blender's own: selections, what is hidden while editing, and the vertices of corners.
        if not name.startswith(".") or name == ".corner_vert":
            arrays.append((name, (yield from _array(data, name))))
    return {"shape": _hash([len(data.vertices), len(data.polygons), arrays, shapes])}


def _shape_keys(data: bpy.types.ID) -> Any:
    return getattr(data, "shape_keys", None)


def _points(data: bpy.types.ID) -> list:
    """Control points of curves."""
    points = [
        [tuple(point.co) for point in (spline.bezier_points or spline.points)]
        for spline in getattr(data, "splines", ())
    ]
    return [points, [tuple(element.co) for element in getattr(data, "elements", ())]]


def _array(data: bpy.types.Mesh, name: str) -> Generator[None, None, str]:
    """Of all values of an attribute: a copy of them, then a part at a time."""
    values = _values_of(data, name)
    if values is None:
        return ""
    found = 0
    for start in range(0, len(values), SLICE_BYTES):
        yield
        found = zlib.crc32(values[start : start + SLICE_BYTES], found)
    yield
    return f"{found:08x}"


def _values_of(data: bpy.types.Mesh, name: str) -> memoryview | None:
    """The bytes of an attribute; None if it is not there, or of a type that no picture shows."""
    attribute = data.attributes.get(name)
    if attribute is None or attribute.data_type not in ATTRIBUTES:
        return None
    kind, of, width = ATTRIBUTES[attribute.data_type]
    values: np.ndarray = np.empty(len(attribute.data) * width, of)
    attribute.data.foreach_get(kind, values)
    return values.view(np.uint8).data


def _material(material: bpy.types.Material) -> Print:
    tree = used_tree(material)
    return {"nodes": _hash(_tree(tree) if tree else _values(material))}


def _image(image: bpy.types.Image) -> Print | None:
    """Of the files behind an image: of tiles all."""
    if image.source not in {"FILE", "SEQUENCE", "TILED"} or image.packed_file:
        return None
    path = bpy.path.abspath(image.filepath, library=image.library)
    tiles = [tile.number for tile in image.tiles] if image.source == "TILED" else [0]
    return {"file": _hash([_stamp(path.replace("<UDIM>", str(tile))) for tile in tiles])}


def _stamp(path: str) -> tuple[int, int] | None:
    """Differs when a file was written anew."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns


def _tree(tree: bpy.types.NodeTree) -> list:
    """Everything that a node tree and the groups in it compute with."""
    nodes = [_node(node) for node in tree.nodes if node.bl_idname not in {"NodeFrame", "NodeReroute"}]
    links = [
        (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
        for link in tree.links
        if not link.is_muted
    ]
    return [nodes, sorted(links)]


def _node(node: bpy.types.Node) -> list:
    inputs = [plain(socket.default_value) for socket in node.inputs if hasattr(socket, "default_value")]
    outputs = [plain(socket.default_value) for socket in node.outputs if hasattr(socket, "default_value")]
    extra: list[Any] = []
    if (ramp := getattr(node, "color_ramp", None)) is not None:
        extra.append([ramp.interpolation, [(stop.position, tuple(stop.color)) for stop in ramp.elements]])
    if (mapping := getattr(node, "mapping", None)) is not None and hasattr(mapping, "curves"):
        extra.append([[tuple(point.location) for point in curve.points] for curve in mapping.curves])
    if (image := getattr(node, "image", None)) is not None:
        extra.append([image.filepath, image.colorspace_settings.name])
    if (inner := getattr(node, "node_tree", None)) is not None:
        extra.append(_tree(inner))
    return [node.name, node.bl_idname, node.mute, _values(node), inputs, outputs, extra]


def _values(struct: Any) -> list:
    """Simple settings of any part of a file."""
    found = []
    for prop in effective_properties(struct):
        name = prop.identifier
        if prop.type in SIMPLE:
            found.append((name, plain(getattr(struct, name))))
        elif prop.type == "POINTER":
            target = getattr(struct, name)
            found.append((name, target.name_full if isinstance(target, bpy.types.ID) else ""))
    return found


def _camera(scene: bpy.types.Scene) -> Print | None:
    return _camera_print(scene, scene.camera) if scene.camera else None


def _camera_print(scene: bpy.types.Scene, camera: bpy.types.Object) -> Print:
    try:
        lens = json.loads(camera_json(camera, scene, (1, 1)))
    except UnsupportedCameraError as error:
        lens = {"world_from_object": [], "unsupported": str(error)}
    lens.pop("name", None)  # The same camera may be renamed.
    return {"name": camera.name_full, "place": _matrix(lens.pop("world_from_object")), "lens": _hash(lens)}


def _film(scene: bpy.types.Scene, size: tuple[int, int] | None = None) -> Print:
    width, height = size or film_size(scene.render)
    return {"size": f"{width} x {height}"}


def _settings(scene: bpy.types.Scene) -> Print:
    return {"paths": _hash(trace_settings(scene, lambda _message: None).get("paths")), "space": working_space()}


def _collections(scene: bpy.types.Scene) -> Print:
    """Objects that collections of the view layer hide from renders, and those whose collections alter what rays see.
    Costs next to nothing where no collection does either."""
    layers = list(_layers(render_layer(scene).layer_collection, False))
    hidden = {obj for layer, is_hidden in layers if is_hidden for obj in layer.collection.objects if _counts(obj)}
    if hidden:
        hidden -= {obj for layer, is_hidden in layers if not is_hidden for obj in layer.collection.objects}
    altered = [
        (obj.name_full, layer.holdout, layer.indirect_only)
        for layer, is_hidden in layers
        if not is_hidden and (layer.holdout or layer.indirect_only)
        for obj in layer.collection.objects
        if _counts(obj)
    ]
    return {"hidden": _hash(sorted(obj.name_full for obj in hidden)), "rays": _hash(sorted(altered))}


def _layers(layer: bpy.types.LayerCollection, is_hidden: bool) -> Iterator[tuple[bpy.types.LayerCollection, bool]]:
    """A collection of a view layer and all in it, with whether renders leave it out."""
    is_hidden = is_hidden or layer.collection.hide_render
    yield layer, is_hidden or layer.exclude
    for child in layer.children:
        yield from _layers(child, is_hidden)


class _WorldRecorder:
    """Takes what `export_world` says about a world."""

    def __init__(self) -> None:
        self.color = [0.0, 0.0, 0.0]
        self.shape: list[Any] = []

    def set_world(self, color: list[float], texture: Any = None, **shape: Any) -> None:
        """As the scene builder's."""
        self.color, self.shape = color, [texture, sorted(shape.items())]

    def number(self, image: bpy.types.Image, _owner: str) -> str:
        """As the image exporter's."""
        return repr([image.name_full, image.filepath, image.colorspace_settings.name, image.alpha_mode])

    def texture_of(self, graph: WorldGraph, _name: str) -> str:
        """In place of rendering the world."""
        return graph.text

    def warn(self, message: str) -> None:
        """What cannot be represented is a part of the world too."""
        self.shape.append(message)


def world(scene: bpy.types.Scene) -> Print:
    """The print of the scene's world."""
    recorder: Any = _WorldRecorder()
    export_world(recorder, recorder, recorder.texture_of, scene, render_layer(scene))
    return {"shape": _hash(recorder.shape), "color": color_text(recorder.color)}


ONE_OF_A_KIND: dict[str, Callable[[bpy.types.Scene], Print | None]] = {
    "camera": _camera,
    "film": _film,
    "settings": _settings,
    "collections": _collections,
    "world": world,
}
ATTRIBUTES = {
    "BOOLEAN": ("value", np.bool_, 1),
    "INT": ("value", np.int32, 1),
    "INT16_2D": ("value", np.int32, 2),
    "FLOAT": ("value", np.float32, 1),
    "FLOAT2": ("vector", np.float32, 2),
    "FLOAT_VECTOR": ("vector", np.float32, 3),
    "FLOAT_COLOR": ("color", np.float32, 4),
    "BYTE_COLOR": ("color", np.float32, 4),
}
"""How values of a mesh are read by their type."""
