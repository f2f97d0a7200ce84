"""The list of a scene's shots, `scene.relume_shots`."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ...engine.shot.options import OF_SCENE
from ...live import follow
from ..settings import QUALITY_ITEMS


def _is_camera(_entry: RelumeShot, obj: bpy.types.Object) -> bool:
    return obj.type == "CAMERA"


def _note_camera(entry: RelumeShot, _context: Any) -> None:
    if entry.camera is not None:
        entry.camera_name = entry.camera.name
    _follow(entry, _context)


def _follow(edited: Any, _context: Any) -> None:
    state = edited.id_data.relume_shots
    if state.follow:
        follow.follow(edited.id_data)


class RelumeShot(bpy.types.PropertyGroup):
    """One shot; kept in the .blend file."""

    key: StringProperty(
        name="Key", description="Name in folders, which stays when the shot is renamed", options={"HIDDEN"}
    )
    on: BoolProperty(
        name="On", description="Whether Bake All, the contact sheet and other programs have this shot", default=True
    )
    camera: PointerProperty(
        type=bpy.types.Object,
        name="Camera",
        description="The camera of this shot",
        poll=_is_camera,
        update=_note_camera,
    )
    camera_name: StringProperty(
        name="Camera Name", description="Finds the camera again when it was deleted and came back", options={"HIDDEN"}
    )
    use_frame: BoolProperty(
        name="Fixed Frame", description="This shot is of one frame. Off: of the frame that is current", update=_follow
    )
    frame: IntProperty(name="Frame", description="Frame of this shot", default=1, update=_follow)
    layer: StringProperty(
        name="View Layer",
        description="View layer that is baked. Empty: the first one that Blender renders",
        update=_follow,
    )
    use_size: BoolProperty(name="Own Size", description="This shot has a size of its own. Off: the scene's resolution")
    width: IntProperty(name="Width", description="Pixels per row", default=1920, min=4, max=65536, subtype="PIXEL")
    height: IntProperty(name="Height", description="Rows of pixels", default=1080, min=4, max=65536, subtype="PIXEL")
    quality: EnumProperty(
        name="Quality",
        description="How many paths per pixel are traced for this shot",
        items=[(OF_SCENE, "As Scene", "The quality that is chosen for the scene"), *QUALITY_ITEMS],
        default=OF_SCENE,
    )
    samples: IntProperty(name="Samples", description="Paths per pixel", default=64, min=1, soft_max=1024, max=65536)
    folder: StringProperty(
        name="Bake Folder",
        description="Where the paths of this shot are stored. Empty: a folder of its own in that of the scene, or "
        "beside the .blend file",
        subtype="DIR_PATH",
        # From Blender 4.5 on paths relative to the file have to be asked for.
        **({"options": {"PATH_SUPPORTS_BLEND_RELATIVE"}} if bpy.app.version >= (4, 5, 0) else {}),
    )
    is_foreign: BoolProperty(
        name="Bake of Another File", description="Shown with the others and never written", options={"HIDDEN"}
    )
    baked_folder: StringProperty(
        name="Baked In", description="Where the bake of this shot was written, to be found again", options={"HIDDEN"}
    )
    baked_absolute: StringProperty(name="Baked In", description="The same as an absolute path", options={"HIDDEN"})


class RelumeShots(bpy.types.PropertyGroup):
    """All shots of a scene; kept in the .blend file."""

    items: CollectionProperty(type=RelumeShot, name="Shots", description="Shots of this scene")
    active: IntProperty(name="Shot", description="The shot whose details are shown below", update=_follow)
    follow: BoolProperty(
        name="Follow",
        description="Choosing a shot makes its camera, frame and view layer the scene's, and shows its bake",
        default=True,
        update=_follow,
    )


CLASSES = (RelumeShot, RelumeShots)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds `scene.relume_shots`."""
    _register()
    bpy.types.Scene.relume_shots = PointerProperty(type=RelumeShots)


def unregister():
    """Takes it away; values stay in the file."""
    del bpy.types.Scene.relume_shots
    _unregister()
