"""Opaque materials of a scene for Mitsuba as one, which reads their colours and constants from textures.

In every step Dr.Jit traces the code of each BSDF anew, which in a scene of many materials takes far longer than the
paths do. So the base colours of all opaque materials lie side by side in one texture, an atlas, their roughness and
metallic in two more like it, and the texture coordinates of meshes are moved there; meshes that share a BSDF Mitsuba
joins by itself. Every surface stays what it was. Tangents turn where the material is a constant, which changes the
noise of a seed but no mean: none of the materials is anisotropic.
"""

from xml.etree import ElementTree as Xml

import mitsuba as mi
import numpy as np

CONSTANTS = ("roughness", "metallic")
SHARED = "opaque"
WIDTH = 4096
"""Texels of an atlas, unless one patch alone is wider."""


class Material:
    """An opaque material, its meshes' texture coordinates, and its patch of the atlas."""

    def __init__(self, bsdf, folder):
        inputs = {part.get("name"): part for part in bsdf.find("bsdf")}
        self.constants = {name: float(inputs[name].get("value")) for name in CONSTANTS}
        color = inputs["base_color"]
        self.textured = color.tag == "texture"
        if self.textured:
            self.image = linear_image(folder / color.find("string").get("value"))
        else:
            self.image = np.array(color.get("value").split(), np.float32).reshape(1, 1, 3)
        self.size = np.array(self.image.shape[1::-1])
        self.low, self.high = np.full(2, np.inf), np.full(2, -np.inf)

    def texels(self, mesh):
        """Where the image is looked up [V, 2]: column and row, unwrapped."""
        uvs = np.array(mi.traverse(mesh)["vertex_texcoords"]) if self.textured and mesh.has_vertex_texcoords() else None
        return np.full((mesh.vertex_count(), 2), 0.5) if uvs is None else uvs.reshape(-1, 2) * self.size

    def needs(self, mesh):
        """Widens what the patch covers to this mesh, with a texel more for interpolation."""
        texels = self.texels(mesh)
        self.low = np.minimum(self.low, np.floor(texels.min(0)) - 1)
        self.high = np.maximum(self.high, np.ceil(texels.max(0)) + 1)

    def patch(self):
        """The part of the repeated image that is looked up [height, width, 3]."""
        columns, rows = (np.arange(low, high).astype(int) for low, high in zip(self.low, self.high, strict=True))
        return self.image[np.ix_(rows % self.size[1], columns % self.size[0])]


def share_bsdf(scene, folder):
    """Gives the opaque meshes of an XML scene, whose files are in a folder, one BSDF; new files go there as well."""
    materials = {bsdf.get("id"): Material(bsdf, folder) for bsdf in scene.findall("bsdf") if is_opaque(bsdf)}
    meshes = []
    for shape in scene.findall("shape"):
        reference = shape.find("ref")
        if reference is not None and reference.get("id") in materials:
            mesh = mi.load_dict({"type": "ply", "filename": str(folder / shape.find("string").get("value"))})
            materials[reference.get("id")].needs(mesh)
            meshes.append((shape, mesh))
    used = {shape.find("ref").get("id") for shape, _ in meshes}
    patches = {name: materials[name].patch() for name in used}
    places, size = shelves({name: patch.shape[1::-1] for name, patch in patches.items()})
    write_atlas(folder, size, [(places[name], patches[name], materials[name].constants) for name in used])
    for number, (shape, mesh) in enumerate(meshes):
        name = shape.find("ref").get("id")
        uvs = (materials[name].texels(mesh) - materials[name].low + places[name]) / size
        file = f"{SHARED}{number}.ply"
        with_texture_coordinates(mesh, uvs).write_ply(str(folder / file))
        shape.find("string").set("value", file)
        shape.find("ref").set("id", SHARED)
    for bsdf in scene.findall("bsdf"):
        if bsdf.get("id") in materials:
            scene.remove(bsdf)
    scene.insert(0, shared_bsdf())


def is_opaque(bsdf):
    """True if a BSDF is one that `mitsuba_scene.py` writes for surfaces without transmission, with an image for nothing
    but its base colour."""
    inner = bsdf.find("bsdf")
    return inner is not None and all(part.tag != "texture" or part.get("name") == "base_color" for part in inner)


def linear_image(path):
    """Linear RGB [height, width, 3], in the precision that Mitsuba keeps textures of bytes in."""
    bitmap = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float16, srgb_gamma=False)
    return np.array(bitmap)


def shelves(sizes):
    """Places (column, row) of named rectangles (width, height) beside each other, and the size of all together."""
    width = max(WIDTH, *(size[0] for size in sizes.values()))
    places, column, row, height = {}, 0, 0, 0
    for name in sorted(sizes, key=lambda name: -sizes[name][1]):
        if column + sizes[name][0] > width:
            column, row, height = 0, row + height, 0
        places[name] = (column, row)
        column, height = column + sizes[name][0], max(height, sizes[name][1])
    return places, (width, row + height)


def write_atlas(folder, size, patches):
    """A texture for each input; `patches` are (place, base colours, constants)."""
    channels = {"base_color": 3} | dict.fromkeys(CONSTANTS, 1)
    atlas = {name: np.zeros((*size[::-1], count), np.float32) for name, count in channels.items()}
    for (column, row), colors, constants in patches:
        area = np.s_[row : row + colors.shape[0], column : column + colors.shape[1]]
        atlas["base_color"][area] = colors
        for name, value in constants.items():
            atlas[name][area] = value
    for name, texels in atlas.items():
        mi.Bitmap(texels).write(str(folder / texture_file(name)))


def with_texture_coordinates(mesh, uvs):
    """A copy of a mesh with other texture coordinates [V, 2]."""
    old = mi.traverse(mesh)
    counts = mesh.vertex_count(), mesh.face_count()
    copy = mi.Mesh("", *counts, has_vertex_normals=mesh.has_vertex_normals(), has_vertex_texcoords=True)
    new = mi.traverse(copy)
    for name in ("vertex_positions", "vertex_normals", "faces"):
        new[name] = old[name]
    new["vertex_texcoords"] = mi.Float(uvs.reshape(-1).astype(np.float32))
    new.update()
    return copy


def shared_bsdf():
    """The BSDF that reads the atlas."""
    bsdf = Xml.Element("bsdf", type="twosided", id=SHARED)
    inner = Xml.SubElement(bsdf, "bsdf", type="principled")
    for name in ("base_color", *CONSTANTS):
        texture = Xml.SubElement(inner, "texture", type="bitmap", name=name)
        Xml.SubElement(texture, "string", name="filename", value=texture_file(name))
        Xml.SubElement(texture, "boolean", name="raw", value="true")
        if name in CONSTANTS:
            Xml.SubElement(texture, "string", name="filter_type", value="nearest")
    return bsdf


def texture_file(name):
    """Name of a file of floats, not compressed: other formats are read with threads, of which Mitsuba may have one."""
    return f"{SHARED}_{name}.pfm"
