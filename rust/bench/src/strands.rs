//! Speed of rays through hair.

use std::time::Instant;

use anyhow::Result;
use glam::{Affine3A, Vec2, Vec3};
use relume_scene::{Camera, Curves, Geometry, Instance, Scene, SceneBuilder, StrandShape};
use relume_trace::bvh::SceneBvh;
use relume_trace::sampler::PixelSampler;

use crate::figure::Figure;
use crate::rays::{bounce, camera_rays, rays_per_second};
use crate::record::FigureRecord;

/// Keys of a hair.
const KEYS: usize = 11;
/// Radius of the head, length of the hair and radius of a hair, metres.
const HEAD: f32 = 0.1;
const LENGTH: f32 = 0.15;
const HAIR: f32 = 4e-5;

/// Closest-hit rays per second on one thread in a head of so many hairs: camera rays and those that bounce off them, at most
/// `count` each; with the time to build its tree and the tree's bytes.
///
/// # Errors
/// If there are too many hairs.
pub fn measure((hairs, count): (usize, usize)) -> Result<Vec<FigureRecord>> {
    let mut records = Vec::new();
    for (name, shape) in
        [("ribbons", StrandShape::Ribbon { subdivisions: 2 }), ("round strands", StrandShape::Round)]
    {
        let scene = head(hairs, shape, count.isqrt())?;
        let start = Instant::now();
        let bvh = SceneBvh::new(&scene)?;
        let built = start.elapsed().as_secs_f64();
        let figure =
            |what: &str, value, unit| Figure::new(format!("{what}, {hairs} {name}"), value, unit).into();
        records.push(figure("tree build", built, "s"));
        records.push(figure("tree", bvh.bytes() as f64 / hairs as f64, "bytes/strand"));
        let rays = camera_rays(&scene);
        for (stage, rays) in [("first bounce", bounce(&scene, &bvh, &rays)), ("camera rays", rays)] {
            let speed = rays_per_second(&rays, |ray| bvh.intersect(ray).is_some());
            records.push(figure(&format!("{stage}, 1 thread"), speed, "rays/s"));
        }
    }
    Ok(records)
}

/// A head of hair that is combed down and curled, seen from the front.
fn head(hairs: usize, shape: StrandShape, edge: usize) -> Result<Scene> {
    let mut curves = Curves { name: "hair".into(), shape, first_keys: vec![0], ..Curves::default() };
    for hair in 0..hairs as u32 {
        let [u, v, turn, _] = PixelSampler::new(0, hair, 0).draw(0, 0);
        let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
        let root = Vec3::new(cos * (1.0 - v * v).sqrt(), sin * (1.0 - v * v).sqrt(), v);
        for key in 0..KEYS {
            let share = key as f32 / (KEYS - 1) as f32;
            let (sin, cos) = (std::f32::consts::TAU * turn + 6.0 * share).sin_cos();
            let outwards = root * (HEAD + 0.25 * LENGTH * share.sqrt());
            let wave = Vec3::new(cos, sin, 0.0) * (0.006 * share);
            curves.keys.push(outwards - Vec3::Z * (0.8 * LENGTH * share.powf(1.5)) + wave);
            curves.radii.push(HAIR);
        }
        curves.first_keys.push(curves.keys.len() as u32);
    }
    let mut builder = SceneBuilder::new("Linear Rec.709");
    builder.set_camera(Camera {
        width: edge,
        height: edge,
        window_min: Vec2::splat(-0.25),
        window_max: Vec2::splat(0.25),
        world_from_camera: Affine3A::from_translation(Vec3::new(0.0, -0.7, 0.05))
            * Affine3A::from_rotation_x(std::f32::consts::FRAC_PI_2),
        ..Camera::default()
    });
    let curves = builder.add_curves(curves)?;
    builder.add_instance(Instance::new("hair", Geometry::Curves(curves), Affine3A::IDENTITY, vec![]))?;
    Ok(builder.build()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_shapes_are_measured() {
        let records = measure((200, 400)).unwrap();
        assert_eq!(records.len(), 2 * 4);
        assert!(records.iter().all(|record| record.value > 0.0), "{records:?}");
    }
}
