"""A scene of the benchmark: its bake, made once, and solving with it."""

import json
import subprocess
import sys
import time
from pathlib import Path

import relume

ROOT = Path(__file__).resolve().parents[3]
POLL_SECONDS = 0.02


class Shot:
    """A .blend file at the benchmark's size, baked and open in Cycles."""

    def __init__(self, judge, name, args):
        self.judge, self.name, self.args = judge, name, args
        self.size = args.size
        self.blend = args.scenes_folder / f"{name}.blend"
        self.folder = args.out / "solve" / f"{name}-{self.size}-{args.bake_samples}"

    def open(self, bare):
        """Opens the file in Cycles and bakes it if that is not done; `bare` is as of the judge."""
        self.resolution = self.judge.open(blend=str(self.blend), size=self.size, bare=bare)
        self._bake()
        self._train()
        return self

    def picture(self, seed):
        """A render of the lights that are set."""
        return self.judge.picture(self.args.samples, seed)

    def solve(self, request, images=None, on_preview=None):
        """The result of `relume.solve`, with processor seconds; better lights go to `on_preview(seconds, lights)`."""
        general = {"steps": self.args.steps, "through": self.args.through}
        text = json.dumps(general | request)
        start, processor = time.perf_counter(), time.process_time()
        job = relume.solve([str(self.folder)], text, images or {}, threads=self.args.threads)
        while not job.done:
            self._preview(job, start, on_preview)
            time.sleep(POLL_SECONDS)
        self._preview(job, start, on_preview)
        return job.result() | {"processor_seconds": time.process_time() - processor}

    def _preview(self, job, start, on_preview):
        found = on_preview and job.preview()
        if found:
            on_preview(time.perf_counter() - start, found["lights"])

    def _bake(self):
        print(f"  bake of {self.name}", flush=True)
        size = "{width}x{height}".format(**self.resolution)
        options = ("--samples", self.args.bake_samples, "--resolution", size, "--threads", self.args.threads, "--quiet")
        command = [sys.executable, ROOT / "relume_bake.py", self.blend, "--", "bake", "--out", self.folder, *options]
        command += ["--resume"] if (self.folder / "manifest.json").exists() else []
        subprocess.run([str(word) for word in command], check=True)

    def _train(self):
        if self.args.train and not (self.folder / "proxy_sphere.safetensors").exists():
            print(f"  training {self.name}", flush=True)
            options = {"type": "sphere", "seconds": self.args.train, "all_paths": True}
            relume.train(self.folder, **options).wait()
