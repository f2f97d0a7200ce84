"""Hair curves: objects of type CURVES, which geometry nodes make too, and the paths of particle systems."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import Any, NamedTuple

import bpy
import numpy as np

from .arrays import stored
from .attributes import attribute_colors
from .materials import FACTOR
from .materials.hair import asks_for_normals

DEFAULT_RADIUS = 0.005
"""Radius of keys of curves that have none, metres."""
POLY = 1
SHAPES = {"RIBBONS": "ribbon", "THICK": "round", "THICK_LINEAR": "linear"}
"""Shapes of the tracer by Cycles' names. What they look like is the same in all versions."""
SUBDIVISIONS = 2
"""Cycles' default of `cycles_curves.subdivisions`."""
MOST_SUBDIVISIONS = 4
MANY_KEYS = 2_000_000
"""Keys of particle hair from which their reading is slow: Blender tells the place of each alone."""


Move = Callable[..., dict[str, np.ndarray]]
"""Finds the motion of elements by their places now, their attributes and the name of their part, as an argument for a
builder."""


class Strands(NamedTuple):
    """Curves that were exported."""

    number: int
    material_slot: int
    attributes: set[str]
    """Names of attributes that materials can read."""


class CurvesExporter:
    """Exports each hair geometry once and remembers its number."""

    def __init__(self, builder: Any, scene: bpy.types.Scene, attribute_names: Collection[str]):
        self.builder = builder
        self.attribute_names = attribute_names
        self.shape = strand_shape(scene)
        self.has_normals = asks_for_normals()
        self.known: dict[Any, list[Strands]] = {}
        """Exported parts, by the addresses of evaluated curves or the evaluated object."""

    def of_curves(self, obj: bpy.types.Object, move: Move) -> list[Strands]:
        """The strands of an evaluated object of type CURVES; none if there is nothing to see."""
        key = obj.data.as_pointer()
        if key not in self.known:
            self.known[key] = self._add_curves(obj, move)
        return self.known[key]

    def of_particles(self, obj: bpy.types.Object, move: Move) -> list[Strands]:
        """The strands of the particle systems of an evaluated object, each system's by itself."""
        key = obj.as_pointer(), "particles"
        if key not in self.known:
            self.known[key] = []
            hair = [modifier for modifier in obj.modifiers if is_rendered_hair(modifier)]
            if hair and not hair_of(obj):
                advice = "go to Object Mode, and bake again"
                self.builder.warn(
                    f"object '{obj.name}': its particle hair is left out while it is edited, as by Cycles; {advice}"
                )
                return []
            first_number = 0
            for modifier in hair:
                if len(modifier.particle_system.particles) > 0:
                    arrays = particle_arrays(obj, modifier, self.attribute_names)
                    if arrays is not None:
                        self._say_slow(obj, modifier, len(arrays["keys"]))
                        slot = modifier.particle_system.settings.material - 1
                        part = partial(move, attributes=None, part=modifier.particle_system.name)
                        self.known[key] += self._add(obj, arrays | {"first_number": first_number}, slot, part)
                        first_number += len(arrays["first_keys"]) - 1
        return self.known[key]

    def _say_slow(self, obj: bpy.types.Object, modifier: Any, keys: int) -> None:
        if keys >= MANY_KEYS:
            name = modifier.particle_system.name
            problem = f"particle system '{name}' has {keys} keys, which Blender tells one by one: slow to read"
            self.builder.warn(f"object '{obj.name}': {problem} (convert it to hair curves)")

    def _add_curves(self, obj: bpy.types.Object, move: Move) -> list[Strands]:
        curves = obj.data
        if len(curves.points) == 0:
            return []
        arrays = curves_arrays(curves, self.attribute_names)
        if self.has_normals:
            # One by one: `foreach_get` reads an array that Blender frees before.
            arrays["normals"] = np.array([normal.vector[:] for normal in curves.normals], np.float32)
        # From Blender 5.0 on.
        is_linear = bpy.app.version >= (5, 0) and _is_poly(curves)
        part = partial(move, attributes=curves.attributes)
        return self._add(obj, arrays | ({"shape": "linear"} if is_linear else {}), 0, part)

    def _add(self, obj: bpy.types.Object, arrays: dict[str, Any], slot: int, move: Move) -> list[Strands]:
        self._mend(obj, arrays)
        try:
            number = self.builder.add_curves(obj.name, **(self.shape | arrays), **move(places_of_curves(arrays)))
        except ValueError as error:
            self.builder.warn(f"object '{obj.name}': {error}; its hair is left out")
            return []
        names = (*arrays["key_attributes"], *arrays["curve_attributes"], *arrays["uv_maps"])
        return [Strands(number, slot, {name.removesuffix(FACTOR) for name in names})]

    def _mend(self, obj: bpy.types.Object, arrays: dict[str, Any]) -> None:
        """Takes the thickness from strands with keys that are not finite, and says so once."""
        keys, radii, first_keys = arrays["keys"], arrays["radii"], arrays["first_keys"]
        bad = ~(np.isfinite(keys).all(axis=1) & np.isfinite(radii))
        if bad.any():
            curve_of = np.repeat(np.arange(len(first_keys) - 1), np.diff(first_keys))
            broken = np.zeros(len(first_keys) - 1, bool)
            broken[curve_of[bad]] = True
            lost = broken[curve_of]
            keys[lost], radii[lost] = 0.0, 0.0
            self.builder.warn(f"object '{obj.name}': {broken.sum()} strands with keys that are no numbers are left out")
        np.maximum(radii, 0.0, out=radii)
        if not radii.any():
            self.builder.warn(f"object '{obj.name}': its hair has no thickness and cannot be seen; set its radius")


