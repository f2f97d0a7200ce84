"""Reads the float layers of an EXR of scan lines, plain or ZIP, in one part or (Blender 5, Relume) in several."""

import struct
import zlib

import numpy as np

MULTI_PART = 0x1000
ROWS_OF_A_BLOCK = {0: 1, 3: 16}
"""By compression: none and ZIP."""


def read_fields(path):
    """Texts of the headers of all parts, by name."""
    headers, *_ = _headers(path.read_bytes())
    return {name: text for header in headers for name, text in header.items() if isinstance(text, str)}


def read_exr(path):
    """Pixels by channel name, [height, width], top row first."""
    data = path.read_bytes()
    headers, version, at = _headers(data)
    found = {}
    for header in headers:
        _, _, right, bottom = header["dataWindow"]
        blocks = -(-(bottom + 1) // ROWS_OF_A_BLOCK[header["compression"]])
        offsets = struct.unpack_from(f"<{blocks}Q", data, at)
        at += 8 * blocks
        found |= _part(data, header, offsets, right + 1, 8 if version & MULTI_PART else 4)
    return found


def _headers(data):
    magic, version = struct.unpack_from("<II", data)
    assert magic == 20000630
    headers, at = [], 8
    while len(headers) == 0 or version & MULTI_PART:
        header, at = _header(data, at)
        if not header:
            break
        headers.append(header)
    return headers, version, at


def _header(data, at):
    header = {}
    while data[at]:
        name, at = _text(data, at)
        kind, at = _text(data, at)
        (size,) = struct.unpack_from("<I", data, at)
        value = data[at + 4 : at + 4 + size]
        at += 4 + size
        header[name] = READERS.get(kind, bytes)(value)
    return header, at + 1


def _text(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _channels(value):
    names, at = [], 0
    while value[at]:
        name, at = _text(value, at)
        assert struct.unpack_from("<I", value, at) == (2,), "32-bit floats"
        names.append(name)
        at += 16
    return names


READERS = {
    "chlist": _channels,
    "box2i": lambda value: struct.unpack("<4i", value),
    "compression": lambda value: value[0],
    "string": bytes.decode,
}


def _part(data, header, offsets, width, size_at):
    channels = header["channels"]
    blocks = []
    for offset in offsets:
        (size,) = struct.unpack_from("<I", data, offset + size_at)
        block = data[offset + size_at + 4 : offset + size_at + 4 + size]
        if header["compression"] == 3:
            block = _unzipped(block, 4 * width * len(channels))
        blocks.append(np.frombuffer(block, "<f4").reshape(-1, len(channels), width))
    pixels = np.concatenate(blocks)
    part = header.get("name", "")
    names = [name if "." in name or not part else f"{part}.{name}" for name in channels]
    return {name: pixels[:, i] for i, name in enumerate(names)}


def _unzipped(block, row_size):
    """OpenEXR's ZIP: differences of bytes, even ones before odd ones; kept plain where that is smaller."""
    try:
        packed = np.frombuffer(zlib.decompress(block), np.uint8)
    except zlib.error:
        return block
    assert len(packed) % row_size == 0
    split = (np.cumsum(packed, dtype=np.int64) - 128 * np.arange(len(packed))).astype(np.uint8)
    half = (len(split) + 1) // 2
    plain = np.empty_like(split)
    plain[::2], plain[1::2] = split[:half], split[half:]
    return plain.tobytes()
