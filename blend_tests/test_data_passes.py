"""Data passes of F12 against those of Cycles: positions, UV, motion, pass indices, Cryptomatte and its metadata."""

import json
import struct

import bpy
import numpy as np
import pytest

import addon
from addon.engine.render.data_passes import (
    MATERIAL_INDEX,
    MATTES,
    OBJECT_INDEX,
    POSITION,
    TEXTURE_COORDINATES,
    VECTOR,
    DataPassSettings,
)
from addon.engine.render.unwritten_passes import unwritten_passes
from exr import read_exr, read_fields
from helpers import add_light, add_material, add_quad, write_multilayer

pytestmark = pytest.mark.every_version

LAYER = "View Layer.1"


@pytest.fixture
def shot(scene, tmp_path):
    """A ground, and before it a card of glass-like transparency and a small opaque one, that belongs to an empty."""
    addon.register()
    white, tree, output = add_material("White")
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], output.inputs["Surface"])
    half, tree, output = add_material("Half")
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = 0.25
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    ground = add_quad(scene, "Ground", size=3.0, material=white)
    veil = add_quad(scene, "Veil é", size=1.0, material=half)
    card = add_quad(scene, "Card", size=0.7, material=white)
    veil.location, card.location, card.rotation_euler = (0.3, 0.1, 0.5), (-0.4, 0.2, 0.4), (0.2, 0.3, 0.4)
    rig = bpy.data.objects.new("Rig", None)
    scene.collection.objects.link(rig)
    card.parent = rig
    ground.pass_index, veil.pass_index, white.pass_index, half.pass_index = 3, 5, 7, 9
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    layer = scene.view_layers[0]
    layer.name = LAYER
    layer.use_pass_position = layer.use_pass_object_index = layer.use_pass_material_index = True
    layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = layer.use_pass_cryptomatte_asset = True
    layer.pass_cryptomatte_depth, layer.pass_alpha_threshold = 4, 0.2
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.relume.quality, scene.relume.samples = "CUSTOM", 64
    scene.relume.folder = str(tmp_path / "bake")
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = 64, False, False
    write_multilayer(scene, tmp_path / "f12.exr")
    yield scene
    addon.unregister()


def render(scene, tmp_path, engine):
    """Channels and texts of the file that an engine renders."""
    scene.render.engine = engine
    bpy.ops.render.render(write_still=True)
    path = tmp_path / "f12.exr"
    channels = {name.removeprefix(f"{LAYER}."): channel for name, channel in read_exr(path).items()}
    return channels, {name: text for name, text in read_fields(path).items() if name.startswith("cryptomatte/")}


def mattes_of(channels, fields, matte):
    """Shares of the pixels by the names of a matte's manifest, as the specification decodes them."""
    title = f"{LAYER}.{matte}"
    (key,) = [name.split("/")[1] for name, text in fields.items() if name.endswith("/name") and text == title]
    assert fields[f"cryptomatte/{key}/hash"] == "MurmurHash3_32"
    assert fields[f"cryptomatte/{key}/conversion"] == "uint32_to_float32"
    manifest = json.loads(fields[f"cryptomatte/{key}/manifest"])
    found = {}
    for name, code in manifest.items():
        (wanted,) = struct.unpack(">f", bytes.fromhex(code))
        ranks = [(f"{matte}{level:02d}.{a}", f"{matte}{level:02d}.{b}") for level in range(2) for a, b in ("rg", "ba")]
        shares = [channels[share] * (channels[identity] == np.float32(wanted)) for identity, share in ranks]
        found[name] = np.sum(shares, axis=0)
    return found


def test_mattes_are_those_of_cycles_with_their_names(shot, tmp_path):
    ours, theirs = (render(shot, tmp_path, engine) for engine in ("RELUME", "CYCLES"))
    names = {
        "CryptoObject": {"Ground", "Veil é", "Card"},
        "CryptoMaterial": {"White", "Half"},
        "CryptoAsset": {"Ground", "Veil é", "Rig"},
    }
    for matte in MATTES:
        mine, other = mattes_of(*ours, matte), mattes_of(*theirs, matte)
        assert names[matte] <= set(mine)
        for name in names[matte]:
            assert mine[name].mean() == pytest.approx(other[name].mean(), rel=0.01), (matte, name)
            # Shares of an edge are counts of 64 rays each.
            assert np.abs(mine[name] - other[name]).max() < 0.35, (matte, name)
            assert np.abs(mine[name] - other[name]).mean() < 0.01, (matte, name)
    veiled = mattes_of(*ours, "CryptoObject")["Veil é"]
    assert veiled.max() == pytest.approx(0.25, abs=1e-3)


