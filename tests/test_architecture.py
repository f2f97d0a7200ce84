"""ARCHITECTURE.md tells the truth: its table of rooms and arrows is what cargo sees."""

import json
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def arrows_in_table():
    """Crate -> crates that it may use, from the table of ARCHITECTURE.md."""
    rows = re.findall(r"^\| `rust/(\w+)` \|[^|]*\|([^|]*)\|", (ROOT / "ARCHITECTURE.md").read_text(), re.M)
    return {room: set(re.findall(r"\w+", uses)) for room, uses in rows}


def arrows_in_cargo():
    """Crate -> workspace crates that it depends on outside of tests, from `cargo metadata`."""
    command = ["cargo", "metadata", "--no-deps", "--offline", "--format-version", "1"]
    packages = json.loads(subprocess.check_output(command, cwd=ROOT))["packages"]
    return {
        package["name"].removeprefix("relume-"): {
            dependency["name"].removeprefix("relume-")
            for dependency in package["dependencies"]
            if dependency["name"].startswith("relume-") and dependency["kind"] != "dev"
        }
        for package in packages
    }


def test_table_names_every_crate_and_arrow():
    assert arrows_in_table() == arrows_in_cargo()


def test_arrows_have_no_cycle():
    arrows = arrows_in_cargo()
    while arrows:
        leaves = {crate for crate, uses in arrows.items() if not uses & arrows.keys()}
        assert leaves, f"cycle among {sorted(arrows)}"
        arrows = {crate: uses for crate, uses in arrows.items() if crate not in leaves}
