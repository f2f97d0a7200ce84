"""The lights that a scene has at this moment, as its window shows it. What an edit changes is read again and nothing
else: walking over all objects of a large scene takes longer than a picture. Where many lights are to be read it is done
in turns, so that the window goes on."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import compress
from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Matrix

from ...export.images import texture_size
from ...export.instancers import Instancers, may_be_instanced
from ...export.lamp_shaders import LampShaders
from ...export.lights import UniqueNames, describe_light, name_of, ray_visibility
from ...export.linking import LightLinking
from ...export.working_space import working_space
from ..native import native

LIGHT = bpy.types.Object.bl_rna.properties["type"].enum_items["LIGHT"].value
"""Value of `type` in `foreach_get` for a light."""
Key = tuple[int, ...]
"""Session uids of a light and of what instances it, or of itself, and which of the instances it is."""


class Description(dict):
    """JSON form of a light, and its handle, which all requests share until the light changes."""

    @cached_property
    def handle(self) -> Any:
        """The `relume.Light`. Raises ValueError that names the light."""
        return native().Light(self)


@dataclass
class _Entry:
    """One light or one instance of one."""

    light: bpy.types.Object
    owner: bpy.types.Object
    """Object that instances the light, or the light itself."""
    data_uid: int
    name: str
    settings: tuple
    """Settings of both objects, see `_settings_of`."""
    matrix: Matrix | None
    """Matrix of an instance; None for a light itself, which is asked."""
    description: Description | None = None
    """Description of a light that can shine."""
    warnings: list[str] = field(default_factory=list)

    def is_same(self, other: _Entry) -> bool:
        """True if reading both entries gives the same. Members of light linking's collections are not compared."""
        found: dict[str, Any] = self.description or {}
        is_linked = "receivers" in found or "blockers" in found.get("rules", {})
        return not is_linked and self._sources() == other._sources()

    def _sources(self) -> tuple:
        return self.data_uid, self.name, self.settings, self.matrix


