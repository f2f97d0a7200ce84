//! Speed of rays, compared with obvhs's own traversal of its own trees, on the same rays in
//! the same process: one thread, best of several for each small batch, so that other work on the machine hardly counts.

use std::hint::black_box;
use std::time::Instant;

use anyhow::Result;
use glam::{Vec3, Vec3A};
use obvhs::{
    BvhBuildParams, bvh2::builder::build_bvh2_from_tris, cwbvh::builder::build_cwbvh_from_tris, ray::RayHit,
    triangle::Triangle,
};
use relume_scene::{STILL, Scene};
use relume_trace::bvh::{Ray, RayKind, SceneBvh};
use relume_trace::camera::CameraSampler;
use relume_trace::filter::PixelFilter;
use relume_trace::sampler::PixelSampler;
use relume_trace::shading::Hit;

use crate::figure::Figure;
use crate::record::FigureRecord;
use crate::scenes::cave;

/// Rays that are timed together, a fraction of a millisecond.
const BATCH: usize = 512;
/// Repetitions of a batch, of which the fastest counts. They follow each other at a distance of the whole set, so that
/// caches are as cold as in real work.
const REPEATS: usize = 5;

/// Closest-hit rays per second on one thread in a cave: camera rays and two bounces off its walls, at most `count` each.
///
/// # Errors
/// If the scene is too large.
pub fn measure((edge, count): (usize, usize)) -> Result<Vec<FigureRecord>> {
    let scene = cave((count.isqrt(), count.isqrt()), edge)?;
    let start = Instant::now();
    let bvh = SceneBvh::new(&scene)?;
    let built = start.elapsed().as_secs_f64();
    let triangles: usize = scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum();
    let mut records = vec![Figure::new(format!("tree build, {triangles} triangles"), built, "s").into()];
    let peers = Peers::new(&scene);
    let mut rays = camera_rays(&scene);
    for stage in ["camera rays", "first bounce", "second bounce"] {
        let ours = rays_per_second(&rays, |ray| bvh.intersect(ray).is_some());
        for (peer, peer_value) in [
            ("obvhs Bvh2", rays_per_second(&rays, |ray| peers.hits_binary(ray))),
            ("obvhs CwBvh", rays_per_second(&rays, |ray| peers.hits_wide(ray))),
        ] {
            let name = format!("{stage} against {peer}, {triangles} triangles, 1 thread");
            records.push(FigureRecord {
                peer: Some(peer.into()),
                peer_value: Some(peer_value),
                ratio: Some(ours / peer_value),
                ..Figure::new(name, ours, "rays/s").into()
            });
        }
        rays = bounce(&scene, &bvh, &rays);
    }
    Ok(records)
}

/// Peer trees: the triangles in obvhs's own trees.
struct Peers {
    triangles: Vec<Triangle>,
    binary: obvhs::bvh2::Bvh2,
    wide: obvhs::cwbvh::CwBvh,
}

impl Peers {
    fn new(scene: &Scene) -> Self {
        let mut triangles = Vec::new();
        for instance in &scene.instances {
            let Some(mesh) = scene.mesh(instance.geometry) else { continue };
            triangles.extend(mesh.triangles.iter().map(|triangle| {
                let [v0, v1, v2] = triangle.map(|vertex| {
                    instance.world_from_object.transform_point3a(Vec3A::from(mesh.positions[vertex as usize]))
                });
                Triangle { v0, v1, v2 }
            }));
        }
        let params = BvhBuildParams::slow_build();
        let binary = build_bvh2_from_tris(&triangles, params, &mut Default::default());
        let wide = build_cwbvh_from_tris(&triangles, params, &mut Default::default());
        Self { triangles, binary, wide }
    }

    fn hits_binary(&self, ray: &Ray) -> bool {
        let mut hit = RayHit::none();
        self.binary.ray_traverse(obvhs_ray(ray), &mut hit, |ray, id| {
            self.triangles[self.binary.primitive_indices[id] as usize].intersect(ray)
        })
    }

    fn hits_wide(&self, ray: &Ray) -> bool {
        let mut hit = RayHit::none();
        self.wide.ray_traverse(obvhs_ray(ray), &mut hit, |ray, id| {
            self.triangles[self.wide.primitive_indices[id] as usize].intersect(ray)
        })
    }
}

fn obvhs_ray(ray: &Ray) -> obvhs::ray::Ray {
    obvhs::ray::Ray::new(Vec3A::from(ray.origin), Vec3A::from(ray.direction), ray.t_min, f32::MAX)
}

/// Rays, or what else is traced, per second of the fastest of several repetitions.
pub fn rays_per_second<R>(rays: &[R], mut trace: impl FnMut(&R) -> bool) -> f64 {
    let mut best = vec![f64::INFINITY; rays.len().div_ceil(BATCH)];
    for _ in 0..REPEATS {
        for (batch, seconds) in rays.chunks(BATCH).zip(&mut best) {
            let start = Instant::now();
            black_box(batch.iter().filter(|ray| trace(ray)).count());
            *seconds = seconds.min(start.elapsed().as_secs_f64());
        }
    }
    rays.len() as f64 / best.iter().sum::<f64>()
}

/// Rays through the centres of all pixels.
pub fn camera_rays(scene: &Scene) -> Vec<Ray> {
    let camera = CameraSampler::new(&scene.camera, PixelFilter::Box);
    let pixels = scene.camera.width * scene.camera.height;
    let ray = |pixel: usize| {
        let ray = camera.ray(pixel % scene.camera.width, pixel / scene.camera.width, STILL, [0.5; 4])?;
        Some(Ray::new(ray.origin, ray.direction))
    };
    (0..pixels).filter_map(ray).collect()
}

/// Cosine-distributed rays off whatever the rays hit.
pub fn bounce(scene: &Scene, bvh: &SceneBvh, rays: &[Ray]) -> Vec<Ray> {
    let hits = rays.iter().enumerate().filter_map(|(index, ray)| Some((index, ray, bvh.intersect(ray)?)));
    hits.map(|(index, ray, hit)| {
        let normal = normal_towards(scene, &hit, ray.direction);
        let [u, v, ..] = PixelSampler::new(0, index as u32, 0).draw(0, 0);
        let (x, y) = normal.any_orthonormal_pair();
        let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
        let direction = (x * cos + y * sin) * v.sqrt() + normal * (1.0 - v).sqrt();
        let origin = ray.origin + ray.direction * hit.distance + normal * (hit.distance * 1e-5);
        Ray {
            kind: RayKind::Diffuse,
            from: Some((hit.instance, hit.primitive)),
            ..Ray::new(origin, direction)
        }
    })
    .collect()
}

fn normal_towards(scene: &Scene, hit: &Hit, direction: Vec3) -> Vec3 {
    let instance = &scene.instances[hit.instance as usize];
    let Some(mesh) = scene.mesh(instance.geometry) else { return hit.front.normalize_or(-direction) };
    let [a, b, c] = mesh.triangles[hit.primitive as usize]
        .map(|vertex| instance.world_from_object.transform_point3(mesh.positions[vertex as usize]));
    let normal = (b - a).cross(c - a).normalize_or(-direction);
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_is_measured_against_both_peers() {
        let rays = measure((12, 1000)).unwrap();
        assert_eq!(rays.len(), 1 + 3 * 2);
        assert!(rays[1..].iter().all(|record| record.ratio.is_some_and(|ratio| ratio > 0.0)), "{rays:?}");
    }
}
