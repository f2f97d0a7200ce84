"""The extension is enabled in a window; disabling and enabling it leaves nothing behind."""

import bpy
from calls import Calls
from driver import ADDON

NEEDS = ["demo.blend"]
EVERY_TIME = True


def handlers():
    """Every handler that somebody has put into Blender."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    return {
        f"{name}: {entry.__module__}.{entry.__qualname__}"
        for name, entries in lists.items()
        if isinstance(entries, list)
        for entry in entries
    }


def classes():
    """Every class that Blender knows, with its properties, as text."""
    known = {name: getattr(bpy.types, name) for name in dir(bpy.types)}
    return {
        f"{name}.{prop}"
        for name, kind in known.items()
        if hasattr(kind, "bl_rna")
        for prop in ["", *kind.bl_rna.properties.keys()]
    }


def keys():
    """Every shortcut of an add-on."""
    keymaps = bpy.context.window_manager.keyconfigs.addon.keymaps
    return {f"{keymap.name}: {item.idname} {item.to_string()}" for keymap in keymaps for item in keymap.keymap_items}


def footprint():
    """All that an add-on can leave and that Blender lists. Timers and drawing show up as calls (`Calls`)."""
    return {"handlers": handlers(), "classes": classes(), "keys": keys()}


def switch(driver, on):
    """Enables or disables the add-on, as the tick box in the preferences does."""
    (bpy.ops.preferences.addon_enable if on else bpy.ops.preferences.addon_disable)(module=ADDON)
    yield from driver.drawn()


def play(driver):
    """See the first line of this file."""
    with driver.step("open"):
        driver.check(ADDON in bpy.context.preferences.addons, "the extension is enabled after a restart")
        with Calls() as calls:
            yield from driver.open("demo.blend")
            yield from driver.look_through_camera()
        driver.check(calls.found, "calls of an enabled add-on are noted")
        driver.photo("camera")

    enabled = footprint()
    with driver.step("disable"):
        yield from switch(driver, on=False)
    disabled = footprint()
    with driver.step("disabled"):
        with Calls() as calls:
            bpy.context.scene.frame_set(2)
            bpy.data.objects[0].location.x += 1
            yield from driver.drawn()
            yield from driver.wait(1)
        driver.check(not calls.found, f"nothing of a disabled add-on is called any more: {calls.found}")

    with driver.step("enable again, disable again"):
        yield from switch(driver, on=True)
        for kind, there in footprint().items():
            driver.check(there == enabled[kind], f"the same {kind} again; changed: {there ^ enabled[kind]}")
        yield from switch(driver, on=False)
        for kind, there in footprint().items():
            driver.check(there == disabled[kind], f"the same {kind} left; changed: {there ^ disabled[kind]}")
        traces = {entry for there in footprint().values() for entry in there if "relume" in entry.lower()}
        driver.check(not traces, f"no trace of the add-on; found {traces}")