class SceneLights:
    """Descriptions of all lights that are visible both in the view and in renders, instances included.

    Between turns it holds light objects: after undo call `forget`."""

    def __init__(self, view_layer: str, receivers: list[str]):
        self.view_layer = view_layer
        self.receivers = receivers
        """Full names of the scene's objects when it was baked: their order is the meaning of light linking."""
        self.descriptions: list[Description] = []
        """Descriptions of all lights from `export.lights.describe_light`, each under a name of its own."""
        self.warnings: list[str] = []
        self._entries: dict[Key, _Entry] = {}
        self._waiting: dict[Key, None] = {}
        self._differs = False
        """True if `descriptions` or `warnings` are no longer those of the entries."""
        self._hidden: list[str] = []
        """Warnings about hidden lights."""
        self._instancers: set[int] = set()
        self._shown: set[int] = set()
        """Uids of all lights that were found."""
        self._visibility: tuple | None = None

    @property
    def is_waiting(self) -> bool:
        """True if lights have still to be read: until then `descriptions` are the former ones."""
        return bool(self._waiting) or self._differs

    @property
    def is_forgotten(self) -> bool:
        """True if nothing was read since `forget`."""
        return self._visibility is None

    @property
    def instanced(self) -> set[str]:
        """Names (`name_of`) of lights that are shown in other places than their own."""
        return {entry.name for entry in self._entries.values() if entry.matrix is not None}

    def shows(self, uid: int) -> bool | None:
        """True if a light gives light, in place or as an instance, by its session uid; None until that is known."""
        return None if self.is_forgotten else uid in self._shown

    def forget(self) -> None:
        """Forgets all that was read, for example after undo: the next update reads everything."""
        self._entries, self._waiting, self._differs, self._visibility = {}, {}, False, None

    def update(self, depsgraph: bpy.types.Depsgraph, seconds: float = math.inf) -> bool:
        """Reads for about that many seconds what an update of the scene has changed. Returns True if all is read, and
        any light may have changed."""
        if depsgraph.mode != "VIEWPORT" or not self._is_ours(depsgraph):
            return False
        if self._visibility is None:
            return self.read(depsgraph, seconds)
        begun = time.perf_counter()
        edited, shaded, may_instance = self._named(depsgraph)
        is_known = edited | shaded <= {key[0] for key in self._entries}
        if may_instance or not is_known or self._visibility != _visibility(depsgraph.view_layer, self._instancers):
            self._walk(depsgraph, edited)
        else:
            self._waiting |= {key: None for key in self._entries if key[0] in edited | shaded}
        may_differ = self.go_on(depsgraph, seconds - (time.perf_counter() - begun))
        return self.read(depsgraph, seconds) if self.is_forgotten else may_differ

    def _named(self, depsgraph: bpy.types.Depsgraph) -> tuple[set[int], set[int], bool]:
        """Uids of the lights that an update names as edited, those that it only names as shaded anew, and True if
        instances may have changed. Blender names all objects as shaded anew when one comes or goes."""
        edited: set[int] = set()
        shaded: set[int] = set()
        data: set[int] = set()
        may_instance, instancers = False, Instancers()
        # Kept, as looking one of them up takes longer than all the rest.
        object_kind, light_kind, collection_kind = bpy.types.Object, bpy.types.Light, bpy.types.Collection
        for update in depsgraph.updates:
            found = update.id
            if isinstance(found, object_kind):
                if found.type == "LIGHT":
                    is_edited = (
                        update.is_updated_transform or update.is_updated_geometry or not update.is_updated_shading
                    )
                    (edited if is_edited else shaded).add(found.original.session_uid)
                may_instance = may_instance or self._may_instance(update, found, instancers)
            elif isinstance(found, light_kind):
                data.add(found.original.session_uid)
            elif isinstance(found, collection_kind):
                may_instance = True
        edited |= {key[0] for key, entry in self._entries.items() if entry.data_uid in data}
        return edited, shaded, may_instance

    def _may_instance(self, update: bpy.types.DepsgraphUpdate, found: bpy.types.Object, instancers: Instancers) -> bool:
        """True if an updated object may instance other lights than before."""
        if found.instance_type != "NONE" or (self._instancers and found.original.session_uid in self._instancers):
            return True
        has_others = update.is_updated_geometry and len(found.modifiers) > 0
        return has_others and instancers.may_show_lights(found.original)

    def _is_ours(self, depsgraph: bpy.types.Depsgraph) -> bool:
        """Windows may show several view layers of a scene; the lights are those of one."""
        if self.view_layer not in depsgraph.scene.view_layers:
            self.view_layer = depsgraph.view_layer.name
        return depsgraph.view_layer.name == self.view_layer

    def read(self, depsgraph: bpy.types.Depsgraph, seconds: float = math.inf) -> bool:
        """Begins to read every light again, for about that many seconds. Returns True if all are read."""
        begun = time.perf_counter()
        self.forget()
        self._walk(depsgraph, set())
        return self.go_on(depsgraph, seconds - (time.perf_counter() - begun))

    def go_on(self, depsgraph: bpy.types.Depsgraph, seconds: float = math.inf) -> bool:
        """Continues reading for about that many seconds. Returns True if all is read and any light may have changed."""
        if seconds < 0.0:
            return False
        deadline = time.perf_counter() + seconds
        try:
            while self._waiting:
                key = next(iter(self._waiting))
                self._read_one(self._entries[key], depsgraph)
                del self._waiting[key]
                if time.perf_counter() > deadline:
                    break
        except ReferenceError:  # Something was deleted of which no update has told yet.
            self.forget()
            return False
        if self._waiting or not self._differs:
            return False
        self._describe_anew()
        return True

    def _walk(self, depsgraph: bpy.types.Depsgraph, edited: set[int]) -> None:
        """Finds all lights and their instances; what is new or edited has to be read."""
        known, waiting, layer = self._entries, self._waiting, depsgraph.view_layer
        rendered, instancers = _RenderedObjects(layer), Instancers()
        are_instanced = may_be_instanced(_lights(bpy.data.objects))
        unseen = _hidden_instancers(layer, instancers) if are_instanced else []
        self._entries, self._waiting, self._instancers = {}, {}, {obj.session_uid for obj in unseen}
        for shown in _shown(depsgraph) if are_instanced else _shown_themselves(depsgraph):
            light, owner, is_rendered = shown.light, shown.owner, True
            if shown.matrix is not None:
                self._instancers |= {owner.session_uid, light.session_uid}
                is_rendered = instancers.renders(owner, shown.which, light, rendered.__contains__)
            # Blender tells here of objects that the eye of a collection hides, too.
            is_seen = shown.is_shown and owner.visible_get(view_layer=layer)
            if is_seen and is_rendered and owner in rendered and not _is_replaced(owner):
                key, entry = self._found(shown)
                before = None if key in waiting or light.session_uid in edited else known.get(key)
                if before is None or not before.is_same(entry):
                    self._waiting[key] = None
                    before = entry
                self._entries[key] = before
        self._differs = True
        self._shown = {key[0] for key in self._entries}
        self._visibility = _visibility(layer, self._instancers)
        hidden = [
            obj
            for obj in _lights(layer.objects)
            if not obj.visible_get(view_layer=layer) and obj in rendered and not _is_replaced(obj)
        ]
        if are_instanced and (unseen or _views_hide()):
            hidden += _hidden_instances(layer, rendered, instancers, self._shown)
        self._hidden = [
            f"light '{name_of(obj)}' is hidden in the view only: off here, but on in renders" for obj in hidden
        ]

    def _found(self, shown: _Shown) -> tuple[Key, _Entry]:
        """A light of the walk, not read yet."""
        light, owner = shown.light, shown.owner
        key = (light.session_uid, owner.session_uid, *shown.which)
        while key in self._entries:
            key = (*key, 0)
        settings = _settings_of(shown.evaluated, owner)
        return key, _Entry(light, owner, light.data.session_uid, name_of(light), settings, shown.matrix)

    def _read_one(self, entry: _Entry, depsgraph: bpy.types.Depsgraph) -> None:
        """Blender also names what was only evaluated again: that makes no difference."""
        obj = entry.light.evaluated_get(depsgraph)
        warnings: list[str] = []
        linking = LightLinking(self.receivers, warnings.append)
        place, camera = entry.matrix or obj.matrix_world, (depsgraph.scene_eval or depsgraph.scene).camera
        builder = native().SceneBuilder
        shaders = LampShaders(
            builder.constant_emission,
            lambda: builder(working_space()),
            depsgraph.scene.frame_current,
            texture_size(depsgraph.scene),
        )
        found = describe_light(obj, entry.owner, place, camera, linking, warnings.append, shaders)
        before, name = entry.description, name_of(entry.light)
        if found is not None:
            found["name"] = before["name"] if before is not None and name == entry.name else name
        self._differs |= found != before or warnings != entry.warnings
        entry.data_uid, entry.name, entry.settings = entry.light.data.session_uid, name, _settings_of(obj, entry.owner)
        entry.description, entry.warnings = None if found is None else Description(found), warnings

    def _describe_anew(self) -> None:
        """Gives each light a name of its own, in the order of the export."""
        self._differs = False
        unique = UniqueNames()
        warnings: list[str] = []
        self.descriptions = []
        for entry in self._entries.values():
            warnings += entry.warnings
            if entry.description is not None:
                name = unique(entry.name)
                if entry.description["name"] != name:
                    entry.description = Description(entry.description | {"name": name})
                self.descriptions.append(entry.description)
        self.warnings = list(dict.fromkeys([*warnings, *self._hidden]))


