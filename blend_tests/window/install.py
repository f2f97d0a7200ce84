"""Installs the extension for this user: `blender --background --python install.py -- ZIP`."""

import sys

import bpy

bpy.context.preferences.view.show_splash = False
bpy.ops.preferences.addon_enable(module="cycles")
bpy.ops.extensions.package_install_files(filepath=sys.argv[-1], repo="user_default", enable_on_install=True)
bpy.ops.wm.save_userpref()
