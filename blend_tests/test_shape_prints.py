"""Prints of shapes are of all that they are made of."""

import zlib

import bpy
import numpy as np
import pytest

from addon.engine import shape_prints
from helpers import add_quad

KINDS = bpy.types.Attribute.bl_rna.properties["data_type"].enum_items.keys()


@pytest.mark.parametrize("kind", [kind for kind in shape_prints.ATTRIBUTES if kind in KINDS])
def test_prints_of_attributes_are_of_all_values(lit, kind):
    mesh = add_quad(lit, "Quad").data
    mesh.attributes.new("It", kind, "CORNER")
    data, (name, width, _) = mesh.attributes["It"].data, shape_prints.ATTRIBUTES[kind]
    of = np.bool_ if kind == "BOOLEAN" else np.int32 if kind.startswith("INT") else np.float32
    data.foreach_set(name, (np.arange(len(data) * width) % 7 / (7 if of is np.float32 else 1)).astype(of))
    values = np.empty(len(data) * width, of)
    data.foreach_get(name, values)
    steps = shape_prints._attribute(mesh, "It")
    with pytest.raises(StopIteration) as end:
        while True:
            next(steps)
    assert end.value.value == f"{zlib.crc32(values.tobytes()):08x}" and len(set(values.tolist())) > 1
