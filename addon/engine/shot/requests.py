"""Requests for pictures, and their text where they are kept."""

from __future__ import annotations

import json
from typing import Any

from ..native import native


def request(content: dict[str, Any], interactive: bool) -> Any:
    """Request for lights, as `SceneLights` describes them, under the gains of `core.rows.mix`."""
    options = {name: value for name, value in content.items() if name != "lights"}
    return native().Request([light.handle for light in content["lights"]], **options, interactive=interactive)


def request_text(content: dict[str, Any]) -> str:
    """JSON text of a request that is to be kept; `kept_request` reads it."""
    return json.dumps(content | {"with": "auto", "interactive": False})


def kept_request(text: str) -> Any:
    """The `relume.Request` of a text. Raises ValueError."""
    return native().Request.parse(text)
