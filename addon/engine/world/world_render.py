"""The body of `relume render-world`: builds a world from its plain data (`export.world_graph`) and has Cycles render it
over all directions. Runs in a Blender of its own."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...export.materials.graph import resolve
from ...export.working_space import working_space
from ...export.world_graph import WorldGraph, WorldReader
from ..cycles.render import read_picture, set_up
from .worlds import JOB, RESULT

SAMPLES, REFINED_SAMPLES = 4, 1024
"""Samples of a pixel, and of one that much of all light may come from, such as the edge of the sun."""
REFINED_SHARE = 1e-4
"""Share of all light by which a pixel and its neighbours must differ to be refined."""
TILE = 64
MOST_TILES = 8
FACING = (math.pi / 2.0, 0.0, -math.pi / 2.0)
"""Turn of a panoramic camera whose picture is an environment texture: +x in the middle, +z at the top."""


class WorldBuildError(Exception):
    """The world that was built is not the one that was described; the message says where."""


def render(place: Path) -> None:
    """Does the job of a folder."""
    job = json.loads((place / JOB).read_text(encoding="utf-8"))
    if job["working_space"] != working_space():
        bpy.ops.wm.set_working_color_space(working_space=job["working_space"])
    scene = bpy.data.scenes.new("World")
    scene.world = _World(scene, place, job).built
    _prepare(scene, job["size"])
    if job["texture_size"]:
        _limit_textures(scene, *job["texture_size"])
    pixels = _Panorama(scene, place / "world.exr").render()
    pixels[..., 3] = 1.0
    np.save(place / RESULT, pixels)


class _World:
    """Builds a world from plain data."""

    def __init__(self, scene: bpy.types.Scene, place: Path, job: dict[str, Any]):
        self.scene, self.place, self.job = scene, place, job
        self.images: dict[str, bpy.types.Image] = {}
        self.built = bpy.data.worlds.new("World")
        if bpy.app.version < (5, 2, 0):
            self.built.use_nodes = True
        self.tree = self.built.node_tree
        self.tree.nodes.clear()
        self.nodes = [self._node(description) for description in job["nodes"]]
        for node, description in zip(self.nodes, job["nodes"], strict=True):
            self._connect(node, description["inputs"])
        output = self.tree.nodes.new("ShaderNodeOutputWorld")
        self._link(job["surface"], output.inputs["Surface"])
        scene.view_layers[0].update()
        self._check(output)

    def _node(self, description: dict[str, Any]) -> bpy.types.Node:
        node = self.tree.nodes.new(description["type"])
        _set(node, description["settings"])
        for name, part in description["parts"].items():
            self._part(node, name, part)
        if description["value"] is not None:
            node.outputs[0].default_value = description["value"]
        return node

    def _part(self, node: bpy.types.Node, name: str, part: dict[str, Any]) -> None:
        if "image" in part:
            setattr(node, name, self._image(part["image"]))
        elif "object" in part:
            setattr(node, name, self._empty(part["object"]))
        else:
            owner = getattr(node, name)
            _set(owner, part["settings"])
            if "stops" in part:
                _set_stops(owner, part["stops"])
            if "curves" in part:
                _set_curves(owner, part["curves"])

    def _connect(self, node: bpy.types.Node, inputs: dict[str, Any]) -> None:
        sockets = {socket.identifier: socket for socket in node.inputs}
        for identifier, value in inputs.items():
            if isinstance(value, dict):
                self._link(value, sockets[identifier])
            else:
                sockets[identifier].default_value = value

    def _link(self, source: dict[str, Any], target: bpy.types.NodeSocket) -> None:
        outputs = self.nodes[source["node"]].outputs
        self.tree.links.new(next(socket for socket in outputs if socket.identifier == source["output"]), target)

    def _image(self, name: str) -> bpy.types.Image:
        if name not in self.images:
            self.images[name] = self._opened(self.job["images"][name])
        return self.images[name]

    def _opened(self, image: dict[str, Any]) -> bpy.types.Image:
        if "file" in image:
            opened = bpy.data.images.load(str(self.place / image.get("first", image["file"])))
            if "tiles" in image:
                opened.source, opened.filepath = "TILED", image["file"]
                for number in set(image["tiles"]) - {tile.number for tile in opened.tiles}:
                    opened.tiles.new(number)
            opened.colorspace_settings.name = image["space"]
            opened.alpha_mode = image["alpha"]
            if image.get("is_packed"):  # Cycles reads the alpha of packed images in another way than that of files.
                opened.pack()
            return opened
        width, height = image["size"]
        made = bpy.data.images.new("made", width, height, alpha=True, float_buffer=image["is_float"])
        # Blender has made the numbers of floats linear already.
        is_linear = image["is_float"] and not image["is_data"]
        made.colorspace_settings.name = self.job["working_space"] if is_linear else image["space"]
        made.alpha_mode = image["alpha"]
        pixels = np.load(self.place / image["pixels"]).reshape(height, width, image["channels"])
        made.pixels.foreach_set(_rgba(pixels).reshape(-1))
        return made

    def _empty(self, place: list[list[float]]) -> bpy.types.Object:
        """An object with a matrix of any kind, also with shear."""
        origin, empty = (bpy.data.objects.new(name, None) for name in ("Origin", "Place"))
        for obj in (origin, empty):
            self.scene.collection.objects.link(obj)
        empty.parent = origin
        empty.matrix_parent_inverse = Matrix(place)
        return empty

    def _check(self, output: bpy.types.Node) -> None:
        """Compares what was built with what was to be built."""
        surface = resolve(output.inputs["Surface"], ())
        built = WorldGraph(surface, WorldReader()).content if surface else {"surface": None, "nodes": []}
        for wanted, found in zip(self.job["nodes"], json.loads(json.dumps(built["nodes"])), strict=True):
            # Images have other names here.
            known = {name: part for name, part in found["parts"].items() if name in wanted["parts"]}
            if _without_images(wanted) != _without_images(found | {"parts": known}):
                raise WorldBuildError(f"a node of type {wanted['type']} could not be handed over whole")


def _without_images(node: dict[str, Any]) -> dict[str, Any]:
    return node | {"parts": {name: part for name, part in node["parts"].items() if "image" not in part}}


def _set(struct: Any, settings: dict[str, Any]) -> None:
    for name, value in settings.items():
        is_flags = struct.bl_rna.properties[name].type == "ENUM" and isinstance(value, list)
        setattr(struct, name, set(value) if is_flags else value)


def _set_stops(ramp: bpy.types.ColorRamp, stops: list) -> None:
    while len(ramp.elements) > 1:
        ramp.elements.remove(ramp.elements[-1])
    ramp.elements[0].position, ramp.elements[0].color = stops[0]
    for position, color in stops[1:]:
        ramp.elements.new(position).color = color


def _set_curves(mapping: bpy.types.CurveMapping, curves: list) -> None:
    for curve, points in zip(mapping.curves, curves, strict=True):
        for _ in points[len(curve.points) :]:
            curve.points.new(0.0, 0.0)
        while len(curve.points) > len(points):
            curve.points.remove(curve.points[-1])
        for point, (location, handle) in zip(curve.points, points, strict=True):
            point.location, point.handle_type = location, handle
    mapping.update()


def _rgba(pixels: np.ndarray) -> np.ndarray:
    height, width, channels = pixels.shape
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[..., : 3 if channels >= 3 else 1]
    if channels == 4:
        rgba[..., 3] = pixels[..., 3]
    return rgba


def _prepare(scene: bpy.types.Scene, size: list[int]) -> None:
    """Sets up a camera and settings that give plain means over the pixels of an equirectangular picture."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.rotation_euler = FACING
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.data.type, camera.data.panorama_type = "PANO", "EQUIRECTANGULAR"
    scene.world.cycles.sampling_method = "NONE"  # No surface is lit by it.
    render = {"film_transparent": False, "use_persistent_data": True, "use_crop_to_border": True}
    exact = {"film_exposure": 1.0, "pixel_filter_type": "BOX", "sample_clamp_direct": 0.0}
    set_up(scene, (size[0], size[1]), render, exact | {"device": "CPU", "shading_system": False})


