"""Starts the solver on the bake of a shot. It works on threads of its own, and is polled."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...core.solve import SolveError
from ..native import NativeModuleError, native
from ..shot import open_shots
from ..shot.shot import Shot


def start(shot: Shot, request: dict[str, Any], images: dict[str, np.ndarray], folders: list[Path]) -> Any:
    """A `relume.Job` whose result is the solver's answer, by the bakes of its views. Raises SolveError with one line
    for the artist."""
    options = shot.options
    compute = {"device": options.device, "gpu_memory": options.gpu_memory, "threads": options.threads}
    try:
        return native().solve(
            list(map(str, folders)), json.dumps(request), images, shots=open_shots.natives(), **compute
        )
    except (NativeModuleError, RuntimeError, ValueError) as error:
        raise SolveError(one_line(error)) from error


def answer(job: Any) -> dict[str, Any]:
    """The answer of a job that is done. Raises SolveError."""
    try:
        return job.result()
    except (RuntimeError, ValueError) as error:
        raise SolveError(one_line(error)) from error


def one_line(error: BaseException) -> str:
    """Message of an error, without line breaks."""
    return " ".join(str(error).split()) or repr(error)
