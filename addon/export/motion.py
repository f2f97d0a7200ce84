"""Motion within the time that the shutter is open: transforms and shapes at keys, found by showing the frames between,
as Cycles finds them (`blender/sync.cpp`, `blender/object.cpp`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from math import floor
from typing import Any, NamedTuple

import bpy
import numpy as np

from .arrays import stored
from .curves import curves_arrays, hair_of, particle_arrays, places_of_curves
from .dicing import adaptive_modifier, cage_of
from .geometry import shown_mesh
from .points import places_of_points, points_arrays

FrameSet = Callable[[int, float], None]
"""Shows a frame, and a part of the way to the next one, in the depsgraph that is read."""
Rows = list[tuple[float, ...]]

TICKS = 128
"""Steps of the shutter's interval. Keys of all objects lie on them: Cycles takes 129 at most."""
CENTER = TICKS // 2
CURVE_STEPS = 256
"""Steps in which the shutter curve is read, as by Cycles."""
ORTHOGRAPHIC_MOVES = (5, 2, 0)
"""Version from which on orthographic cameras blur what they pass."""
VELOCITY = "velocity"


@dataclass(frozen=True)
class Shutter:
    """When a scene's camera sees."""

    center: float
    """Frame in the middle of the interval."""
    duration: float
    """Frames that it lasts."""
    frame_seconds: float
    """Seconds of a frame."""
    curve: list[float]
    """How far it is open, at equally spaced times."""
    still: float
    """Time in 0..1 of the interval at which the frame's volumes have not moved yet, as Cycles counts by the setting."""
    rolling: float | None
    """Share of the interval in which a line is exposed, where they follow each other."""

    def frame_at(self, tick: int) -> float:
        """Frame at a step of the interval."""
        return self.center + (tick / TICKS - 0.5) * self.duration

    def as_json(self) -> dict[str, Any]:
        """The form that the native module takes."""
        return {"curve": self.curve} | ({} if self.rolling is None else {"rolling": self.rolling})


