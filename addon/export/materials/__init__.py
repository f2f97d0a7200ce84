"""Material node trees to the JSON form of `relume_scene::Material`."""

from .exporter import MaterialExporter

__all__ = ["MaterialExporter"]
