"""Stands in for `relume.solve` where a test wants to say itself what the solver answers."""

import json

import relume


class FakeJob:
    """Remembers what was asked; `answer` ends it."""

    made = []

    def __init__(self, folders, request, images=None, *, shots=(), device="auto", gpu_memory=None, threads=0):
        self.folders, self.request, self.images = folders, json.loads(request), images or {}
        self.shots = shots
        self.is_cancelled = self.done = False
        self.reports, self.previews, self._answer, self._error = [], [], None, None
        FakeJob.made.append(self)

    def progress(self):
        """Stands in for `Job.progress`."""
        return self.reports.pop(0) if self.reports else None

    def preview(self):
        """Stands in for `Job.preview`."""
        return self.previews.pop(0) if self.previews else None

    def cancel(self):
        """Stands in for `Job.cancel`."""
        self.is_cancelled = self.done = True

    def result(self):
        """Stands in for `Job.result`."""
        if self._error:
            raise relume.RelumeError(self._error)
        return self._answer

    def fail(self, message):
        """The work ends with an error."""
        self._error, self.done = message, True

    def answer(self, changed=(), added=(), removed=(), **more):
        """The work ends well: lights as dicts of Blender's settings."""
        lights = [{"name": light["name"], "kind": {"type": light["type"]}} for light in (*changed, *added)]
        self._answer = {
            "lights": {"format": "relume-lights", "version": 1, "lights": lights},
            "world": self.request["world"],
            "changed": [light["name"] for light in changed],
            "added": [light["name"] for light in added],
            "removed": list(removed),
            "blender": [*changed, *added],
            "report": [],
            "warnings": [],
            "rarely_met": [],
            **more,
        }
        self.done = True


def light(name, kind="POINT", place=(0.0, 0.0, 2.0), **settings):
    """A light of an answer."""
    matrix = [[float(row == column) for column in range(4)] for row in range(4)]
    for row in range(3):
        matrix[row][3] = place[row]
    return {
        "name": name,
        "type": kind,
        "world_from_object": matrix,
        "energy": 50.0,
        "color": [1.0, 0.5, 0.25],
        **settings,
    }
