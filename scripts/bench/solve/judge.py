"""Client of `judge_server.py`: Cycles in a process of its own."""

import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent


class Cycles:
    """An open .blend file that takes lights and makes pictures. Methods are those of `judge_server.Judge`."""

    def __init__(self, python, threads=0):
        command = [str(python), str(HERE / "judge_server.py")]
        if threads:
            command = ["taskset", "--cpu-list", f"0-{threads - 1}", *command]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )

    def __getattr__(self, name):
        return lambda **arguments: self._call(name, arguments)

    def _call(self, name, arguments):
        self.process.stdin.write(json.dumps({"do": name, **arguments}) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"Cycles ended in {name}; run {HERE / 'judge_server.py'} by hand to see why")
        return json.loads(line)

    def picture(self, samples, seed):
        """A denoised render, scene-linear [height, width, 3], top row first."""
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "picture.npy")
            self._call("render", {"samples": samples, "seed": seed, "out": path})
            return np.load(path)

    def close(self):
        """Ends the process."""
        self.process.stdin.close()
        self.process.wait()
