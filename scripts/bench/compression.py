"""Bytes of a bake's records, and what quick lossless compression of its shards would give and cost.

    python scripts/bench/compression.py BAKE... --keep docs/bench/dump/compression.json

Each tensor is tried as it is and with its bytes in planes: all first bytes, then all second ones. Speeds are those of
one thread in memory, as the programs `zstd` and `lz4` measure them; beside them the speed at which the same bytes are
read from a mapping that is in memory, by the same thread.
"""

import argparse
import json
import re
import struct
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

# Program, its level, and how it prints its figures.
COMPRESSORS = {"zstd 1": ["zstd", "-b1", "-i1", "-q"], "lz4": ["lz4", "-b1", "-i1"]}
FIGURES = re.compile(r"\(([\d.]+)\),? *([\d.]+) MB/s *,? *([\d.]+) MB/s")
RECORD_TENSORS = ("position_xy", "position_z_flags", "throughput")


def tensors(path: Path) -> Iterator[tuple[str, bytes]]:
    """Name and bytes of each tensor of a shard."""
    data = path.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    for name, about in json.loads(data[8 : 8 + length]).items():
        if name != "__metadata__":
            start, end = about["data_offsets"]
            yield name, data[8 + length + start : 8 + length + end]


def in_planes(data: bytes) -> bytes:
    """The bytes of 32-bit words, plane by plane."""
    return np.frombuffer(data, np.uint8).reshape(-1, 4).T.tobytes()


def tried(path: Path) -> dict[str, dict[str, float]]:
    """Ratio and GB/s of each compressor on a file."""
    results = {}
    for name, command in COMPRESSORS.items():
        printed = subprocess.run([*command, path], capture_output=True, text=True, check=True)
        found = FIGURES.findall((printed.stdout + printed.stderr).replace("\r", "\n"))
        ratio, compress, decompress = map(float, found[-1])
        results[name] = {"ratio": ratio, "compress": compress / 1000, "decompress": decompress / 1000}
    return results


def mapped(path: Path) -> float:
    """GB/s at which words of a mapping are summed up, once it is in memory."""
    best = float("inf")
    for _ in range(4):
        words = np.memmap(path, np.uint32, "r")
        start = time.perf_counter()
        words.sum()
        best = min(best, time.perf_counter() - start)
    return words.nbytes / best / 1e9


def measured(bake: Path) -> dict[str, Any]:
    """Figures of a bake."""
    shards = sorted(bake.glob("tile_*.safetensors"))
    parts: dict[str, list[bytes]] = {}
    for shard in shards:
        for name, data in tensors(shard):
            parts.setdefault(name, []).append(data)
    records = sum(map(len, parts["throughput"])) // 4
    on_disk = sum(shard.stat().st_size for shard in shards)
    of_records = sum(len(data) for name in RECORD_TENSORS for data in parts.get(name, []))
    result: dict[str, Any] = {
        "records": records,
        "bytes": on_disk,
        "bytes_a_record": on_disk / records,
        "bytes_a_record_without_pixels": of_records / records,
        "tensors": {},
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tensor"
        for name, data in parts.items():
            file.write_bytes(b"".join(data))
            about: dict[str, Any] = {
                "share": sum(map(len, data)) / on_disk,
                "mapped": mapped(file),
                "as it is": tried(file),
            }
            file.write_bytes(b"".join(map(in_planes, data)))
            result["tensors"][name] = about | {"in planes": tried(file)}
    for name in COMPRESSORS:
        for order in ("as it is", "in planes"):
            figures = [(about["share"], about[order][name]) for about in result["tensors"].values()]
            size = sum(share / figure["ratio"] for share, figure in figures)
            seconds = sum(share / figure["decompress"] for share, figure in figures)
            result[f"{name}, {order}"] = {"ratio": 1 / size, "decompress": 1 / seconds}
    seconds = sum(about["share"] / about["mapped"] for about in result["tensors"].values())
    return result | {"mapped": 1 / seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("bakes", nargs="+", type=Path, help="bake folders")
    parser.add_argument("--keep", type=Path, help="file for the figures")
    arguments = parser.parse_args()
    figures = {bake.name: measured(bake) for bake in arguments.bakes}
    text = json.dumps(figures, indent=1, default=float) + "\n"
    text = re.sub(r"\d+\.\d+", lambda number: f"{float(number[0]):.4g}", text)
    print(text)
    if arguments.keep:
        arguments.keep.write_text(text)


if __name__ == "__main__":
    main()
