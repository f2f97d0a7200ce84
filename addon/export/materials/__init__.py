"""Material node trees to the JSON form of `relume_scene::Material`."""

from .attribute_nodes import FACTOR
from .exporter import MaterialExporter, asked_attributes
from .surface_nodes import ISLAND, POINTINESS
from .translation import bump_shadowing, sampling_settings
from .values import ANY_UV_MAP

__all__ = [
    "ANY_UV_MAP",
    "FACTOR",
    "ISLAND",
    "MaterialExporter",
    "POINTINESS",
    "asked_attributes",
    "bump_shadowing",
    "sampling_settings",
]
