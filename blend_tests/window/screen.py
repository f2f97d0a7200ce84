"""Pictures of the virtual display: what a person would see, not what Blender says that it drew."""

import struct
import zlib

import numpy as np


def photograph(framebuffer):
    """Display-referred pixels of the file that Xvfb keeps its screen in, uint8 [height, width, 3], top row first.

    The file is an X window dump (XWDFile.h): 25 big-endian words, a name, the colours, then rows of BGRX.
    """
    data = framebuffer.read_bytes()
    header = struct.unpack(">25I", data[:100])
    header_size, width, height, row_bytes, colours = header[0], header[4], header[5], header[12], header[19]
    pixels = np.frombuffer(data, np.uint8, row_bytes * height, header_size + 12 * colours)
    return pixels.reshape(height, row_bytes // 4, 4)[:, :width, 2::-1].copy()


def write_png(path, pixels):
    """Writes uint8 pixels [height, width, 3], top row first."""
    height, width, _ = pixels.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, width * 3)], axis=1)

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
