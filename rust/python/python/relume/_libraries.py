"""Finds the libraries that the native module needs on Windows, before it is imported. Elsewhere its run path does."""

import ctypes
import os
import sys
from pathlib import Path

FOLDER = Path(__file__).parent / "oidn" / "lib"


def _find() -> None:
    """Names the folder of the wheel's own Open Image Denoise to the loader, which takes a library of the same name that
    the host (Blender) has loaded before it looks there."""
    if sys.platform != "win32":
        return
    os.add_dll_directory(str(FOLDER))
    try:
        # Open Image Denoise loads its modules for devices by their paths; what they need is not looked for beside them.
        ctypes.WinDLL(str(FOLDER / "tbb12.dll"))
    except OSError as error:
        raise ImportError(f"{error}; install Microsoft's Visual C++ runtime if it is missing") from error


_find()
