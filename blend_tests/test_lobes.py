"""Pictures of lights parted by lobes: against the light passes of Cycles, and as passes of F12."""

import bpy
import numpy as np
import pytest
import relume

import addon
from addon.commands import run
from addon.core.pass_names import LOBES
from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from exr import read_exr
from helpers import add_light, add_material, add_quad, write_multilayer

pytestmark = pytest.mark.every_version

IS_OLD = bpy.app.version < (5, 0, 0)
BLOCK = 8


def cycles_name(part):
    """Name of a part's pass in files of Cycles."""
    if not IS_OLD:
        return part
    short = {"Diffuse": "Diff", "Transmission": "Trans", "Glossy": "Gloss", "Emission": "Emit", "Volume": "Volume"}
    lobe, *way = part.split()
    return short[lobe] + {"Direct": "Dir", "Indirect": "Ind", "": ""}["".join(way)]


def color_name(part):
    """Name of the pass of the colour that Cycles divides a part by; none if it does not."""
    lobe = part.split()[0]
    if lobe in {"Emission", "Volume"}:
        return None
    return {"Diffuse": "DiffCol", "Glossy": "GlossCol", "Transmission": "TransCol"}[lobe] if IS_OLD else f"{lobe} Color"


def surface(name, *shaders):
    """A material that adds the halves of two shaders, or has one."""
    material, tree, output = add_material(name)
    nodes = []
    for kind, values in shaders:
        node = tree.nodes.new(kind)
        for socket, value in values.items():
            node.inputs[socket].default_value = value
        nodes.append(node)
    if len(nodes) == 2:
        mix = tree.nodes.new("ShaderNodeMixShader")
        for number, node in enumerate(nodes):
            tree.links.new(node.outputs[0], mix.inputs[1 + number])
        nodes = [mix]
    tree.links.new(nodes[0].outputs[0], output.inputs["Surface"])
    return material


@pytest.fixture
def room(scene):
    """A floor, a red wall, a mirror, a glossy card, a veil, and a pane of glass above a bulb in sight."""
    diffuse, glossy = "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy"
    red, orange, grey = (0.8, 0.1, 0.1, 1.0), (0.8, 0.5, 0.1, 1.0), (0.6, 0.6, 0.6, 1.0)
    add_quad(scene, "Floor", size=6.0, material=surface("Grey", (diffuse, {"Color": grey})))
    wall = add_quad(scene, "Wall", size=4.0, material=surface("Red", (diffuse, {"Color": red})))
    wall.location, wall.rotation_euler = (-1.6, 0.0, 1.0), (0.0, 1.3, 0.0)
    mixed = surface("Mixed", (diffuse, {"Color": orange}), (glossy, {"Color": grey, "Roughness": 0.5}))
    card = add_quad(scene, "Card", size=0.9, material=mixed)
    card.location, card.rotation_euler = (0.6, 0.6, 0.3), (0.2, -0.2, 0.0)
    mirror = add_quad(scene, "Mirror", size=0.8, material=surface("Mirror", (glossy, {"Roughness": 0.0})))
    mirror.location, mirror.rotation_euler = (0.6, -0.5, 0.3), (0.0, -0.55, 0.0)  # It shows the wall.
    glass = surface("Glass", ("ShaderNodeBsdfRefraction", {"Roughness": 0.3, "IOR": 1.1}))
    pane = add_quad(scene, "Pane", size=0.6, material=glass)
    pane.location = (-0.25, 0.1, 2.2)  # Before half of the bulb.
    veil = surface("Veil", (diffuse, {"Color": orange}), ("ShaderNodeBsdfTransparent", {}))
    sheet = add_quad(scene, "Sheet", size=0.7, material=veil)
    sheet.location = (-0.5, 0.6, 0.6)
    add_light(scene, "POINT", name="Key", location=(0.1, 0.1, 1.6), energy=120.0, shadow_soft_size=0.25)
    scene.objects["Key"].visible_camera = True
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    return scene


def lobes(scene, folder, samples):
    """Lobes of the light *Key* by Relume, raw, top row first, and the light's picture."""
    bpy.context.view_layer.update()
    loaded = load_scene(scene)
    assert loaded.warnings == []
    relume.bake(loaded, folder, trace_settings(scene, lambda _: None) | {"samples": samples}).wait()
    picture = relume.Relighter(folder).relight(loaded.lights(), denoise=False, lobes=True)
    return picture["lobes"]["Key"], picture["lights"]["Key"]


def cycles_lobes(scene, path, samples):
    """Light of Cycles' passes by part, and its picture."""
    layer = scene.view_layers[0]
    for lobe in ("diffuse", "glossy", "transmission"):
        for way in ("direct", "indirect", "color"):
            setattr(layer, f"use_pass_{lobe}_{way}", True)
    layer.use_pass_emit = True
    layer.cycles.use_pass_volume_direct = layer.cycles.use_pass_volume_indirect = True
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = samples, False, False
    cycles.light_sampling_threshold, cycles.pixel_filter_type = 0.0, "BOX"
    scene.render.engine = "CYCLES"
    write_multilayer(scene, path)
    bpy.ops.render.render(write_still=True)
    passes = {}
    for name, channel in read_exr(path).items():
        _, name, letter = name.split(".")
        passes.setdefault(name, {})[letter] = channel
    passes = {name: np.stack([found[c] for c in "RGB"], -1) for name, found in passes.items() if "R" in found}
    found = {}
    for part in LOBES:
        color = color_name(part)
        found[part] = passes[cycles_name(part)] * (passes[color] if color else 1.0)
    return found, passes["Combined"]


