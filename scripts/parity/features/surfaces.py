"""Feature scenes of nodes that look around, of thin films, and of panes. Need `bpy`."""

import math

import bpy

from . import stage


def looking_around(scene):
    """Balls dirty in their corners, a box with rounded edges, a ball in a wire, tangents and sharp edges in colour."""
    dirt, tree, output = _diffuse("Dirt")
    occlusion = tree.nodes.new("ShaderNodeAmbientOcclusion")
    occlusion.inputs["Distance"].default_value = 0.6
    occlusion.inputs["Color"].default_value = (0.8, 0.7, 0.5, 1.0)
    tree.links.new(occlusion.outputs["Color"], output.inputs["Color"])
    for x in (-1.0, -0.55):
        stage.add_ball(scene, "Dirt", 0.3, dirt, (x, 0.2, -0.7))
    rounded, tree, shader = _diffuse("Rounded", "ShaderNodeBsdfPrincipled")
    shader.inputs["Roughness"].default_value = 0.3
    bevel = tree.nodes.new("ShaderNodeBevel")
    bevel.inputs["Radius"].default_value = 0.12
    tree.links.new(bevel.outputs[0], shader.inputs["Normal"])
    stage.add_box(scene, "Rounded", 0.6, rounded, (0.1, -0.1, -0.7)).rotation_euler.z = 0.5
    wire, tree, shader = _diffuse("Wire")
    lines = tree.nodes.new("ShaderNodeWireframe")
    lines.inputs["Size"].default_value = 0.03
    tree.links.new(lines.outputs[0], shader.inputs["Color"])
    stage.add_ball(scene, "Wire", 0.3, wire, (0.8, 0.0, -0.7))
    brushed, tree, shader = _diffuse("Brushed", "ShaderNodeBsdfAnisotropic")
    shader.inputs["Roughness"].default_value, shader.inputs["Anisotropy"].default_value = 0.3, 0.8
    tangent = tree.nodes.new("ShaderNodeTangent")
    tangent.axis = "X"
    tree.links.new(tangent.outputs[0], shader.inputs["Tangent"])
    stage.add_ball(scene, "Brushed", 0.3, brushed, (0.3, 0.8, -0.6))
    sharp, tree, shader = _diffuse("Sharp")
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Pointiness"], shader.inputs["Color"])
    stage.add_box(scene, "Sharp", 0.5, sharp, (-0.4, 1.0, -0.7))


def thin_films(scene):
    """Balls of lacquer, glass and metal with films of different thickness; from Blender 5.2 on a soapy pane, too."""
    for number, thickness in enumerate((250.0, 420.0, 600.0)):
        material, _, shader = _diffuse(f"Film {number}", "ShaderNodeBsdfPrincipled")
        shader.inputs["Thin Film Thickness"].default_value = thickness
        shader.inputs["Base Color"].default_value = (0.05, 0.05, 0.05, 1.0) if number != 1 else (0.9, 0.6, 0.4, 1.0)
        shader.inputs["Roughness"].default_value = 0.25
        shader.inputs["Metallic" if number == 1 else "Transmission Weight"].default_value = float(number > 0)
        stage.add_ball(scene, f"Film {number}", 0.35, material, (0.8 * number - 0.8, 0.0, -0.65))
    if bpy.app.version >= (5, 2, 0):
        material, _, shader = _diffuse("Pane", "ShaderNodeBsdfPrincipled")
        shader.inputs["Transmission Weight"].default_value = 1.0
        shader.inputs["Thin Wall"].default_value = True
        shader.inputs["Roughness"].default_value = 0.4
        shader.inputs["Base Color"].default_value = (0.6, 0.9, 0.7, 1.0)
        pane = stage.hunt.add(scene, "Pane", stage.hunt.square("Pane", 0.8, material))
        pane.location, pane.rotation_euler = (0.4, -0.8, -0.5), (1.4, 0.0, 0.4)
    scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False


def dispersion(scene):
    """Balls of glass that part colours, and a rough box of it, before a window of bright bars. From Blender 5.3 on."""
    glow, tree, emission = _diffuse("Bars", "ShaderNodeEmission")
    bars = tree.nodes.new("ShaderNodeTexWave")
    bars.inputs["Scale"].default_value = 1.2
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], bars.inputs["Vector"])
    tree.links.new(bars.outputs["Color"], emission.inputs["Color"])
    window = stage.hunt.add(scene, "Window", stage.hunt.square("Window", 2.4, glow))
    window.location, window.rotation_euler = (0.0, 1.6, 0.0), (math.pi / 2, 0.0, 0.0)
    for number, (roughness, abbe_number) in enumerate(((0.0, 10.0), (0.15, 20.0), (0.3, 10.0))):
        material, _, shader = _diffuse(f"Glass {number}", "ShaderNodeBsdfPrincipled")
        shader.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        shader.inputs["Transmission Weight"].default_value = 1.0
        shader.inputs["Roughness"].default_value = roughness
        shader.inputs["Transmission Dispersion Scale"].default_value = 1.0
        shader.inputs["Transmission Dispersion Abbe Number"].default_value = abbe_number
        if number < 2:
            stage.add_ball(scene, f"Glass {number}", 0.4, material, (0.9 * number - 0.9, 0.0, -0.5))
        else:
            stage.add_box(scene, f"Glass {number}", 0.6, material, (0.9, 0.0, -0.6)).rotation_euler.z = 0.6
    scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False


