"""Light linking in requests that are kept. A bake counts its objects, and another bake, of another camera or a later
scene, counts them anew: what is kept therefore names the objects that a light shines on, or those that it does not, and
likewise what blocks it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable

RECEIVER_LIMIT = 2048
"""Objects from the last number on share it."""


def numbers_of(lit: Iterable[int]) -> list[int]:
    """The receiver numbers of objects by their places in a bake's list, sorted."""
    return sorted({min(place, RECEIVER_LIMIT - 1) for place in lit})


def with_names(request: str, objects: list[str]) -> str:
    """A request that any bake can serve. `objects` are the full names that the numbers in it mean."""
    return _linked(request, lambda linked: _names(linked["receivers"], objects) if "receivers" in linked else linked)


def with_numbers(request: str, objects: list[str]) -> str:
    """A kept request for the bake of those objects; numbers in it, as looks had them before, stay."""
    return _linked(request, lambda linked: linked if "receivers" in linked else _numbers(linked, objects))


def _linked(request: str, change: Callable[[dict], dict]) -> str:
    content = json.loads(request)
    lights = content.get("lights", ())
    for light in lights["lights"] if isinstance(lights, dict) else lights:  # Of the solver: a light set.
        for holder, key in ((light, "receivers"), (light.get("rules", {}), "blockers")):
            if holder.get(key) is not None:
                holder[key] = change(holder[key])
    return json.dumps(content)


def _names(numbers: list[int], objects: list[str]) -> dict[str, list[str]]:
    known = set(numbers)
    lit = [name for place, name in enumerate(objects) if min(place, RECEIVER_LIMIT - 1) in known]
    dark = [name for place, name in enumerate(objects) if min(place, RECEIVER_LIMIT - 1) not in known]
    # Where nothing is dark the objects were listed one by one.
    return {"names": lit} if len(lit) < len(dark) or not dark else {"all_but": dark}


def _numbers(linked: dict[str, list[str]], objects: list[str]) -> dict[str, list[int]]:
    named = set(linked.get("names", linked.get("all_but", ())))
    wanted = "names" in linked
    return {"receivers": numbers_of(place for place, name in enumerate(objects) if (name in named) == wanted)}
