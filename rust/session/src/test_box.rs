//! A closed box with lights, for tests.

use crate::error::SessionError;
use glam::{Affine3A, Vec2, Vec3};
use relume_dump::{Dump, MemoryWriter};
use relume_scene::{Camera, Input, Instance, Light, LightShape, Material, Mesh, Node, Scene, SceneBuilder};
use relume_trace::{Control, TraceSettings, Tracer};

/// A closed grey box, seen from its middle.
pub fn closed_box((width, height): (usize, usize)) -> Result<Scene, SessionError> {
    let corner = |i: usize| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - Vec3::ONE;
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mesh = Mesh {
        name: "box".into(),
        positions: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect(),
        ..Mesh::default()
    };
    let diffuse = Node::Diffuse {
        color: Input::Rgb([0.7; 3]),
        roughness: Input::Float(0.0),
        multiple_scattering: Default::default(),
        normal: None,
    };
    let material =
        Material { name: "grey".into(), nodes: vec![diffuse], surface: Some(0), ..Material::default() };
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
