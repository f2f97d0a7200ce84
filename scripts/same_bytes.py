"""Hashes of bakes and gathered pictures from a fixed seed, to see that a change of the code changes no picture:
`.venv-4.2/bin/python scripts/same_bytes.py > before.json`, later the same into `after.json`, and compare."""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import relume

ROOT = Path(__file__).resolve().parents[1]
SCENES = Path(os.environ.get("RELUME_SCENES", ROOT.parent / "shared/scenes"))
RELUME = (sys.executable, "-m", "relume", "--quiet", "--seed", "7", "--device", "cpu")
DEMO = ROOT / "out/same_bytes/demo.blend"
"""Made once: Blender's primitives are others each time by a last bit."""

NAMES = ("demo", "cornell_box", "modern_hall")
SIZE, SAMPLES = "160x90", "32"


def run(*command):
    """Runs a program."""
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)


def file_hashes(folder):
    """SHA-256 of each array file of a bake folder; JSON files hold times and versions."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".json")
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def hashes(name, folder):
    """Hashes of a scene's bake, and of the gathered pictures of its own lights."""
    blend = DEMO if name == "demo" else SCENES / f"{name}.blend"
    if not blend.exists():
        blend.parent.mkdir(parents=True, exist_ok=True)
        run(sys.executable, ROOT / "scripts/demo/make_scene.py", blend)
    scene, bake = folder / f"{name}.scene", folder / name
    run(sys.executable, ROOT / "relume_bake.py", blend, "--", "export", "--out", scene, "--resolution", SIZE)
    run(*RELUME, "trace", scene, "--samples", SAMPLES, "--out", bake)
    found = file_hashes(bake)
    whole = hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()
    passes = relume.Relighter(bake).relight(denoise=False)
    passes |= {f"light {name}": picture for name, picture in passes.pop("lights").items()}
    pictures = {key: hashlib.sha256(np.ascontiguousarray(passes[key]).tobytes()).hexdigest() for key in sorted(passes)}
    return {"bake": whole, "files": len(found), "pictures": pictures}


def main():
    """Prints the hashes of each scene as JSON."""
    with tempfile.TemporaryDirectory(prefix="relume-bytes-") as folder:
        print(json.dumps({name: hashes(name, Path(folder)) for name in NAMES}, indent=1))


if __name__ == "__main__":
    main()
