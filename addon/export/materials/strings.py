"""Texts in shaders, which Blender computes where it inlines: only what becomes a number of them is seen."""

from __future__ import annotations

import re
import string
from typing import Any

import numpy as np

from .graph import Constant, Context, Source, constant_value, trace
from .translation import TranslateValue, Translation

NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"


class _UnknownTextError(Exception):
    """A text that is not known."""


def _text(node: Any, name: str, context: Context) -> str:
    """The text of an input. Raises _UnknownTextError."""
    return _text_of(node.inputs[name], context)


def _text_of(socket: Any, context: Context) -> str:
    source = trace(socket, context)
    if isinstance(source, Constant):
        shown = getattr(source.owner, "default_value", "")
        return shown if isinstance(shown, str) else ""
    return _made(source.node, source.socket.identifier, source.context)


def _number(node: Any, name: str, context: Context) -> float:
    return _number_of(node.inputs[name], context)


def _number_of(socket: Any, context: Context) -> float:
    value = constant_value(socket, context)
    if not isinstance(value, float):
        raise _UnknownTextError
    return value


def _made(node: Any, output: str, context: Context) -> str:
    """The text that a node makes. Raises _UnknownTextError."""
    match node.bl_idname:
        case "FunctionNodeInputString":
            return str(node.string)
        case "FunctionNodeInputMenu":
            return str(node.value)
        case "FunctionNodeInputSpecialCharacters":
            return {"Line Break": "\n", "Tab": "\t"}[output]
        case "FunctionNodeReverseString":
            return _text(node, "String", context)[::-1]
        case "FunctionNodeReplaceString":
            text, find, to = (_text(node, name, context) for name in ("String", "Find", "Replace"))
            return text.replace(find, to) if find else text
        case "FunctionNodeSetStringCase":
            text = _text(node, "String", context)
            return text.upper() if _text(node, "Case", context) == "Uppercase" else text.lower()
        case "FunctionNodeSliceString":
            start, length = (max(0, int(_number(node, name, context))) for name in ("Position", "Length"))
            return _text(node, "String", context)[start : start + length]
        case "FunctionNodeTrimString":
            return _trimmed(node, context)
        case "FunctionNodeValueToString":
            return _of_number(node, context)
        case "FunctionNodeFormatString":
            return _formatted(node, context)
    raise _UnknownTextError


def _trimmed(node: Any, context: Context) -> str:
    text, characters = _text(node, "String", context), _text(node, "Characters", context)
    if _number(node, "Whitespace", context) > 0.0:
        characters += " \t\n\r\v\f"
    if _number(node, "Start", context) > 0.0:
        text = text.lstrip(characters) if characters else text
    if _number(node, "End", context) > 0.0:
        text = text.rstrip(characters) if characters else text
    return text


def _of_number(node: Any, context: Context) -> str:
    value = _number(node, "Value", context)
    if node.data_type == "FLOAT":
        return f"{value:.{max(0, int(_number(node, 'Decimals', context)))}f}"
    base, left, digits = int(_number(node, "Base", context)), abs(int(value)), ""
    if not 2 <= base <= len(DIGITS):
        raise _UnknownTextError
    while left or not digits:
        left, digit = divmod(left, base)
        digits = DIGITS[digit] + digits
    return "-" * (value < 0.0) + digits.rjust(int(_number(node, "Padding", context)), "0")


def _formatted(node: Any, context: Context) -> str:
    """The text of a Format String; none where its format does not fit, as in Blender."""
    sockets = [socket for socket in node.inputs[1:] if socket.type in {"VALUE", "INT", "STRING"}]
    values = [_item(socket, context) for socket in sockets]
    names = {socket.name: value for socket, value in zip(sockets, values, strict=True)}
    try:
        return _Formatter().vformat(_text(node, "Format", context), values, names)
    except (ValueError, LookupError):
        return ""


def _item(socket: Any, context: Context) -> Any:
    if socket.type == "STRING":
        return _text_of(socket, context)
    value = _number_of(socket, context)
    return int(value) if socket.type == "INT" else value


class _Formatter(string.Formatter):
    """Python's formats, as far as they are those of Blender, which have neither attributes nor conversions."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> tuple[Any, Any]:
        """The value of a name or number."""
        if not re.fullmatch(r"\d+|[A-Za-z_]\w*", field_name):
            raise ValueError(field_name)
        return super().get_field(field_name, args, kwargs)

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        """The value as it is."""
        if conversion is not None:
            raise ValueError(conversion)
        return value

    def format_field(self, value: Any, format_spec: str) -> str:
        """A value as text. Numbers with a point are of single precision; whole ones keep it where nothing is asked."""
        if not isinstance(value, float):
            if isinstance(value, int) and format_spec[-1:] in {*"eEfFgG%n"}:
                raise ValueError(format_spec)
            return format(value, format_spec)
        if format_spec[-1:].isalpha():
            return format(value, format_spec)
        if "." in format_spec:
            return format(value, f"{format_spec}g")
        shortest = np.format_float_positional(np.float32(value), trim="-" if format_spec else "0")
        sign = "+" if "+" in format_spec and value >= 0.0 else ""
        found = re.fullmatch(r"\+?(0?)(\d*)", format_spec)
        if found is None:
            raise _UnknownTextError
        text, width = sign + shortest, int(found[2] or 0)
        return text.zfill(width) if found[1] else text.rjust(width)


def _length(node: Any, _output: str, context: Context) -> float:
    return float(len(_text(node, "String", context)))


def _found(node: Any, output: str, context: Context) -> float:
    text, search = _text(node, "String", context), _text(node, "Search", context)
    if output == "Count":
        return float(text.count(search)) if search else 0.0
    is_forward = _text(node, "Mode", context) == "From Start"
    return float(max(0, text.find(search) if is_forward else text.rfind(search)))


def _matches(node: Any, _output: str, context: Context) -> float:
    text, key = _text(node, "String", context), _text(node, "Key", context)
    match _text(node, "Operation", context):
        case "Starts With":
            return float(text.startswith(key))
        case "Ends With":
            return float(text.endswith(key))
        case _:
            return float(key in text)


def _as_number(node: Any, output: str, context: Context) -> float:
    text = _text(node, "String", context)
    if node.data_type == "FLOAT":
        found = NUMBER.match(text)
        value, length = (float(found[0]), found.end()) if found else (0.0, 0)
    else:
        value, length = _whole(text, int(_number(node, "Base", context)))
    return value if output == "Value" else float(length)


def _whole(text: str, base: int) -> tuple[float, int]:
    """The whole number that a text begins with, and its length."""
    if not 2 <= base <= len(DIGITS):
        raise _UnknownTextError
    sign = 1 if text[:1] in {"-", "+"} else 0
    end = sign
    while end < len(text) and text[end].lower() in DIGITS[:base]:
        end += 1
    return (float(int(text[:end], base)), end) if end > sign else (0.0, 0)


def _known(name: str, compute: Any) -> TranslateValue:
    """Translation of a node to the number that comes of texts."""

    def translate(t: Translation, source: Source) -> Any:
        try:
            return compute(source.node, source.socket.identifier, source.context)
        except _UnknownTextError:
            t.warn(f"node '{source.node.name}': its text is not known; {name} is taken as 0")
            return 0.0

    return translate


STRING_VALUES: dict[str, TranslateValue] = {
    "FunctionNodeStringLength": _known("its length", _length),
    "FunctionNodeFindInString": _known("what is found", _found),
    "FunctionNodeMatchString": _known("its match", _matches),
    "FunctionNodeStringToValue": _known("its value", _as_number),
}
