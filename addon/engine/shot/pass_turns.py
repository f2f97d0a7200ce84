"""Pictures of single passes, for views that show one. The native module makes one picture at a time, so they are asked
for in turn, when the picture as a whole is there: what they are summed from is computed by then."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any


class PassTurns:
    """Pictures of single passes, and the requests that they are to come from."""

    def __init__(self) -> None:
        self.pictures: dict[str, Any] = {}
        """The newest frames by name of the pass."""
        self.is_away = False
        """True if a pass was asked for, and no whole picture has come since."""
        self.is_waiting = False
        """True while the pass that was asked for last is on its way."""
        self._versions: dict[str, str] = {}
        """Version of each pass that was asked for last or found missing."""
        self._requests: dict[int, str] = {}
        """Passes by the numbers of requests that frames may still come of."""

    def keep(self, names: Collection[str]) -> None:
        """Lets go of all other passes."""
        for kept in (self.pictures, self._versions):
            for name in kept.keys() - set(names):
                del kept[name]

    def due(self, versions: Mapping[str, str]) -> str | None:
        """The next pass that there is no picture of, or only one of another version, in their order."""
        return next((name for name, version in versions.items() if self._versions.get(name) != version), None)

    def ask(self, name: str, version: str, number: int) -> None:
        """Notes under which number a pass was asked for."""
        self._versions[name], self._requests[number] = version, name
        self.is_away = self.is_waiting = True

    def miss(self, name: str, version: str) -> None:
        """Notes that there is no such pass in a version."""
        self._versions[name] = version
        self.pictures.pop(name, None)

    def take(self, frame: Any) -> bool:
        """Keeps a frame if it is of a pass; returns True if so."""
        name = self._requests.get(frame.request)
        # No frame of an older request comes any more.
        self._requests = {number: of for number, of in self._requests.items() if number >= frame.request}
        is_newest = not any(number > frame.request for number in self._requests)
        self.is_waiting &= not is_newest
        if name is None:
            self.is_away &= not is_newest
        elif name in self._versions:
            self.pictures[name] = frame
        return name is not None