def test_the_compositor_finds_an_object_by_its_name(shot, tmp_path):
    if bpy.app.version >= (5, 0, 0):
        tree = shot.compositing_node_group = bpy.data.node_groups.new("Matte", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        output = tree.nodes.new("NodeGroupOutput")
    else:
        shot.use_nodes = True
        tree = shot.node_tree
        tree.nodes.clear()
        output = tree.nodes.new("CompositorNodeComposite")
    node = tree.nodes.new("CompositorNodeCryptomatteV2")
    node.source, node.scene, node.layer_name, node.matte_id = "RENDER", shot, f"{LAYER}.CryptoObject", "Card"
    tree.links.new(node.outputs["Matte"], output.inputs[0])
    channels, fields = render(shot, tmp_path, "RELUME")
    (found,) = [channel for name, channel in channels.items() if name.endswith("Composite.Combined.R")]
    np.testing.assert_allclose(found, mattes_of(channels, fields, "CryptoObject")["Card"], atol=1e-4)
    assert 0.02 < found.mean() < 0.2


def test_positions_and_indices_are_those_of_cycles(shot, tmp_path):
    (ours, fields), (theirs, _) = (render(shot, tmp_path, engine) for engine in ("RELUME", "CYCLES"))
    # Each is of one ray, which sees another place of pixels at edges.
    shares = np.stack(list(mattes_of(ours, fields, "CryptoObject").values()))
    inside = (np.abs(shares - np.round(4.0 * shares) / 4.0) < 1e-3).all(axis=0)
    assert inside.mean() > 0.6
    for name in (OBJECT_INDEX, MATERIAL_INDEX):
        assert len(np.unique(ours[f"{name}.X"][inside])) > 2
        assert (ours[f"{name}.X"] == theirs[f"{name}.X"])[inside].mean() > 0.99
    shot.view_layers[0].pass_alpha_threshold = 0.5
    through, _ = render(shot, tmp_path, "RELUME")
    assert 5.0 not in through[f"{OBJECT_INDEX}.X"][inside] and 5.0 in ours[f"{OBJECT_INDEX}.X"][inside]
    for axis in "XYZ":
        difference = np.abs(ours[f"{POSITION}.{axis}"] - theirs[f"{POSITION}.{axis}"])[inside]
        # A pixel is 0.075 m wide.
        assert difference.mean() < 0.04 and np.quantile(difference, 0.99) < 0.12


def test_uv_are_those_of_cycles_of_the_map_that_renders_use(shot, tmp_path):
    for name in ("Ground", "Veil é"):  # The card has no map.
        maps = shot.objects[name].data.uv_layers
        first, second = maps.new(name="First"), maps.new(name="Second")
        for corner, value in zip(second.data, ((0.25, 0.5), (0.75, 0.5), (1.5, 1.0), (0.0, 2.0)), strict=True):
            corner.uv = value
        first.active_render, second.active_render = name != "Ground", name == "Ground"
    layer = shot.view_layers[0]
    layer.use_pass_uv = True
    layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = layer.use_pass_cryptomatte_asset = False
    pictures = {}
    for threshold in (0.2, 0.5):
        layer.pass_alpha_threshold = threshold
        found = [render(shot, tmp_path, engine)[0] for engine in ("RELUME", "CYCLES")]
        ours, theirs = (np.stack([one[f"{TEXTURE_COORDINATES}.{axis}"] for axis in "UVA"]) for one in found)
        blocks = [picture.reshape(3, 8, 4, 12, 4).mean(axis=(2, 4)) for picture in (ours, theirs)]
        np.testing.assert_allclose(*blocks, atol=0.02)
        assert np.abs(ours - theirs).mean() < 0.01 and np.ptp(blocks[0][0]) > 0.3
        pictures[threshold] = ours
    # Through the veil the ground is seen.
    assert np.abs(pictures[0.2] - pictures[0.5]).max() > 0.3
    share = pictures[0.2][2]
    assert share.max() == pytest.approx(1.0) and 0.02 < (share < 0.01).mean() < 0.5, (
        "of the card, and beside the ground"
    )


def test_passes_that_are_not_written_are_named(shot):
    layer = shot.view_layers[0]
    assert unwritten_passes(shot, layer) == ""
    layer.use_pass_environment = layer.use_pass_mist = True
    layer.aovs.add().name = "Dirt"
    layer.lightgroups.add(name="Keys")
    words = unwritten_passes(shot, layer)
    assert words.startswith(f"view layer '{LAYER}'") and "'Mist', 'Environment', 'Dirt' and 1 more" in words


def test_passes_that_nobody_wants_are_not_traced(shot, tmp_path, monkeypatch):
    layer = shot.view_layers[0]
    for name in dir(layer):
        if name.startswith("use_pass_") and name != "use_pass_combined":
            setattr(layer, name, False)
    monkeypatch.setattr(addon.engine.render.render_engine.DataPassSettings, "trace", None)
    channels, fields = render(shot, tmp_path, "RELUME")
    assert not fields and not any(name.startswith(("Crypto", POSITION)) for name in channels)


def inside(mask, steps=2):
    """A mask without the pixels at its edge."""
    for _ in range(steps):
        padded = np.pad(mask, 1)
        mask = mask & padded[2:, 1:-1] & padded[:-2, 1:-1] & padded[1:-1, 2:] & padded[1:-1, :-2]
    return mask


def test_vectors_are_those_of_cycles(shot, tmp_path):
    layer = shot.view_layers[0]
    layer.use_pass_vector = True
    layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = layer.use_pass_cryptomatte_asset = False
    shot.frame_set(5)
    for obj, frame, place in (
        (shot.camera, 3, (0.1, 0.0, 5.0)),
        (shot.camera, 8, (-0.2, 0.1, 4.6)),
        (shot.objects["Card"], 3, (-0.4, 0.2, 0.4)),
        (shot.objects["Card"], 8, (-0.1, 0.5, 0.6)),
    ):
        obj.location = place
        obj.keyframe_insert("location", frame=frame)
    veil = shot.objects["Veil é"]
    veil.shape_key_add(name="Basis")
    key = veil.shape_key_add(name="Wide")
    for point in key.data:
        point.co.x *= 1.5
    for frame, value in ((3, 0.0), (8, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)
    shot.frame_set(5)
    found = [render(shot, tmp_path, engine)[0] for engine in ("RELUME", "CYCLES")]
    ours, theirs = (np.stack([one[f"{VECTOR}.{axis}"] for axis in "XYZW"]) for one in found)
    assert np.abs(ours).max() > 1.0 and shot.frame_current == 5
    # Pixels that few rays meet may have none of the one or of the other.
    seen = [(picture != 0.0).any(axis=0) for picture in (ours, theirs)]
    both = seen[0] & seen[1]
    if bpy.app.version[:2] == (5, 2):
        # The background there has the way of the camera's turn, none here, which edges have a share of.
        both = inside(both)
    assert (seen[0] ^ seen[1]).mean() < 0.02 and 0.3 < both.mean() < 0.95
    difference = np.abs(ours - theirs)[:, both]
    assert difference.mean() < 0.003 and difference.max() < 0.3
    before, after = ours[:2], ours[2:]
    assert np.abs(before - after).max() > 0.05, "the two ways differ"


def test_vectors_with_motion_blur_and_of_panoramas_are_named(shot):
    layer = shot.view_layers[0]
    layer.use_pass_vector = True
    assert DataPassSettings.of(shot, layer).vector
    shot.render.use_motion_blur = True
    assert "'Vector (with motion blur)'" in unwritten_passes(shot, layer)
    shot.render.use_motion_blur, shot.camera.data.type = False, "PANO"
    assert "'Vector (of a panoramic camera)'" in unwritten_passes(shot, layer)
    assert not DataPassSettings.of(shot, layer).vector
