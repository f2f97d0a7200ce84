"""Settings of a scene's bake: `scene.relume`."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from ..engine.shot.farm import FARMS
from ..engine.shot.options import QUALITIES

QUALITY_ITEMS = [
    (name, label, f"{samples} paths per pixel: {text}") for name, (label, samples, text) in QUALITIES.items()
] + [("CUSTOM", "Custom", "As many paths per pixel as you choose")]


class RelumeSettings(bpy.types.PropertyGroup):
    """Kept in the .blend file."""

    folder: StringProperty(
        name="Bake Folder",
        description="Where the paths of this shot are stored. Empty: a folder beside the .blend file, or in the cache "
        "folder of the preferences while the file is not saved",
        subtype="DIR_PATH",
        # From Blender 4.5 on paths relative to the file have to be asked for.
        **({"options": {"PATH_SUPPORTS_BLEND_RELATIVE"}} if bpy.app.version >= (4, 5, 0) else {}),
    )
    baked_folder: StringProperty(
        name="Baked In", description="Where the bake of this scene was written, to be found again", options={"HIDDEN"}
    )
    baked_absolute: StringProperty(name="Baked In", description="The same as an absolute path", options={"HIDDEN"})
    quality: EnumProperty(
        name="Quality",
        description="How many paths per pixel are traced. More are cleaner, take longer and need more disk space",
        items=QUALITY_ITEMS,
        default="GOOD",
    )
    samples: IntProperty(name="Samples", description="Paths per pixel", default=64, min=1, soft_max=1024, max=65536)
    farm_kind: EnumProperty(
        name="Farm",
        description="What the machines are managed by",
        items=[(name, label, text) for name, (label, text) in FARMS.items()],
    )
    farm_frames: StringProperty(
        name="Frames",
        description="Frames to bake, each into a folder of its own, such as 1-10,15. Empty: the present one",
    )
    farm_parts: IntProperty(
        name="Parts", description="Parts that the bake of each frame is cut into", default=8, min=1, max=4096
    )
    show_warnings: BoolProperty(
        name="Warnings", description="List what this shot has and Relume cannot represent", default=False
    )
    open_warnings: StringProperty(
        name="Open Warnings", description="Kinds of warnings that show their names, by line", options={"HIDDEN"}
    )


def register():
    """Adds `scene.relume`."""
    bpy.utils.register_class(RelumeSettings)
    bpy.types.Scene.relume = PointerProperty(type=RelumeSettings)


def unregister():
    """Takes it away; values stay in the file."""
    del bpy.types.Scene.relume
    bpy.utils.unregister_class(RelumeSettings)