def shutter_of(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> Shutter | None:
    """The shutter of a scene's camera; None without motion blur."""
    render = scene.render
    if not (render.use_motion_blur and layer.use_motion_blur):
        return None
    duration = render.motion_blur_shutter
    shift, still = {"START": (0.5, 0.0), "END": (-0.5, duration - 1.0)}.get(render.motion_blur_position, (0.0, 0.5))
    mapping = render.motion_blur_shutter_curve
    mapping.initialize()
    times = [step / (CURVE_STEPS - 1) for step in range(CURVE_STEPS)]
    curve = [abs(mapping.evaluate(mapping.curves[0], time)) for time in times]
    cycles: Any = getattr(scene, "cycles", None)
    rolls = cycles is not None and cycles.rolling_shutter_type == "TOP"
    return Shutter(
        center=scene.frame_current + scene.frame_subframe + shift * duration,
        duration=duration,
        frame_seconds=render.fps_base / render.fps,
        curve=curve if any(curve) else [1.0],
        still=still,
        rolling=cycles.rolling_shutter_duration if rolls else None,
    )


class Settings(NamedTuple):
    """How the motion of an object is followed."""

    keys: int
    """Number of its keys; 0 if it stands still."""
    deforms: bool
    """True if its shape is followed, too."""

    def ticks(self) -> list[int]:
        """Steps of the interval on which its keys are."""
        return [step * TICKS // (self.keys - 1) for step in range(self.keys)]

    def others(self) -> set[int]:
        """Those steps but for the middle."""
        return set(self.ticks()) - {CENTER}


def settings_of(obj: bpy.types.Object, owner: bpy.types.Object) -> Settings:
    """Settings of an object, shown by an owner: both allow motion, and the one with more steps counts."""
    found = [cycles for each in dict.fromkeys((obj.original, owner.original)) if (cycles := _cycles(each)) is not None]
    if not all(cycles.use_motion_blur for cycles in found):
        return Settings(0, False)
    steps = max((1, *(cycles.motion_steps for cycles in found)))
    return Settings(min(2**steps, TICKS) + 1, all(cycles.use_deform_motion for cycles in found))


def motion_settings(obj: bpy.types.Object) -> tuple[bool, int, bool] | None:
    """Settings of an object's motion: blurred or not, steps, and if its shape is; None where they are Blender's."""
    cycles = _cycles(obj)
    if cycles is None:
        return None
    found = cycles.use_motion_blur, cycles.motion_steps, cycles.use_deform_motion
    return found if found != (True, 1, True) else None


def _cycles(obj: bpy.types.Object) -> Any:
    return getattr(obj, "cycles", None)


def owner_of(instance: bpy.types.DepsgraphObjectInstance) -> bpy.types.Object:
    """Object that makes the instance, or the object itself."""
    return instance.parent if instance.is_instance and instance.parent else instance.object


Key = tuple[Any, ...]
"""Identity of an instance, the same in each frame."""


def key_of(instance: bpy.types.DepsgraphObjectInstance) -> Key:
    """Key of an instance."""
    obj = instance.object
    path = tuple(instance.persistent_id) if instance.is_instance else ()
    return obj.original.session_uid, obj.type, owner_of(instance).original.session_uid, path


Velocities = tuple[tuple[str, ...], float, float]
"""Names of grids of velocities, one or three for the axes; the way for a velocity of 1 while the shutter is open; and
the time at which values are where the grids have them."""


def velocity_grids(volume: bpy.types.Volume) -> tuple[str, ...]:
    """Names of the grids of velocities that a volume has: one, or three for the axes."""
    present = {grid.name for grid in volume.grids}
    if volume.velocity_grid in present:
        return (volume.velocity_grid,)
    names = volume.velocity_x_grid, volume.velocity_y_grid, volume.velocity_z_grid
    return names if present.issuperset(names) else ()


@dataclass
class Motion:
    """Transforms and shapes at keys. Without motion blur it knows of none."""

    shutter: Shutter | None = None
    settings: dict[Key, Settings] = field(default_factory=dict)
    """Settings of what may move."""
    matrices: dict[Key, dict[int, Rows]] = field(default_factory=dict)
    shapes: dict[tuple[Key, str], dict[int, np.ndarray]] = field(default_factory=dict)
    """Positions, with radii of strands and points, by instance and part: a particle system's name."""
    camera: dict[int, Rows] = field(default_factory=dict)
    lenses: dict[int, float] = field(default_factory=dict)
    is_used: bool = False
    """True once something moves."""
    regrown: set[str] = field(default_factory=set)
    """Names of objects whose particle hair has other keys elsewhere in the shutter's interval."""

    def hides(self, instance: bpy.types.DepsgraphObjectInstance) -> bool:
        """True for what a particle shows that does not live through all keys: Cycles leaves it out."""
        key = key_of(instance)
        settings = self.settings.get(key)
        if settings is None or not instance.is_instance or instance.particle_system is None:
            return False
        return not self.matrices.get(key, {}).keys() >= settings.others()

    def of_instance(self, instance: bpy.types.DepsgraphObjectInstance) -> list[Rows]:
        """Matrices of an instance at its keys; none if it stands still."""
        key = key_of(instance)
        found = self.matrices.get(key)
        if not found:
            return []
        now = rows(instance.matrix_world)
        keys = [now if tick == CENTER else found.get(tick, now) for tick in self.settings[key].ticks()]
        return self._used(keys) if any(rows != now for rows in keys) else []

    def of_grids(self, instance: bpy.types.DepsgraphObjectInstance) -> Velocities | None:
        """Velocities of a volume object, whose grids are loaded; None if its values stand still."""
        volume = instance.object.data
        names, scale = velocity_grids(volume), volume.velocity_scale
        if self.shutter is None or not names or scale == 0.0:
            return None
        if volume.velocity_unit == "SECOND":
            if not settings_of(instance.object, owner_of(instance)).keys:
                return None
            scale *= self.shutter.duration * self.shutter.frame_seconds
        self.is_used = True
        return names, scale, self.shutter.still

    def of_shape(
        self,
        instance: bpy.types.DepsgraphObjectInstance,
        now: np.ndarray,
        attributes: Any,
        part: str = "",
    ) -> dict[str, np.ndarray]:
        """The argument for a builder that tells the places at keys of elements that are at `now`; empty if they keep
        their places. An attribute of velocities comes first. Keys with other elements are left out."""
        key = key_of(instance)
        settings = self.settings.get(key)
        if self.shutter is None or settings is None or not settings.deforms or not np.isfinite(now).all():
            return {}
        velocity = attributes.get(VELOCITY) if attributes is not None else None
        if velocity is not None and (velocity.data_type, velocity.domain) == ("FLOAT_VECTOR", "POINT"):
            way = np.zeros_like(now)
            way[:, :3] = stored(velocity.data, np.float32, 3)
            way *= 0.5 * self.shutter.duration * self.shutter.frame_seconds
            places = [now - way, now, now + way] if way.any() and np.isfinite(way).all() else []
        else:
            found = self.shapes.get((key, part), {})
            places = [found.get(tick, now) if tick != CENTER else now for tick in settings.ticks()] if found else []
            if part and any(tick not in found or found[tick].shape != now.shape for tick in settings.others()):
                self.regrown.add(instance.object.name)
            places = [place if _fits(place, now) else now for place in places]
        if all(np.array_equal(place, now) for place in places):
            return {}
        return {"motion": self._used(np.stack(places).astype(np.float32))}

    def _used(self, keys: Any) -> Any:
        self.is_used = True
        return keys

    def camera_json(self, camera: bpy.types.Object) -> dict[str, Any]:
        """Fields of motion in the description of a camera, once everything was read."""
        if self.shutter is None:
            return {}
        now = rows(camera.matrix_world)
        found = self.camera | {CENTER: now}
        ticks = settings_of(camera, camera).ticks() if len(found) > 1 else []
        keys = [found.get(tick, now) for tick in ticks]
        keys = self._used(keys) if any(rows != now for rows in keys) else []
        lens = _lens(camera.data)
        lenses = [self.lenses.get(tick, lens) for tick in (0, TICKS)]
        zooms = any(other != lens for other in lenses)
        zoom = self._used([camera.data.lens * other / lens for other in lenses]) if zooms else None
        return {"motion": keys, "zoom": zoom, "shutter": self.shutter.as_json()} if self.is_used else {}


def rows(matrix: Any) -> Rows:
    """Rows of a matrix."""
    return [tuple(row) for row in matrix]


def _fits(place: np.ndarray, now: np.ndarray) -> bool:
    return place.shape == now.shape and bool(np.isfinite(place).all())


def _lens(data: bpy.types.Camera) -> float:
    """Focal length of a sensor of one millimetre."""
    return data.lens / (data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width)


@contextmanager
def followed(depsgraph: bpy.types.Depsgraph, camera: bpy.types.Object, frame_set: FrameSet | None) -> Iterator[Motion]:
    """Motion of all that a depsgraph renders. Within the context the depsgraph shows the middle of the shutter's
    interval, and after it the frame that it showed before."""
    scene = depsgraph.scene
    shutter = shutter_of(scene, depsgraph.view_layer) if frame_set is not None else None
    if frame_set is None or shutter is None:
        yield Motion()
        return
    before = scene.frame_current, scene.frame_subframe

    def show(frame: float) -> None:
        frame_set(floor(frame), frame - floor(frame))

    try:
        if shutter.center != before[0] + before[1]:
            show(shutter.center)
        motion = Motion(shutter)
        reader = _Reader(depsgraph, camera, motion)
        ticks = reader.find_settings()
        for tick in sorted(ticks - {CENTER}):
            show(shutter.frame_at(tick))
            reader.read(tick)
        if ticks:
            show(shutter.center)
        yield motion
    finally:
        frame_set(*before)


class _Reader:
    """Reads what is at each key."""

    def __init__(self, depsgraph: bpy.types.Depsgraph, camera: bpy.types.Object, motion: Motion):
        self.depsgraph, self.camera, self.motion = depsgraph, camera, motion
        self.deforming: dict[int, bool] = {}
        """True for each object whose shape may change, by uid."""

    def find_settings(self) -> set[int]:
        """Finds what may move, and returns the steps at which anything has a key."""
        of_camera = settings_of(self.camera, self.camera)
        ticks = set(of_camera.ticks())
        for instance in self.depsgraph.object_instances:
            obj = instance.object
            if obj.type not in {"MESH", "CURVES", "POINTCLOUD", "VOLUME"}:
                continue
            settings = settings_of(obj, owner_of(instance))
            if settings.keys:
                self.motion.settings[key_of(instance)] = settings
                ticks.update(settings.ticks())
        return ticks

    def read(self, tick: int) -> None:
        """Reads all that has a key at a step."""
        camera = self.camera.original.evaluated_get(self.depsgraph)
        if tick in settings_of(camera, camera).ticks() and _camera_moves(camera.data):
            self.motion.camera[tick] = rows(camera.matrix_world)
        if camera.data.type == "PERSP":
            self.motion.lenses[tick] = _lens(camera.data)
        known: dict[tuple[int, str], np.ndarray | None] = {}
        for instance in self.depsgraph.object_instances:
            key = key_of(instance)
            settings = self.motion.settings.get(key)
            if settings is None or tick * (settings.keys - 1) % TICKS:
                continue
            self.motion.matrices.setdefault(key, {})[tick] = rows(instance.matrix_world)
            if settings.deforms:
                for part, places in self._shapes(instance, known):
                    self.motion.shapes.setdefault((key, part), {})[tick] = places

    def _shapes(
        self, instance: bpy.types.DepsgraphObjectInstance, known: dict[tuple[int, str], np.ndarray | None]
    ) -> Iterator[tuple[str, np.ndarray]]:
        obj = instance.object
        address = obj.data.as_pointer()
        parts: dict[str, Callable[[], np.ndarray | None]] = {}
        if obj.type == "CURVES":
            parts[""] = lambda: places_of_curves(curves_arrays(obj.data)) if len(obj.data.points) else None
        elif obj.type == "POINTCLOUD":
            parts[""] = lambda: places_of_points(points_arrays(obj.data)) if len(obj.data.points) else None
        elif obj.type == "MESH" and self._may_deform(instance):
            parts[""] = lambda: self._places(obj)
        if instance.show_particles and obj.type == "MESH":
            for modifier in hair_of(obj):
                parts[modifier.particle_system.name] = partial(places_of_hair, obj, modifier)
        for part, take in parts.items():
            if (address, part) not in known:
                known[address, part] = take()
            if (places := known[address, part]) is not None:
                yield part, places

    def _places(self, obj: bpy.types.Object) -> np.ndarray:
        modifier = adaptive_modifier(obj, self.depsgraph.scene)
        with cage_of(obj, self.depsgraph) if modifier else nullcontext(shown_mesh(obj)) as mesh:
            return stored(mesh.attributes["position"].data, np.float32, 3).copy()

    def _may_deform(self, instance: bpy.types.DepsgraphObjectInstance) -> bool:
        shown = instance.instance_object if instance.is_instance else instance.object
        if shown is None or shown.data != instance.object.data:
            return True  # Nodes made it: modifiers do not tell.
        uid = shown.original.session_uid
        if uid not in self.deforming:
            self.deforming[uid] = shown.original.is_deform_modified(self.depsgraph.scene, "RENDER")
        return self.deforming[uid]


def _camera_moves(data: bpy.types.Camera) -> bool:
    return data.type != "ORTHO" or bpy.app.version >= ORTHOGRAPHIC_MOVES


def places_of_hair(obj: bpy.types.Object, modifier: bpy.types.ParticleSystemModifier) -> np.ndarray | None:
    """Keys and radii of the paths of a particle system; None without any."""
    arrays = particle_arrays(obj, modifier)
    return places_of_curves(arrays) if arrays is not None else None
