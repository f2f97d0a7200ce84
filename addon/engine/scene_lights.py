"""The lights that a scene has at this moment, as its window shows it. A drag re-reads what it moves and nothing else:
walking over all objects of a large scene takes longer than a picture."""

from __future__ import annotations

import dataclasses
from typing import Any

import bpy

from ..export.lights import LightExporter, describe_light, name_of
from ..export.linking import LightLinking


@dataclasses.dataclass
class _Entry:
    """One light or one instance of one."""

    object_uid: int
    data_uid: int
    object_name: str
    description: dict[str, Any]


class SceneLights:
    """Descriptions of all lights that are visible both in the view and in renders, instances included."""

    def __init__(self, view_layer: str, receivers: list[str]):
        self.view_layer = view_layer
        self.receivers = receivers
        """Full names of the scene's objects when it was baked: their order is the meaning of light linking."""
        self.warnings: list[str] = []
        self._entries: list[_Entry] = []
        self._instancers: set[int] = set()
        self._visibility: tuple | None = None

    @property
    def descriptions(self) -> list[dict[str, Any]]:
        """As `export.lights.describe_light` makes them, each under a name of its own."""
        return [entry.description for entry in self._entries]

    def forget(self) -> None:
        """What was read is no longer true, such as after undo."""
        self._visibility = None

    def update(self, depsgraph: bpy.types.Depsgraph) -> bool:
        """Reads what an update of the scene names. Whether any light may have changed."""
        if depsgraph.mode != "VIEWPORT" or not self._is_ours(depsgraph):
            return False
        if self._visibility is None:
            self.read(depsgraph)
            return True
        known = {entry.object_uid for entry in self._entries} - self._instancers
        moved: set[int] = set()
        for update in depsgraph.updates:
            found = update.id.original
            if isinstance(found, bpy.types.Light):
                moved.update(entry.object_uid for entry in self._entries if entry.data_uid == found.session_uid)
            elif isinstance(found, bpy.types.Object):
                if found.type == "LIGHT":
                    moved.add(found.session_uid)
                elif found.session_uid in self._instancers or found.instance_type != "NONE":
                    moved.add(0)
            elif isinstance(found, bpy.types.Collection):
                moved.add(0)
        if not moved <= known or self._visibility != _visibility(depsgraph.view_layer):
            self.read(depsgraph)
            return True
        return bool(moved) and self._read_again(depsgraph, moved)

    def _is_ours(self, depsgraph: bpy.types.Depsgraph) -> bool:
        """Windows may show several view layers of a scene; the lights are those of one."""
        if self.view_layer not in depsgraph.scene.view_layers:
            self.view_layer = depsgraph.view_layer.name
        return depsgraph.view_layer.name == self.view_layer

    def read(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Reads every light."""
        self._entries, self._instancers, self.warnings = [], set(), []
        descriptions: list[dict[str, Any]] = []
        exporter = LightExporter(descriptions.append, self._warn, self._linking())
        rendered = _RenderedObjects(depsgraph.view_layer)
        for instance in depsgraph.object_instances:
            obj = instance.object
            if obj.type != "LIGHT":
                continue
            original = obj.original
            owner = instance.parent.original if instance.is_instance else original
            if instance.is_instance:
                self._instancers |= {owner.session_uid, original.session_uid}
            if instance.show_self and not original.hide_render and owner in rendered:
                exporter.export(obj, instance.matrix_world)
                source = (original.session_uid, original.data.session_uid, name_of(original))
                self._entries += [_Entry(*source, description) for description in descriptions[len(self._entries) :]]
        self._visibility = _visibility(depsgraph.view_layer)
        for obj in _lights(depsgraph.view_layer):
            if not obj.visible_get(view_layer=depsgraph.view_layer) and obj in rendered:
                self._warn(f"light '{obj.name}' is hidden in the view only: off here, but on in renders")

    def _read_again(self, depsgraph: bpy.types.Depsgraph, uids: set[int]) -> bool:
        """Reads some lights; whether any is another one. Blender also names what was only evaluated again."""
        objects = {obj.session_uid: obj for obj in _lights(depsgraph.view_layer)}
        linking = self._linking()
        differs = False
        for entry in self._entries:
            if entry.object_uid not in uids:
                continue
            obj = objects[entry.object_uid].evaluated_get(depsgraph)
            description = describe_light(obj, obj.matrix_world, linking, self._warn)
            if description is None or name_of(obj.original) != entry.object_name:
                self.read(depsgraph)
                return True
            description |= {"name": entry.description["name"]}
            differs |= description != entry.description
            entry.description = description
        return differs

    def _linking(self) -> LightLinking:
        return LightLinking(self.receivers, self._warn)

    def _warn(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(message)


def _lights(view_layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    return [obj for obj in view_layer.objects if obj.type == "LIGHT"]


def _visibility(view_layer: bpy.types.ViewLayer) -> tuple:
    """Differs when a light was added, deleted, hidden or shown."""
    return tuple(
        (obj.session_uid, obj.visible_get(view_layer=view_layer), obj.hide_render) for obj in _lights(view_layer)
    )


class _RenderedObjects:
    """Which objects of a view layer no collection hides from renders."""

    def __init__(self, view_layer: bpy.types.ViewLayer):
        self.shown: list[bpy.types.Collection] = []
        self.hides = False
        self._walk(view_layer.layer_collection)
        # The collections of one object are slow to ask for, so this is the other way round.
        self.uids = (
            {obj.session_uid for collection in self.shown for obj in collection.objects} if self.hides else set()
        )

    def _walk(self, layer: bpy.types.LayerCollection) -> None:
        if layer.exclude:
            return
        if layer.collection.hide_render:
            self.hides = True
            return
        self.shown.append(layer.collection)
        for child in layer.children:
            self._walk(child)

    def __contains__(self, obj: bpy.types.Object) -> bool:
        return not obj.hide_render and (not self.hides or obj.session_uid in self.uids)
