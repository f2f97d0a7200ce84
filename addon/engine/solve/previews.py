"""Lights that are being solved, in the views of other shots than the one that the solve began in."""

from __future__ import annotations

import json
from typing import Any

import bpy

from ...core.receivers import with_names, with_numbers
from ..shot import open_shots, requests
from ..shot.shot import Shot


def show_beside(scene: bpy.types.Scene | None, shot: Shot, request: dict[str, Any]) -> None:
    """Asks for a quick picture of a solve's lights in each shot that views show beside its own. Shots of another view
    layer, which may have other lights, stay as they are."""
    for other in open_shots.all_of(scene) if scene is not None else ():
        follows = other is not shot and other.is_seen and other.can_show
        if follows and other.lights.view_layer == shot.lights.view_layer:
            other.ask(requests.kept_request(_request_for(other, shot, request)))


def _request_for(other: Shot, shot: Shot, request: dict[str, Any]) -> str:
    """The request for another shot, whose bake may count the scene's objects in its own way, and be of the world before
    an edit."""
    theirs, ours = other.changes.world_gain(), shot.changes.world_gain()
    if theirs != ours:
        world = zip(request["world"], theirs, ours, strict=True)
        request = request | {"world": [gain * edited / max(before, 1e-6) for gain, edited, before in world]}
    text = json.dumps(request | {"interactive": True})
    if other.lights.receivers == shot.lights.receivers:
        return text
    return with_numbers(with_names(text, shot.lights.receivers), other.lights.receivers)
