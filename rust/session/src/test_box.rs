//! A closed box with lights, for tests.

use crate::error::SessionError;
use glam::{Affine3A, Vec2, Vec3};
use relume_dump::{Dump, MemoryWriter};
use relume_scene::{
    Camera, Curves, Distribution, Geometry, HairModel, HairPigment, Input, Instance, Light, LightShape,
    Material, MathOp, Mesh, Node, Output, PhaseFunction, PrincipledHair, Scene, SceneBuilder, StrandShape,
    TexCoord, World,
};
use relume_trace::{Control, TraceSettings, Tracer};

/// A closed grey box, seen from its middle.
pub fn closed_box(size: (usize, usize)) -> Result<Scene, SessionError> {
    closed_box_of(size, vec![grey()])
}

/// Lambert's law.
pub fn grey() -> Node {
    diffuse([0.7; 3])
}

/// [`grey`] in a colour that its gloss does not have.
pub fn red() -> Node {
    diffuse([0.9, 0.3, 0.05])
}

fn diffuse(color: [f32; 3]) -> Node {
    Node::Diffuse {
        color: Input::Rgb(color),
        roughness: Input::Float(0.0),
        multiple_scattering: Default::default(),
        normal: None,
    }
}

/// Half of it [`grey`], the other a glossy reflection.
pub fn glossy_grey(roughness: f32) -> Vec<Node> {
    glossy(grey(), roughness)
}

/// Half of it a surface, the other a glossy reflection.
pub fn glossy(surface: Node, roughness: f32) -> Vec<Node> {
    let gloss = Node::Glossy {
        color: Input::Rgb([0.7; 3]),
        roughness: Input::Float(roughness),
        anisotropy: Input::Float(0.0),
        rotation: Input::Float(0.0),
        normal: None,
        tangent: None,
        distribution: Distribution::Ggx,
    };
    vec![surface, gloss, Node::MixShader { factor: Input::Float(0.5), a: Some(0), b: Some(1) }]
}

/// Half of it [`grey`], the other green light that comes through.
pub fn curtain() -> Vec<Node> {
    let through = Node::Translucent { color: Input::Rgb([0.2, 0.8, 0.3]), normal: None };
    vec![grey(), through, Node::MixShader { factor: Input::Float(0.5), a: Some(0), b: Some(1) }]
}

/// Reddish rough glass.
pub fn frosted(roughness: f32) -> Vec<Node> {
    vec![Node::Glass {
        color: Input::Rgb([0.9, 0.7, 0.5]),
        roughness: Input::Float(roughness),
        ior: Input::Float(1.45),
        normal: None,
        anisotropy: None,
        rotation: None,
        tangent: None,
        film: None,
        distribution: Distribution::Ggx,
    }]
}

/// Half of it [`grey`], the other bluish rough refraction alone.
pub fn refracting(roughness: f32) -> Vec<Node> {
    let bent = Node::Refraction {
        color: Input::Rgb([0.5, 0.7, 0.9]),
        roughness: Input::Float(roughness),
        ior: Input::Float(1.3),
        normal: None,
        distribution: Distribution::Beckmann,
    };
    vec![grey(), bent, Node::MixShader { factor: Input::Float(0.5), a: Some(0), b: Some(1) }]
}

/// Principled, transmission of a half, thin or not.
pub fn principled_glass(thin_wall: f32) -> Vec<Node> {
    let white = serde_json::json!([1.0, 1.0, 1.0]);
    let node = serde_json::json!({
        "type": "principled", "base_color": [0.8, 0.6, 0.4], "metallic": 0.0, "roughness": 0.5,
        "diffuse_roughness": 0.0, "ior": 1.45, "alpha": 1.0, "subsurface_weight": 0.0, "thin_wall": thin_wall,
        "specular_ior_level": 0.5, "specular_tint": white, "anisotropic": 0.0, "anisotropic_rotation": 0.0,
        "transmission_weight": 0.5, "coat_weight": 0.0, "coat_roughness": 0.03, "coat_ior": 1.5, "coat_tint": white,
        "sheen_weight": 0.0, "sheen_roughness": 0.5, "sheen_tint": white, "emission_color": white,
        "emission_strength": 0.0, "distribution": "multi_ggx",
    });
    vec![serde_json::from_value(node).expect("a node")]
}

