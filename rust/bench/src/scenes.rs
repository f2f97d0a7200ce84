//! Scenes and lights that are made up.

use glam::{Affine3A, Vec2, Vec3};
use relume_scene::{Camera, Input, Instance, Light, LightShape, Material, Mesh, Node, Scene, SceneBuilder};

/// A closed grey box, seen from its middle.
///
/// # Errors
/// Does not fail unless the scene in here is wrong.
pub fn closed_box(size: (usize, usize)) -> anyhow::Result<Scene> {
    let corner = |i: usize| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - Vec3::ONE;
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    seen_from_within(size, (0..8).map(corner).collect(), &sides)
}

/// A closed cave with bumps, of about `2 * edge * edge` triangles, seen from its middle.
///
/// # Errors
/// Does not fail unless the scene in here is wrong.
pub fn cave(size: (usize, usize), edge: usize) -> anyhow::Result<Scene> {
    let (around, up) = (edge, edge);
    let point = |i: usize| {
        let (u, v) = ((i % around) as f32 / around as f32, (i / around) as f32 / up as f32);
        let (longitude, latitude) = (u * std::f32::consts::TAU, (v - 0.5) * std::f32::consts::PI);
        let bumps = 0.1 * (9.0 * longitude).sin() * (11.0 * latitude).cos();
        let direction =
            Vec3::new(longitude.cos() * latitude.cos(), longitude.sin() * latitude.cos(), latitude.sin());
        direction * (1.0 + bumps)
    };
    let quad = |i: usize| {
        let (x, y) = (i % around, i / around);
        let next = (x + 1) % around;
        [y * around + x, y * around + next, (y + 1) * around + next, (y + 1) * around + x].map(|v| v as u32)
    };
    let quads: Vec<_> = (0..around * up).map(quad).collect();
    seen_from_within(size, (0..around * (up + 1)).map(point).collect(), &quads)
}

fn seen_from_within(
    (width, height): (usize, usize),
    positions: Vec<Vec3>,
    quads: &[[u32; 4]],
) -> anyhow::Result<Scene> {
    let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let mesh = Mesh { name: "walls".into(), positions, triangles, ..Mesh::default() };
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
    let material = builder.add_material_json(&serde_json::to_string(&material)?)?;
    let mesh = builder.add_mesh(mesh)?;
    builder.add_instance(Instance::new("walls", mesh, Affine3A::IDENTITY, vec![material]))?;
    Ok(builder.build()?)
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

#[cfg(test)]
mod tests {
    use super::*;
    use relume_dump::MemoryWriter;
    use relume_trace::{Control, TraceSettings, Tracer};

    #[test]
    fn no_path_leaves_the_scenes() {
        for (scene, nearest) in [(closed_box((128, 128)).unwrap(), 0.9), (cave((64, 64), 20).unwrap(), 0.5)] {
            let tracer =
                Tracer::new(&scene, &TraceSettings { samples: 1, ..TraceSettings::default() }).unwrap();
            let writer = MemoryWriter::new(tracer.manifest()).unwrap();
            tracer.trace(&writer, &Control::default()).unwrap();
            let depth = &writer.snapshot().aovs().depth.data;
            assert!(depth.iter().all(|depth| (nearest..2.0).contains(depth)));
        }
    }
}
