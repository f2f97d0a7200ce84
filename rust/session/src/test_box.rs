//! A closed box with lights, for tests.

use crate::error::SessionError;
use glam::{Affine3A, Vec2, Vec3};
use relume_dump::{Dump, MemoryWriter};
use relume_scene::{
    Camera, Distribution, Input, Instance, Light, LightShape, Material, Mesh, Node, Scene, SceneBuilder,
};
use relume_trace::{Control, TraceSettings, Tracer};

/// A closed grey box, seen from its middle.
pub fn closed_box(size: (usize, usize)) -> Result<Scene, SessionError> {
    closed_box_of(size, vec![grey()])
}

/// Lambert's law.
pub fn grey() -> Node {
    Node::Diffuse {
        color: Input::Rgb([0.7; 3]),
        roughness: Input::Float(0.0),
        multiple_scattering: Default::default(),
        normal: None,
    }
}

/// Half of it [`grey`], the other a glossy reflection.
pub fn glossy_grey(roughness: f32) -> Vec<Node> {
    let gloss = Node::Glossy {
        color: Input::Rgb([0.7; 3]),
        roughness: Input::Float(roughness),
        anisotropy: Input::Float(0.0),
        rotation: Input::Float(0.0),
        normal: None,
        tangent: None,
        distribution: Distribution::Ggx,
    };
    vec![grey(), gloss, Node::MixShader { factor: Input::Float(0.5), a: Some(0), b: Some(1) }]
}

/// A closed box of a material whose last node is its surface, seen from its middle.
pub fn closed_box_of((width, height): (usize, usize), nodes: Vec<Node>) -> Result<Scene, SessionError> {
    let corner = |i: usize| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - Vec3::ONE;
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mesh = Mesh {
        name: "box".into(),
        positions: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect(),
        ..Mesh::default()
    };
    let surface = Some(nodes.len() as u32 - 1);
    let material = Material { name: "grey".into(), nodes, surface, ..Material::default() };
    let mut builder = SceneBuilder::new("Linear Rec.709");
    builder.set_camera(Camera {
        width,
        height,
        window_min: Vec2::splat(-0.8),
        window_max: Vec2::splat(0.8),
        ..Camera::default()
    });
    let material = builder.add_material_json(&serde_json::to_string(&material).unwrap_or_default())?;
    let mesh = builder.add_mesh(mesh)?;
    builder.add_instance(Instance::new("box", mesh, Affine3A::IDENTITY, vec![material]))?;
    Ok(builder.build()?)
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
