"""Data passes of a final render, of which no light changes anything: positions, UV, pass indices, Cryptomatte."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ..native import native

POSITION, TEXTURE_COORDINATES, VECTOR = "Position", "UV", "Vector"
OBJECT_INDEX, MATERIAL_INDEX = (
    ("IndexOB", "IndexMA") if bpy.app.version < (5, 0, 0) else ("Object Index", "Material Index")
)
MATTES = {"CryptoObject": "objects", "CryptoMaterial": "materials", "CryptoAsset": "assets"}
"""Mattes by their names in Blender, and what the native module calls them."""
SAMPLES = 64
"""Most camera rays per pixel: shares of a pixel need no more."""
DEFAULT_RANKS, MOST_RANKS = 6, 16


@dataclass(frozen=True)
class DataPassSettings:
    """Data passes that a render has."""

    position: bool = False
    uv: bool = False
    vector: bool = False
    """The way of what a pixel shows since the frame before and to the one after."""
    object_index: bool = False
    material_index: bool = False
    mattes: tuple[str, ...] = ()
    """Names out of `MATTES`."""
    ranks: int = DEFAULT_RANKS
    """Objects or materials that a matte tells apart in a pixel; an even number."""
    alpha_threshold: float = 0.5
    """Positions and indices are those of the first surface whose alpha reaches it."""

    @classmethod
    def of(cls, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> DataPassSettings:
        """Those that the artist has chosen for a view layer of a scene."""
        wanted = (
            layer.use_pass_cryptomatte_object,
            layer.use_pass_cryptomatte_material,
            layer.use_pass_cryptomatte_asset,
        )
        return cls(
            position=layer.use_pass_position,
            uv=layer.use_pass_uv,
            vector=layer.use_pass_vector and not why_no_vector(scene),
            object_index=layer.use_pass_object_index,
            material_index=layer.use_pass_material_index,
            mattes=tuple(name for name, is_wanted in zip(MATTES, wanted, strict=True) if is_wanted),
            alpha_threshold=layer.pass_alpha_threshold,
            ranks=2 * ((min(MOST_RANKS, layer.pass_cryptomatte_depth) + 1) // 2),
        )

    def __bool__(self) -> bool:
        return any((self.position, self.uv, self.vector, self.object_index, self.material_index, self.mattes))

    def declare(self) -> list[tuple[str, int, str, str]]:
        """Name, channels, their letters and Blender's type of each pass."""
        channels = [(POSITION, 3, "XYZ", "VECTOR")] * self.position
        channels += [(TEXTURE_COORDINATES, 3, "UVA", "VECTOR")] * self.uv
        channels += [(VECTOR, 4, "XYZW", "VECTOR")] * self.vector
        channels += [(OBJECT_INDEX, 1, "X", "VALUE")] * self.object_index
        channels += [(MATERIAL_INDEX, 1, "X", "VALUE")] * self.material_index
        channels += [(name, 4, "rgba", "COLOR") for matte in self.mattes for name in self._levels(matte)]
        return channels

    def trace(
        self,
        exported: Any,
        settings: str,
        samples: int,
        assets: dict[str, str],
        frames: tuple[Any, Any] | None = None,
        relighter: Any = None,
    ) -> Any:
        """Native passes of a scene, whose job is running. The assets are those of objects by their names; the frames
        the scene at the frame before and at the one after, for vectors. A relighter of the scene lends what it has
        prepared."""
        is_mean = self.mattes or self.uv or self.vector  # All else is of the first ray.
        samples = min(samples, SAMPLES) if is_mean else 1
        wanted = {"ranks": self.ranks, "alpha_threshold": self.alpha_threshold, "assets": assets, "frames": frames}
        wanted["relighter"] = relighter
        return native().DataPasses(exported, settings, samples=samples, **wanted)

    def layers(self, pictures: dict[str, Any]) -> dict[str, np.ndarray]:
        """Passes by their names in Blender, of those that the native module has traced."""
        layers = {
            POSITION: pictures["position"],
            TEXTURE_COORDINATES: pictures["uv"],
            VECTOR: pictures["vector"],
            OBJECT_INDEX: pictures["object_index"],
            MATERIAL_INDEX: pictures["material_index"],
        }
        for matte in self.mattes:
            for level, name in enumerate(self._levels(matte)):
                layers[name] = pictures[MATTES[matte]][..., 4 * level : 4 * level + 4]
        return layers

    def _levels(self, matte: str) -> list[str]:
        return [f"{matte}{level:02d}" for level in range(self.ranks // 2)]


def why_no_vector(scene: bpy.types.Scene) -> str:
    """Reason why a scene's pictures have no vectors, in words; empty if they can."""
    if scene.render.use_motion_blur:
        return "with motion blur"  # As with Cycles.
    is_panorama = scene.camera is not None and getattr(scene.camera.data, "type", "") == "PANO"
    return "of a panoramic camera" if is_panorama else ""


def matte_fields(layer: str, matte: str, names: Iterable[str]) -> dict[str, str]:
    """Metadata by which other programs find the names in a matte (Cryptomatte specification 1.2)."""
    title = f"{layer}.{matte}"
    key = f"{native().matte_hash(title)[0]:08x}"[:7]
    manifest = {name: f"{native().matte_hash(name)[1]:08x}" for name in names}
    fields = {
        "name": title,
        "hash": "MurmurHash3_32",
        "conversion": "uint32_to_float32",
        "manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }
    return {f"cryptomatte/{key}/{field}": value for field, value in fields.items()}


def assets_of(depsgraph: bpy.types.Depsgraph) -> dict[str, str]:
    """Name of the topmost parent of each object that has one."""
    assets = {}
    for obj in depsgraph.objects:
        top = obj
        while top.parent is not None:
            top = top.parent
        if top is not obj:
            assets[obj.name] = top.name
    return assets
