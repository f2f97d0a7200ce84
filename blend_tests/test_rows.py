"""Totals of rows and groups, and looks as text. Needs no Blender but for its own temperature colours."""

import json
import math

import bpy
import pytest

from addon.core.blackbody import blackbody_color
from addon.core.looks import Look, LookError, from_json, match, to_json
from addon.core.rows import GROUP, STATIC, WORLD, Row, is_neutral, mix, mix_for

WHITE, BLACK = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
REST = [Row("World", WORLD), Row("Static", STATIC)]


def gains(rows, groups=(), memberships=None):
    return mix([*rows, *REST], groups, memberships or {})["gains"]


def test_neutral_rows_change_nothing():
    assert mix([Row("Key"), *REST], [], {}) == {"gains": {"Key": WHITE}, "world": WHITE, "static": WHITE}
    assert is_neutral(Row("Key")) and not is_neutral(Row("Key", exposure=0.1))
    assert is_neutral(Row("World", color=(1.0, 1.0 - 2.0**-24, 1.0))), "as the solver leaves it"
    assert not is_neutral(Row("Key", on=False)) and not is_neutral(Row("Key", solo=True))


def test_exposure_multiplier_and_color_multiply():
    row = Row("Key", exposure=1.0, multiplier=3.0, color=(1.0, 0.5, 0.0))
    assert gains([row]) == {"Key": [6.0, 3.0, 0.0]}


@pytest.mark.skipif(bpy.app.version < (4, 5, 0), reason="lights have no temperature before Blender 4.5")
def test_kelvin_is_blenders_own_color():
    light = bpy.data.lights.new("Probe", "POINT")
    light.use_temperature = True
    for kelvin in (800, 900, 965, 1000, 1200, 1500, 2000, 3000, 4500, 6500, 9000, 11999, 12000, 20000):
        light.temperature = kelvin
        assert blackbody_color(kelvin) == pytest.approx(list(light.temperature_color), abs=2e-4)
        assert Row("Key", use_kelvin=True, kelvin=kelvin).gain() == blackbody_color(kelvin)


def test_several_solos_are_heard_together_and_silence_the_rest():
    rows = [Row("A", solo=True), Row("B"), Row("C", solo=True, exposure=1.0)]
    out = mix([*rows, *REST], [], {})
    assert out["gains"] == {"A": WHITE, "B": BLACK, "C": [2.0] * 3}
    assert out["world"] == out["static"] == BLACK


def test_a_solo_world_silences_the_lights():
    out = mix([Row("A"), Row("World", WORLD, solo=True), Row("Static", STATIC)], [], {})
    assert (out["gains"]["A"], out["world"], out["static"]) == (BLACK, WHITE, BLACK)


def test_a_solo_group_is_its_members():
    memberships = {"A": ["Rig"], "B": ["Rig", "Top"], "C": ["Top"]}
    groups = [Row("Rig", GROUP, solo=True), Row("Top", GROUP)]
    assert gains([Row("A"), Row("B"), Row("C")], groups, memberships) == {"A": WHITE, "B": WHITE, "C": BLACK}


def test_off_wins_over_solo():
    memberships = {"A": ["Rig"], "B": ["Rig"]}
    groups = [Row("Rig", GROUP, on=False, solo=True)]
    assert gains([Row("A", solo=True), Row("B")], groups, memberships) == {"A": BLACK, "B": BLACK}
    assert gains([Row("A", on=False, solo=True), Row("B")]) == {"A": BLACK, "B": BLACK}


def test_masters_of_all_groups_multiply_and_each_counts_once():
    memberships = {"A": ["Inner", "Outer", "Other", "Outer"]}
    groups = [
        Row("Inner", GROUP, multiplier=2.0),
        Row("Outer", GROUP, exposure=1.0, color=(1.0, 0.5, 1.0)),
        Row("Other", GROUP, multiplier=0.25),
    ]
    assert gains([Row("A", multiplier=3.0)], groups, memberships) == {"A": [3.0, 1.5, 3.0]}


