"""Table of every shader node, option, socket and setting that Blender tells of, and of what becomes of it.

    scripts/coverage.py [VERSION ...]

Asks the oldest and the newest Blender that are here, or those of the versions, and the tables that decide:
`blend_tests/nodes_table.py` and `blend_tests/settings_table.py`. Writes `docs/bench/coverage.json` and
`docs/coverage.md`."""

import argparse
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECORDS, PAGE = ROOT / "docs/bench/coverage.json", ROOT / "docs/coverage.md"
EQUAL, APPROXIMATED, NOT, NONE = "equal", "approximated", "not", "none"
STATUSES = (EQUAL, APPROXIMATED, NOT)
KINDS = {"node": "shader nodes", "option": "options of nodes", "socket": "sockets of nodes", "setting": "settings"}
HEAD = """# What of Cycles Relume has

Written by `make coverage` from Blender's own lists and from the decisions in `blend_tests/nodes_table.py` and
`blend_tests/settings_table.py`. Tests ask for a decision on each node and setting of every Blender version.
What changes no picture of Cycles is left out here.
"""


def collect():
    """Everything that the running Blender tells of, as records, on standard output."""
    sys.path[:0] = [str(ROOT), str(ROOT / "blend_tests")]
    from blender_lists import own_properties, shader_nodes
    from nodes_table import OPTIONS, SOCKETS, decision
    from settings_table import TABLE, decision_on

    records = []
    for kind, node in shader_nodes().items():
        status, words = decision(kind) or ("undecided", "")
        records.append(["node", kind, "", status, words])
        for prop, items in node["options"].items():
            for item in items:
                records.append(["option", kind, f"{prop} {item}", *OPTIONS.get((kind, prop, item), (status, words))])
        for socket in dict.fromkeys([*node["inputs"], *node["outputs"]]):
            records.append(["socket", kind, socket, *SOCKETS.get((kind, socket), (status, words))])
    for structure in TABLE:
        for prop in own_properties(structure):
            records.append(["setting", structure, prop, *fate(decision_on(structure, prop))])
    print(json.dumps(records))


def fate(reason):
    """Status and words of a decision on a setting."""
    if reason is None:
        return "undecided", ""
    if reason.startswith(("read", "exported")) or reason == "of hair":
        return EQUAL, ""
    if reason.startswith(APPROXIMATED):
        return APPROXIMATED, reason.removeprefix(f"{APPROXIMATED}: ")
    if reason in {"named", "refused"}:
        return NOT, reason
    # Such as "of culling, which each object names".
    is_left_out = "name" in reason.split("than the")[0] or "refused" in reason
    return (NOT, reason) if is_left_out and "another unit" not in reason else (NONE, reason)


def versions_here():
    """Blender versions with an environment, the oldest first."""
    found = [path.parents[1].name.removeprefix(".venv-") for path in ROOT.glob(".venv-*/bin/python")]
    return sorted(found, key=lambda version: [int(part) for part in version.split(".")])


def asked(version):
    """Records of one Blender version, by kind, owner and name."""
    python = ROOT / f".venv-{version}/bin/python"
    done = subprocess.run([python, __file__, "--collect"], capture_output=True, text=True, check=True)
    records = json.loads(done.stdout.splitlines()[-1])
    return {tuple(record[:3]): tuple(record[3:]) for record in records}


def merged(by_version):
    """One record for each thing, with the versions that have it; those of the newest version count."""
    keys = dict.fromkeys(key for found in by_version.values() for key in found)
    records = []
    for kind, owner, name in sorted(keys, key=lambda key: (list(KINDS).index(key[0]), key[1:])):
        having = [version for version, found in by_version.items() if (kind, owner, name) in found]
        status, words = by_version[having[-1]][kind, owner, name]
        what = {"kind": kind, "of": owner, "name": name, "versions": having, "status": status, "words": words}
        records.append(what)
    return records


def counts(records, version):
    """Numbers of each status by kind in a version."""
    here = [record for record in records if version in record["versions"]]
    return {kind: Counter(record["status"] for record in here if record["kind"] == kind) for kind in KINDS}


def page(records, versions):
    """The readable table."""
    lines = [HEAD, "| | Blender | equal | approximated | not | equal of all |", "|---|---|---|---|---|---|"]
    for version in versions:
        found = counts(records, version)
        total = sum(found.values(), Counter())
        for words, kind in [*((words, found[kind]) for kind, words in KINDS.items()), ("**all**", total)]:
            known = [kind[status] for status in STATUSES]
            lines.append(f"| {words} | {version} | {' | '.join(map(str, known))} | {kind[EQUAL] / sum(known):.1%} |")
    lines += [
        "",
        "## Approximated, or not there",
        "",
        "| what | Blender | status | how, or what instead |",
        "|---|---|---|---|",
    ]
    owners = {record["of"]: record for record in records if record["kind"] == "node"}
    for record in records:
        owner = owners.get(record["of"])
        is_told = owner is not None and owner is not record and record["status"] == owner["status"]
        if record["status"] in {APPROXIMATED, NOT} and not is_told:
            name = " ".join(filter(None, (record["of"], record["name"])))
            lines.append(f"| `{name}` | {', '.join(record['versions'])} | {record['status']} | {record['words']} |")
    lines += ["", "## Equal", ""]
    equal = [record["of"] for record in records if record["kind"] == "node" and record["status"] == EQUAL]
    lines.append(", ".join(f"`{name}`" for name in equal) + ".")
    return "\n".join(lines) + "\n"


def main():
    """Asks, writes, and fails where something is undecided."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("versions", nargs="*", help="Blender versions; default: the oldest and the newest here")
    parser.add_argument("--collect", action="store_true", help="tell of this Blender alone")
    options = parser.parse_args()
    if options.collect:
        return collect()
    here = versions_here()
    versions = options.versions or list(dict.fromkeys((here[0], here[-1])))
    records = merged({version: asked(version) for version in versions})
    summary = {version: counts(records, version) for version in versions}
    lines = ",\n".join(json.dumps(record) for record in records)
    text = f'{{"counts": {json.dumps(summary)},\n"records": [\n{lines}\n]}}\n'
    RECORDS.write_text(text, encoding="utf-8")
    PAGE.write_text(page(records, versions), encoding="utf-8")
    undecided = [f"{record['of']} {record['name']}" for record in records if record["status"] == "undecided"]
    return f"undecided: {', '.join(undecided)}" if undecided else 0


if __name__ == "__main__":
    sys.exit(main())
