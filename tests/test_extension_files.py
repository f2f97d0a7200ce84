"""The extension as the platform of extensions and Blender's own repositories want it. Its wheels are empty here."""

import hashlib
import json
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MANIFEST = tomllib.loads((ROOT / "addon" / "blender_manifest.toml").read_text())
PLATFORMS = {"linux-x64": "manylinux_2_28_x86_64", "windows-x64": "win_amd64", "macos-arm64": "macosx_11_0_arm64"}
FIELDS = {"schema_version", "id", "name", "tagline", "version", "type", "maintainer", "license", "tags"} | {
    *("blender_version_min", "platforms", "permissions", "archive_url", "archive_size", "archive_hash")
}
"""Fields of an extension in version 1 of Blender's listings: those of its manifest, and where it is fetched from."""
NEVER = {
    r"\b__file__\b": "builds paths from where Blender has put it",
    r"\bsys\.path\b": "changes where Python looks for modules",
    r"(?<![\w.])(eval|exec)\(": "runs text",
    r"(?m)^\s*(import|from) (urllib|socket|http|ftplib|requests)\b": "uses the network, without the permission for it",
    r"\bpip\b|\bensurepip\b": "installs packages",
}
"""Text that reviewers of extensions refuse."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder as `make extension` leaves it."""
    folder = tmp_path_factory.mktemp("extension")
    wheels = []
    for platform, tag in PLATFORMS.items():
        wheels.append(folder / platform)
        wheels[-1].mkdir()
        name = f"relume-{MANIFEST['version']}-cp311-abi3-{tag}.whl"
        with zipfile.ZipFile(wheels[-1] / name, "w") as wheel:
            wheel.writestr("relume/__init__.py", "")
    command = [ROOT / "scripts" / "build-extension", folder / "out", *wheels]
    subprocess.run(command, check=True, capture_output=True, timeout=100)
    return folder / "out"


def test_the_repository_lists_every_zip_as_it_is(built):
    index = json.loads((built / "index.json").read_text())
    assert index["version"] == "v1" and index["blocklist"] == []
    zips = {path.name: path.read_bytes() for path in built.glob("*.zip")}
    assert len(zips) == len(PLATFORMS)
    assert sorted(platform for found in index["data"] for platform in found["platforms"]) == sorted(PLATFORMS)
    for found in index["data"]:
        assert found.keys() >= FIELDS, FIELDS - found.keys()
        assert all(found[name] == value for name, value in MANIFEST.items() if name != "build")
        # Relative, so that the folder can be put on any server.
        content = zips.pop(found["archive_url"].removeprefix("./"))
        assert found["archive_size"] == len(content)
        assert found["archive_hash"] == f"sha256:{hashlib.sha256(content).hexdigest()}"
    assert not zips, "every zip is listed once"


def test_a_zip_holds_the_add_on_and_the_wheel_of_its_platform(built):
    for path in built.glob("*.zip"):
        names = zipfile.ZipFile(path).namelist()
        assert "LICENSE" in names and "__init__.py" in names
        (wheel,) = [name for name in names if name.endswith(".whl")]
        assert any(platform.replace("-", "_") in path.name and tag in wheel for platform, tag in PLATFORMS.items())
        assert not [name for name in names if re.search(r"\.(py[cd]|so|dll|dylib|exe|sh)$", name)]
        assert "relume_bake.py" not in names
    assert (built / "relume_bake.py").read_bytes() == (ROOT / "relume_bake.py").read_bytes()


def test_the_add_on_does_nothing_that_the_platform_refuses():
    files = sorted((ROOT / "addon").rglob("*.py"))
    assert len(files) > 100
    refused = [
        f"{path.relative_to(ROOT)} {words}"
        for path in files
        for pattern, words in NEVER.items()
        if re.search(pattern, path.read_text())
    ]
    assert not refused


def test_each_permission_has_a_reason_as_the_platform_wants_it():
    for name, words in MANIFEST["permissions"].items():
        assert name in {"files", "network", "clipboard", "camera", "microphone"}
        assert 0 < len(words) <= 64 and re.search(r"[\w)]$", words) and "\n" not in words
    assert MANIFEST["permissions"].keys() == {"files", "clipboard"}


def test_the_script_of_farms_takes_the_add_on_beside_it_and_names_what_is_missing(tmp_path):
    script = shutil.copy(ROOT / "relume_bake.py", tmp_path)
    command = [sys.executable, script, "--", "--help"]
    environment = {"HOME": str(tmp_path), "PATH": ""}
    missing = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100)
    assert missing.returncode == 1 and f"nor unpacked as {tmp_path / 'relume'}" in missing.stderr
    shutil.copytree(ROOT / "addon", tmp_path / "relume", ignore=shutil.ignore_patterns("__pycache__"))
    found = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100)
    assert found.returncode == 0 and "bake" in found.stdout, found.stderr