class _Shown(NamedTuple):
    """A light where the view may show it, or an instance of one."""

    evaluated: bpy.types.Object
    light: bpy.types.Object
    owner: bpy.types.Object
    """Object that shows the light: the light itself, or its instancer."""
    is_shown: bool = True
    which: Key = ()
    """Key among the owner's instances."""
    matrix: Matrix | None = None
    """Matrix of an instance; None for a light itself."""


def _shown_themselves(depsgraph: bpy.types.Depsgraph) -> Iterator[_Shown]:
    """Lights of a scene in which nothing instances lights. Other instances, of which there may be hundreds of
    thousands, are not visited."""
    yield from (_Shown(light.evaluated_get(depsgraph), light, light) for light in _lights(depsgraph.view_layer.objects))


def _shown(depsgraph: bpy.types.Depsgraph) -> Iterator[_Shown]:
    for instance in depsgraph.object_instances:
        obj = instance.object
        if obj.type != "LIGHT":
            continue
        if instance.is_instance:
            place = tuple(instance.persistent_id), instance.matrix_world.copy()
            yield _Shown(obj, obj.original, instance.parent.original, instance.show_self, *place)
        else:
            yield _Shown(obj, obj.original, obj.original, instance.show_self)


def _settings_of(light: bpy.types.Object, owner: bpy.types.Object) -> tuple:
    """Settings of the two objects that `describe_light` reads."""
    linking = light.light_linking
    return ray_visibility(light, owner), linking.receiver_collection is None, linking.blocker_collection is None


