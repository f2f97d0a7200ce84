"""Of zips for several platforms, each machine takes its own."""

import platform
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
from extension_zip import zip_for_this_machine  # noqa: E402


@pytest.mark.parametrize(
    ("system", "machine", "name"),
    [
        ("Linux", "x86_64", "relume-0.1.0-linux_x64.zip"),
        ("Windows", "AMD64", "relume-0.1.0-windows_x64.zip"),
        ("Darwin", "arm64", "relume-0.1.0-macos_arm64.zip"),
        ("Darwin", "x86_64", "relume-0.1.0-macos_x64.zip"),
        ("Linux", "aarch64", None),
    ],
)
def test_each_machine_takes_its_own_zip(tmp_path, monkeypatch, system, machine, name):
    for zip_name in ("windows_x64", "linux_x64", "macos_arm64", "macos_x64"):
        (tmp_path / f"relume-0.1.0-{zip_name}.zip").touch()
    monkeypatch.setattr(platform, "system", lambda: system)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    found = zip_for_this_machine(tmp_path)
    assert (found and found.name) == name
