"""Everything that a person can point at says what it is: operators, properties and the items of menus."""

import importlib
import pkgutil

import bpy
import pytest

import addon

pytestmark = pytest.mark.every_version


def registered_classes():
    """All classes that the add-on has registered with Blender."""
    found = {}
    for module in pkgutil.walk_packages(addon.__path__, "addon."):
        for thing in vars(importlib.import_module(module.name)).values():
            if isinstance(thing, type) and getattr(thing, "is_registered", False) and "bl_rna" in vars(thing):
                found[thing.bl_rna.identifier] = thing
    return found


def own_properties(kind):
    """Those that the class has beyond Blender's own of its base."""
    inherited = set(kind.bl_rna.base.properties.keys()) if kind.bl_rna.base else set()
    return [item for item in kind.bl_rna.properties if item.identifier not in inherited]


def added_properties():
    """Properties that the add-on gives to Blender's own types."""
    kinds = (bpy.types.Scene, bpy.types.WindowManager, bpy.types.Object, bpy.types.Light, bpy.types.ViewLayer)
    for kind in (*kinds, bpy.types.View3DShading):
        for name in dir(kind):
            if name.startswith("relume"):
                yield kind.__name__, kind.bl_rna.properties[name]


def without_words(where, item):
    """Names of a property and its items that have no tooltip."""
    missing = []
    if item.is_hidden:
        return missing
    # These two are no buttons; their members are.
    if item.type not in {"POINTER", "COLLECTION"} and not item.description.strip():
        missing.append(f"{where}.{item.identifier}")
    if item.type == "ENUM":
        missing += [
            f"{where}.{item.identifier}: {choice.identifier}"
            for choice in item.enum_items_static
            if not choice.description.strip()
        ]
    return missing


def test_operators_properties_and_menu_items_have_tooltips(registered):
    classes = registered_classes()
    operators = {kind.bl_idname for kind in classes.values() if issubclass(kind, bpy.types.Operator)}
    assert operators == {f"relume.{name}" for name in dir(bpy.ops.relume)} and operators
    missing = []
    for name, kind in classes.items():
        if issubclass(kind, bpy.types.Operator):
            # Blender keeps what is shown of an operator apart from its class.
            continue
        for item in own_properties(kind):
            missing += without_words(name, item)
    for name in dir(bpy.ops.relume):
        shown = getattr(bpy.ops.relume, name).get_rna_type()
        # Blender puts the latter where a class says nothing.
        missing += [name] if shown.description.strip() in {"", "(undocumented operator)"} else []
        for item in shown.properties:
            missing += without_words(name, item)
    for owner, item in added_properties():
        missing += without_words(owner, item)
    assert missing == [], "\n".join(missing)
