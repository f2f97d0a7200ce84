"""Rows and colours of a solved look: what solving does to lights is in them, and nothing else changes."""

import numpy as np
import pytest

from addon.core.rows import GROUP, STATIC, WORLD, Row, freed, mix
from addon.core.solve import SolveOptions, request, solved


def gains(found, memberships):
    """The mix of rows and groups in one list."""
    groups = [row for row in found if row.kind == GROUP]
    return mix([row for row in found if row.kind != GROUP], groups, memberships)


@pytest.mark.parametrize(
    ("key", "fill", "rig"),
    [
        (Row("Key", exposure=1.0), Row("Fill"), Row("Rig", GROUP, multiplier=0.5, color=(1.0, 0.5, 0.25))),
        (Row("Key"), Row("Fill", color=(0.5, 1.0, 1.0)), Row("Rig", GROUP, on=False)),
        (Row("Key"), Row("Fill", solo=True, use_kelvin=True, kelvin=3000.0), Row("Rig", GROUP, exposure=2.0)),
        (Row("Key", on=False), Row("Fill"), Row("Rig", GROUP, solo=True)),
        (Row("Key"), Row("Fill", multiplier=0.0), Row("Rig", GROUP)),
    ],
)
def test_rows_of_lights_that_were_not_solved_keep_their_gain(key, fill, rig):
    present = [key, fill, Row("Rim"), Row("World", WORLD, exposure=-1.0), Row("Emissive Materials", STATIC)]
    memberships = {"Key": ["Rig"], "Fill": ["Rig"]}
    before = mix(present, [rig], memberships)
    after = gains(freed(present, [rig], memberships, ["Key"]), memberships)
    assert after["gains"]["Key"] == [1.0, 1.0, 1.0]
    for name in ("Fill", "Rim"):
        assert np.allclose(after["gains"][name], before["gains"][name])
    assert after["world"] == before["world"] and after["static"] == before["static"]


def test_groups_that_reach_no_solved_light_stay():
    rig = Row("Rig", GROUP, exposure=1.0)
    assert rig in freed([Row("Key"), Row("Fill")], [rig], {"Fill": ["Rig"]}, ["Key"])


def candle(color, is_free=True):
    """A light of a temperature without blue, and what is asked and written for it if a colour was found."""
    light = {"name": "Candle", "color": [1.0, 1.0, 1.0], "temperature_color": [1.0, 0.4, 0.0]}
    shown = {"lights": [light], "gains": {}, "world": [1.0] * 3, "static": [1.0] * 3}
    free = {"Candle": ["color", "strength"] if is_free else ["strength"]}
    asked = request(shown, SolveOptions(free, [{"goal": "cooler"}]))["lights"]
    matrix = [[1.0, 0.0, 0.0, 0.0]] * 4
    state = {"name": "Candle", "settings": {"color": [1.0] * 3, "energy": 5.0, "use_temperature": True}}
    answer = {"changed": ["Candle"], "removed": []}
    answer["blender"] = [
        {"name": "Candle", "color": color, "energy": 9.0, "world_from_object": matrix, "type": "POINT"}
    ]
    (found,) = solved(answer, {"Candle": state}, [light], asked).states
    return asked[0], found["settings"]


def test_a_temperature_without_the_colour_that_is_needed_is_switched_off():
    asked, settings = candle([0.5, 0.5, 1.0])
    assert asked["color"] == [1.0, 0.4, 0.0] and asked["temperature_color"] == [1.0] * 3
    assert settings == {"color": [0.5, 0.5, 1.0], "energy": 9.0, "use_temperature": False}


def test_a_temperature_that_will_do_stays():
    _asked, settings = candle([1.0, 0.2, 0.0])
    assert settings == {"color": [1.0, 0.5, 1.0], "energy": 9.0, "use_temperature": True}


def test_a_light_whose_colour_is_locked_keeps_its_temperature():
    asked, settings = candle([1.0, 1.0, 1.0], is_free=False)
    assert asked["temperature_color"] == [1.0, 0.4, 0.0] and settings["color"] == [1.0, 1.0, 1.0]