def test_instances_follow_the_row_of_their_light():
    rows = [Row("Bulb", multiplier=2.0), Row("Odd#7", on=False), *REST]
    found = mix_for(["Bulb", "Bulb#2", "Odd#7", "Made by nodes"], rows, [], {})
    assert found["gains"] == {"Bulb": [2.0] * 3, "Bulb#2": [2.0] * 3, "Odd#7": BLACK, "Made by nodes": WHITE}
    rows[2] = Row("World", WORLD, solo=True)
    assert mix_for(["Made by nodes"], rows, [], {})["gains"] == {"Made by nodes": BLACK}


def full_look():
    matrix = [[1.0, 0.0, 0.0, 4.0], [0.0, 1.0, 0.0, 5.0], [0.0, 0.0, 1.0, 6.0], [0.0, 0.0, 0.0, 1.0]]
    settings = {"energy": 10.0, "color": [1.0, 0.5, 0.25], "shape": "DISK", "use_temperature": True}
    light = {"name": "Këy", "type": "AREA", "matrix": matrix, "hidden": False, "settings": settings}
    rows = (
        Row("Këy", exposure=-1.0, color=(1.0, 0.5, 0.0), use_kelvin=True, kelvin=3000.0),
        Row("Rig", GROUP, on=False, solo=True, multiplier=2.0),
        Row("World", WORLD, multiplier=0.0),
    )
    return Look("Night", rows, (light,))


def test_a_look_survives_its_text():
    assert from_json(to_json(full_look())) == full_look()


def test_a_look_meets_another_file_by_name():
    present = [Row("Këy"), Row("New", exposure=3.0), Row("Other rig", GROUP, multiplier=5.0), Row("Sky", WORLD)]
    found = match(full_look(), present)
    assert found.rows[0] == full_look().rows[0]
    assert found.rows[1] == Row("New", on=False)
    assert found.rows[2] == Row("Other rig", GROUP)
    assert (found.rows[3].kind, found.rows[3].multiplier) == (WORLD, 0.0)
    assert (found.missing, found.unknown) == (["Rig"], ["New"])
    with pytest.raises(LookError, match="none of this scene's lights"):
        match(full_look(), [Row("Stranger")])


def spoilt(change):
    data = json.loads(to_json(full_look()))
    change(data)
    return json.dumps(data)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not JSON"),
        (b"\xff\xfe\x00", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("[]", '"format"'),
        ('{"format": "relume-bake"}', '"format"'),
        ('{"format": "relume-look", "version": 3}', "version 3"),
        ('{"format": "relume-look", "version": 1}', '"name"'),
        (spoilt(lambda data: data.update(rows={})), '"rows"'),
        (spoilt(lambda data: data["rows"].append(3)), "a row is not an object"),
        (spoilt(lambda data: data["rows"][0].update(kind=[1])), '"kind"'),
        (spoilt(lambda data: data["rows"][0].update(name="a\0b")), '"name"'),
        (spoilt(lambda data: data["rows"][0].update(exposure=math.nan)), '"exposure"'),
        (spoilt(lambda data: data["rows"][0].update(multiplier=10**400)), '"multiplier"'),
        (spoilt(lambda data: data["rows"][0].update(multiplier=-1)), '"multiplier"'),
        (spoilt(lambda data: data["rows"][0].update(color=[1, 2])), '"color"'),
        (spoilt(lambda data: data["rows"][0].pop("on")), '"on"'),
        (spoilt(lambda data: data["lights"][0]["matrix"].pop()), '"matrix"'),
        (spoilt(lambda data: data["lights"][0]["settings"].update(energy=[1])), '"energy"'),
    ],
)
def test_a_bad_look_is_one_clear_line(text, says):
    with pytest.raises(LookError) as error:
        from_json(text)
    assert says in str(error.value) and "\n" not in str(error.value)
