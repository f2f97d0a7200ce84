"""Images with unsaved paint, which another Blender cannot see."""

from __future__ import annotations

import bpy


def names(scene: bpy.types.Scene) -> list[str]:
    """Sorted names of the images with unsaved paint that a render of the scene shows."""
    unsaved = [image for image in bpy.data.images if image.is_dirty]
    users = bpy.data.user_map() if unsaved else {}
    rendered = {obj for obj in scene.objects if not obj.hide_render} if unsaved else set()
    return sorted(image.name_full for image in unsaved if _is_shown(image, users, rendered, scene))


def refusal(scene: bpy.types.Scene) -> str:
    """Steps for the artist before another Blender can render a copy of the file; empty if nothing."""
    unsaved = names(scene)
    if not unsaved:
        return ""
    listed = ", ".join(f"'{name}'" for name in unsaved)
    are, those = ("image {} was", "it") if len(unsaved) == 1 else ("images {} were", "them")
    return f"{are.format(listed)} painted and not saved, so another Blender cannot see that; save or pack {those} first"


Users = dict[bpy.types.ID, set[bpy.types.ID]]


def _is_shown(image: bpy.types.Image, users: Users, rendered: set[bpy.types.ID], scene: bpy.types.Scene) -> bool:
    """True if the scene's world or one of the `rendered` objects uses the image, directly or not."""
    known, waiting = {image}, [image]
    while waiting:
        used = waiting.pop()
        if used in rendered or isinstance(used, bpy.types.World) and scene in users[used]:
            return True
        new = {user for user in users[used] - known if _hands_on(user, used)}
        known |= new
        waiting += new
    return False


def _hands_on(user: bpy.types.ID, used: bpy.types.ID) -> bool:
    """True if the user of a data-block may show it in a render. Scenes have brushes and masks, cameras and empties
    pictures to work by."""
    if isinstance(user, bpy.types.Object):
        return not user.hide_render and not isinstance(used, bpy.types.Image)
    return not isinstance(user, (bpy.types.Scene, bpy.types.Camera))
