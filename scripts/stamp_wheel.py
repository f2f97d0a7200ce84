#!/usr/bin/env python3
"""Gives a wheel a version that changes with its contents, 0.1.0+1a2b3c4d: scripts/stamp_wheel.py WHEEL

Prints its new path.

Blender does not install a wheel of a version that is there already, so that the zip of another build would run with the
native module of the one before. The hash is of what RECORD lists outside of the wheel's own .dist-info.
"""

import base64
import hashlib
import sys
import zipfile
from pathlib import Path

DIGITS = 8


def record_line(name, data):
    """A line of RECORD (Python's "Recording installed projects")."""
    digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
    return f"{name},sha256={digest},{len(data)}\n"


def stamp(wheel):
    """Writes the stamped wheel in the place of the other one; its path."""
    package, version, tags = wheel.name.split("-", 2)
    old_info, plain = f"{package}-{version}.dist-info/", version.partition("+")[0]
    with zipfile.ZipFile(wheel) as old:
        record = old.read(f"{old_info}RECORD").decode().splitlines()
        contents = sorted(line for line in record if not line.startswith(old_info))
        digest = hashlib.sha256("\n".join(contents).encode()).hexdigest()
        stamped = f"{plain}+{digest[:DIGITS]}"
        new_info, path = f"{package}-{stamped}.dist-info/", wheel.with_name(f"{package}-{stamped}-{tags}")
        part = path.with_name(f".part-{path.name}")
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as new:
            lines = []
            for entry in old.infolist():
                if entry.filename == f"{old_info}RECORD":
                    continue
                data = old.read(entry)
                if entry.filename == f"{old_info}METADATA":
                    data = data.replace(f"\nVersion: {version}\n".encode(), f"\nVersion: {stamped}\n".encode(), 1)
                entry.filename = entry.filename.replace(old_info, new_info, 1)
                new.writestr(entry, data)
                lines.append(record_line(entry.filename, data))
            new.writestr(f"{new_info}RECORD", "".join([*lines, f"{new_info}RECORD,,\n"]))
    wheel.unlink()
    part.rename(path)
    return path


if __name__ == "__main__":
    print(stamp(Path(sys.argv[1])))