def strand_shape(scene: bpy.types.Scene) -> dict[str, Any]:
    """Shape of a scene's strands; Cycles' defaults where it is not enabled. Only ribbons are subdivided."""
    settings = getattr(scene, "cycles_curves", None)
    shape = SHAPES.get(getattr(settings, "shape", "RIBBONS"), "ribbon")
    subdivisions = min(getattr(settings, "subdivisions", SUBDIVISIONS), MOST_SUBDIVISIONS)
    return {"shape": shape, "subdivisions": subdivisions} if shape == "ribbon" else {"shape": shape}


def hides_hair(obj: bpy.types.Object) -> bool:
    """True if an object is in a mode in which Blender evaluates no particle hair, not even for renders."""
    return obj.mode in {"EDIT", "PARTICLE_EDIT"}


def hair_of(obj: bpy.types.Object) -> list[bpy.types.ParticleSystemModifier]:
    """Particle systems of an object whose paths Cycles renders."""
    return [] if hides_hair(obj) else [modifier for modifier in obj.modifiers if is_rendered_hair(modifier)]


def places_of_curves(arrays: dict[str, Any]) -> np.ndarray:
    """Keys and radii of strands, [K, 4]."""
    return np.column_stack([arrays["keys"], np.maximum(arrays["radii"], 0.0)])


def is_rendered_hair(modifier: bpy.types.Modifier) -> bool:
    """True if a modifier is a particle system whose paths Cycles renders."""
    if modifier.type != "PARTICLE_SYSTEM" or not modifier.show_render:
        return False
    settings = modifier.particle_system.settings
    return settings.type == "HAIR" and settings.render_type == "PATH"


def curves_arrays(curves: bpy.types.Curves, attribute_names: Collection[str] = ()) -> dict[str, Any]:
    """The arrays that `SceneBuilder.add_curves` takes. Control points are the keys, whatever the type of the curves."""
    attributes = curves.attributes
    keys = stored(attributes["position"].data, np.float32, 3).copy()
    radius = attributes.get("radius")
    if radius is not None and radius.data_type == "FLOAT" and radius.domain == "POINT":
        radii = stored(radius.data, np.float32).copy()
    else:
        radii = np.full(len(keys), DEFAULT_RADIUS, np.float32)
    arrays: dict[str, Any] = {
        "keys": keys,
        "radii": radii,
        "first_keys": stored(curves.curve_offset_data, np.int32).copy(),
        "uv_maps": {},
        "key_attributes": {},
        "curve_attributes": {},
    }
    for attribute in attributes:
        if attribute.data_type == "FLOAT2" and attribute.domain == "CURVE":
            arrays["uv_maps"][attribute.name] = stored(attribute.data, np.float32, 2).copy()
    for name in sorted(attribute_names):
        attribute = attributes.get(name.removesuffix(FACTOR))
        colors = None if attribute is None or name in arrays["uv_maps"] else attribute_colors(attribute, name)
        if attribute is not None and colors is not None:
            arrays["curve_attributes" if attribute.domain == "CURVE" else "key_attributes"][name] = colors
    return arrays


