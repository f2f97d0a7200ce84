"""Run by `test_mitsuba_solve.py` in the Python that has Mitsuba: what it sees of a room before and after figure 9's
changes to it, as a line of JSON. `mitsuba_pictures.py FOLDER`"""

import json
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import mitsuba_solve as solve
import numpy as np
from mitsuba_atlas import share_bsdf
from mitsuba_solve import dr, mi

ROOM = """<scene version="3.0.0"><default name="resx" value="16"/><default name="resy" value="16"/>
<default name="max_depth" value="4"/><integrator type="path"><integer name="max_depth" value="$max_depth"/></integrator>
<bsdf type="twosided" id="image"><bsdf type="principled">
<texture type="bitmap" name="base_color"><string name="filename" value="image.png"/></texture>
<float name="roughness" value="0.3"/><float name="metallic" value="0.001"/></bsdf></bsdf>
<bsdf type="twosided" id="gold"><bsdf type="principled"><rgb name="base_color" value="0.9 0.5 0.1"/>
<float name="roughness" value="0.6"/><float name="metallic" value="1"/></bsdf></bsdf>
<shape type="ply"><string name="filename" value="left.ply"/><ref id="image"/></shape>
<shape type="ply"><string name="filename" value="right.ply"/><ref id="gold"/></shape>
<shape type="sphere"><point name="center" x="-1" y="0" z="0.2"/><float name="radius" value="0.2"/>
<bsdf type="diffuse"/></shape><sensor type="perspective"><float name="fov" value="60"/><transform name="to_world">
<lookat origin="0,0,3" target="0,0,0" up="0,1,0"/></transform><film type="hdrfilm">
<integer name="width" value="$resx"/><integer name="height" value="$resy"/><rfilter type="box"/></film></sensor></scene>
"""
SPACE = {"min": [-1.5, -0.8, 0.3], "max": [1.5, 0.8, 1.5], "size": [0.05, 0.4]}
LAMP = ([0.7, 0.2, 0.8], 0.1, [5.0, 4.0, 3.0])


def make_room(folder):
    """A floor of two squares, one of an image that is repeated and one of a metal, and a ball, since Embree asks for no
    box where a sphere is alone."""
    image = np.random.default_rng(1).integers(0, 256, (5, 7, 3), np.uint8)
    mi.Bitmap(image).write(str(folder / "image.png"))
    for name, x in (("left", -1), ("right", 1)):
        mesh = mi.Mesh(name, 4, 2, has_vertex_normals=True, has_vertex_texcoords=True)
        params = mi.traverse(mesh)
        params["vertex_positions"] = [x - 1, -1, 0, x + 1, -1, 0, x + 1, 1, 0, x - 1, 1, 0]
        params["vertex_normals"] = [0, 0, 1] * 4
        params["vertex_texcoords"] = [-0.3, -0.2, 1.4, -0.2, 1.4, 0.9, -0.3, 0.9]
        params["faces"] = [0, 1, 2, 0, 2, 3]
        params.update()
        mesh.write_ply(str(folder / f"{name}.ply"))
    (folder / "scene.xml").write_text(ROOM)


def surfaces(path):
    """The number of materials, and what surfaces reflect along their normal of light from the side."""
    scene = mi.load_file(str(path))
    x, y = np.meshgrid(np.linspace(-1.9, 1.9, 60), np.linspace(-0.9, 0.9, 40))
    origin = mi.Point3f(x.ravel(), y.ravel(), 1.0) - mi.Vector3f(0.3, 0.2, 0)
    si = scene.ray_intersect(mi.Ray3f(origin, dr.normalize(mi.Vector3f(0.3, 0.2, -1))))
    reflected = si.bsdf().eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, 1))
    return len({shape.bsdf() for shape in scene.shapes()}), np.array(reflected)


def picture(scene):
    """With as many samples and the same noise each time."""
    return np.array(mi.render(scene, spp=16, seed=1))


def main():
    folder = Path(sys.argv[1])
    make_room(folder)
    tree = Xml.parse(folder / "scene.xml")
    share_bsdf(tree.getroot(), folder)
    tree.write(folder / "shared.xml")
    (before, apart), (after, shared) = (surfaces(folder / name) for name in ("scene.xml", "shared.xml"))

    scene = solve.load(str(folder / "scene.xml"), (16, 16), 4)
    solve.place(solve.lamp_anywhere(scene, SPACE), *LAMP)
    moved = picture(scene)
    params = mi.traverse(scene)
    params[f"{solve.LAMP}.to_world"] = solve.sphere(*LAMP[:2])
    params.update()
    result = {
        "materials": [before, after],
        "brightest": float(apart.max()),
        "difference": float(abs(shared - apart).max()),
        "picture": float(moved.mean()),
        "moved": float(abs(picture(scene) - moved).max()),
    }
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
