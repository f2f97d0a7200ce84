"""Figures of the code are read as a compiler reads it."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
from code_map import RustFile, addon_circles, circles, leaves, rust_circles  # noqa: E402
from house import doc_starts, functions, homonyms  # noqa: E402


@pytest.fixture
def crate(tmp_path):
    """Maker of a crate `a` of the given files."""

    def make(**files):
        (tmp_path / "rust/a/src").mkdir(parents=True)
        for name, text in files.items():
            (tmp_path / f"rust/a/src/{name}.rs").write_text(text)
        return [RustFile(tmp_path, f"rust/a/src/{name}.rs") for name in files]

    return make


def test_circles_are_groups_that_reach_each_other():
    assert circles({1: {2}, 2: {3}, 3: {1}, 4: {1}, 5: set()}) == [[1, 2, 3]]


def test_trees_of_use_are_spread_out():
    found = leaves("crate::a::{self, B as C, d::{E, F}}")
    assert found == [
        (("crate", "a"), "a"),
        (("crate", "a", "B"), "C"),
        (("crate", "a", "d", "E"), "E"),
        (("crate", "a", "d", "F"), "F"),
    ]


def test_names_that_are_passed_on_lead_to_where_they_are_defined(crate):
    files = crate(lib="mod b;\nmod c;\npub use b::B;", b="use crate::c::C;", c="// use crate::no;\nuse crate::B;")
    assert rust_circles(files) == ([["b", "c"]], [["b", "c"]])


def test_children_that_use_their_parent_are_told_apart(crate):
    assert rust_circles(crate(lib="mod b;\nuse b::B;\nstruct A;", b="use super::A;")) == ([["lib", "b"]], [])


def test_functions_end_at_their_brace_and_tests_are_left_out(crate):
    code = "fn one(a: [u8; 2]) {\n let b = '}';\n}\n#[cfg(test)]\nmod tests {\n fn two() {}\n}\nfn three() { 1 }\n"
    assert functions(crate(lib=code), {})["rust"] == [(3, "rust/a/src/lib.rs: one"), (1, "rust/a/src/lib.rs: three")]


def test_types_of_one_name_are_found_by_file(crate):
    files = crate(b="pub struct X;\nimpl T for X {\n    type Y = u8;\n}\n", c="pub(crate) enum X {}\ntype Y = u8;\n")
    assert homonyms(files, {}) == ({}, {}, {"rust/a: X": ["rust/a/src/b.rs", "rust/a/src/c.rs"]})


def test_documentation_is_judged_by_its_first_words(crate):
    assert list(doc_starts(crate(lib="//! One.\n//! Two.\n\n/// Of three.\nfn f() {}\n"), {}))[1].startswith("Of three")


def test_imports_within_functions_close_circles(tmp_path):
    package = tmp_path / "addon/ui"
    package.mkdir(parents=True)
    for name, text in (("__init__", ""), ("a", "from . import b"), ("b", "def f():\n    from .a import g")):
        (package / f"{name}.py").write_text(text)
    assert addon_circles(tmp_path) == ([["addon.ui.a", "addon.ui.b"]], [])
