"""Keys that the X server itself presses (extension XTEST), as those of a keyboard: Blender looks for Esc where the
events that it simulates never come by. The protocol of X11, version 11.0, and of XTEST 2.2, without any library."""

import os
import socket
import struct
from pathlib import Path

SOCKETS = Path(os.sep, "tmp", ".X11-unix")
"""Where X servers listen, whatever TMPDIR says (xtrans, `UNIX_PATH`)."""
ESCAPE = 9
"""Key code of X servers on Linux."""
KEY_PRESS, KEY_RELEASE = 2, 3


def press(key_code):
    """Presses and releases a key; it goes to the window under the mouse, or to the one that has the focus."""
    number = os.environ["DISPLAY"].split(":")[1].split(".")[0]
    with socket.socket(socket.AF_UNIX) as server:
        server.connect(str(SOCKETS / f"X{number}"))
        server.sendall(struct.pack("<BxHHHHxx", ord("l"), 11, 0, 0, 0))
        status, words = struct.unpack("<Bx4xH", _read(server, 8))
        _read(server, 4 * words)
        if status != 1:
            raise ConnectionError("the X server refuses the connection")
        opcode = _extension(server, b"XTEST")
        for event in (KEY_PRESS, KEY_RELEASE):
            # FakeInput: event, key, milliseconds to wait, root window, place; the last two are for mice.
            server.sendall(struct.pack("<BBHBBxxII8xhh7xB", opcode, 2, 9, event, key_code, 0, 0, 0, 0, 0))
        _extension(server, b"XTEST")  # Answered when the keys have been pressed.


def _extension(server, name):
    """Number of an extension's requests."""
    padding = -len(name) % 4
    length = 2 + (len(name) + padding) // 4
    server.sendall(struct.pack("<BxHHxx", 98, length, len(name)) + name + bytes(padding))
    reply = _read(server, 32)
    while reply[0] > 1:  # An event, such as that the keys are those of another keyboard now.
        reply = _read(server, 32)
    if reply[0] != 1 or not reply[8]:
        raise ConnectionError(f"the X server has no {name.decode()}")
    return reply[9]


def _read(server, size):
    data = b""
    while len(data) < size:
        part = server.recv(size - len(data))
        if not part:
            raise ConnectionError("the X server hung up")
        data += part
    return data
