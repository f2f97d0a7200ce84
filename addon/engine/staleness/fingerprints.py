"""Fingerprints of what a bake depends on, cheap enough to be taken while the artist works.

They see transforms, data and its attributes, modifiers with all that they read (objects that no render shows, groups of
geometry nodes, textures), particle settings, poses, material and world nodes, visibility of objects and collections,
objects of instanced collections, camera and render settings, and size and time of files of images and volumes, of
sequences those that are shown in the frame. Of smoke they see the frame, and not what its simulation left there; nor do
they see other simulation caches, combed hair, multiresolution sculpting, and other files."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterator
from functools import partial
from typing import Any, NamedTuple

import bpy

from ...core.diff import Fingerprint
from ...export import trace_settings
from ...export.camera import UnsupportedCameraError, camera_json, film_size
from ...export.culling import culling_settings
from ...export.current_shot import current_size
from ...export.curves import strand_shape
from ...export.dicing import dicing_camera, dicing_settings
from ...export.images import frame_of, path_of, texture_size, tile_path
from ...export.instancers import objects_in
from ...export.lights import rules_of_lights
from ...export.materials import bump_shadowing, sampling_settings
from ...export.materials.graph import used_tree
from ...export.view_layer import render_layer
from ...export.working_space import working_space
from ...export.world import world_of
from .dependencies import dependencies_of, image_nodes, may_instance
from .motion_fingerprints import motion
from .node_fingerprints import group, hashed, ramp, tree, values
from .object_fingerprints import matrix_text, object_fingerprint
from .shape_fingerprints import DATA, shape
from .volume_fingerprints import smoke, stamp, volume
from .world_fingerprints import space, world

Steps = Generator[None, None, Fingerprint | None]
"""Takes a fingerprint in steps of a few milliseconds, many for a large mesh; returns None if there is none."""
Fingerprinter = Callable[[], Steps]

GEOMETRY = {"MESH", "CURVE", "SURFACE", "FONT", "META", "CURVES", "POINTCLOUD", "VOLUME"}


def keys_of_blocks(blocks: list[bpy.types.ID], scene: bpy.types.Scene) -> dict[str, None]:
    """Keys of all fingerprints that edited data-blocks may be part of."""
    objects = [block for block in blocks if isinstance(block, bpy.types.Object)]
    here = {obj.session_uid for obj in scene.objects} if objects else set()
    around = {each for obj in objects if obj.session_uid not in here for each in obj.users_collection}
    own = [key for block in blocks for key in keys_of_block(block, scene)]
    return dict.fromkeys([*own, *(f"instanced {each.name_full}" for each in around)])


def keys_of_block(found: bpy.types.ID, scene: bpy.types.Scene) -> list[str]:
    """Keys of the fingerprints that one data-block may be part of, without those of collections that instance it."""
    if isinstance(found, bpy.types.Object):
        helper = f"helper {found.name_full}"
        dices = ["settings"] * (found == dicing_camera(scene))
        if found.type == "CAMERA":
            return ["camera", helper, *dices]
        return [f"object {found.name_full}", helper, *dices] if _counts(found) else [helper, *dices]
    if isinstance(found, bpy.types.Camera):
        return ["camera", "settings"]
    if isinstance(found, bpy.types.World):
        return ["world", "space"]
    if isinstance(found, bpy.types.Scene):
        return list(ONE_OF_A_KIND)
    if isinstance(found, bpy.types.Key):
        return keys_of_block(found.user, scene)
    if isinstance(found, bpy.types.Action):
        return ["motion"]
    kind = _kind(found)
    own = [f"{kind} {found.name_full}"] if kind else []
    if isinstance(found, bpy.types.Image):
        return [*own, "world", "space"]
    if isinstance(found, bpy.types.Material):
        return [*own, "sequences"]
    is_collection = isinstance(found, bpy.types.Collection)
    return [*own, f"instanced {found.name_full}", "collections"] if is_collection else own


def _counts(obj: bpy.types.Object) -> bool:
    """True if the object can be seen in a render, or moves an object that can."""
    return not obj.hide_render and _may_count(obj)


def _may_count(obj: bpy.types.Object) -> bool:
    """True if the object would count when it is not hidden."""
    return obj.type in GEOMETRY or obj.type == "ARMATURE" or obj.instance_type != "NONE"


def iter_fingerprints(scene: bpy.types.Scene) -> Iterator[tuple[str, Fingerprinter]]:
    """Yields every key with a function that takes its fingerprint; shapes come last, as they take longest.

    Each step takes microseconds. Steps with an empty key only give the caller a chance to stop. Between steps the
    iterator holds data-blocks, and nothing inside of them that an edit could free. A step raises ReferenceError if a
    data-block was deleted; after undo the iterator must be thrown away."""
    for kind, take in ONE_OF_A_KIND.items():
        yield kind, partial(in_one_step, take, scene)
    rendered = _rendered(scene)
    objects = {obj.session_uid for obj in rendered}
    world = world_of(scene, render_layer(scene))
    todo: list[bpy.types.ID] = [*reversed(rendered), *([world] if world else [])]
    reached: set[int] = set()
    shapes: list[bpy.types.ID] = []
    instanced: list[bpy.types.Collection | None] = []
    while todo:
        block = todo.pop()
        if block.session_uid in reached:
            continue
        reached.add(block.session_uid)
        if isinstance(block, bpy.types.Object):
            kind = "object" if block.session_uid in objects else "helper"
            yield f"{kind} {block.name_full}", partial(in_one_step, object_fingerprint, block)
            if kind == "helper" and block.instance_collection is not None:
                todo.append(block.instance_collection)
        elif isinstance(block, DATA):
            shapes.append(block)
        elif kind := _kind(block):
            yield f"{kind} {block.name_full}", partial(BLOCKS[kind].take, block)
        for found in dependencies_of(block):
            if found is None:
                yield "", _nothing
            else:
                todo.append(found)
                instanced += [found] * (isinstance(found, bpy.types.Collection) and may_instance(block, found))
    outer = _with_instanced(instanced)
    for collection in dict.fromkeys(inner for found in outer for inner in (found, *found.children_recursive)):
        yield f"instanced {collection.name_full}", partial(BLOCKS["instanced"].take, collection)
    weighted = _weighted()
    for data in shapes:
        yield f"data {data.name_full}", partial(shape, data, data.session_uid in weighted)


def _rendered(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of a scene that count, and those of instanced collections that are not in the scene themselves."""
    return [obj for obj in [*scene.objects, *_instanced(scene)] if _counts(obj)]