def _is_poly(curves: bpy.types.Curves) -> bool:
    """True if the first curve goes straight from point to point."""
    attribute = curves.attributes.get("curve_type")
    return attribute is not None and len(attribute.data) > 0 and attribute.data[0].value == POLY


def particle_arrays(
    obj: bpy.types.Object, modifier: bpy.types.ParticleSystemModifier, attribute_names: Collection[str] = ()
) -> dict[str, Any] | None:
    """The arrays of the paths of a particle system, of children where it has some; None without any. Each key is asked
    for alone: some microseconds each, so a million keys take some seconds. Only a render's depsgraph knows all keys."""
    system, settings = modifier.particle_system, modifier.particle_system.settings
    parents, children = len(system.particles), len(system.child_particles)
    has_children = settings.child_type != "NONE" and children > 0
    first = parents if has_children else 0
    numbers = range(first, parents + (children if has_children else 0))
    steps = 2**settings.render_step + 1 + (settings.kink_extra_steps if settings.kink == "SPIRAL" else 0)
    keys = np.array([system.co_hair(obj, particle_no=n, step=k) for n in numbers for k in range(steps)], np.float32)
    keys = _in_object(keys, obj).reshape(-1, steps, 3)
    lengths = np.zeros(keys.shape[:2])
    lengths[:, 1:] = np.linalg.norm(np.diff(keys, axis=1), axis=2).cumsum(axis=1)
    total = lengths[:, -1]
    shown = total != 0.0
    if not shown.any():
        return None
    keys = keys[shown]
    share = lengths[shown] / total[shown, None]
    radii = radius_along(share, settings)
    if settings.use_close_tip:
        radii[:, -1] = 0.0
    emitted = _on_emitter(obj, modifier, np.flatnonzero(shown) + first, attribute_names)
    return {
        "keys": keys.reshape(-1, 3),
        "radii": radii.reshape(-1).astype(np.float32),
        "first_keys": np.arange(0, keys.shape[0] * steps + 1, steps, dtype=np.int32),
        "generated": _generated(keys[:, 0], obj.data),
        "key_attributes": {},
    } | emitted


def radius_along(share: np.ndarray, settings: bpy.types.ParticleSettings) -> np.ndarray:
    """Radius at shares of the length from root to tip, metres."""
    shape = settings.shape
    power = 1.0 + shape if shape < 0.0 else 1.0 / (1.0 - shape) if shape < 1.0 else np.inf
    root, tip = (0.5 * settings.radius_scale * radius for radius in (settings.root_radius, settings.tip_radius))
    return (1.0 - share) ** power * (root - tip) + tip


def _in_object(world: np.ndarray, obj: bpy.types.Object) -> np.ndarray:
    matrix = np.array(obj.matrix_world.inverted_safe())
    return (world @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)


def _generated(roots: np.ndarray, mesh: bpy.types.Mesh) -> np.ndarray:
    """Places of roots in the texture space of the emitter, in 0..1."""
    center, half = np.array(mesh.texspace_location), np.array(mesh.texspace_size)
    half = np.where(half == 0.0, 1.0, half)
    return ((roots - center) / (2.0 * half) + 0.5).astype(np.float32)


def _on_emitter(
    obj: bpy.types.Object, modifier: Any, numbers: np.ndarray, attribute_names: Collection[str]
) -> dict[str, Any]:
    """UV maps and the colours that materials ask for, at the roots of strands."""
    system, mesh = modifier.particle_system, obj.data
    last = len(system.particles) - 1
    roots = [(system.particles[min(int(n), last)], int(n)) for n in numbers]
    layers = sorted(enumerate(mesh.uv_layers), key=lambda entry: not entry[1].active_render)
    uv_maps = {
        layer.name: np.array([system.uv_on_emitter(modifier, particle=p, particle_no=n, uv_no=k) for p, n in roots])
        for k, layer in layers
    }
    colors = {}
    for k, layer in enumerate(mesh.vertex_colors):
        if layer.name in attribute_names:
            found = [system.mcol_on_emitter(modifier, particle=p, particle_no=n, vcol_no=k) for p, n in roots]
            colors[layer.name] = _linear(np.array(found))
    return {
        "uv_maps": {name: np.ascontiguousarray(coords, np.float32) for name, coords in uv_maps.items()},
        "curve_attributes": colors,
    }


def _linear(srgb: np.ndarray) -> np.ndarray:
    """Scene-linear RGBA of colours in sRGB."""
    linear = np.where(srgb < 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.column_stack((linear, np.ones(len(linear)))).astype(np.float32)
