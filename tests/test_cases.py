"""`scripts/cases.py` judges what a case printed, and its page is the table of the records beside it."""

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

sys.path.insert(0, str(ROOT / "scripts"))

import cases  # noqa: E402

EQUAL = {"bake": 0, "relight": 0, "finite": True, "median": 0.004, "p95": 0.03, "noise_p95": 0.01, "mean_ratio": 1.0}
OTHER = EQUAL | {"p95": 0.2}


@pytest.mark.parametrize(
    ("found", "expect", "verdict", "met"),
    [
        (EQUAL, "equal", "equal", True),
        (OTHER, "equal", "different", False),
        (OTHER | {"noise_p95": 0.08}, "equal", "equal", True),
        (EQUAL | {"finite": False}, "equal", "different", False),
        (OTHER | {"warning": ["fur is left out"]}, "curves and volume named", "named", True),
        (OTHER | {"warning": ["fur is left out"]}, "equal", "named", False),
        (EQUAL, "a note that the layer is not baked", "equal", False),
        (EQUAL | {"relight_warning": ["the layer is not baked"]}, "a note that the layer is not baked", "equal", True),
        ({"bake": 1, "error": ["stereo is not supported"]}, "refused with a clear error", "refused", True),
        ({"bake": 1, "error": []}, "refused", "crash", False),
        ({"bake": -11}, "equal", "crash", False),
        ({"bake": "hang"}, "equal", "crash", False),
        ({"bake": 1, "error": ["no camera"], "traceback": "Traceback"}, "refused", "crash", False),
        ({"bake": 0}, "equal", "unjudged", False),
    ],
)
def test_a_case_is_judged_by_its_numbers_and_by_what_was_said(found, expect, verdict, met):
    kept = cases.record("01_any", "4.2", found | {"expect": expect})
    assert (kept["verdict"], cases.is_met(kept)) == (verdict, met)


def test_records_hold_no_folder_of_the_machine():
    said = ["image '/home/artist/shots/wall.png' is missing", "render 'a/b' of C:/Users/me/x.exr", "noise of 1/2"]
    kept = cases.record("01_any", "4.2", EQUAL | {"expect": "equal", "warning": said})
    assert kept["warnings"] == ["image 'wall.png' is missing", "render 'a/b' of x.exr", "noise of 1/2"]


def test_a_new_record_replaces_that_of_its_case_and_version(tmp_path, monkeypatch):
    monkeypatch.setattr(cases, "RECORDS", tmp_path / "cases.json")
    monkeypatch.setattr(cases, "PAGE", tmp_path / "cases.md")
    first = [cases.record("01_any", version, OTHER | {"expect": "equal"}) for version in ("5.3", "4.2")]
    cases.keep(first)
    cases.keep([cases.record("01_any", "5.3", EQUAL | {"expect": "equal"})])
    kept = json.loads((tmp_path / "cases.json").read_text())
    assert [(one["version"], one["verdict"]) for one in kept] == [("4.2", "different"), ("5.3", "equal")]
    assert "| 01_any | 4.2 | equal | **different** |" in (tmp_path / "cases.md").read_text()


def test_the_kept_page_is_that_of_the_kept_records():
    assert cases.PAGE.read_text() == cases.page(json.loads(cases.RECORDS.read_text()))