def _weighted() -> set[int]:
    """Session uids of the data of all objects with vertex groups."""
    return {obj.data.session_uid for obj in bpy.data.objects if obj.vertex_groups}


def _instanced(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of instanced collections that are not in the scene themselves."""
    found = {obj.name_full: obj for collection in _instanced_collections(scene) for obj in collection.all_objects}
    return [obj for name, obj in found.items() if _by_full_name(scene.objects, name) is None]


def _instanced_collections(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Collections that the scene's objects instance, and those that are instanced in them."""
    return _with_instanced([obj.instance_collection for obj in scene.objects if _counts(obj)])


def _with_instanced(todo: list[bpy.types.Collection | None]) -> list[bpy.types.Collection]:
    """Collections of a list and those that are instanced in them, each once."""
    found: dict[int, bpy.types.Collection] = {}
    while todo:
        collection = todo.pop()
        if collection is None or collection.session_uid in found:
            continue
        found[collection.session_uid] = collection
        todo += [obj.instance_collection for obj in collection.all_objects]
    return list(found.values())


def _nothing() -> Steps:
    return in_one_step(lambda: None)


def in_one_step(of: Callable[..., Fingerprint | None], *arguments: Any) -> Steps:
    """Wraps a function whose fingerprint takes no time."""
    return of(*arguments)
    yield


def fingerprint(scene: bpy.types.Scene, key: str) -> Steps:
    """Takes the fingerprint of a key; None if its part of the scene is gone, or cannot be seen any more."""
    kind, _, name = key.partition(" ")
    if kind in ONE_OF_A_KIND:
        return in_one_step(ONE_OF_A_KIND[kind], scene)
    if kind in {"object", "helper"}:
        obj = _object_of(scene, kind, name)
        return in_one_step(object_fingerprint, obj) if obj is not None else _nothing()
    places = [getattr(bpy.data, place) for place in (SHAPES if kind == "data" else [BLOCKS[kind].place])]
    block = next((block for place in places if (block := _by_full_name(place, name)) is not None), None)
    if block is None:
        return _nothing()
    return shape(block, block.session_uid in _weighted()) if kind == "data" else BLOCKS[kind].take(block)


def _object_of(scene: bpy.types.Scene, kind: str, name: str) -> bpy.types.Object | None:
    """Object of a key. Each object has either an `object` key, if it is rendered, or a `helper` key."""
    found = _by_full_name(scene.objects, name)
    if found is None:
        found = next((obj for obj in _instanced(scene) if obj.name_full == name), None)
    if found is not None and _counts(found):
        return found if kind == "object" else None
    return _by_full_name(bpy.data.objects, name) if kind == "helper" else None


def _by_full_name(place: Any, name: str) -> Any:
    """A data-block; those of libraries have the library in their full name."""
    found = place.get(name)
    if found is not None and found.name_full == name:
        return found
    return next((block for block in place if block.name_full == name), None) if "[" in name else None


def all_fingerprints(
    scene: bpy.types.Scene, camera: bpy.types.Object, size: tuple[int, int] | None = None
) -> dict[str, Fingerprint]:
    """Takes all fingerprints at once, for a camera and a picture size; takes long for a large scene."""
    found = {key: taken for key, take in iter_fingerprints(scene) if (taken := _all_of(take())) is not None}
    return found | of_view(scene, camera, size or current_size(scene))


def of_view(scene: bpy.types.Scene, camera: bpy.types.Object, size: tuple[int, int] | None) -> dict[str, Fingerprint]:
    """The fingerprints that tell shots of one scene apart; a shot without a `size` has the scene's."""
    width, height = size or film_size(scene.render)
    return {"camera": _camera_fingerprint(scene, camera), "film": {"size": f"{width} x {height}"}}


def _all_of(steps: Steps) -> Fingerprint | None:
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def _material(material: bpy.types.Material) -> Fingerprint:
    used = used_tree(material)
    if used is None:
        found = {"nodes": hashed(values(material))}
    else:
        method = material.displacement_method
        found = {"nodes": hashed(tree(used) if method == "BUMP" else [tree(used), method])}
    if sampling := sampling_settings(material):
        found["sampling"] = hashed(sampling)
    if bump_shadowing(material) == "off":
        found["bumps"] = "off"
    return found


def _group(geometry: bpy.types.NodeTree) -> Steps:
    return {"nodes": hashed((yield from group(geometry)))}


def _texture(texture: bpy.types.Texture) -> Fingerprint:
    return {"settings": hashed([values(texture), ramp(texture)])}


def _particles(settings: bpy.types.ParticleSettings) -> Fingerprint:
    return {"settings": hashed(values(settings))}


def _collection(collection: bpy.types.Collection) -> Fingerprint:
    return {"objects": hashed(sorted(block.name_full for block in [*collection.objects, *collection.children]))}


def _instanced_fingerprint(collection: bpy.types.Collection) -> Fingerprint | None:
    """Fingerprint of the objects that a collection hides where nodes or particles instance it; None if it is no part of
    a bake."""
    if not any(map(_may_count, collection.all_objects)):
        return None
    hidden = sorted(obj.name_full for obj in collection.objects if obj.hide_render and _may_count(obj))
    return {"lacking": hashed([collection.hide_render, hidden])}


def _image(image: bpy.types.Image) -> Fingerprint | None:
    """Fingerprint of the files behind an image, including all tiles."""
    if image.source not in {"FILE", "SEQUENCE", "TILED"}:
        return None
    tiles = [tile.number for tile in image.tiles] if image.source == "TILED" else []
    if image.packed_file:
        return {"tiles": hashed(tiles)} if tiles else None
    path = bpy.path.abspath(image.filepath, library=image.library)
    return {"file": hashed([stamp(tile_path(path, number)) for number in tiles] if tiles else [stamp(path)])}


def _smoke(scene: bpy.types.Scene) -> Fingerprint:
    return smoke(filter(_counts, scene.objects), scene.frame_current)


def _sequences(scene: bpy.types.Scene) -> Fingerprint:
    """Fingerprints of image sequences and movies in the scene's frame, by name. Costs next to nothing without any."""
    images = {image for image in bpy.data.images if image.source in {"SEQUENCE", "MOVIE"}}
    shown: dict[str, list] = {}
    for material in bpy.data.materials if images else ():
        for node in image_nodes(used_tree(material)) if material.users else ():
            if node.image in images:
                path = path_of(node.image, node.image_user, scene.frame_current)
                files = shown.setdefault(node.image.name_full, [])
                files.append([path, frame_of(node.image_user, scene.frame_current), stamp(path)])
    return {name: hashed(sorted(files)) for name, files in shown.items()}


def _camera(scene: bpy.types.Scene) -> Fingerprint | None:
    return _camera_fingerprint(scene, scene.camera) if scene.camera else None


def _camera_fingerprint(scene: bpy.types.Scene, camera: bpy.types.Object) -> Fingerprint:
    try:
        lens = json.loads(camera_json(camera, scene, (1, 1)))
    except UnsupportedCameraError as error:
        lens = {"world_from_object": [], "unsupported": str(error)}
    lens.pop("name", None)  # The same camera may be renamed.
    return {"name": camera.name_full, "place": matrix_text(lens.pop("world_from_object")), "lens": hashed(lens)}


def _film(scene: bpy.types.Scene) -> Fingerprint:
    width, height = current_size(scene) or film_size(scene.render)
    return {"size": f"{width} x {height}"}


def _settings(scene: bpy.types.Scene) -> Fingerprint:
    layer = render_layer(scene)
    override = layer.material_override
    dicing = dicing_settings(scene)
    camera = dicing_camera(scene) if dicing is not None else None
    diced_for = _camera_fingerprint(scene, camera) if camera is not None else {}
    return {
        **({"dicing": hashed([dicing, sorted(diced_for.items())])} if dicing is not None else {}),
        "paths": hashed(trace_settings(scene, lambda _message: None).get("paths")),
        "override": override.name_full if override is not None else "",
        "volumes": str(layer.use_volumes),
        **({} if layer.use_solid else {"surfaces": "off"}),
        "strands": hashed([strand_shape(scene), layer.use_strand]),
        "space": working_space(),
        **({"culling": hashed(culling)} if (culling := culling_settings(scene)) else {}),
        **({"textures": hashed(size)} if (size := texture_size(scene)) is not None else {}),
    }


def _rules(scene: bpy.types.Scene) -> Fingerprint:
    return {"lights": hashed(rules_of_lights(scene))}


def _collections(scene: bpy.types.Scene) -> Fingerprint:
    """Fingerprint of what collections do to their objects: which they hide from renders, in the view layer or as
    instances, which they alter for rays, and the origins of instanced collections. Costs next to nothing where they do
    none of it."""
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
    instanced = {obj.instance_collection for obj in scene.objects} - {None}
    lacking = {
        (collection.name_full, obj.name_full)
        for collection in _instanced_collections(scene)
        if any(inner.hide_render for inner in (collection, *collection.children_recursive))
        for obj, is_shown in objects_in(collection)
        if not is_shown and _counts(obj)
    }
    return {
        "hidden": hashed(sorted(obj.name_full for obj in hidden)),
        "lacking": hashed(sorted(lacking)),
        "rays": hashed(sorted(altered)),
        "origins": hashed(sorted((found.name_full, *found.instance_offset) for found in instanced)),
    }


def _layers(layer: bpy.types.LayerCollection, is_hidden: bool) -> Iterator[tuple[bpy.types.LayerCollection, bool]]:
    """Collections of a view layer below one, each with True if renders leave it out."""
    is_hidden = is_hidden or layer.collection.hide_render
    yield layer, is_hidden or layer.exclude
    for child in layer.children:
        yield from _layers(child, is_hidden)


ONE_OF_A_KIND: dict[str, Callable[[bpy.types.Scene], Fingerprint | None]] = {
    "camera": _camera,
    "film": _film,
    "settings": _settings,
    "rules": _rules,
    "collections": _collections,
    "motion": motion,
    "world": world,
    "space": space,
    "sequences": _sequences,
    "smoke": _smoke,
}


class _Block(NamedTuple):
    """Fingerprinting of one kind of data-block."""

    type: type
    place: str
    """Name of their collection in `bpy.data`."""
    take: Callable[[Any], Steps]


BLOCKS = {
    "material": _Block(bpy.types.Material, "materials", partial(in_one_step, _material)),
    "image": _Block(bpy.types.Image, "images", partial(in_one_step, _image)),
    "collection": _Block(bpy.types.Collection, "collections", partial(in_one_step, _collection)),
    "instanced": _Block(bpy.types.Collection, "collections", partial(in_one_step, _instanced_fingerprint)),
    "nodes": _Block(bpy.types.GeometryNodeTree, "node_groups", _group),
    "volume": _Block(bpy.types.Volume, "volumes", partial(in_one_step, volume)),
    "texture": _Block(bpy.types.Texture, "textures", partial(in_one_step, _texture)),
    "particles": _Block(bpy.types.ParticleSettings, "particles", partial(in_one_step, _particles)),
}
SHAPES = ("meshes", "curves", "metaballs", "lattices", "hair_curves", "pointclouds")
"""Collections in `bpy.data` whose data-blocks have a fingerprint of their shape."""


def _kind(block: bpy.types.ID) -> str:
    """Kind of a data-block's fingerprint, the first one for collections; empty if it has none."""
    if isinstance(block, DATA):
        return "data"
    return next((kind for kind, of in BLOCKS.items() if isinstance(block, of.type)), "")
