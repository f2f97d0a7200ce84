"""Installs the extension for this user: `blender --background --python install.py -- ZIP`."""

import sys

import bpy

bpy.context.preferences.view.show_splash = False
# Smoothed edges are eight more drawings of the view, smoothed wires one: each of them slow on software OpenGL.
bpy.context.preferences.system.viewport_aa = "OFF"
bpy.context.preferences.system.use_overlay_smooth_wire = False
bpy.ops.preferences.addon_enable(module="cycles")
bpy.ops.extensions.package_install_files(filepath=sys.argv[-1], repo="user_default", enable_on_install=True)
bpy.ops.wm.save_userpref()
