"""Light solving measured: the paper's table 3 and figure 9, and painted strokes. Writes `out/solve.json`: `make solve`.

Records of the same settings that are there already are kept, so that a stopped run goes on; delete the file to begin
anew. With --keep they are those of `docs/bench/solve`, where runs of many days add up, and the tables go there too.
Bakes stay in `out/solve`. Runs in a Python with `bpy` and `relume`; Mitsuba lives in an environment of its own.
"""

import argparse
import contextlib
import io
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(ROOT), str(HERE)]

import figure9  # noqa: E402
import scribbles  # noqa: E402
import table3  # noqa: E402
from judge import Cycles  # noqa: E402
from records import GENERAL, Records  # noqa: E402
from shot import Shot  # noqa: E402

TABLES = {"3": table3, "9": figure9, "scribbles": scribbles}
RUNS = {"3": 5, "9": 50, "scribbles": 5}
QUICK_PICTURES = {"size": 96, "steps": 100, "peer_steps": 100, "samples": 16, "bake_samples": 64}
QUICK = QUICK_PICTURES | {"runs": 1, "fractions": [0.05], "lights": [1, 3]}
KEPT = ROOT / "docs/bench/solve"
SIZES = {"3": 320, "9": 128, "scribbles": 320}


def arguments():
    """The command line; `--quick` changes defaults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", nargs="+", choices=TABLES, default=list(TABLES))
    parser.add_argument("--scenes", nargs="+", help="default: all of each table")
    parser.add_argument("--runs", type=int, help="default: 5 of table 3, 50 of figure 9, 5 of scribbles")
    parser.add_argument("--seed", type=int, default=0, help="of scribbles: of other hidden changes and strokes")
    parser.add_argument("--lights", nargs="+", type=int, help="of table 3; default: 1 3 5 20")
    parser.add_argument("--fractions", nargs="+", type=float, help="of table 3; default: the paper's six")
    parser.add_argument("--starts", nargs="+", type=int, default=[1, 4], help="of table 3; more than one at 5 %% only")
    parser.add_argument(
        "--least-cells",
        type=int,
        default=128,
        help="of table 3, that a step looks at; as in the add-on. Of the paper's 885 x 500 pixels 0.1 %% are some 440",
    )
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--peer-steps", type=int, default=500, help="of Mitsuba in figure 9; the paper's are 500")
    parser.add_argument("--size", type=int, help="longer edge of the pictures; default: 320, and 128 for figure 9")
    parser.add_argument("--samples", type=int, default=128, help="of Cycles' denoised renders")
    parser.add_argument("--bake-samples", type=int, default=256)
    parser.add_argument("--through", choices=("auto", "proxy", "gather"), default="auto")
    parser.add_argument("--train", type=float, default=0.0, help="seconds to train a proxy of sphere lights first")
    parser.add_argument("--threads", type=int, default=0, help="0 for one a core")
    parser.add_argument("--quick", action="store_true", help="small pictures, few runs: whether it works")
    parser.add_argument("--keep", action="store_true", help="add to the records and tables in docs/bench")
    parser.add_argument("--blender", type=Path, default=sys.executable, help="python with bpy that renders")
    parser.add_argument("--peers", type=Path, help="python with mitsuba; figure 9 shows Relume alone without")
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    if "--quick" in sys.argv:
        parser.set_defaults(**QUICK)
    args = parser.parse_args()
    args.scenes_folder = Path(os.environ.get("RELUME_SCENES") or ROOT.parent / "shared/scenes")
    args.out = args.out.resolve()
    return args


def main():
    args = arguments()
    if not args.scenes_folder.is_dir():
        sys.exit(f"solve: the scenes are not in {args.scenes_folder}; set RELUME_SCENES")
    (args.out / "solve").mkdir(parents=True, exist_ok=True)
    records = Records(KEPT / "records.json" if args.keep else args.out / "solve.json")
    judge = Cycles(args.blender, args.threads)
    asked = args.runs, args.size
    for table in args.table:
        module = TABLES[table]
        args.runs, args.size = (value or default[table] for value, default in zip(asked, (RUNS, SIZES), strict=True))
        for name in args.scenes or module.SCENES:
            if name in module.SCENES:
                print(f"{table}: {name}", flush=True)
                module.run(Shot(judge, name, args), records, args)
    judge.close()
    if args.keep:
        (KEPT / "README.md").write_text(page(records))
    for table in args.table:
        TABLES[table].show(records)


def page(records):
    """All tables as a document, with the settings of what is in them."""
    made_by = 'Made by `make solve SOLVE="--keep ..."` from the records beside it.'
    text = f"# Lights found again\n\n{made_by}\n"
    for number, table in TABLES.items():
        found = records.select(table=number)
        shown = io.StringIO()
        with contextlib.redirect_stdout(shown):
            table.show(records)
        settings = sorted({", ".join(f"{key} {record[key]}" for key in GENERAL) for record in found})
        settings = "" if number == "3" else f"\n{'; '.join(settings)}\n"
        text += f"\n```text\n{shown.getvalue().strip()}\n```\n{settings}" if found else ""
    return text


if __name__ == "__main__":
    main()
