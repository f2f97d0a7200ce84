"""Writes OpenVDB files of small arrays: Blender's module cannot."""

import struct

import numpy as np

EDGE = 8
"""Voxels along an edge of a leaf; a node of the lower level has 16 leaves along an edge, one of the upper 32 nodes."""
ACTIVE_VALUES_ONLY = 2
ALL_VALUES, BACKGROUND_ELSEWHERE = b"\x06", b"\x00"


def write_vdb(path, grids, voxel=1.0, origin=(0.0, 0.0, 0.0)):
    """Writes arrays [x, y, z] or [x, y, z, 3] of up to 128 voxels along each edge, by their names; voxel (0, 0, 0) lies
    at `origin`. What is 0 is not active."""
    head = struct.pack("<qIIIB", 0x56444220, 224, 11, 0, 1) + b"0" * 36 + struct.pack("<Ii", 0, len(grids))
    with open(path, "wb") as file:
        file.write(head)
        for name, array in grids.items():
            kind = b"Tree_vec3s_5_4_3" if array.ndim == 4 else b"Tree_float_5_4_3"
            file.write(_string(name.encode()) + _string(kind) + _string(b""))
            data = _grid(name, np.asarray(array, np.float32), voxel, origin)
            start = file.tell() + 24
            file.write(struct.pack("<qqq", start, start, start + len(data)) + data)


def _string(text):
    return struct.pack("<I", len(text)) + text


def _grid(name, array, voxel, origin):
    about = {b"name": name.encode(), b"class": b"fog volume"}
    about = b"".join(_string(key) + _string(b"string") + _string(value) for key, value in about.items())
    scale = [voxel] * 3 + [voxel] * 3 + [1 / voxel] * 3 + [1 / voxel**2] * 3 + [0.5 / voxel] * 3
    place = _string(b"UniformScaleTranslateMap") + struct.pack("<18d", *origin, *scale)
    return struct.pack("<II", ACTIVE_VALUES_ONLY, 2) + about + place + _tree(array)


def _tree(array):
    channels = array.shape[3:]
    background = np.zeros(channels, np.float32).tobytes()
    edges = [-(-size // EDGE) for size in array.shape[:3]]
    padding = [(0, edge * EDGE - size) for edge, size in zip(edges, array.shape[:3], strict=True)]
    array = np.pad(array, padding + [(0, 0)] * len(channels))
    leaves = {
        index: array[tuple(slice(EDGE * i, EDGE * i + EDGE) for i in index)].reshape(EDGE**3, *channels)
        for index in np.ndindex(*edges)
    }
    lower = np.zeros((16, 16, 16), bool)
    for index in leaves:
        lower[index] = True
    upper = np.zeros((32, 32, 32), bool)
    upper[0, 0, 0] = True
    tree = struct.pack("<i", 1) + background + struct.pack("<II3i", 0, 1, 0, 0, 0)
    for node in (upper, lower):
        tree += _mask(node) + _mask(np.zeros(node.shape, bool)) + BACKGROUND_ELSEWHERE
    masks = {index: _mask(leaf.reshape(EDGE**3, -1).any(axis=1)) for index, leaf in leaves.items()}
    tree += b"".join(masks.values())
    return tree + b"".join(masks[index] + ALL_VALUES + leaf.tobytes() for index, leaf in leaves.items())


def _mask(bits):
    return np.packbits(bits.reshape(-1), bitorder="little").tobytes()
