"""docs/bench/README.md is the table of the figures beside it."""

import importlib.util
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def test_table_of_gpu_benchmarks_is_up_to_date():
    spec = importlib.util.spec_from_file_location("gpu", ROOT / "scripts/bench/gpu.py")
    gpu = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(gpu)
    kept = ROOT / "docs/bench"
    assert list(kept.glob("*.json"))
    assert (kept / "README.md").read_text() == gpu.table(kept)
