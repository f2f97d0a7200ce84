"""Walks a render-mode depsgraph: every instance once, every evaluated mesh once."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any, NamedTuple

import bpy
import numpy as np

from ..core.random_number import MASK, random_of_name
from .active_camera import asks_for_camera
from .camera import WatchedCamera, camera_json, film_size
from .culling import Culling
from .curves import CurvesExporter, Move, Strands
from .dicing import DicingExporter
from .geometry import GeometryExporter, is_open, shown_mesh
from .images import Convert, ImageExporter, no_convert, texture_size
from .instance_attributes import InstanceAttributes, UnknownInstanceError
from .lamp_shaders import LampShaders
from .lights import LightExporter
from .linking import LightLinking, receiver_names
from .materials import ANY_UV_MAP, MaterialExporter, asked_attributes
from .motion import FrameSet, Motion, followed, owner_of
from .node_graph import NodeGraph, WorldRenderError
from .object_attributes import Rgba, surroundings_of, values_of_instance
from .points import PointsExporter
from .volumes import VolumeExporter, density_factor, has_velocity, smoke_domain
from .world import Space, export_world, world_of

GREASE_PENCIL = {"GREASEPENCIL", "GPENCIL"}
"""Types of objects that Blender draws over the pictures of any render engine."""
FILTERS = {"GREASEPENCIL": "use_grease_pencil"}
"""Switches of a view layer that leave such objects out of every picture."""


@dataclasses.dataclass(frozen=True)
class ExportOptions:
    """Options of an export."""

    camera: str | None = None
    """Name of the camera object; the scene's own if None."""
    resolution_percentage: int | None = None
    """Overrides the scene's resolution percentage."""
    resolution: tuple[int, int] | None = None
    """Width and height in pixels; the scene's if None."""
    others: tuple[str, ...] = ()
    """Names of cameras that see the same scene, if nothing in it depends on which it is."""


RenderWorld = Callable[[NodeGraph], np.ndarray]
"""Renders a world over all directions: equirectangular RGBA [height, width, 4], bottom row first, scene-linear. Raises
WorldRenderError."""


class ExportError(Exception):
    """The scene cannot be exported; the message has the reason and the way out."""


def _no_render(_world: NodeGraph) -> np.ndarray:
    raise WorldRenderError("there is no other Blender to render it")


def export_scene(
    builder: Any,
    depsgraph: bpy.types.Depsgraph,
    options: ExportOptions,
    render_world: RenderWorld = _no_render,
    convert_image: Convert = no_convert,
    frame_set: FrameSet | None = None,
) -> dict[str, str]:
    """Feeds `builder` (a `relume.SceneBuilder`) with everything that `depsgraph` renders. What a world's nodes do
    `render_world` finds out where they are more than a colour or an environment texture. `convert_image` knows all
    colour spaces. `frame_set` shows other frames in the depsgraph; without it nothing moves.
    Returns descriptions of the other cameras that see the very same scene, by their names."""
    if depsgraph.mode != "RENDER":
        raise ExportError("the scene must be evaluated for rendering; start the export from a render engine")
    scene = depsgraph.scene_eval
    size = options.resolution or film_size(scene.render, options.resolution_percentage)
    camera = _camera_object(depsgraph, options)
    builder.set_camera(camera_json(camera, scene, size))
    frame = scene.frame_current
    watched = WatchedCamera(camera)
    with followed(depsgraph, camera, frame_set) as motion:
        dicing = DicingExporter(depsgraph, watched, size)
        _SceneExporter(builder, depsgraph, watched, render_world, convert_image, motion, frame, dicing).run()
        if moved := motion.camera_json(camera):
            builder.set_camera(camera_json(camera, scene, size, moved))
    if not options.others or watched.is_used or motion.shutter is not None or asks_for_camera():
        return {}
    evaluated = {obj.name: obj for obj in depsgraph.objects if obj.type == "CAMERA" and not obj.hide_render}
    return {name: camera_json(evaluated[name], scene, size) for name in options.others if name in evaluated}


def _camera_object(depsgraph: bpy.types.Depsgraph, options: ExportOptions) -> bpy.types.Object:
    scene = depsgraph.scene
    camera = scene.objects.get(options.camera) if options.camera else scene.camera
    if camera is None or camera.type != "CAMERA":
        cameras = [obj.name for obj in scene.objects if obj.type == "CAMERA"]
        problem = f"camera '{options.camera}' is not in the scene" if options.camera else "no camera is set"
        have = f"its cameras are: {', '.join(cameras)}" if cameras else "add a camera"
        raise ExportError(f"{problem}; {have}")
    return camera.evaluated_get(depsgraph)


