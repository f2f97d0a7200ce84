"""Lights of OpenUSD: what other programs write, what a file lacks, and OpenUSD's own reader (usd-core, if it is there:
`pip install usd-core` somewhere on PYTHONPATH)."""

import math
import random
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
from addon.core.looks import Look, from_json, to_json  # noqa: E402
from addon.core.rows import GROUP, WORLD, Row  # noqa: E402
from addon.core.usd.reading import look_of  # noqa: E402
from addon.core.usd.text import UsdError  # noqa: E402
from addon.core.usd.writing import write  # noqa: E402

HEAD = '#usda 1.0\n(\n    metersPerUnit = {metres}\n    upAxis = "{up}"\n)\n'
HOUDINI = """
def Xform "rig" ( kind = "group" )
{
    double3 xformOp:translate = (100, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    # A comment with a "quote
    def SphereLight "key" (
        prepend apiSchemas = ["ShapingAPI"]
    )
    {
        color3f inputs:color.timeSamples = { 1: (1, 0.5, 0), 24: (0, 0, 1), }
        float inputs:exposure = 1
        float inputs:intensity = 10 ( doc = "x (y" )
        float inputs:radius = 5
        float inputs:shaping:cone:angle = 30
        rel light:filters = </rig/gobo>
        double3 xformOp:translate = (0, 200, 0)
        float3 xformOp:rotateXYZ = (-90, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }
    def RectLight "fill" { float inputs:width = 100
        float inputs:height = 50
        float inputs:intensity = 3
        bool inputs:normalize = true
        token visibility = "invisible"
    }
    def DomeLight_1 "sky" { asset inputs:texture:file = @./sky.hdr@ }
    class SphereLight "_unused" { }
}
"""


def light(kind="POINT", name="Lamp", **settings):
    """One light of a look at (1, 2, 3)."""
    own = {
        "POINT": {"shadow_soft_size": 0.25, "use_soft_falloff": True},
        "SPOT": {"shadow_soft_size": 0.1, "use_soft_falloff": False, "spot_size": 1.0, "spot_blend": 0.3},
        "SUN": {"angle": 0.1},
        "AREA": {"shape": "ELLIPSE", "size": 2.0, "size_y": 0.5, "spread": math.pi},
    }[kind]
    matrix = [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]]
    values = {"energy": 100.0, "color": [1.0, 0.5, 0.25], **own, **settings}
    return {"name": name, "type": kind, "matrix": matrix, "hidden": False, "settings": values}


def test_a_rig_in_centimetres_with_y_up_stands_in_metres():
    look, warnings = look_of(HEAD.format(metres=0.01, up="Y") + HOUDINI, "rig")
    key, fill = look.lights
    assert (key["name"], key["type"], fill["type"]) == ("key", "SPOT", "AREA")
    # Down along y there is down along z here; the spot shines along its own -z.
    assert [row[3] for row in key["matrix"][:3]] == pytest.approx([1.0, 0.0, 2.0])
    assert [row[2] for row in key["matrix"][:3]] == pytest.approx([0.0, 0.0, 1.0])
    assert key["settings"]["spot_size"] == pytest.approx(math.radians(60))
    # A sphere of radiance 20 and 5 cm: 4 pi^2 r^2 L.
    assert key["settings"]["shadow_soft_size"] == pytest.approx(0.05)
    assert key["settings"]["energy"] == pytest.approx(4 * math.pi**2 * 0.05**2 * 20)
    assert key["settings"]["color"] == [1.0, 0.5, 0.0]
    # Its radiance is 3 / (100 x 50), its area half a square metre.
    assert fill["settings"]["energy"] == pytest.approx(math.pi * 0.5 * 3 / 5000)
    assert [row.on for row in look.rows] == [True, False]
    assert any("'sky' is left out" in words for words in warnings)
    assert any("'key'" in words and "filters" in words and "first frame" in words for words in warnings)
    assert from_json(to_json(look)) == look


def test_what_rows_do_is_in_the_file():
    lights = (light(name="Key"), light("SUN", name="Sun", energy=3.0), light("AREA", name="Fill"))
    rows = (
        Row("Key", exposure=1.0),
        Row("Sun", on=False),
        Row("Rig", GROUP, multiplier=0.5),
        Row("W", WORLD, on=False),
    )
    written = write(Look("Dusk", rows, lights), {"Fill": ["Rig"]}, {"Key": [1.0, 0.0, 1.0]})
    look, _ = look_of(written.text, "other")
    assert look.name == "Dusk"
    key, sun, fill = (found["settings"] for found in look.lights)
    assert key["energy"] == pytest.approx(200) and key["color"] == pytest.approx([1.0, 0.0, 0.25])
    assert sun["energy"] == pytest.approx(3.0) and [row.on for row in look.rows] == [True, False, True]
    assert fill["energy"] == pytest.approx(50) and fill["shape"] == "ELLIPSE"
    assert (fill["size"], fill["size_y"]) == pytest.approx((2.0, 0.5))
    assert written.warnings == ["the row of the world is not written: the file holds lights only"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("PXR-USDC", "begins with #usda"),
        (HEAD.format(metres=1, up="Z") + 'def SphereLight "a" {', "file ends"),
        (HEAD.format(metres=1, up="Z") + 'def SphereLight "a" { float inputs:radius = "big" }', "not of the kind"),
        (HEAD.format(metres=1, up="Z") + 'def Xform "a" { }', "no light"),
        ("#usda 1.0\n" + 'def Xform "a" {' * 5000, "inside of each other"),
        ("#usda 1.0\n" + 'def Xform "a" { float[] b = ' + "[" * 5000, "inside of each other"),
        (HEAD.format(metres=1, up="Z") + 'def Xform "a" ( references = @b.usd@</c> ) { }', "usdcat --flatten"),
    ],
)
def test_what_cannot_be_read_is_one_line(text, says):
    with pytest.raises(UsdError, match=says) as caught:
        look_of(text, "x")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_damage_anywhere_is_told_and_nothing_else_happens():
    whole = write(Look("L", (), (light(), light("SPOT", "S"), light("AREA", "A"))), {}, {}).text
    dice = random.Random(1)
    outcomes = set()
    for _ in range(400):
        start = dice.randrange(len(whole))
        damaged = whole[:start] + dice.choice(["", "(", '"', "}", "9e999", "x"]) + whole[start + dice.randrange(9) :]
        try:
            look_of(damaged, "x")
            outcomes.add("read")
        except UsdError:
            outcomes.add("told")
    assert outcomes == {"read", "told"}


