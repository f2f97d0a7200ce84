"""The extension zip installs, runs its command and is removed, under private user resources."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPOSITORY / "scripts"))
from extension_zip import zip_for_this_machine  # noqa: E402

INSTALL = """
import importlib, os, sys
import bpy

def main(zip_path, out):
    bpy.ops.preferences.addon_enable(module="bl_pkg")
    bpy.ops.preferences.addon_enable(module="cycles")
    bpy.ops.extensions.package_install_files(
        filepath=zip_path, repo="user_default", enable_on_install=True
    )
    addon = importlib.import_module("bl_ext.user_default.relume")
    # The wheel of the extension, not the one that the tests use.
    sys.path.sort(key=lambda path: "extensions" not in path)
    import relume
    assert "extensions" in relume.__file__, relume.__file__
    assert len(addon._registered) == 1
    # What `blender --command relume` calls.
    code = addon._run_command(["bake", "--out", out, "--samples", "2", "--resolution", "16x9", "--quiet"])
    bpy.ops.preferences.addon_disable(module="bl_ext.user_default.relume")
    assert addon._registered == []
    return code

code = 1
try:
    code = main(*sys.argv[1:])
finally:
    sys.stdout.flush()
    os._exit(code)
"""


def test_extension_installs_and_bakes(tmp_path):
    extension = zip_for_this_machine(REPOSITORY / "build" / "extension")
    if extension is None:
        assert not os.environ.get("CI"), "CI builds the extension first"
        pytest.skip("the extension is not built; run make extension-linux")
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user")}
    (tmp_path / "user").mkdir()
    command = [sys.executable, "-c", INSTALL, str(extension), str(tmp_path / "bake")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "bake" / "lights.json").exists()
