"""The lights that a scene has at this moment, as the window shows it."""

from __future__ import annotations

import dataclasses
from typing import Any

import bpy

from ..export.lights import LightExporter
from ..export.linking import LightLinking


@dataclasses.dataclass
class SceneLights:
    """Descriptions as `export.lights` makes them, and what could not be described."""

    lights: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    warnings: list[str] = dataclasses.field(default_factory=list)


def read(depsgraph: bpy.types.Depsgraph, receivers: list[str]) -> SceneLights:
    """All lights, instances of lights included, that are visible in the view and in renders. `receivers` are the
    full names of the scene's objects when it was baked: their order is the meaning of light linking."""
    found = SceneLights()
    exporter = LightExporter(found.lights.append, found.warnings.append, LightLinking(receivers, found.warnings.append))
    rendered = _RenderedObjects(depsgraph)
    for instance in depsgraph.object_instances:
        obj = instance.object
        if obj.type != "LIGHT" or not instance.show_self:
            continue
        owner = instance.parent if instance.is_instance else obj
        if not obj.hide_render and owner.original in rendered:
            exporter.export(obj, instance.matrix_world)
    return found


class _RenderedObjects:
    """Which objects of a view layer no collection hides from renders."""

    def __init__(self, depsgraph: bpy.types.Depsgraph):
        self.shown: set[bpy.types.Collection] = set()
        self.all = True
        self._walk(depsgraph.view_layer.layer_collection)

    def _walk(self, layer: bpy.types.LayerCollection) -> None:
        if layer.exclude:
            return
        if layer.collection.hide_render:
            self.all = False
            return
        self.shown.add(layer.collection)
        for child in layer.children:
            self._walk(child)

    def __contains__(self, obj: bpy.types.Object) -> bool:
        return not obj.hide_render and (self.all or not self.shown.isdisjoint(obj.users_collection))
