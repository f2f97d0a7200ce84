"""Writes a .blend file as a Mitsuba scene, so that Mitsuba can trace what Relume and Cycles trace.

Geometry, camera and area lights are those of Relume's own export. Materials are approximated: the main closure of each
becomes Mitsuba's `principled`, each of its inputs a constant or the first image texture behind it. Textures keep sRGB
bytes; normal maps, bumps, mixes and alpha are left out, and the world is its mean colour.
"""

import argparse
import json
import math
import os
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import bpy
import numpy as np
from mathutils import Matrix
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.engine.reading.render_depsgraph import with_render_depsgraph  # noqa: E402
from addon.export import ExportOptions, export_scene  # noqa: E402

HEADER = """<scene version="3.0.0"><default name="spp" value="64"/><default name="resx" value="640"/>
<default name="resy" value="360"/><default name="max_depth" value="8"/>
<integrator type="path"><integer name="max_depth" value="$max_depth"/></integrator></scene>"""
COLORS = {"diffuse": "color", "glossy": "color", "glass": "color", "refraction": "color", "translucent": "color"}


class MitsubaScene:
    """Receives what `export_scene` finds, as a `relume.SceneBuilder` would, and writes it into a folder."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.xml = Xml.fromstring(HEADER)
        self.meshes, self.textures, self.materials = [], [], []

    def warn(self, message):
        """Drops warnings: whatever Relume's export leaves out is left out here as well."""

    def add_mesh(self, name, positions, corner_verts, face_starts, **attributes):
        """One PLY file for each material slot; numbers of slots and their files."""
        triangles, face = fans(face_starts, len(corner_verts))
        slots = attributes.get("material_slots")
        slots = np.zeros(len(face), np.int32) if slots is None else slots[face]
        normals = attributes.get("corner_normals")
        if attributes.get("vertex_normals") is not None:
            normals = attributes["vertex_normals"][corner_verts]
        uvs = next(iter(attributes.get("uv_maps", {}).values()), None)
        files = {}
        for slot in np.unique(slots):
            files[int(slot)] = f"mesh{len(self.meshes)}_{slot}.ply"
            corners = triangles[slots == slot].reshape(-1)
            columns = [positions[corner_verts[corners]]]
            columns += [values[corners] for values in (normals, uvs) if values is not None]
            write_ply(self.folder / files[int(slot)], np.hstack(columns), normals is not None, uvs is not None)
        self.meshes.append(files)
        return len(self.meshes) - 1

    def add_instance(self, name, mesh, world_from_object, materials, **_options):
        """A shape for each slot in use."""
        for slot, file in self.meshes[mesh].items():
            material = self.materials[materials[min(slot, len(materials) - 1)]]
            shape = element(self.xml, "shape", type="ply")
            element(shape, "string", name="filename", value=file)
            element(shape, "ref", id=material["id"])
            transform(shape, world_from_object)
            if any(material["emission"]):
                emitter(shape, material["emission"])

    def add_material(self, text):
        """A `principled` of the main closure."""
        material, number = json.loads(text), len(self.materials)
        nodes = material["nodes"]
        closure, emission = main_closure(nodes, material["surface"])
        glassy = closure["type"] in {"glass", "refraction"} or constant(closure.get("transmission_weight", 0)) > 0.5
        bsdf = element(self.xml, "bsdf", type="principled" if glassy else "twosided", id=f"material{number}")
        inner = bsdf if glassy else element(bsdf, "bsdf", type="principled")
        color = closure.get("base_color", closure.get(COLORS.get(closure["type"]), [0.8] * 3))
        self._input(inner, "base_color", nodes, color)
        is_principled, glossy = closure["type"] == "principled", closure["type"] in {"glossy", "glass", "refraction"}
        self._input(inner, "roughness", nodes, closure["roughness"] if is_principled or glossy else 1.0)
        self._input(inner, "metallic", nodes, closure.get("metallic", float(closure["type"] == "glossy")))
        if glassy:
            element(inner, "float", name="spec_trans", value="1")
            element(inner, "float", name="eta", value=str(max(constant(closure.get("ior", 1.5)), 1.01)))
        self.materials.append({"id": f"material{number}", "emission": emission})
        return number

    def _input(self, bsdf, name, nodes, value):
        image = first_image(nodes, value)
        if image is not None:
            texture = element(bsdf, "texture", type="bitmap", name=name)
            element(texture, "string", name="filename", value=self.textures[image][0])
            element(texture, "boolean", name="raw", value=str(name != "base_color").lower())
        elif name == "base_color":
            element(bsdf, "rgb", name=name, value=" ".join(map(str, np.clip(rgb(value), 0, 1))))
        else:
            element(bsdf, "float", name=name, value=str(min(max(constant(value), 0.001), 1.0)))

    def add_texture_file(self, _name, _path, **_options):
        """None: Blender reads them."""

    def add_texture(self, name, texels, **_options):
        """A PNG file, and its mean colour."""
        file = f"texture{len(self.textures)}.png"
        pixels = texels if texels.dtype == np.uint8 else np.rint(np.clip(texels, 0, 1) ** (1 / 2.2) * 255)
        Image.fromarray(pixels[::-1, :, :3].astype(np.uint8)).save(self.folder / file)
        self.textures.append((file, texels[..., :3].reshape(-1, 3).mean(0) / (255 if texels.dtype == np.uint8 else 1)))
        return len(self.textures) - 1

    def set_camera(self, text):
        """Perspective, along the longer edge as Blender's automatic fit."""
        camera = json.loads(text)
        sensor = element(self.xml, "sensor", type="perspective")
        field = 2 * math.degrees(math.atan(camera["sensor"][0] / 2 / camera["lens"]))
        element(sensor, "float", name="fov", value=str(field))
        element(sensor, "string", name="fov_axis", value="larger")
        element(sensor, "float", name="near_clip", value=str(camera["clip_start"]))
        transform(sensor, Matrix(camera["world_from_object"]) @ Matrix.Diagonal((-1, 1, -1, 1)))
        sampler = element(sensor, "sampler", type="independent")
        element(sampler, "integer", name="sample_count", value="$spp")
        film = element(sensor, "film", type="hdrfilm")
        element(film, "integer", name="width", value="$resx")
        element(film, "integer", name="height", value="$resy")
        element(film, "rfilter", type="box")

    def add_light(self, text):
        """Area lights as rectangles; others are left out."""
        light = json.loads(text)
        if light["kind"]["type"] != "AREA":
            return
        width, height = light["kind"]["size"], light["kind"]["size_y"]
        shape = element(self.xml, "shape", type="rectangle")
        # Mitsuba's rectangle spans -1..1 and faces +z, Blender's light -z.
        size = Matrix.Diagonal((width / 2, height / 2, 1, 1)) @ Matrix.Rotation(math.pi, 4, "X")
        transform(shape, Matrix(light["world_from_object"]) @ size)
        emitter(shape, [light["energy"] * channel / (math.pi * width * height) for channel in light["color"]])

    def set_world(self, color, *, texture=None, **_options):
        """A constant."""
        mean = np.array(color) * (1 if texture is None else self.textures[texture][1])
        if mean.any():
            light = element(self.xml, "emitter", type="constant")
            element(light, "rgb", name="radiance", value=" ".join(map(str, mean)))

    def write(self):
        """The file that Mitsuba loads."""
        path = self.folder / "scene.xml"
        Xml.ElementTree(self.xml).write(path)
        return path


