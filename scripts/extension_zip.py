"""Which of the extension's zips, one for each platform, is that of this machine."""

import platform

SYSTEMS = {"darwin": "macos"}
MACHINES = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64"}


def zip_for_this_machine(folder):
    """The newest zip in a folder that Blender would take here; None if there is none."""
    # Blender's own names: `platform_from_this_system` in bl_pkg/cli/blender_ext.py.
    system, machine = platform.system().lower(), platform.machine().lower()
    found = folder.glob(f"relume-*-{SYSTEMS.get(system, system)}_{MACHINES.get(machine, machine)}.zip")
    return max(found, key=lambda path: path.stat().st_mtime, default=None)