def raycast(scene):
    """A floor that is red below objects, balls tinted by the distance to what they face. From Blender 5.1 on."""
    covered, tree, shader = _diffuse("Covered")
    tint, up = _tint_of_a_ray(tree, shader, "Is Hit", (0.0, 0.0, 1.0))
    up.inputs["Length"].default_value = 1.5
    tint.inputs[6].default_value, tint.inputs[7].default_value = (0.7, 0.7, 0.7, 1.0), (0.8, 0.2, 0.1, 1.0)
    scene.objects["Floor"].data.materials[0] = covered
    near, tree, shader = _diffuse("Near", "ShaderNodeBsdfPrincipled")
    tint, aside = _tint_of_a_ray(tree, shader, "Hit Distance", (1.0, 0.0, 0.0))
    aside.inputs["Length"].default_value = 2.0
    tint.inputs[6].default_value, tint.inputs[7].default_value = (0.1, 0.2, 0.8, 1.0), (0.9, 0.8, 0.2, 1.0)
    for x in (-0.9, 0.0):
        stage.add_ball(scene, "Near", 0.35, near, (x, 0.1, -0.5))
    grey = stage.hunt.plain_material("Grey", Color=(0.5, 0.5, 0.5, 1.0))
    stage.add_box(scene, "Grey", 0.6, grey, (0.9, 0.2, -0.3)).rotation_euler.z = 0.4


def _tint_of_a_ray(tree, shader, output, direction):
    """Mixes a shader's colour by what a ray tells; returns the mix and the node of the ray."""
    mix, cast, towards = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Mix", "Raycast", "CombineXYZ"))
    mix.data_type = "RGBA"
    for socket, value in zip(towards.inputs, direction, strict=True):
        socket.default_value = value
    tree.links.new(towards.outputs[0], cast.inputs["Direction"])
    tree.links.new(cast.outputs[output], mix.inputs[0])
    tree.links.new(mix.outputs[2], shader.inputs[0])
    return mix, cast


def _diffuse(name, kind="ShaderNodeBsdfDiffuse"):
    """A material of one shader; returns it, its tree and the shader."""
    material, tree, output = stage.hunt.new_material(name)
    shader = tree.nodes.new(kind)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material, tree, shader


def sky_on_a_dome(scene):
    """A ball painted with a sky, on which another one shines that glows with it."""
    for number, kind in enumerate(("ShaderNodeBsdfDiffuse", "ShaderNodeEmission")):
        material, tree, output = stage.hunt.new_material(f"Sky {number}")
        sky, shader = (tree.nodes.new(name) for name in ("ShaderNodeTexSky", kind))
        dim, coordinates = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeTexCoord")
        sky.sun_disc, sky.sun_elevation, sky.sun_rotation = False, 0.5, 2.6
        dim.operation = "SCALE"
        dim.inputs["Scale"].default_value = 0.1
        tree.links.new(coordinates.outputs["Object"], sky.inputs["Vector"])
        tree.links.new(sky.outputs[0], dim.inputs[0])
        tree.links.new(dim.outputs[0], shader.inputs["Color"])
        tree.links.new(shader.outputs[0], output.inputs["Surface"])
        stage.add_ball(scene, f"Ball {number}", 0.7, material, (1.6 * number - 0.8, 0.0, 0.0))


def steep_bumps(scene):
    """Balls with steep bumps, diffuse and translucent."""
    for number, kind in enumerate(("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTranslucent")):
        material, tree, output = stage.hunt.new_material(f"Bumpy {number}")
        noise, bump, shader = (tree.nodes.new(name) for name in ("ShaderNodeTexNoise", "ShaderNodeBump", kind))
        noise.inputs["Scale"].default_value = 3.0
        bump.inputs["Distance"].default_value = 0.6
        tree.links.new(noise.outputs["Fac"], bump.inputs["Height"])
        tree.links.new(bump.outputs[0], shader.inputs["Normal"])
        tree.links.new(shader.outputs[0], output.inputs["Surface"])
        stage.add_ball(scene, f"Ball {number}", 0.7, material, (1.6 * number - 0.8, 0.0, 0.0))


def radial_tiling(scene):
    """Boards of sharp, rounded and broken segments."""
    for number, (sides, roundness) in enumerate(((5.0, 0.0), (3.6, 0.4), (7.3, 1.0))):
        material, tree, output = stage.hunt.new_material(f"Tiles {number}")
        tiling, shader = (tree.nodes.new(name) for name in ("ShaderNodeRadialTiling", "ShaderNodeBsdfDiffuse"))
        tiling.normalize = True
        tiling.inputs["Sides"].default_value, tiling.inputs["Roundness"].default_value = sides, roundness
        coordinates = tree.nodes.new("ShaderNodeTexCoord")
        tree.links.new(coordinates.outputs["Normal"], tiling.inputs["Vector"])
        tree.links.new(tiling.outputs["Segment Coordinates"], shader.inputs["Color"])
        tree.links.new(shader.outputs[0], output.inputs["Surface"])
        ball = stage.add_ball(scene, f"Ball {number}", 0.55, material, (1.2 * (number - 1), 0.0, 0.0))
        ball.rotation_euler = (1.3, 0.0, 0.0)


SCENES = {build.__name__: build for build in (looking_around, thin_films, sky_on_a_dome, steep_bumps)}
if hasattr(bpy.types, "ShaderNodeRaycast"):
    SCENES["raycast"] = raycast
if hasattr(bpy.types, "ShaderNodeRadialTiling"):
    SCENES["radial_tiling"] = radial_tiling
if bpy.app.version >= (5, 3, 0):
    SCENES["dispersion"] = dispersion
