"""Grids of volume objects, of volumes that geometry nodes make, and of smoke domains."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from math import sqrt
from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Vector

from ..core.words import listed
from .materials.graph import used_tree
from .motion import Velocities

INFO = ("color", "density", "flame", "temperature")
"""Grids behind the outputs of Volume Info."""
DEFAULT_GRIDS = ("density", "temperature")
"""Grids that Cycles' material for volumes without one asks for."""
SMOKE = {
    "density": ("density_grid", 1, True),
    "color": ("color_grid", 4, True),
    "flame": ("flame_grid", 1, True),
    "temperature": ("temperature_grid", 1, True),
    "heat": ("heat_grid", 1, False),
    "velocity": ("velocity_grid", 3, False),
}
"""Names under which shaders ask for the grids of a smoke domain, each with its property, its numbers a voxel, and True
if noise makes it finer."""

SHIFT = 0.5 if bpy.app.version < (5, 0, 0) else 0.0
"""Voxels by which Cycles shows the values of a file away from their whole numbers, along each axis."""

Materials = Sequence[bpy.types.Material | None]


class Volume(NamedTuple):
    """Parts of a volume in the scene, by their numbers."""

    grids: int
    mesh: int
    """A box around all voxels."""


class VolumeExporter:
    """Exports the grids of each evaluated volume once and remembers their number."""

    def __init__(self, builder: Any, frame: int):
        """Exports to a builder of a scene in a frame."""
        self.builder = builder
        self.frame = frame
        self.known: dict[tuple, Volume | None] = {}
        """By the address of an evaluated volume, and what is asked of it."""

    def of_object(
        self, obj: bpy.types.Object, materials: Materials, velocities: Callable[[], Velocities | None]
    ) -> Volume | None:
        """Grids that the materials of an evaluated volume object ask for; None if nothing of it can be seen.
        `velocities` tells those of its values, once its grids are loaded."""
        obj.data.grids.load()
        moving = velocities()
        wanted, interpolation = grids_wanted(materials), _interpolation(materials)
        key = (obj.data.as_pointer(), tuple(wanted), interpolation, moving)
        if key not in self.known:
            self.known[key] = self._add(obj, wanted, {"interpolation": interpolation, "velocities": moving})
        return self.known[key]

    def of_domain(self, obj: bpy.types.Object, materials: Materials) -> Volume | None:
        """Grids of an evaluated smoke domain in the frame; None if nothing of it can be seen."""
        domain: Any = smoke_domain(obj)
        if not domain.cache_frame_start <= self.frame <= domain.cache_frame_end:
            return None
        found = {name: smoke_grid(domain, name) for name in grids_wanted(materials) if name in SMOKE}
        grids = {name: array for name, array in found.items() if array is not None}
        center, half = Vector(obj.data.texspace_location), Vector(obj.data.texspace_size)
        settings = {"clipping": domain.clipping, "interpolation": _interpolation(materials)}
        try:
            added = self.builder.add_grid_arrays(
                obj.name, grids, tuple(center - half), tuple(center + half), **settings
            )
        except ValueError as error:
            self._leave_out(obj, str(error))
            return None
        return Volume(*added) if added else None

    def _add(self, obj: bpy.types.Object, wanted: list[str], settings: dict[str, Any]) -> Volume | None:
        volume = obj.data
        names = [grid.name for grid in volume.grids]
        if not names:
            if volume.grids.error_message:  # No grids are in order where a sequence has no file for the frame.
                self._leave_out(obj, f"its file cannot be read ({volume.grids.error_message}); choose another")
            return None
        if not set(names).intersection(wanted):
            asked = f"grids {listed(wanted)}" if wanted else "no grid"
            self._leave_out(obj, f"its material asks for {asked}, and it has {listed(names)}")
            return None
        try:
            added = self._add_saved(obj, wanted, settings)
        except (OSError, ValueError) as error:
            self._leave_out(obj, f"its grids cannot be read ({error})")
            return None
        if added is None and volume.filepath:
            self._leave_out(obj, "no voxel of its file is active and above its clipping")
        return Volume(*added) if added else None

    def _add_saved(self, obj: bpy.types.Object, wanted: list[str], settings: dict[str, Any]) -> tuple[int, int] | None:
        """Blender gives voxels to files alone."""
        with tempfile.TemporaryDirectory(prefix="relume-") as folder:
            path = os.path.join(folder, "grids.vdb")
            if not obj.data.grids.save(path):
                raise OSError("the folder for temporary files does not take them; make room there")
            clipping = obj.data.render.clipping
            return self.builder.add_grid_file(obj.name, path, wanted, clipping=clipping, shift=SHIFT, **settings)

    def _leave_out(self, obj: bpy.types.Object, reason: str) -> None:
        self.builder.warn(f"object '{obj.name}': {reason}; left out")


def smoke_domain(obj: bpy.types.Object) -> bpy.types.FluidDomainSettings | None:
    """Settings of the smoke that fills an object; None if it is no smoke domain."""
    for modifier in obj.modifiers:
        if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN" and modifier.show_render:
            settings = modifier.domain_settings
            return settings if settings and settings.domain_type == "GAS" else None
    return None


def smoke_grid(domain: Any, name: str) -> np.ndarray | None:
    """A grid of a smoke domain, [z, y, x] or [z, y, x, numbers]; None if it has none of that name, or no simulation."""
    source, numbers, is_fine = SMOKE[name]
    scale = domain.noise_scale if is_fine and domain.use_noise else 1
    x, y, z = (size * scale for size in domain.domain_resolution)
    values = getattr(domain, source)
    if not len(values) or len(values) != x * y * z * numbers:
        return None
    array = np.empty(len(values), np.float32)
    values.foreach_get(array)
    return array.reshape((z, y, x, numbers) if numbers > 1 else (z, y, x))


def has_velocity(obj: bpy.types.Object) -> bool:
    """True if a smoke domain has velocities, by which Cycles blurs it."""
    domain: Any = smoke_domain(obj)
    return len(domain.velocity_grid) > 0


def density_factor(obj: bpy.types.Object, matrix: Any) -> float:
    """Factor on the density of a volume that is placed by a matrix: Blender means it by metre of the object, or of the
    world."""
    if obj.type != "VOLUME" or obj.data.render.space != "OBJECT":
        return 1.0
    length = (matrix.to_3x3() @ Vector((1.0, 1.0, 1.0))).length / sqrt(3.0)
    return 1.0 / length if length > 0.0 else 0.0


def grids_wanted(materials: Materials) -> list[str]:
    """Names of the grids that materials ask volumes for."""
    found: set[str] = set()
    for material in materials:
        tree = used_tree(material) if material else None
        found.update(_asked(tree) if tree else DEFAULT_GRIDS if material is None else ())
    return sorted(found - {""})


def _asked(tree: bpy.types.NodeTree) -> Iterator[str]:
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeVolumeInfo":
            yield from INFO
        elif node.bl_idname == "ShaderNodeAttribute":
            yield node.attribute_name
        elif node.bl_idname == "ShaderNodeVolumePrincipled":
            sockets = ("Density Attribute", "Color Attribute", "Temperature Attribute")
            yield from (node.inputs[name].default_value for name in sockets)
        elif (group := getattr(node, "node_tree", None)) is not None:
            yield from _asked(group)


def _interpolation(materials: Materials) -> str:
    """Values between voxels; cubic if a material asks for it."""
    settings = [material.cycles for material in materials if material and getattr(material, "cycles", None)]
    return "cubic" if any(each.volume_interpolation == "CUBIC" for each in settings) else "linear"
