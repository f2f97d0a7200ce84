"""Material node trees to the JSON form of `relume_scene::Material`."""

from .exporter import MaterialExporter, asked_attributes
from .values import FACTOR

__all__ = ["FACTOR", "MaterialExporter", "asked_attributes"]