class _Shared(NamedTuple):
    """Properties that all instances of an object by another one share: there may be hundreds of thousands."""

    name: str
    materials: list[int]
    settings: dict[str, Any]
    asked: set[str]
    """Names that its materials ask each instance for."""


class _Placed(NamedTuple):
    """Geometry that the builder has."""

    kind: str
    """`mesh`, `curves` or `points`."""
    number: int
    attributes: set[str]
    """Names of attributes that materials can read."""
    material_slot: int = 0
    """Slot of the material of all of it, unless it is a mesh."""
    is_hull: bool = False
    """True for a box around a volume."""


class _SceneExporter:
    """Exports all that one depsgraph holds."""

    def __init__(
        self,
        builder: Any,
        depsgraph: bpy.types.Depsgraph,
        camera: WatchedCamera,
        render_world: RenderWorld,
        convert_image: Convert,
        motion: Motion,
        frame: int,
        dicing: DicingExporter,
    ):
        """Exports what the depsgraph shows and its motion; images are those of the frame."""
        self.builder, self.motion = builder, motion
        self.camera = camera
        self.render_world = render_world
        self.depsgraph = depsgraph
        self.view_layer = depsgraph.view_layer
        size = texture_size(depsgraph.scene)
        self.images = ImageExporter(builder, frame, convert_image, size, self._world_texture, depsgraph)
        self.materials = MaterialExporter(builder, self.images, surroundings_of(depsgraph, camera))
        self.culling = Culling(depsgraph, camera)
        self.linking = LightLinking(receiver_names(depsgraph.scene), builder.warn)
        self.lights = LightExporter(
            lambda light: builder.add_light(json.dumps(light)),
            builder.warn,
            self.linking,
            LampShaders(builder.constant_emission, builder.empty, frame, self.images.size),
        )
        names = asked_attributes()
        self.geometry = GeometryExporter(builder, names, dicing)
        self.curves = CurvesExporter(builder, depsgraph.scene, names)
        self.points = PointsExporter(builder, names)
        self.volumes = VolumeExporter(builder, depsgraph.scene.frame_current)
        self.may_displace = any(material.displacement_method != "BUMP" for material in bpy.data.materials)
        self.given = InstanceAttributes()
        self.not_given: set[int] = set()
        """Uids of objects whose instances have attributes that are not known."""
        self.known: set[tuple[int, str]] = set()
        """Uids of objects that were met, and in which type: nodes may add others to an object's own."""
        self.shared: dict[tuple[int, int, str, int], _Shared] = {}
        """Shared properties of instances, by the uids of an object and of its instancer, and its geometry."""

    def run(self) -> None:
        """Exports instances, lights, camera and world."""
        for instance in self.depsgraph.object_instances:
            obj = instance.object
            uid = obj.original.session_uid
            if obj.type != "LIGHT" and (self.culling.leaves_out(instance) or self.motion.hides(instance)):
                continue
            if instance.show_particles and self.view_layer.use_strand:
                for strands in self.curves.of_particles(obj, self._move(instance)):
                    self._export_strands(instance, strands)
            if not instance.show_self:
                continue
            if self._is_new(uid, obj.type):
                self._warn_about_type(obj)
            if obj.type == "LIGHT":
                self.lights.export(obj, owner_of(instance), instance.matrix_world, self.camera)
            elif obj.type == "VOLUME" or (obj.type == "MESH" and not instance.is_instance and smoke_domain(obj)):
                self._export_volume(instance)
            elif obj.type == "MESH" and self.view_layer.use_solid:  # Such are curves, text and metaballs, too.
                number = self.geometry.mesh_number(obj, self._is_displaced(obj), self._move(instance))
                if number is not None:
                    self._place(instance, _Placed("mesh", number, self.geometry.attributes[number]))
            elif obj.type == "CURVES" and self.view_layer.use_strand:
                for strands in self.curves.of_curves(obj, self._move(instance)):
                    self._export_strands(instance, strands)
            elif obj.type == "POINTCLOUD" and (cloud := self.points.of_cloud(obj, self._move(instance))) is not None:
                self._place(instance, _Placed("points", *cloud))
        for name in sorted(self.motion.regrown):
            words = "particle hair whose number of keys changes while the shutter is open stands still in part"
            self.builder.warn(f"object '{name}': {words}")
        if any(shared.settings["is_shadow_catcher"] for shared in self.shared.values()):
            for name in self.lights.not_on_catchers:
                self.builder.warn(f"light '{name}': it cannot be kept from shadow catchers; it lights them too")
        scene, view_layer = self.depsgraph.scene_eval, self.depsgraph.view_layer_eval
        world = world_of(scene, view_layer)
        volume = self.materials.world_volume(world) if world is not None else None
        space = Space(volume, self.linking.space_number)
        export_world(self.builder, self.images, self._world_texture, scene, view_layer, space)

    def _move(self, instance: bpy.types.DepsgraphObjectInstance) -> Move:
        return partial(self.motion.of_shape, instance)

    def _world_texture(self, world: NodeGraph, name: str) -> int:
        return self.builder.add_texture(name, self.render_world(world), encoding="linear", alpha="none")

    def _export_strands(self, instance: bpy.types.DepsgraphObjectInstance, strands: Strands) -> None:
        self._place(instance, _Placed("curves", strands.number, strands.attributes, strands.material_slot))

    def _export_volume(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        """Grids of a volume, in a box that its material fills."""
        obj = instance.object
        if not self.view_layer.use_volumes:
            return
        is_domain, slots = obj.type != "VOLUME", self._slots(obj)
        velocities = partial(self.motion.of_grids, instance)
        volume = self.volumes.of_domain(obj, slots) if is_domain else self.volumes.of_object(obj, slots, velocities)
        if volume is not None:
            if is_domain and self.motion.shutter is not None and has_velocity(obj):
                words = "motion by its velocities is not supported yet; it moves as a whole"
                self.builder.warn(f"object '{obj.name}': {words}")
            settings = {"grids": volume.grids, "density_factor": density_factor(obj, instance.matrix_world)}
            self._place(instance, _Placed("mesh", volume.mesh, set(), is_hull=True), **settings)

    def _place(self, instance: bpy.types.DepsgraphObjectInstance, placed: _Placed, **volume: Any) -> None:
        obj = instance.object
        owner = owner_of(instance).original
        key = obj.original.session_uid, owner.session_uid, placed.kind, placed.number
        if key not in self.shared:
            self.shared[key] = self._shared(obj, owner, placed)
        shared = self.shared[key]
        asked = shared.asked
        attributes = {"attributes": values_of_instance(instance, asked, self._given)} if asked else {}
        moved = {"motion": keys} if (keys := self.motion.of_instance(instance)) else {}
        self.builder.add_instance(
            shared.name,
            placed.number,
            [tuple(row) for row in instance.matrix_world],
            shared.materials,
            kind=placed.kind,
            random=(instance.random_id & MASK) / MASK if instance.is_instance else random_of_name(shared.name),
            **shared.settings,
            **attributes,
            **moved,
            **volume,
        )

    def _shared(self, obj: bpy.types.Object, owner: bpy.types.Object, placed: _Placed) -> _Shared:
        number = self.materials.number_in_volume if placed.is_hull else self.materials.number
        materials = [number(material, obj.name) for material in self._slots(obj)]
        if placed.kind != "mesh":
            materials = materials[min(placed.material_slot, len(materials) - 1) :][:1]
        if not placed.is_hull:
            self._warn_about_attributes(obj, placed, materials)
            self._warn_about_holes(obj, placed, materials)
        settings = {
            "receiver": self.linking.receiver_number(obj.original, owner),
            "color": tuple(value if isfinite(value) else 0.0 for value in obj.color),
            "pass_index": obj.pass_index,
            "shadow_terminator_offset": shadow_terminator(obj)[0],
            "shadow_terminator_shading": shadow_terminator(obj)[1],
            "visibility": self._visibility(obj, owner),
            "visible_shadow": obj.visible_shadow and owner.visible_shadow,
            "visible_raycast": all(getattr(each, "visible_raycast", True) for each in (obj, owner)),
            "is_shadow_catcher": obj.is_shadow_catcher or owner.is_shadow_catcher,
            **self._links(owner, materials),
            "occlusion_distance": occlusion_distance(obj),
            "is_holdout": owner.is_holdout or owner.holdout_get(view_layer=self.view_layer),
            "visible_volume_scatter": obj.visible_volume_scatter and owner.visible_volume_scatter,
        }
        asked = set().union(*(self.materials.of_objects.get(number, ()) for number in materials))
        return _Shared(obj.name, materials, settings, asked)

    def _given(self, instance: bpy.types.DepsgraphObjectInstance, name: str) -> Rgba | None:
        """An attribute that nodes give an instance."""
        try:
            return self.given.find(instance, name)
        except UnknownInstanceError:
            if (uid := instance.object.original.session_uid) not in self.not_given:
                self.not_given.add(uid)
                words = "attributes that nodes give their instances are not known; those of the instancer are taken"
                self.builder.warn(f"object '{instance.object.name}': {words}")
            return None

    def _slots(self, obj: bpy.types.Object) -> list[bpy.types.Material | None]:
        """Materials of an evaluated object: it has a slot for each of its mesh."""
        override = self.view_layer.material_override
        return [override] if override is not None else [slot.material for slot in obj.material_slots] or [None]

    def _is_displaced(self, obj: bpy.types.Object) -> bool:
        """True if a material of an evaluated object displaces meshes."""
        if not self.may_displace:
            return False
        numbers = (self.materials.number(material, obj.name) for material in self._slots(obj))
        return not self.materials.displacing.isdisjoint(numbers)

    def _visibility(self, obj: bpy.types.Object, owner: bpy.types.Object) -> tuple[bool, bool, bool, bool]:
        """Visibility to camera, diffuse, glossy and transmitted rays: those see it that see its owner too."""
        camera, *others = (
            getattr(obj, f"visible_{ray}") and getattr(owner, f"visible_{ray}")
            for ray in ("camera", "diffuse", "glossy", "transmission")
        )
        return (camera and not owner.indirect_only_get(view_layer=self.view_layer), *others)

    def _is_new(self, uid: int, kind: str) -> bool:
        """True if an object is met in a type for the first time."""
        is_new = (uid, kind) not in self.known
        self.known.add((uid, kind))
        return is_new

    def _warn_about_type(self, obj: bpy.types.Object) -> None:
        warn, name = self.builder.warn, obj.name
        if not getattr(self.view_layer, FILTERS.get(obj.type, ""), True):
            return
        if obj.type in GREASE_PENCIL:
            warn(
                f"object '{name}': Blender draws grease pencil itself, over renders with Relume as render engine alone"
            )
        elif obj.type == "CURVE" and obj.original.type != "CURVE":
            warn(f"object '{name}': curves that its geometry nodes leave without a profile are left out, as by Cycles")

    def _links(self, owner: bpy.types.Object, materials: list[int]) -> dict[str, Any]:
        """Light linking and shadow linking of what shines."""
        if not self.materials.emissive.intersection(materials):
            return {}
        links = self.linking.receivers(owner), self.linking.blockers(owner)
        if links == (None, None):
            return {}
        if self.materials.filled.intersection(materials, self.materials.emissive):
            words = "light linking of volumes that glow is not supported; they shine on everything"
            self.builder.warn(f"object '{owner.name}': {words}")
        return {"links": links}

    def _warn_about_holes(self, obj: bpy.types.Object, placed: _Placed, materials: list[int]) -> None:
        if placed.kind == "mesh" and self.materials.filled.intersection(materials) and is_open(shown_mesh(obj)):
            self.builder.warn(f"object '{obj.name}': its mesh is open; rays that pass the hole miss or keep its volume")

    def _warn_about_attributes(self, obj: bpy.types.Object, placed: _Placed, materials: list[int]) -> None:
        for attributes in (self.materials.attributes[number] for number in materials):
            for name in sorted(attributes.keys() - placed.attributes):
                where = attributes.pop(name)  # Said once for each material.
                problem = f"it has no attribute '{name}'; taken as 0"
                if name == ANY_UV_MAP:
                    problem = (
                        "its mesh has no UV map, and the normal map bends light otherwise than in Cycles; unwrap it"
                    )
                self.builder.warn(f"object '{obj.name}', {where}: {problem}")


def shadow_terminator(obj: bpy.types.Object) -> tuple[float, float]:
    """Offsets of geometry and of shading against the shadows that coarse meshes cast on themselves: the object's since
    Blender 4.5, Cycles' before."""
    if hasattr(obj, "shadow_terminator_shading_offset"):
        return obj.shadow_terminator_geometry_offset, obj.shadow_terminator_shading_offset
    cycles = getattr(obj, "cycles", None)
    return (cycles.shadow_terminator_geometry_offset, cycles.shadow_terminator_offset) if cycles else (0.1, 0.0)


def occlusion_distance(obj: bpy.types.Object) -> float:
    """Reach of the rays that Fast GI cuts where they leave an object; 0 for that of the world."""
    cycles = getattr(obj, "cycles", None)
    return cycles.ao_distance if cycles else 0.0
