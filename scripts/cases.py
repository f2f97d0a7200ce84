"""Small files that strangers might make, relit and compared with Cycles: `make cases`.

A case is a script `NN_name.py` in the folder of cases or its folder `passing`. It builds a scene, bakes and relights it
by the command line, renders it by Cycles, and prints one line `QA {...}` with what it found. A run replaces the
records of its cases and versions in `docs/bench/cases.json`, keeps the others, and writes the page beside it anew.
"""

import argparse
import json
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts/bench"))

from markdown import rows  # noqa: E402

RECORDS = ROOT / "docs/bench/cases.json"
PAGE = ROOT / "docs/bench/cases.md"
OUT = ROOT / "out/cases"
MEDIAN_LIMIT, P95_LIMIT, TIMES_NOISE = 0.02, 0.08, 3
MEASURES = ("median", "p95", "mean_ratio", "noise_p95")
SECONDS = 900
"""How long a case may take before it counts as a crash."""

FOLDER_PATH = re.compile(r"(?<![\w.])(?:[A-Za-z]:)?/(?:[^\s'\",:()/]+/)*(?=[^\s'\",:()/])")
"""An absolute path up to the name of its file: what a record leaves out."""

TEXT = """# Small files, in Blender's versions

{met} of {all} are as expected. Made from `cases.json` by `make cases`; `CASES="--only 83 --version 5.3"` runs a part
anew.
Numbers compare means of blocks of 8 x 8 pixels with those of Cycles: median and 95th percentile of the relative
difference, and the ratio of the means. Noise is the 95th percentile between two renders of Cycles.

| verdict | meaning |
| --- | --- |
| equal | median within {median:.0%} and p95 within {p95:.0%}, or p95 within {times} times the noise of Cycles |
| named | another picture, and a warning says so |
| refused | no picture, and an error says why |
| different | another picture, and nothing says so |
| crash | ended by a signal, a traceback or the time limit |
| unjudged | the script gives no picture that can be compared, and nothing is said |

{table}
"""


def versions_here():
    """The oldest version, its successor with long support and the newest that have an environment here, in order."""
    found = [path.parents[1].name.removeprefix(".venv-") for path in ROOT.glob(".venv-*/bin/python")]
    found = sorted((name for name in found if re.fullmatch(r"\d+\.\d+", name)), key=number)
    return [name for name in found if name in ("4.2", "4.5", *found[-1:])]


def number(version):
    """A version as numbers, for sorting."""
    return [int(part) for part in version.split(".")]


def find_cases(folder, only):
    """The scripts of all cases, or of those whose name begins with one of `only`."""
    found = sorted([*folder.glob("[0-9]*.py"), *folder.glob("passing/[0-9]*.py")], key=lambda path: path.stem)
    return [path for path in found if not only or path.stem.startswith(tuple(only))]