def _is_replaced(light: bpy.types.Object) -> bool:
    """True if renders show a light only where it is instanced, while views also show the light itself."""
    return light.parent is not None and light.parent.instance_type in {"VERTS", "FACES"}


def _hidden_instances(
    view_layer: bpy.types.ViewLayer, rendered: _RenderedObjects, instancers: Instancers, shown: set[int]
) -> list[bpy.types.Object]:
    """Lights of instanced collections that are hidden in the view only: by themselves, or by what they are in."""
    reached = [instancers.reached_from(owner) for owner in view_layer.objects if owner in rendered]
    lights = dict.fromkeys(obj for found in reached for obj in found if obj.type == "LIGHT")
    # Those that nodes name are shown by them, hidden or not, or only read.
    named = {obj for found in reached for obj, is_named in found.items() if is_named}
    own = view_layer.objects
    return [obj for obj in lights.keys() - named if obj.session_uid not in shown and own.get(obj.name) is not obj]


def _views_hide() -> bool:
    """True if views hide anything that renders show and that instances of lights may be shown by."""
    may_hide = [obj for obj in bpy.data.objects if obj.type in {"LIGHT", "EMPTY"}]
    return any(block.hide_viewport and not block.hide_render for block in [*may_hide, *bpy.data.collections])


def _hidden_instancers(view_layer: bpy.types.ViewLayer, instancers: Instancers) -> list[bpy.types.Object]:
    """Objects that may show lights by instances, but are hidden in the view."""
    carriers = {obj.parent for obj in _lights(view_layer.objects) if _is_replaced(obj)}
    return [
        obj
        for obj in view_layer.objects
        if (obj.instance_type != "NONE" or len(obj.modifiers))
        and not obj.visible_get(view_layer=view_layer)
        and (obj in carriers or instancers.may_show_lights(obj))
    ]


def _lights(objects: bpy.types.bpy_prop_collection, others: Collection[int] = ()) -> list[bpy.types.Object]:
    """The lights among many objects, and others by their session uids."""
    kinds, uids = np.empty(len(objects), np.int32), np.empty(len(objects), np.int32)
    objects.foreach_get("type", kinds)
    objects.foreach_get("session_uid", uids)
    is_wanted = (kinds == LIGHT) | np.isin(uids, list(others))
    return list(compress(objects, is_wanted.tolist()))


def _visibility(view_layer: bpy.types.ViewLayer, instancers: set[int]) -> tuple:
    """Differs when a light, or one of what instances lights, was added, deleted, hidden or shown."""
    sources = _lights(view_layer.objects, instancers)
    return tuple((obj.session_uid, obj.visible_get(view_layer=view_layer), obj.hide_render) for obj in sources)


class _RenderedObjects:
    """Objects of a view layer that no collection hides from renders."""

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