/// Reddish hair.
pub fn hair(model: HairModel) -> Vec<Node> {
    let value = Input::Float;
    vec![Node::PrincipledHair(PrincipledHair {
        model,
        pigment: HairPigment::Absorption,
        color: Input::Rgb([0.5; 3]),
        melanin: value(0.0),
        melanin_redness: value(0.0),
        tint: Input::Rgb([1.0; 3]),
        absorption_coefficient: Input::Rgb([0.2, 0.5, 1.0]),
        aspect_ratio: value(1.0),
        roughness: value(0.3),
        radial_roughness: value(0.4),
        coat: value(0.0),
        ior: value(1.55),
        offset: value(0.03),
        random_color: value(0.0),
        random_roughness: value(0.0),
        random: None,
        reflection: value(1.0),
        transmission: value(1.0),
        secondary_reflection: value(1.0),
    })]
}

/// Fog that scatters so much a metre, mostly forwards, red more than blue.
pub fn fog(density: f32) -> Vec<Node> {
    let phase = PhaseFunction::HenyeyGreenstein { anisotropy: Input::Float(0.4) };
    let [scatter, absorption] =
        [[1.0, 0.7, 0.4], [0.1, 0.1, 0.3]].map(|color| Input::Rgb(color.map(|value| density * value)));
    vec![Node::VolumeCoefficients { absorption, scatter, emission: Input::Float(0.0), phase }]
}

/// Greenish absorption.
pub fn tinted(density: f32) -> Vec<Node> {
    vec![Node::VolumeAbsorption { color: Input::Rgb([0.3, 0.9, 0.6]), density: Input::Float(density) }]
}

/// Smoke whose density grows from the bottom of its object, where it is 0, to the top.
pub fn smoke(density: f32) -> Vec<Node> {
    let link = |node, output| Input::Link { node, output };
    let scaled = Node::Math {
        operation: MathOp::Multiply,
        clamp: false,
        a: link(1, Output::Z),
        b: Input::Float(density),
        c: Input::Float(0.0),
    };
    let phase = PhaseFunction::HenyeyGreenstein { anisotropy: Input::Float(0.0) };
    vec![
        Node::TextureCoordinate { kind: TexCoord::Generated },
        Node::SeparateXyz { vector: link(0, Output::Vector) },
        scaled,
        Node::VolumeScatter { color: Input::Float(0.9), density: link(2, Output::Value), phase },
    ]
}

/// A closed box of a material whose last node is its surface, seen from its middle.
pub fn closed_box_of(size: (usize, usize), nodes: Vec<Node>) -> Result<Scene, SessionError> {
    Ok(box_builder(size, nodes)?.build()?)
}

/// [`closed_box_of`] with another closed box in its middle, of half its edges, that is but the hull of a medium.
pub fn closed_box_around(
    size: (usize, usize),
    nodes: Vec<Node>,
    medium: Vec<Node>,
) -> Result<Scene, SessionError> {
    let mut builder = box_builder(size, nodes)?;
    let hull =
        add_material(&mut builder, Material { volume: last(&medium), nodes: medium, ..Material::default() })?;
    let mesh = builder.add_mesh(box_mesh())?;
    builder.add_instance(Instance::new("hull", mesh, Affine3A::from_scale(Vec3::splat(0.5)), vec![hull]))?;
    Ok(builder.build()?)
}

/// [`closed_box`] with thick strands before the camera.
pub fn closed_box_with_strands(size: (usize, usize), nodes: Vec<Node>) -> Result<Scene, SessionError> {
    let mut builder = box_builder(size, vec![grey()])?;
    let material =
        add_material(&mut builder, Material { surface: last(&nodes), nodes, ..Material::default() })?;
    let mut curves = Curves { name: "strands".into(), shape: StrandShape::Round, ..Curves::default() };
    for strand in 0..12 {
        let x = 0.1 * strand as f32 - 0.55;
        curves.first_keys.push(curves.keys.len() as u32);
        curves.keys.extend([-0.5, 0.0, 0.5].map(|y: f32| Vec3::new(x + 0.2 * y, y, 0.1 * x - 0.6)));
        curves.radii.extend([0.03; 3]);
    }
    curves.first_keys.push(curves.keys.len() as u32);
    let curves = Geometry::Curves(builder.add_curves(curves)?);
    builder.add_instance(Instance::new("strands", curves, Affine3A::IDENTITY, vec![material]))?;
    Ok(builder.build()?)
}

/// A block before the camera of [`closed_box`].
pub fn block() -> Mesh {
    let mut block = box_mesh();
    for position in &mut block.positions {
        *position = *position * 0.25 + Vec3::new(0.0, 0.0, -0.7);
    }
    block
}

/// A single sheet before the camera of [`closed_box`].
pub fn sheet() -> Mesh {
    let corner = |i: usize| Vec3::new((i & 1) as f32 - 0.5, (i >> 1) as f32 - 0.5, -0.5);
    let positions = (0..4).map(corner).collect();
    Mesh { name: "sheet".into(), positions, triangles: vec![[0, 1, 3], [0, 3, 2]], ..Mesh::default() }
}

