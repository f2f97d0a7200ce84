"""A scene of the benchmark: its bake, made once, and solving with it."""

import json
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import relume

from addon.core.solve import moved_out_of_sight, samples_towards

ROOT = Path(__file__).resolve().parents[3]
POLL_SECONDS = 0.02


def processor_seconds():
    """Processor time of this process and those that it has waited for."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


class Shot:
    """A .blend file at the benchmark's size, baked and open in Cycles."""

    def __init__(self, judge, name, args, blend=None):
        """`blend` is a file in place of the scene of that name."""
        self.judge, self.name, self.args = judge, name, args
        self.size = args.size
        # With one thread the processor's, which other work on the machine does not lengthen.
        self.clock = processor_seconds if args.threads == 1 else time.perf_counter
        self.blend = blend or args.scenes_folder / f"{name}.blend"
        self.folder = args.out / "solve" / f"{self.blend.stem}-{self.size}-{args.bake_samples}"
        self.bake_seconds = None
        """Time of the bake, Blender's start and reading of the file included, once it is there."""

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
        """The result of `relume.solve`, with processor seconds; better lights go to `on_preview(seconds, lights)`. As
        in the add-on, lights that hardly any path meets are solved on with paths that look for them."""
        general = {"steps": self.args.steps, "through": self.args.through}
        start, processor = self.clock(), processor_seconds()
        result = self._solved(self.folder, general | request, images, start, on_preview)
        if moved_out_of_sight(result, request["lights"]):
            again = general | request | {"from": result, "steps": 0, "starts": 1}
            result = self._solved(self._bake_towards(result), again, images, start, on_preview)
        seconds = {"seconds": self.clock() - start, "processor_seconds": processor_seconds() - processor}
        return result | seconds

    def _solved(self, folder, request, images, start, on_preview):
        job = relume.solve([str(folder)], json.dumps(request), images or {}, threads=self.args.threads)
        while not job.done:
            self._preview(job, start, on_preview)
            time.sleep(POLL_SECONDS)
        self._preview(job, start, on_preview)
        return job.result()

    def _preview(self, job, start, on_preview):
        found = on_preview and job.preview()
        if found:
            on_preview(self.clock() - start, found["lights"])

    def _bake(self):
        times = self.folder / "bake_seconds.json"
        if not times.exists():
            print(f"  bake of {self.name}", flush=True)
            shutil.rmtree(self.folder, ignore_errors=True)
            start = self.clock()
            self._run_bake(self.folder, "--samples", self.args.bake_samples)
            times.write_text(json.dumps(self.clock() - start))
        self.bake_seconds = json.loads(times.read_text())

    def _bake_towards(self, result):
        """A folder with a few paths that look for the lights as they are and as they were found."""
        folder = self.folder.with_name(f"{self.folder.name}-towards")
        shutil.rmtree(folder, ignore_errors=True)
        found = result["lights"]
        towards = self.folder / "towards.json"
        towards.write_text(json.dumps(found | {"lights": [*self.judge.light_set(), *found["lights"]]}))
        self._run_bake(folder, "--samples", samples_towards(self.args.bake_samples), "--towards", towards)
        return folder

    def _run_bake(self, folder, *options):
        size = "{width}x{height}".format(**self.resolution)
        general = ("--resolution", size, "--threads", self.args.threads, "--quiet")
        script = ROOT / "relume_bake.py"
        command = [sys.executable, script, self.blend, "--", "bake", "--out", folder, *general, *options]
        subprocess.run([str(word) for word in command], check=True)

    def _train(self):
        if self.args.train and not (self.folder / "proxy_sphere.safetensors").exists():
            print(f"  training {self.name}", flush=True)
            options = {"type": "sphere", "seconds": self.args.train, "all_paths": True}
            relume.train(self.folder, **options).wait()
