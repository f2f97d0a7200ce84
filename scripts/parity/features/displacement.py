"""Feature scenes of displaced meshes. Needs `bpy`."""

from . import stage


def displaced_plane(scene):
    """A square in waves, as dunes."""
    _displace(_square(scene), "DISPLACEMENT", 0.35)


def displaced_both(scene):
    """A ball of soft noise, displaced and bumped, at twice the size."""
    material, tree, output = _paint()
    ball = stage.hunt.add(scene, "Ball", stage.hunt.ball("Ball", 0.4, material, rings=48))
    ball.scale = (2.0,) * 3
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 4.0, 2.0
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], noise.inputs["Vector"])
    _along_normal(tree, output, noise.outputs[0], 0.08)
    material.displacement_method = "BOTH"


def vector_displacement(scene):
    """A square that is thrown into folds that hang over."""
    material, tree, output = _square(scene)
    wave, mix = tree.nodes.new("ShaderNodeTexWave"), tree.nodes.new("ShaderNodeCombineXYZ")
    wave.inputs["Scale"].default_value = 0.6
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], wave.inputs["Vector"])
    for axis in "XY":
        tree.links.new(wave.outputs[1], mix.inputs[axis])
    node = tree.nodes.new("ShaderNodeVectorDisplacement")
    node.space = "TANGENT"
    node.inputs["Scale"].default_value = 0.5
    tree.links.new(mix.outputs[0], node.inputs["Vector"])
    tree.links.new(node.outputs[0], output.inputs["Displacement"])
    material.displacement_method = "DISPLACEMENT"


def adaptive_plane(scene):
    """Ground of a single face, in waves up to the horizon, that its render dices."""
    material, tree, output = _paint()
    ground = stage.hunt.add(scene, "Ground", stage.hunt.square("Ground", 60.0, material))
    ground.location.z = -0.4
    scene.objects["Wall"].hide_render = True
    ground.data.polygons.foreach_set("use_smooth", [True])
    _dice(scene, ground, "SIMPLE")
    wave = tree.nodes.new("ShaderNodeTexWave")
    wave.inputs["Scale"].default_value, wave.inputs["Distortion"].default_value = 20.0, 2.0
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], wave.inputs["Vector"])
    _along_normal(tree, output, wave.outputs[1], 0.2)
    material.displacement_method = "DISPLACEMENT"


def adaptive_cube(scene):
    """A cube that becomes a smooth stone, displaced and bumped."""
    material, tree, output = _paint()
    cube = stage.hunt.add(scene, "Stone", stage.hunt.box("Stone", 1.6, material))
    cube.data.polygons.foreach_set("use_smooth", [True] * len(cube.data.polygons))
    cube.rotation_euler = (0.3, 0.2, 0.6)
    _dice(scene, cube, "CATMULL_CLARK")
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 3.0, 2.0
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], noise.inputs["Vector"])
    _along_normal(tree, output, noise.outputs[0], 0.2)
    material.displacement_method = "BOTH"


def _dice(scene, obj, kind):
    """Subdivides an object adaptively, as its version of Blender does."""
    modifier = obj.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type = kind
    modifier.levels = modifier.render_levels = 1
    if hasattr(modifier, "use_adaptive_subdivision"):  # From Blender 5.0 on.
        modifier.use_adaptive_subdivision = True
    else:
        scene.cycles.feature_set, obj.cycles.use_adaptive_subdivision = "EXPERIMENTAL", True


def _paint():
    """A material with a little gloss; returns it, its tree and its output."""
    material, tree, output = stage.hunt.new_material("Paint")
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    node.inputs["Base Color"].default_value = (0.7, 0.5, 0.3, 1.0)
    node.inputs["Roughness"].default_value = 0.4
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material, tree, output


def _square(scene):
    """A smooth square of many quads above the floor; returns its material, tree and output."""
    material, tree, output = _paint()
    square = stage.hunt.add(scene, "Square", stage.hunt.square("Square", 2.4, material))
    square.location.z = -0.3
    subdivision = square.modifiers.new("Subdivision", "SUBSURF")
    subdivision.subdivision_type = "SIMPLE"
    subdivision.levels = subdivision.render_levels = 6
    square.data.polygons.foreach_set("use_smooth", [True])
    return material, tree, output


def _displace(square, method, scale):
    material, tree, output = square
    wave = tree.nodes.new("ShaderNodeTexWave")
    wave.inputs["Scale"].default_value, wave.inputs["Distortion"].default_value = 0.8, 2.0
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], wave.inputs["Vector"])
    _along_normal(tree, output, wave.outputs[1], scale)
    material.displacement_method = method


def _along_normal(tree, output, height, scale):
    node = tree.nodes.new("ShaderNodeDisplacement")
    node.inputs["Midlevel"].default_value, node.inputs["Scale"].default_value = 0.5, scale
    tree.links.new(height, node.inputs["Height"])
    tree.links.new(node.outputs[0], output.inputs["Displacement"])


SCENES = {
    scene.__name__: scene
    for scene in (displaced_plane, displaced_both, vector_displacement, adaptive_plane, adaptive_cube)
}
"""Builders by the names of their scenes."""