def _limit_textures(scene: bpy.types.Scene, largest: int | None, share: float) -> None:
    scene.render.use_simplify = True
    scene.cycles.texture_limit_render = "OFF" if largest is None else str(largest)
    if share < 1.0:
        scene.cycles.texture_resolution_render = share


class _Panorama:
    """Renders a scene whole, and again with many samples where much light may come from few pixels."""

    def __init__(self, scene: bpy.types.Scene, file: Path):
        self.scene, self.file = scene, file

    def render(self) -> np.ndarray:
        """RGBA [height, width, 4], bottom row first."""
        pixels = self._part(SAMPLES)
        height, width = pixels.shape[:2]
        for left, bottom, right, top in strong_parts(pixels):
            part = self._part(REFINED_SAMPLES, (left / width, bottom / height, right / width, top / height))
            pixels[bottom:top, left:right] = part
        return pixels

    def _part(self, samples: int, border: tuple[float, float, float, float] | None = None) -> np.ndarray:
        render = self.scene.render
        self.scene.cycles.samples = samples
        render.use_border = border is not None
        if border is not None:
            # Blender rounds down.
            nudge_x, nudge_y = 0.25 / render.resolution_x, 0.25 / render.resolution_y
            render.border_min_x, render.border_max_x = border[0] + nudge_x, border[2] + nudge_x
            render.border_min_y, render.border_max_y = border[1] + nudge_y, border[3] + nudge_y
        render.filepath = str(self.file)
        bpy.ops.render.render(write_still=True, scene=self.scene.name)
        return read_picture(self.file)


