"""ARCHITECTURE.md tells the truth: its table of packages and arrows is what cargo sees."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

sys.path.insert(0, str(ROOT / "scripts"))
from code_map import addon_circles, imports_of  # noqa: E402


def arrows_in_table():
    """Crate -> crates that it may use, from the table of ARCHITECTURE.md."""
    rows = re.findall(r"^\| `rust/(\w+)` \|[^|]*\|([^|]*)\|", (ROOT / "ARCHITECTURE.md").read_text(), re.M)
    return {package: set(re.findall(r"\w+", uses)) for package, uses in rows}


def arrows_in_cargo():
    """Crate -> workspace crates that it depends on outside of tests, from `cargo metadata`."""
    command = ["cargo", "metadata", "--no-deps", "--offline", "--format-version", "1"]
    packages = json.loads(subprocess.check_output(command, cwd=ROOT))["packages"]
    packages = [package for package in packages if package["name"] != "relume-fuzz"]  # Tests, as they are.
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


def packages_of_addon():
    """Packages of the add-on in the order of ARCHITECTURE.md: each may use those before it."""
    row = re.search(r"^\| `addon/` \|(.*)\|$", (ROOT / "ARCHITECTURE.md").read_text(), re.M)[1]
    found = re.search(r"arrows point down this list:(.*)", row)[1]
    return re.findall(r"`(\w+)` \(", found)


def imports_by_package():
    """Package of the add-on -> (file, imported name) of each import in it."""
    packages = packages_of_addon()
    found = {package: [] for package in packages}
    for path in sorted((ROOT / "addon").rglob("*.py")):
        package = path.relative_to(ROOT / "addon").parts[0]
        if package in packages:
            found[package] += [(str(path.relative_to(ROOT)), name) for name in imports_of(path)]
    return found


def test_every_folder_of_the_addon_is_a_package():
    folders = {path.parent.name for path in (ROOT / "addon").glob("*/__init__.py")}
    assert set(packages_of_addon()) == folders and len(folders) == 7


def test_arrows_of_the_addon_point_down_the_list():
    packages = packages_of_addon()
    for number, package in enumerate(packages):
        allowed = {package, *packages[:number]}
        for file, name in imports_by_package()[package]:
            parts = name.split(".")
            assert parts[0] != "addon" or parts[1] in allowed, f"{file} imports {name}"


def test_modules_of_the_addon_import_in_no_circle():
    modules, packages = addon_circles()
    assert modules == []
    # A package and those inside of it are one.
    assert [circle for circle in packages if not all(name.startswith(circle[0]) for name in circle)] == []


def test_core_needs_no_blender():
    blender = {"bpy", "bpy_extras", "bl_math", "blf", "bmesh", "gpu", "gpu_extras", "imbuf", "mathutils"}
    for file, name in imports_by_package()["core"]:
        assert name.split(".")[0] not in blender, f"{file} imports {name}"


def test_engine_alone_imports_the_native_module():
    importers = {
        package
        for package, imports in imports_by_package().items()
        for _, name in imports
        if name.split(".")[0] == "relume"
    }
    assert importers == {"engine"}


def test_a_class_of_the_addon_has_a_name_of_its_own():
    files = {}
    for path in sorted((ROOT / "addon").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                files.setdefault(node.name.lstrip("_"), []).append(str(path.relative_to(ROOT)))
    assert {name: places for name, places in files.items() if len(places) > 1} == {}