def play(case, version):
    """The record of one case in one version."""
    environment = os.environ | {"RELUME_REPO": str(ROOT), "QA_OUT": str(OUT)}
    try:
        done = subprocess.run(
            [ROOT / f".venv-{version}/bin/python", case],
            env=environment,
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
        status, output = done.returncode, done.stdout
    except subprocess.TimeoutExpired:
        status, output = "hang", ""
    lines = [line.removeprefix("QA ") for line in output.splitlines() if line.startswith("QA ")]
    found = json.loads(lines[-1]) if lines else without_line(case, version, status)
    if found.get("error") == "build failed":
        found = {"error": ["the script does not run in this version"]}
    return record(case.stem, version, {"expect": expected(case)} | found)


def expected(case):
    """Expectation of a case's script."""
    said = re.search(r'expect="([^"]*)"', case.read_text())
    return said[1] if said else "equal"


def without_line(case, version, status):
    """Messages of the command line where the script failed later, as where Cycles writes other files than it reads."""
    log = OUT / f"{case.stem}-{version}" / "bake.log"
    if status != 1 or not log.exists():
        return {"bake": status}
    events = [json.loads(line) for line in log.read_text().splitlines() if line.startswith('{"')]
    said = {kind: [e["message"] for e in events if e.get("event") == kind] for kind in ("warning", "error")}
    return said | {"bake": int(bool(said["error"]))}


def record(case, version, found):
    """Record of a case's line, as it is kept."""
    warnings = [*found.get("warning", []), *found.get("relight_warning", [])]
    errors = [*found.get("error", []), *found.get("relight_error", [])]
    return {
        "case": case,
        "version": version,
        "expect": found["expect"],
        **{name: found.get(name) for name in MEASURES},
        "warnings": [FOLDER_PATH.sub("", text) for text in warnings],
        "errors": [FOLDER_PATH.sub("", text) for text in errors],
        "verdict": verdict(found, bool(warnings)),
    }


def verdict(found, warned):
    """Which of the page's verdicts a case's line deserves."""
    codes = [found.get("bake", 0), found.get("relight", 0)]
    if "traceback" in found or any(code == "hang" or code < 0 for code in codes):
        return "crash"
    if any(codes):
        return "refused" if found.get("error") or found.get("relight_error") else "crash"
    if found.get("median") is None:
        return "named" if warned else "different" if "shapes" in found else "unjudged"
    if found.get("finite", True) and is_equal(found):
        return "equal"
    return "named" if warned else "different"


def is_equal(found):
    """True if a measured picture is that of Cycles."""
    within = found["median"] <= MEDIAN_LIMIT and found["p95"] <= P95_LIMIT
    return within or found["p95"] <= TIMES_NOISE * found["noise_p95"]


def is_met(kept):
    """True if a record is what its case expects, which is said in words. Where a feature may be named, an equal picture
    is better still; a note has to be there."""
    words = {
        "equal": r"equal|as Cycles|near|\bbut\b|region",
        "named": r"named|\bnote\b|\bsaid\b|differs",
        "refused": r"refused",
    }
    accepted = [name for name, pattern in words.items() if re.search(pattern, kept["expect"])]
    is_equal = kept["verdict"] == "equal" and "named" in accepted
    return kept["verdict"] in accepted or (is_equal and ("named" in kept["expect"] or bool(kept["warnings"])))


def page(records):
    """Text of `docs/bench/cases.md` from the records."""
    judged = [kept for kept in records if kept["verdict"] != "unjudged"]
    return TEXT.format(
        met=sum(map(is_met, judged)),
        all=len(judged),
        median=MEDIAN_LIMIT,
        p95=P95_LIMIT,
        times=TIMES_NOISE,
        table=rows(["case", "Blender", "expected", "verdict", *HEADS, "said"], map(cells, records)),
    )


HEADS = ("median", "p95", "mean ratio", "noise")


def cells(kept):
    """A record's row of the page, in which a verdict that is not as expected is bold."""
    shown = kept["verdict"] if is_met(kept) or kept["verdict"] == "unjudged" else f"**{kept['verdict']}**"
    figures = ["" if kept[name] is None else f"{kept[name]:.4g}" for name in MEASURES]
    said = [text.replace("|", "\\|").replace("\n", " ") for text in [*kept["errors"], *kept["warnings"]]]
    more = [f"and {len(said) - 3} more"] if len(said) > 3 else []
    return [kept["case"], kept["version"], kept["expect"], shown, *figures, "<br>".join([*said[:3], *more])]


def keep(new):
    """Replaces the records of the same cases and versions, and the page."""
    kept = {(old["case"], old["version"]): old for old in json.loads(RECORDS.read_text())} if RECORDS.exists() else {}
    kept |= {(one["case"], one["version"]): one for one in new}
    records = [kept[key] for key in sorted(kept, key=lambda key: (key[0], number(key[1])))]
    RECORDS.write_text(json.dumps(records, indent=1, ensure_ascii=False) + "\n")
    PAGE.write_text(page(records))


def line(kept):
    """A record for the terminal."""
    figures = "  ".join("" if kept[name] is None else f"{name} {kept[name]:.4g}" for name in MEASURES)
    return (
        f"{'ok   ' if is_met(kept) else 'WRONG'} {kept['case']:<32} {kept['version']}  {kept['verdict']:<9}  {figures}"
    )


def main():
    """Plays cases, two at a time, and keeps each record as soon as it is there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("RELUME_CASES") or ROOT.parent / "shared/cases"
    parser.add_argument("--folder", type=Path, default=default, help="where the cases are")
    parser.add_argument("--only", nargs="+", metavar="NN", help="cases whose names begin so")
    parser.add_argument("--version", nargs="+", dest="versions", help="Blender versions")
    parser.add_argument("--at-once", type=int, choices=(1, 2), default=2, help="cases side by side")
    args = parser.parse_args()
    folder = Path(args.folder)
    if not folder.is_dir():
        print(f"cases: skipped, {folder} is not here; RELUME_CASES names another folder")
        return
    OUT.mkdir(parents=True, exist_ok=True)
    plays = [(case, v) for case in find_cases(folder, args.only) for v in args.versions or versions_here()]
    with ThreadPoolExecutor(args.at_once) as pool:
        for kept in pool.map(lambda one: play(*one), plays):
            keep([kept])
            print(line(kept), flush=True)


if __name__ == "__main__":
    main()
