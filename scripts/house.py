"""Figures of how readable the code is, to compare over time: scripts/house.py [--json FILE] [--keep NAME]

Reads what git tracks, as text: nothing is built or imported. Prints the names behind each count, then the counts.
--keep puts both under a name into docs/bench/house.json, and writes the page beside it anew.
"""

import argparse
import ast
import json
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))
from bench.markdown import rows  # noqa: E402
from code_map import RustFile, addon_circles, item_end, rust_circles  # noqa: E402
from sentences import lengths, percentile  # noqa: E402

KEPT = ROOT / "docs/bench/house.json"
LONG_FUNCTION, LONG_FILE = 80, 400
FOLDERS = ("blend_tests/window", "blend_tests", "fuzz", "scripts", "shaders", "tests")
KINDS = {
    "addon": "add-on",
    "blend_tests/window": "window",
    "blend_tests": "tests",
    "tests": "tests",
    "scripts": "scripts",
}
# Types inside a trait or an implementation are indented, and are no homonyms.
TYPES = re.compile(r"^(?:\s*(pub\S* )?(?:unsafe )?(?:struct|enum|trait|union)|(pub\S* )?type) (\w+)", re.M)
TIMER = "bpy.app.timers.register"
OPENERS = ("As", "Of", "The same", "What", "Whether")
PAGE = """# Figures of the code

Made by `scripts/house.py --keep NAME`. The names behind each count are in `house.json`. Columns are commits.

- A circle is a group of modules that use each other, directly or not. In crates, code of tests has no part in it.
- Types, functions and circles of Rust are those outside of tests.
- Types are counted in crates and in packages of the add-on. Private ones are those that only their file sees.
- `all` counts lines of code and lines of tests apart, and tests.

"""


def part_of(name):
    """Part of the repository that a file counts for: a crate, a package of the add-on, a folder; None for others."""
    parts = name.split("/")
    if parts[0] in ("rust", "addon") and len(parts) > 2:
        return "/".join(parts[:2])
    return next((part for part in (*FOLDERS, "addon") if name.startswith(part + "/")), None)


def read_rust(root, names):
    """Rust files of `names`, of which test code is left out."""
    files = [RustFile(root, name) for name in names if name.startswith("rust/")]
    hidden = {(file.crate, *file.module, module) for file in files for module in file.test_modules}
    for file in files:
        path = (file.crate, *file.module)
        if file.is_test or any(path[:end] in hidden for end in range(2, len(path) + 1)):
            file.code = ""
    return files


def functions(rust, python):
    """Functions by kind of code: (lines, file and name) each."""
    found = {kind: [] for kind in ("rust", *KINDS.values())}
    for file in rust:
        for start in re.finditer(r"\bfn +(\w+)", file.code):
            end, has_block = item_end(file.code, start.end())
            if has_block:
                found["rust"].append((file.code.count("\n", start.start(), end) + 1, f"{file.name}: {start[1]}"))
    for name, tree in python.items():
        kind = next((kind for folder, kind in KINDS.items() if name.startswith(folder + "/")), None)
        for node in ast.walk(tree):
            if kind and isinstance(node, ast.FunctionDef):
                found[kind].append((node.end_lineno - node.lineno + 1, f"{name}: {node.name}"))
    return {kind: sorted(those, reverse=True) for kind, those in found.items()}


def homonyms(rust, python):
    """Types whose name stands in several parts, the same of types that are not private, and types whose name stands in
    several files of one part."""
    seen = [
        (match[3], file.name, bool(match[1] or match[2])) for file in rust for match in TYPES.finditer(file.code)
    ] + [
        (node.name, name, not node.name.startswith("_"))
        for name, tree in python.items()
        if name.startswith("addon/")
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    ]
    parts, shared, files = (defaultdict(set) for _ in range(3))
    for name, file, is_shared in sorted(seen):
        parts[name].add(part_of(file))
        files[name, part_of(file)].add(file)
        if is_shared:
            shared[name].add(part_of(file))
    several, visible = ({name: sorted(of) for name, of in one.items() if len(of) > 1} for one in (parts, shared))
    return several, visible, {f"{part}: {name}": sorted(of) for (name, part), of in files.items() if len(of) > 1}


def doc_starts(rust, python):
    """First words of each documentation comment and docstring."""
    for file in rust:
        yield from (block.strip(" \t/!") for block in re.findall(r"(?:^[ \t]*//[/!].*\n)+", file.raw, re.M))
    for tree in python.values():
        values = (node.value for node in ast.walk(tree) if isinstance(node, ast.Expr))
        yield from (one.value for one in values if isinstance(one, ast.Constant) and isinstance(one.value, str))