@pytest.fixture
def pxr():
    """OpenUSD itself."""
    return pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")


def test_openusd_reads_what_is_written(pxr, tmp_path):
    from pxr import Gf, Usd, UsdGeom, UsdLux

    lights = (light(name='Key "1"/ä'), light("SPOT", "S"), light("SUN", "Sun"), light("AREA", "A", spread=1.0))
    (tmp_path / "out.usd").write_text(write(Look("L", (Row("S", on=False),), lights), {}, {}).text, encoding="utf-8")
    stage = Usd.Stage.Open(str(tmp_path / "out.usd"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    key, spot, sun, area = stage.GetDefaultPrim().GetChildren()
    assert key.GetDisplayName() == 'Key "1"/ä' and all(prim.HasAPI(UsdLux.LightAPI) for prim in (key, spot, sun, area))
    assert UsdLux.SphereLight(key).GetRadiusAttr().Get() == 0.25
    assert UsdLux.LightAPI(key).GetIntensityAttr().Get() == pytest.approx(100 / math.pi)
    assert UsdLux.LightAPI(key).GetColorAttr().Get() == Gf.Vec3f(1.0, 0.5, 0.25)
    assert UsdLux.LightAPI(key).GetNormalizeAttr().Get() is True
    assert UsdLux.ShapingAPI(spot).GetShapingConeAngleAttr().Get() == pytest.approx(math.degrees(0.5))
    assert UsdGeom.Imageable(spot).ComputeVisibility() == "invisible"
    assert UsdLux.DistantLight(sun).GetAngleAttr().Get() == pytest.approx(math.degrees(0.1))
    assert UsdLux.LightAPI(sun).GetIntensityAttr().Get() == 100.0
    place = UsdGeom.Xformable(area).ComputeLocalToWorldTransform(0)
    assert place.Transform(Gf.Vec3d(0.5, 0.0, 0.0)) == Gf.Vec3d(2.0, 2.0, 3.0), "the end of a diameter of 2 m"


def test_places_and_values_are_those_of_openusd(pxr, tmp_path):
    from pxr import Gf, Usd, UsdGeom, UsdLux

    dice = random.Random(2)
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for number in range(20):
        root = UsdGeom.Xform.Define(stage, f"/r{number}")
        for _ in range(3):
            kind = dice.choice("translate scale rotate orient transform".split())
            vector = Gf.Vec3d(*(dice.uniform(0.5, 2.0) for _ in range(3)))
            suffix = f"n{len(root.GetOrderedXformOps())}"
            double = UsdGeom.XformOp.PrecisionDouble
            if kind == "rotate":
                order = dice.choice("XYZ XZY YXZ YZX ZXY ZYX".split())
                getattr(root, f"AddRotate{order}Op")(double, suffix).Set(vector * 50)
            elif kind == "orient":
                root.AddOrientOp(double, suffix).Set(Gf.Quatd(1.0, vector).GetNormalized())
            elif kind == "transform":
                root.AddTransformOp(double, suffix).Set(Gf.Matrix4d(1.0).SetRotate(Gf.Rotation(vector, 40.0)))
            else:
                getattr(root, f"Add{kind.title()}Op")(double, suffix).Set(vector)
        pivot = root.AddTranslateOp(double, "pivot")
        pivot.Set(Gf.Vec3d(1, 2, 3))
        root.AddTranslateOp(double, "pivot", isInverseOp=True)
        UsdLux.RectLight.Define(stage, f"/r{number}/light").CreateIntensityAttr(number + 1.0)
    stage.Save()
    look, warnings = look_of((tmp_path / "in.usda").read_text(), "x")
    assert not warnings and len(look.lights) == 20
    for number, found in enumerate(look.lights):
        prim = stage.GetPrimAtPath(f"/r{number}/light")
        wanted = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0)
        for row in range(4):
            assert found["matrix"][row] == pytest.approx([wanted[column][row] for column in range(4)], abs=1e-6)
        x, y = (wanted.TransformDir(axis).GetLength() for axis in (Gf.Vec3d(1, 0, 0), Gf.Vec3d(0, 1, 0)))
        assert found["settings"]["energy"] == pytest.approx(math.pi * x * y * (number + 1), rel=1e-6)