def strong_parts(pixels: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Left, bottom, right and top of the parts of an equirectangular picture, a few at most, where the difference
    between neighbours is a good share of all light."""
    height, width = pixels.shape[:2]
    latitude = ((np.arange(height) + 0.5) / height - 0.5) * np.pi
    light = np.abs(pixels[..., :3]).max(axis=2) * np.cos(latitude)[:, None]
    total = light.sum()
    if not np.isfinite(total) or total <= 0.0:
        return []
    share = _differences(light) / total
    found: list[tuple[float, tuple[int, int, int, int]]] = []
    for bottom in range(0, height, TILE):
        for left in range(0, width, TILE):
            rows, columns = np.nonzero(share[bottom : bottom + TILE, left : left + TILE] > REFINED_SHARE)
            if len(rows):
                strength = float(share[bottom : bottom + TILE, left : left + TILE].max())
                low, high = (int(columns.min()), int(rows.min())), (int(columns.max()) + 1, int(rows.max()) + 1)
                found.append((strength, (left + low[0], bottom + low[1], left + high[0], bottom + high[1])))
    found.sort(reverse=True)
    return [box for _, box in found[:MOST_TILES]]


def _differences(values: np.ndarray) -> np.ndarray:
    """Largest minus smallest of each value's neighbourhood of three by three; columns go round."""
    low = high = np.pad(values, ((1, 1), (0, 0)), mode="edge")
    low = np.minimum(np.minimum(low[:-2], low[1:-1]), low[2:])
    high = np.maximum(np.maximum(high[:-2], high[1:-1]), high[2:])
    low = np.minimum(np.minimum(np.roll(low, 1, axis=1), low), np.roll(low, -1, axis=1))
    high = np.maximum(np.maximum(np.roll(high, 1, axis=1), high), np.roll(high, -1, axis=1))
    return high - low
