"""Fingerprints of shapes are of all that they are made of."""

import zlib

import bpy
import numpy as np
import pytest

from addon.engine.staleness import shape_fingerprints
from addon.export.arrays import LAYOUTS
from helpers import add_quad

KINDS = bpy.types.Attribute.bl_rna.properties["data_type"].enum_items.keys()


@pytest.mark.parametrize("kind", [kind for kind in LAYOUTS if kind in KINDS])
def test_fingerprints_of_attributes_are_of_all_values(lit, monkeypatch, kind):
    monkeypatch.setattr(shape_fingerprints, "SLICE_BYTES", 3)
    mesh = add_quad(lit, "Quad").data
    mesh.attributes.new("It", kind, "CORNER")
    of, width = LAYOUTS[kind]
    values = (np.arange(4 * width) % 5).astype(of)
    if kind == "BYTE_COLOR":
        for corner, color in zip(mesh.attributes["It"].data, values.reshape(4, 4) / 255, strict=True):
            corner.color_srgb = color
    else:
        field = next(name for name in ("value", "vector", "color") if hasattr(mesh.attributes["It"].data[0], name))
        mesh.attributes["It"].data.foreach_set(field, values)
    steps = shape_fingerprints._attribute(mesh, "It")
    with pytest.raises(StopIteration) as end:
        while True:
            next(steps)
    assert end.value.value == f"{zlib.crc32(values.tobytes()):08x}" and len(set(values.tolist())) > 1
