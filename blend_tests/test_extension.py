"""The extension zip installs, runs its command and is removed, under private user resources."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.every_version

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPOSITORY / "scripts"))
from extension_zip import zip_for_this_machine  # noqa: E402
from stamp_wheel import record_line, stamp  # noqa: E402

INSTALL = """
import importlib, os, subprocess, sys
import bpy

def main(zip_path, out, script):
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
    # The function that `blender --command relume` calls.
    code = addon._run_command(["bake", "--out", out, "--samples", "2", "--resolution", "16x9", "--quiet"])
    # That of farms, away from the checkout: it finds what is installed.
    subprocess.run([sys.executable, script, "--", "info", out], check=True)
    for switch in ("disable", "enable", "disable", "enable"):
        getattr(bpy.ops.preferences, f"addon_{switch}")(module=addon.__name__)
        addon = importlib.import_module(addon.__name__)
        assert len(addon._registered) == (switch == "enable"), switch
    repositories = bpy.context.preferences.extensions.repos
    number = next(i for i, found in enumerate(repositories) if found.module == "user_default")
    folder = os.path.join(repositories[number].directory, "relume")
    assert os.path.isdir(folder), folder
    bpy.ops.extensions.package_uninstall(repo_index=number, pkg_id="relume")
    assert not os.path.exists(folder) and addon.__name__ not in bpy.context.preferences.addons
    assert addon._registered == [] and not hasattr(bpy.types.Scene, "relume")
    return code

code = 1
try:
    code = main(*sys.argv[1:])
finally:
    sys.stdout.flush()
    os._exit(code)
"""


def test_extension_installs_bakes_and_goes_without_a_trace(tmp_path):
    extension = zip_for_this_machine(REPOSITORY / "build" / "extension")
    if extension is None:
        assert not os.environ.get("CI"), "CI builds the extension first"
        pytest.skip("the extension is not built; run make extension-linux")
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user")}
    (tmp_path / "user").mkdir()
    script = shutil.copy(extension.parent / "relume_bake.py", tmp_path)
    command = [sys.executable, "-c", INSTALL, str(extension), str(tmp_path / "bake"), script]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "bake" / "lights.json").exists()
    left = [path for path in (tmp_path / "user").rglob("*") if "relume" in path.name.lower()]
    assert not left, left


INSTALL_ALL = """
import os, sys
import bpy

code = 1
try:
    bpy.ops.preferences.addon_enable(module="bl_pkg")
    for path in sys.argv[1:]:
        bpy.ops.extensions.package_install_files(filepath=path, repo="user_default", enable_on_install=True)
    code = 0
finally:
    sys.stdout.flush()
    os._exit(code)
"""
MANIFEST = """
schema_version = "1.0.0"
id = "small"
version = "0.1.0"
name = "Small"
tagline = "Stands in for a large one"
maintainer = "Nobody"
type = "add-on"
blender_version_min = "4.2.0"
license = ["SPDX:GPL-3.0-or-later"]
wheels = ["./wheels/{wheel}"]
"""


def small_wheel(folder, code):
    """A wheel of one module, stamped as ours is."""
    folder.mkdir()
    info = "small_native-0.1.0.dist-info"
    files = {
        "small_native.py": code,
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: small_native\nVersion: 0.1.0\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    wheel = folder / "small_native-0.1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
        lines = [record_line(name, text.encode()) for name, text in files.items()]
        archive.writestr(f"{info}/RECORD", "".join([*lines, f"{info}/RECORD,,\n"]))
    return stamp(wheel)


def small_extension(folder, code):
    """The zip of an extension with a small wheel."""
    wheel, path = small_wheel(folder, code), folder / "small.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("blender_manifest.toml", MANIFEST.format(wheel=wheel.name))
        archive.writestr("__init__.py", "def register():\n    pass\n\n\ndef unregister():\n    pass\n")
        archive.write(wheel, f"wheels/{wheel.name}")
    return path


def test_another_build_of_the_same_version_replaces_the_native_module(tmp_path):
    """Blender keeps a wheel whose version it has; a stamped one has another."""
    user = tmp_path / "user"
    user.mkdir()
    zips = [small_extension(tmp_path / name, f"BUILD = {name!r}\n") for name in ("first", "second")]
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(user)}
    command = [sys.executable, "-c", INSTALL_ALL, *map(str, zips)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stdout + done.stderr
    (module,) = user.rglob("small_native.py")
    assert module.read_text() == "BUILD = 'second'\n", done.stdout + done.stderr
    assert len(list(user.rglob("small_native-*.dist-info"))) == 1, "nothing of the first is left"


def test_the_stamp_is_of_the_contents_alone(tmp_path):
    names = [small_wheel(tmp_path / folder, code).name for folder, code in (("a", "1"), ("b", "1"), ("c", "2"))]
    assert names[0] == names[1] != names[2]
    stamped = tmp_path / "a" / names[0]
    assert stamp(stamped).name == names[0], "stamping again changes nothing"
