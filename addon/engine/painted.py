"""Images that were painted in Blender and not saved: another Blender cannot see what was painted."""

from __future__ import annotations

import bpy


def painted_images(scene: bpy.types.Scene) -> list[str]:
    """Names of those that a render of the scene shows, sorted."""
    painted = [image for image in bpy.data.images if image.is_dirty]
    users = bpy.data.user_map() if painted else {}
    rendered = {obj for obj in scene.objects if not obj.hide_render} if painted else set()
    return sorted(image.name_full for image in painted if _is_shown(image, users, rendered, scene))


def refusal(scene: bpy.types.Scene) -> str:
    """What to do before a copy of the file can be rendered as the scene is; empty if nothing."""
    names = painted_images(scene)
    if not names:
        return ""
    listed = ", ".join(f"'{name}'" for name in names)
    are, those = ("image {} was", "it") if len(names) == 1 else ("images {} were", "them")
    return f"{are.format(listed)} painted and not saved, so another Blender cannot see that; save or pack {those} first"


Users = dict[bpy.types.ID, set[bpy.types.ID]]


def _is_shown(image: bpy.types.Image, users: Users, rendered: set[bpy.types.ID], scene: bpy.types.Scene) -> bool:
    """Whether the scene's world or one of the `rendered` objects uses the image, through whatever is between."""
    known, waiting = {image}, [image]
    while waiting:
        used = waiting.pop()
        if used in rendered or isinstance(used, bpy.types.World) and scene in users[used]:
            return True
        found = {user for user in users[used] - known if _hands_on(user, used)}
        known |= found
        waiting += found
    return False


def _hands_on(user: bpy.types.ID, used: bpy.types.ID) -> bool:
    """Whether what uses a data-block may show it in a render. Scenes have brushes and masks, cameras and empties
    pictures to work by."""
    if isinstance(user, bpy.types.Object):
        return not user.hide_render and not isinstance(used, bpy.types.Image)
    return not isinstance(user, (bpy.types.Scene, bpy.types.Camera))