def parts(texts, rust):
    """Lines of each part, those of test code apart, and its number of tests."""
    found = {part: {"lines": 0, "test lines": 0, "tests": 0} for part in ["all", *sorted({*map(part_of, texts)})]}
    own = {file.name: file.code.count("\n") for file in rust}
    for name, text in sorted(texts.items()):
        count = text.count("\n")
        source = own.get(name, 0 if "tests/" in name else count)
        can_test = name.endswith(".rs") or Path(name).name.startswith("test_")
        tests = can_test * len(re.findall(r"^[ \t]*(?:#\[test\]|def test_)", text, re.M))
        for part in ("all", part_of(name)):
            for what, more in (("lines", source), ("test lines", count - source), ("tests", tests)):
                found[part][what] += more
    return found


def measure(root):
    """All figures of a checkout, and the names behind them."""
    names = subprocess.check_output(["git", "ls-files"], cwd=root, text=True).split()
    names = [name for name in names if (root / name).is_file()]
    sources = [name for name in names if part_of(name) and Path(name).suffix in (".py", ".rs", ".wgsl", "")]
    texts = {name: (root / name).read_text() for name in sources}
    rust = read_rust(root, [name for name in texts if name.endswith(".rs")])
    python = {name: ast.parse(text) for name, text in texts.items() if name.endswith(".py")}
    addon = [node for name, tree in python.items() if name.startswith("addon/") for node in ast.walk(tree)]
    found = functions(rust, python)
    counts = {kind: sorted(length for length, _ in those) for kind, those in found.items()}
    crates = defaultdict(list)
    for file in rust:
        if file.code and "/src/" in file.name:
            crates[file.crate].append(file)
    in_crates = {crate: rust_circles(files) for crate, files in sorted(crates.items())}
    several, visible, twice = homonyms(rust, python)
    modules, packages = addon_circles(root)
    starts = list(doc_starts(rust, python))
    return {
        "types of one name in several parts": several,
        "types of one name in several parts, private ones aside": visible,
        "types of one name in several files of a part": twice,
        "import circles of add-on modules": modules,
        "import circles of add-on packages": packages,
        "circles in crates": {crate: both[0] for crate, both in in_crates.items() if both[0]},
        "circles in crates, uses of parents aside": {crate: both[1] for crate, both in in_crates.items() if both[1]},
        "timers registered": sum(isinstance(node, ast.Call) and ast.unparse(node.func) == TIMER for node in addon),
        "global statements": sum(isinstance(node, ast.Global) for node in addon),
        f"functions above {LONG_FUNCTION} lines": {
            name: length for those in found.values() for length, name in those if length > LONG_FUNCTION
        },
        f"files above {LONG_FILE} lines": {
            name: count for name, text in texts.items() if (count := text.count("\n")) > LONG_FILE
        },
        "doc comments that begin with": {
            word: sum(bool(re.match(rf"{word}\b", start)) for start in starts) for word in OPENERS
        },
        "lines of functions": {
            kind: {"functions": len(those), "median": percentile(those, 0.5), "p90": percentile(those, 0.9)}
            | {"longest": those[-1]}
            for kind, those in counts.items()
        },
        "words of sentences": {
            name: {"median": percentile(those, 0.5), "p90": percentile(those, 0.9)}
            for name in names
            if re.fullmatch(r"(docs/)?[\w-]+\.md", name) and (those := lengths((root / name).read_text()))
        },
        "parts": parts(texts, rust),
    }


def cells(figures):
    """Rows of a table: name -> text."""
    found = {}
    for name, value in figures.items():
        inner = list(value.values()) if isinstance(value, dict) else []
        if inner and isinstance(inner[0], dict):
            for key, those in value.items():
                found[f"{key}: {', '.join(those)}"] = " / ".join(map(str, those.values()))
        elif name.startswith("doc"):
            found |= {f"{name} {word}": str(count) for word, count in value.items()}
        elif name.startswith("circles"):
            found[name] = str(sum(map(len, inner)))
        else:
            found[name] = str(value if isinstance(value, int) else len(value))
    return found


def page(kept):
    """Table in Markdown of kept figures, a column for each name."""
    columns = {name: cells(figures) for name, figures in kept.items()}
    labels = dict.fromkeys(label for column in columns.values() for label in column)
    lines = [[label, *(column.get(label, "") for column in columns.values())] for label in labels]
    return rows(["", *columns], lines) + "\n"


def main():
    """See the first lines of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=ROOT, help="another checkout")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures and names there")
    parser.add_argument("--keep", metavar="NAME", help="keep them in docs/bench under this name, such as a commit")
    options = parser.parse_args()
    figures = measure(options.root.resolve())
    for name, value in figures.items():
        if name not in ("lines of functions", "words of sentences", "parts") and not isinstance(value, int):
            print(f"{name}:", *(f"  {one}" for one in (value.items() if isinstance(value, dict) else value)), sep="\n")
    print("\n" + page({"now": figures}))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    if options.keep:
        kept = (json.loads(KEPT.read_text()) if KEPT.exists() else {}) | {options.keep: figures}
        KEPT.write_text(json.dumps(kept, indent=1) + "\n")
        KEPT.with_suffix(".md").write_text(PAGE + page(kept))


if __name__ == "__main__":
    main()
