"""Text files of OpenUSD (`.usda`), as far as lights need them: prims with their attributes, and metadata of the layer.

What makes a prim out of other files or of variants is not followed, but noted: `usdcat --flatten` writes all into one
file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

MAGIC = "#usda 1.0"
MOST_DEPTH = 200
"""Prims and lists inside of each other, beyond which a file counts as damaged."""
TOKEN = re.compile(
    r"""(?:\s|\#[^\n]*)*
    (?: (?P<string> \"\"\".*?\"\"\" | '''.*?''' | "(?:[^"\\\n]|\\.)*" | '(?:[^'\\\n]|\\.)*' )
      | (?P<asset> @@@.*?@@@ | @[^@\n]*@ )
      | (?P<path> <[^>\n]*> )
      | (?P<number> [-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!\w) )
      | (?P<word> [-+]?[^\W\d][\w:.|]*(?:\[\])? )
      | (?P<sign> [(){}\[\]=,;:&] ) )""",
    re.VERBOSE | re.DOTALL,
)
COMPOSED = {"references", "payload", "inherits", "specializes", "variants", "subLayers"}
"""Metadata that bring in what is written elsewhere."""
NAME = "userProperties:blender:object_name"
"""Attribute with an object's name, as Blender's exporter writes it."""
OPERATIONS = {"prepend", "append", "add", "delete", "reorder"}
ESCAPES = {"n": "\n", "t": "\t", "r": "\r"}


class UsdError(Exception):
    """A file cannot be read; the message is one line."""


@dataclass
class Prim:
    """A prim; the root of a layer has neither type nor name."""

    kind: str = ""
    name: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    """Attributes: numbers, texts, lists; of animated ones, the first sample."""
    metadata: dict[str, Any] = field(default_factory=dict)
    children: list[Prim] = field(default_factory=list)
    animated: set[str] = field(default_factory=set)
    """Attributes with samples over time."""

    def get(self, name: str, other: Any = None) -> Any:
        """An attribute of UsdLux; files from before 2021 have it without "inputs:"."""
        return self.values.get(f"inputs:{name}", self.values.get(name, other))


def read(text: str) -> Prim:
    """The root of a layer. Raises UsdError."""
    if not text.startswith("#usda"):
        raise UsdError("it is no text of OpenUSD, which begins with #usda; usdcat IN -o OUT.usda makes it so")
    return _UsdText(text).layer()


def quoted(text: str) -> str:
    """A text in quotes."""
    inner = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return f'"{inner}"'


def _unquoted(text: str) -> str:
    ends = 3 if text[:3] in {'"""', "'''"} else 1
    return re.sub(r"\\(.)", lambda found: ESCAPES.get(found[1], found[1]), text[ends:-ends], flags=re.DOTALL)


class _UsdText:
    """Recursive descent over the tokens of a layer."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.place = 0
        self.depth = 0
        self.kind, self.token = "", ""
        self._next()

    def _next(self) -> str:
        """Goes on to the next token; returns the one before."""
        before = self.token
        found = TOKEN.match(self.text, self.place)
        if found is None:
            if not re.fullmatch(r"(?:\s|#[^\n]*)*", self.text[self.place :]):
                raise self._error(f"{self.text[self.place : self.place + 20]!r}")
            self.kind, self.token = "end", ""
        else:
            self.kind, self.token = found.lastgroup or "", found[found.lastgroup or 0]
            self.place = found.end()
        return before

    def _error(self, what: str) -> UsdError:
        line = self.text.count("\n", 0, self.place) + 1
        words = "the file ends" if self.kind == "end" else " ".join(what.split())
        return UsdError(f"line {line} cannot be read: {words}")

    def _take(self, sign: str) -> None:
        if self.token != sign:
            raise self._error(f"{self.token!r} where {sign!r} should be")
        self._next()

    def _takes(self, sign: str) -> bool:
        is_next = self.kind in {"sign", "word"} and self.token == sign
        if is_next:
            self._next()
        return is_next

    def _deeper(self) -> None:
        self.depth += 1
        if self.depth > MOST_DEPTH:
            raise self._error("too many brackets inside of each other")

    def layer(self) -> Prim:
        root = Prim()
        if self.token == "(":
            root.metadata = self._metadata()
        while self.kind != "end":
            if (prim := self._prim()) is not None:
                root.children.append(prim)
        return root

    def _prim(self) -> Prim | None:
        """A prim; None for a class, which is not there by itself, and for what says only an order."""
        if self._takes("reorder"):
            self._next()
            self._take("=")
            self._value()
            return None
        specifier = self._next()
        if specifier not in {"def", "over", "class"}:
            raise self._error(f"{specifier!r} where a prim should begin")
        prim = Prim(kind=self._next() if self.kind == "word" else "")
        if self.kind != "string":
            raise self._error(f"{self.token!r} where the name of a prim should be")
        prim.name = _unquoted(self._next())
        if self.token == "(":
            prim.metadata = self._metadata()
        self._deeper()
        self._take("{")
        while not self._takes("}"):
            self._statement(prim)
        self.depth -= 1
        return None if specifier == "class" else prim

    def _statement(self, prim: Prim) -> None:
        """A prim, a set of variants, a relationship or an attribute."""
        if self._takes(";"):
            return
        if self.token in {"def", "over", "class", "reorder"}:
            if (child := self._prim()) is not None:
                prim.children.append(child)
            return
        if self._takes("variantSet"):
            self._skip_variants()
            prim.metadata["variants"] = True
            return
        while self.token in OPERATIONS or self.token in {"custom", "uniform", "varying", "config"}:
            self._next()
        if self.kind != "word":
            raise self._error(f"{self.token!r}")
        self._next()  # The type, or "rel".
        if self.kind != "word":
            raise self._error(f"{self.token!r} where a name should be")
        name, _, suffix = self._next().partition(".")
        has_value = self._takes("=")
        value = self._samples() if has_value and suffix == "timeSamples" else self._value() if has_value else None
        if suffix == "timeSamples":
            prim.animated.add(name)
        if value is not None and suffix in {"", "timeSamples"}:
            prim.values.setdefault(name, value)
        if self.token == "(":
            self._metadata()

    def _skip_variants(self) -> None:
        self._next()
        self._take("=")
        self._deeper()
        self._take("{")
        while not self._takes("}"):
            self._next()
            if self.token == "(":
                self._metadata()
            self._take("{")
            unused = Prim()
            while not self._takes("}"):
                self._statement(unused)
        self.depth -= 1

    def _samples(self) -> Any:
        """The first of the samples of an attribute."""
        self._take("{")
        samples = []
        while not self._takes("}"):
            self._next()
            self._take(":")
            samples.append(self._value())
            self._takes(",")
        return samples[0] if samples else None

    def _metadata(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        self._take("(")
        while not self._takes(")"):
            if self.kind == "string":  # A comment.
                self._next()
                continue
            while self.token in OPERATIONS:
                self._next()
            if self.kind != "word":
                raise self._error(f"{self.token!r} in metadata")
            name = self._next()
            self._take("=")
            found[name] = self._value()
            self._takes(";")
        return found

    def _value(self) -> Any:
        """A number, text, list or dictionary; assets and paths as text."""
        kind, token = self.kind, self.token
        if kind == "sign" and token in {"(", "["}:
            return self._list(")" if token == "(" else "]")
        if kind == "sign" and token == "{":
            return self._dictionary()
        if kind in {"", "end", "sign"}:
            raise self._error(f"{token!r} where a value should be")
        self._next()
        if kind == "number":
            return float(token)
        if kind == "string":
            return _unquoted(token)
        if kind in {"asset", "path"}:
            if kind == "asset" and self.kind == "path":  # The prim of the file that is meant.
                self._next()
            if self.token == "(":  # How a layer is shifted in time.
                self._metadata()
            return token.strip("@<>")
        return {"true": True, "false": False, "None": None, "inf": float("inf")}.get(token, token)

    def _list(self, end: str) -> list[Any]:
        self._deeper()
        self._next()
        values = []
        while not self._takes(end):
            values.append(self._value())
            self._takes(",")
        self.depth -= 1
        return values

    def _dictionary(self) -> dict[str, Any]:
        self._deeper()
        self._next()
        values = {}
        while not self._takes("}"):
            self._next()  # The type.
            name = self._next()
            self._take("=")
            values[name.strip("\"'")] = self._value()
            self._takes(";") or self._takes(",")
        self.depth -= 1
        return values
