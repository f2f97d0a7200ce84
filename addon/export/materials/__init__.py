"""Material node trees to the JSON form of `relume_scene::Material`."""

from .exporter import MaterialExporter, asked_attributes

__all__ = ["MaterialExporter", "asked_attributes"]