/// [`closed_box`] with a mesh of another surface, the hull of a medium that may be empty.
pub fn closed_box_with(
    size: (usize, usize),
    mesh: Mesh,
    mut nodes: Vec<Node>,
    medium: Vec<Node>,
) -> Result<Scene, SessionError> {
    let mut builder = box_builder(size, vec![grey()])?;
    let surface = last(&nodes);
    let volume = if medium.is_empty() { None } else { Some(nodes.len() as u32) };
    nodes.extend(medium);
    let material = add_material(&mut builder, Material { surface, volume, nodes, ..Material::default() })?;
    let mesh = builder.add_mesh(mesh)?;
    builder.add_instance(Instance::new("inner", mesh, Affine3A::IDENTITY, vec![material]))?;
    Ok(builder.build()?)
}

/// A grey floor of 0.2 m below a camera that looks along it, all space filled with a medium.
pub fn floor_in((width, height): (usize, usize), medium: Vec<Node>) -> Result<Scene, SessionError> {
    let mut builder = SceneBuilder::new("Linear Rec.709");
    builder.set_camera(Camera {
        width,
        height,
        world_from_camera: Affine3A::from_translation(Vec3::new(0.0, -0.1, 0.05))
            * Affine3A::from_rotation_x(1.5),
        window_min: Vec2::splat(-0.6),
        window_max: Vec2::splat(0.6),
        ..Camera::default()
    });
    let floor = add_material(
        &mut builder,
        Material { nodes: vec![grey()], surface: Some(0), ..Material::default() },
    )?;
    let corner = |i: usize| Vec3::new((i & 1) as f32 * 0.2 - 0.1, (i >> 1) as f32 * 0.2 - 0.1, 0.0);
    let positions = (0..4).map(corner).collect();
    let mesh =
        Mesh { name: "floor".into(), positions, triangles: vec![[0, 1, 3], [0, 3, 2]], ..Mesh::default() };
    let mesh = builder.add_mesh(mesh)?;
    builder.add_instance(Instance::new("floor", mesh, Affine3A::IDENTITY, vec![floor]))?;
    let fog =
        add_material(&mut builder, Material { volume: last(&medium), nodes: medium, ..Material::default() })?;
    builder.set_world(World { volume: Some(fog), ..World::default() })?;
    Ok(builder.build()?)
}

fn box_mesh() -> Mesh {
    let corner = |i: usize| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - Vec3::ONE;
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    Mesh {
        name: "box".into(),
        positions: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect(),
        ..Mesh::default()
    }
}

/// Number of the last node.
fn last(nodes: &[Node]) -> Option<u32> {
    Some(nodes.len() as u32 - 1)
}

fn add_material(builder: &mut SceneBuilder, material: Material) -> Result<usize, SessionError> {
    Ok(builder.add_material_json(&serde_json::to_string(&material).unwrap_or_default())?)
}

fn box_builder((width, height): (usize, usize), nodes: Vec<Node>) -> Result<SceneBuilder, SessionError> {
    let mut builder = SceneBuilder::new("Linear Rec.709");
    builder.set_camera(Camera {
        width,
        height,
        window_min: Vec2::splat(-0.8),
        window_max: Vec2::splat(0.8),
        ..Camera::default()
    });
    let material =
        add_material(&mut builder, Material { surface: last(&nodes), nodes, ..Material::default() })?;
    let mesh = builder.add_mesh(box_mesh())?;
    builder.add_instance(Instance::new("box", mesh, Affine3A::IDENTITY, vec![material]))?;
    Ok(builder)
}

/// Paths in the closed box.
pub fn boxed(size: (usize, usize), samples: u32) -> Result<Dump, SessionError> {
    let settings = TraceSettings { samples, ..TraceSettings::default() };
    let scene = closed_box(size)?;
    let tracer = Tracer::new(&scene, &settings)?;
    let writer = MemoryWriter::new(tracer.manifest())?;
    tracer.trace(&writer, &Control::default())?;
    Ok(writer.snapshot())
}

/// Lights in the closed box.
pub fn bulbs(count: usize) -> Vec<Light> {
    let bulb = |i: usize| {
        let around = i as f32 / count as f32 * std::f32::consts::TAU;
        let center = Vec3::new(0.6 * around.cos(), 0.6 * around.sin(), -0.5);
        Light { name: format!("Bulb {i}"), ..Light::unit(LightShape::Sphere { center, radius: 0.15 }) }
    };
    (0..count).map(bulb).collect()
}