def fans(face_starts, corners):
    """Corners of triangles [T, 3] that share the first corner of their face, and the face of each."""
    counts = np.diff(np.append(face_starts, corners))
    face = np.repeat(np.arange(len(counts)), counts - 2)
    number = np.arange(len(face)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    first = face_starts[face]
    return np.stack([first, first + number + 1, first + number + 2], 1), face


def main_closure(nodes, number):
    """The closure that stands for a material, and its emission."""
    if number is None:
        return {"type": "diffuse", "color": [0, 0, 0]}, [0, 0, 0]
    node = nodes[number]
    if node["type"] in {"mix_shader", "add_shader"}:
        parts = [main_closure(nodes, part) for part in (node["a"], node["b"]) if part is not None]
        solid = [part for part in parts if part[0]["type"] not in {"transparent", "emission"}] or parts
        first = len(solid) > 1 and constant(node.get("factor", 0)) > 0.5
        return solid[first][0] if solid else node, [max(values) for values in zip(*(p[1] for p in parts), strict=True)]
    color, strength = node.get("emission_color"), node.get("emission_strength", 0)
    if node["type"] == "emission":
        color, strength = node["color"], node["strength"]
    emission = [0, 0, 0] if color is None else [channel * constant(strength) for channel in rgb(color)]
    return node, emission


def first_image(nodes, value):
    """Number of the first image texture behind an input."""
    if not isinstance(value, dict):
        return None
    node = nodes[value["node"]]
    if node["type"] == "image_texture":
        return node["texture"]
    behind = (first_image(nodes, part) for part in node.values() if isinstance(part, dict) and "node" in part)
    return next((image for image in behind if image is not None), None)


def rgb(value):
    """A constant colour; grey for links."""
    if isinstance(value, dict):
        return [0.5] * 3
    return value if isinstance(value, list) else [value] * 3


def constant(value):
    """A constant number; the middle for links."""
    return sum(rgb(value)) / 3


def element(parent, tag, **attributes):
    """A child element."""
    return Xml.SubElement(parent, tag, attributes)


def transform(parent, rows):
    """A `to_world` of matrix rows."""
    numbers = " ".join(str(float(value)) for row in rows for value in row)
    element(element(parent, "transform", name="to_world"), "matrix", value=numbers)


def emitter(shape, radiance):
    """Makes a shape emit."""
    light = element(shape, "emitter", type="area")
    element(light, "rgb", name="radiance", value=" ".join(map(str, radiance)))


def write_ply(path, vertices, has_normals, has_uvs):
    """Triangles in order, three vertices each, little endian."""
    names = ["x", "y", "z", *(["nx", "ny", "nz"] if has_normals else []), *(["u", "v"] if has_uvs else [])]
    properties = "".join(f"property float {name}\n" for name in names)
    count = len(vertices) // 3
    faces = np.empty(count, np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, np.arange(3 * count).reshape(-1, 3)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {3 * count}\n{properties}"
    header += f"element face {count}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("blend")
    parser.add_argument("folder", help="existing folder for scene.xml, its meshes and textures")
    args = parser.parse_args()
    bpy.ops.wm.open_mainfile(filepath=args.blend)
    bpy.ops.preferences.addon_enable(module="cycles")
    scene = MitsubaScene(args.folder)
    with_render_depsgraph(bpy.context.scene, lambda _engine, graph, _: export_scene(scene, graph, ExportOptions()))
    print(json.dumps({"scene": str(scene.write())}), flush=True)


if __name__ == "__main__":
    main()
    # Blender before 5.0 can crash at exit.
    os._exit(0)
