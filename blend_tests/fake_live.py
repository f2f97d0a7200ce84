"""Stands in for `relume.Live` where a test wants to say itself what the native module answers."""

import json
from types import SimpleNamespace

import numpy as np
import relume


class FakeLight:
    """Stands in for `relume.Light`."""

    def __init__(self, description):
        self.description = dict(description)


class FakeRequest:
    """Stands in for `relume.Request`; its content can be looked at."""

    def __init__(self, lights, **options):
        self.content = {"lights": [light.description for light in lights], "with": "auto"} | options

    @classmethod
    def parse(cls, text):
        """Stands in for `Request.parse`."""
        request = cls([])
        request.content = json.loads(text)
        return request


class FakeBoard:
    """Stands in for `relume.Board`."""


class FakeLive:
    """Remembers what it was asked; `tell` and `show` are its answers."""

    made = []

    def __init__(self, folder, *, device="auto", gpu_memory=None, threads=0, board=None):
        self.board = board
        self.arguments = {"folder": folder, "device": device, "gpu_memory": gpu_memory, "threads": threads}
        self.calls = []
        self.requests = []
        self.newest = None
        self.state = {"device": "CPU, 2 threads", "world_is_stored": True}
        """Fields of `relume.LiveStatus` that are not those of a shot without a bake."""
        FakeLive.made.append(self)

    def tell(self, **changes):
        """Changes the status."""
        self.state |= changes

    def show(self, serial=1, scale=1, samples=4, denoised=False, value=0.5):
        """A picture of the newest request."""
        summary = {"samples": samples, "makers": {"Key": "gather"}, "denoised": denoised}
        image = np.full((48 // scale, 64 // scale, 4), value, np.float32)
        self.newest = SimpleNamespace(
            serial=serial, request=len(self.requests), scale=scale, image=image, summary=json.dumps(summary)
        )
        shown = {"serial": serial, "request": len(self.requests), "scale": scale, "settled": True}
        self.state["shown"] = shown | summary

    def bake(self, scene, settings, *, train_seconds=60.0, anew=False):
        """Stands in for `Live.bake`."""
        self.calls.append(("bake", settings, train_seconds, *["anew"] * anew))
        self.tell(state="baking", samples_total=settings["samples"])

    def open(self, *, train_seconds=0.0):
        """Stands in for `Live.open`."""
        self.calls.append(("open", train_seconds))
        self.tell(state="ready", samples=4, samples_total=4)

    def learn(self, train_seconds):
        """Stands in for `Live.learn`."""
        self.calls.append(("learn", train_seconds))
        self.tell(state="training")

    def relight(self, request):
        """Stands in for `Live.relight`."""
        self.requests.append(request.content)
        return len(self.requests)

    def show_world(self, world, request):
        """Stands in for `Live.show_world`."""
        self.calls.append(("show_world", world.map))
        self.tell(world_map=world.map, world_color=list(world.color))
        return self.relight(request)

    def frame(self, newer_than=0):
        """Stands in for `Live.frame`."""
        return self.newest if self.newest is not None and self.newest.serial > newer_than else None

    def status(self):
        """Stands in for `Live.status`."""
        return relume.LiveStatus(**self.state)

    def attend(self):
        """Stands in for `Live.attend`."""
        self.calls.append(("attend",))

    def pause(self, paused):
        """Stands in for `Live.pause`."""
        self.tell(paused=paused)

    def cancel(self):
        """Stands in for `Live.cancel`."""
        self.tell(state="cancelled", stage=None)

    def close(self, *, wait_seconds=0.0):
        """Stands in for `Live.close`."""
        self.calls.append(("close",))
        self.tell(state="empty")
