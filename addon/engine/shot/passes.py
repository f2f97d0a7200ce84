"""The single passes that views show follow the whole picture of a shot."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from ...core import pass_names
from .pass_turns import PassTurns

Ask = Callable[[dict[str, Any], bool], int]
"""Asks the native module for the picture of some content, `interactive` or not; the number of the request."""


@dataclass(frozen=True)
class Whole:
    """A whole picture that is there."""

    frame: Any
    content: dict[str, Any]
    """Content of the request for it."""
    is_interactive: bool
    number: int
    """Number of the first request with this content."""
    samples: int
    """Paths per pixel that are traced."""
    proxies: dict[str, Any]

    def version(self, name: str) -> str:
        """Version of a pass, which differs where its picture would. Lights change nothing of the surfaces' AOVs."""
        if name in pass_names.AOVS:
            return str(self.samples)
        shown = json.loads(self.frame.summary)
        return json.dumps([self.number, self.frame.scale, shown.get("samples"), shown.get("makers"), self.proxies])

    @property
    def is_finished(self) -> bool:
        """True if no better picture is on its way."""
        return self.is_interactive or json.loads(self.frame.summary).get("settled", True)


class Passes:
    """Asks for the pass that is due, and for the whole picture again afterwards."""

    def __init__(self, ask: Ask):
        self.turns = PassTurns()
        self._ask = ask

    def follow(self, names: Collection[str], whole: Whole | None) -> None:
        """One turn. Only what `names` has is kept, and nothing is asked for without a whole picture."""
        self.turns.keep(names)
        if whole is None or self.turns.is_waiting or not whole.is_finished:
            return
        versions = {name: whole.version(name) for name in sorted(names)}
        name = self.turns.due(versions)
        if name is not None:
            self._ask_pass(name, versions[name], whole)
        elif self.turns.is_away and not whole.is_interactive:  # Otherwise a request follows anyway.
            self._ask(whole.content, False)

    def _ask_pass(self, name: str, version: str, whole: Whole) -> None:
        content = pass_names.only(whole.content, name)
        if content is None:
            self.turns.miss(name, version)
        else:
            self.turns.ask(name, version, self._ask(content, whole.is_interactive))