def blocks(image):
    """Means of the blocks of an image."""
    height, width, channels = image.shape
    shape = (height // BLOCK, BLOCK, width // BLOCK, BLOCK, channels)
    return image.reshape(shape).mean(axis=(1, 3))


def compare(ours, theirs, wanted, tolerance):
    """Each part is as bright as that of Cycles by blocks, on average; those that are not wanted are black.

    Brightness only: where a surface has several lobes, each has the colour of all."""
    for part in LOBES:
        a, b = (blocks(picture[part]).mean(axis=-1) for picture in (ours, theirs))
        if part in wanted:
            error = np.abs(a - b).mean() / b.mean()
            assert b.mean() > 1e-4, part
            assert error < tolerance, (part, error, a.mean(), b.mean())
        else:
            assert a.max() == 0.0 and b.max() < 1e-6, part


def test_lobes_of_surfaces_are_those_of_cycles(room, tmp_path):
    room.cycles.pixel_filter_type = "BOX"
    ours, whole = lobes(room, tmp_path / "bake", 512)
    np.testing.assert_allclose(sum(ours.values()), whole, rtol=1e-5, atol=1e-7)
    theirs, combined = cycles_lobes(room, tmp_path / "cycles.exr", 512)
    assert sum(theirs.values()).mean() == pytest.approx(combined.mean(), rel=1e-3)
    compare(ours, theirs, {part for part in LOBES if not part.startswith("Volume")}, 0.06)


def test_lobes_of_a_fog_are_those_of_cycles(room, tmp_path):
    fog, tree, output = add_material("Fog")
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 0.4
    tree.links.new(scatter.outputs[0], output.inputs["Volume"])
    bpy.ops.mesh.primitive_cube_add(size=1.2, location=(0.0, 0.0, 0.8))
    bpy.context.object.data.materials.append(fog)
    for name in ("Card", "Mirror", "Pane", "Sheet"):
        bpy.data.objects.remove(room.objects[name])
    room.objects["Key"].data.shadow_soft_size = 0.4
    room.cycles.pixel_filter_type, room.cycles.volume_bounces = "BOX", 2
    ours, _ = lobes(room, tmp_path / "bake", 512)
    theirs, _ = cycles_lobes(room, tmp_path / "cycles.exr", 512)
    wanted = {"Emission", "Diffuse Direct", "Diffuse Indirect", "Volume Direct", "Volume Indirect"}
    compare(ours, theirs, wanted, 0.07)


@pytest.fixture
def shot(room, tmp_path):
    """The room with a second light, that F12 renders by Relume."""
    addon.register()
    add_light(room, "AREA", name="Rim.001", location=(1, 0, 2), size=1.0)
    room.render.engine = "RELUME"
    room.relume.quality, room.relume.samples = "CUSTOM", 16
    room.relume.folder = str(tmp_path / "bake")
    write_multilayer(room, tmp_path / "f12.exr")
    yield room
    addon.unregister()


def test_passes_of_lobes_add_up_to_their_light_and_are_those_of_the_command_line(shot, tmp_path):
    shot.relume_render.lobe_passes = True
    bpy.ops.render.render(write_still=True)
    passes = read_exr(tmp_path / "f12.exr")
    for light in ("Key", "Rim_001"):
        for letter in "RGB":
            parts = [passes[f"ViewLayer.{part}_{light}.{letter}"] for part in LOBES]
            np.testing.assert_allclose(sum(parts), passes[f"ViewLayer.Combined_{light}.{letter}"], rtol=1e-5, atol=1e-7)
            assert sum(part.max() > 0.0 for part in parts) > 3
    out = tmp_path / "relit.exr"
    bake = str(tmp_path / "bake")
    assert run(["relight", bake, "--out", str(out), "--quiet", "--float", "--lobes"]) == 0
    file = read_exr(out)
    for name, channel in passes.items():
        assert (channel == file[name]).all(), name
    plain = ["relight", bake, "--out", str(out), "--quiet", "--float", "--lobes", "--layout", "plain"]
    assert run(plain) == 0
    assert (read_exr(out)["Diffuse_Direct_Key.R"] == passes["ViewLayer.Diffuse Direct_Key.R"]).all()


def test_lobes_need_the_bake_and_cost_nothing_unless_asked_for(shot, tmp_path):
    bpy.ops.render.render(write_still=True)
    assert not any("Direct" in name for name in read_exr(tmp_path / "f12.exr"))
    assert all(parts == {} for parts in relume.Relighter(tmp_path / "bake").relight()["lobes"].values())
