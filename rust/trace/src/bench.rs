//! Speed of rays and of whole paths. Rays are compared with obvhs's own traversal of its own trees, on the same rays in
//! the same process: one thread, best of several for each small batch, so that other work on the machine hardly counts.

use std::{
    hint::black_box,
    sync::atomic::{AtomicU64, Ordering},
    time::Instant,
};

use glam::{Vec3, Vec3A};
use obvhs::{
    BvhBuildParams, bvh2::builder::build_bvh2_from_tris, cwbvh::builder::build_cwbvh_from_tris, ray::RayHit,
    triangle::Triangle,
};
use relume_dump::{DumpError, Lobe, Manifest, ShardSink, TileSamples};
use relume_scene::Scene;

use crate::{
    Control, TraceError, TraceSettings, Tracer,
    bvh::{Ray, SceneBvh},
    camera::CameraSampler,
    filter::PixelFilter,
    sampler::PixelSampler,
    shading::Hit,
};

/// One figure.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Measurement {
    /// Name of the measurement.
    pub name: String,
    /// The figure.
    pub value: f64,
    /// Unit of the figure.
    pub unit: &'static str,
    /// Name of the program that it is compared with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peer: Option<&'static str>,
    /// The peer's figure, in the same unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peer_value: Option<f64>,
}

impl Measurement {
    fn alone(name: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, unit, peer: None, peer_value: None }
    }

    /// `value / peer_value`.
    pub fn ratio(&self) -> Option<f64> {
        self.peer_value.map(|peer| self.value / peer)
    }
}

/// Rays that are timed together, a fraction of a millisecond.
const BATCH: usize = 512;
/// Repetitions of a batch, of which the fastest counts. They follow each other at a distance of the whole set, so that
/// caches are as cold as in real work.
const REPEATS: usize = 5;

/// Closest-hit rays per second on one thread: camera rays and two bounces off the surfaces, at most `count` each.
///
/// # Errors
/// If the scene is too large.
pub fn measure_rays(scene: &Scene, count: usize) -> Result<Vec<Measurement>, TraceError> {
    let start = Instant::now();
    let bvh = SceneBvh::new(scene)?;
    let mut measurements = vec![Measurement::alone("tree build", start.elapsed().as_secs_f64(), "s")];
    let peers = Peers::new(scene);
    let mut rays = camera_rays(scene, count);
    for stage in ["camera rays", "first bounce", "second bounce"] {
        if rays.is_empty() {
            break;
        }
        let ours = rays_per_second(&rays, |ray| bvh.intersect(ray).is_some());
        for (peer, peer_value) in [
            ("obvhs Bvh2", rays_per_second(&rays, |ray| peers.hits_binary(ray))),
            ("obvhs CwBvh", rays_per_second(&rays, |ray| peers.hits_wide(ray))),
        ] {
            measurements.push(Measurement {
                name: format!("{stage}, 1 thread"),
                value: ours,
                unit: "rays/s",
                peer: Some(peer),
                peer_value: Some(peer_value),
            });
        }
        rays = bounce(scene, &bvh, &rays);
    }
    Ok(measurements)
}

/// Whole paths per second, without storing them.
///
/// # Errors
/// If the scene cannot be traced.
pub fn measure_paths(scene: &Scene, settings: &TraceSettings) -> Result<Vec<Measurement>, TraceError> {
    let start = Instant::now();
    let tracer = Tracer::new(scene, settings)?;
    let prepare = start.elapsed().as_secs_f64();
    let sink = Discard { manifest: tracer.manifest(), records: AtomicU64::new(0) };
    let start = Instant::now();
    tracer.trace(&sink, &Control::default())?;
    let seconds = start.elapsed().as_secs_f64();
    let pixels = (sink.manifest.width * sink.manifest.height) as f64;
    let paths = pixels * f64::from(sink.manifest.samples());
    let segments = sink.records.load(Ordering::Relaxed) as f64;
    Ok(vec![
        Measurement::alone("prepare", prepare, "s"),
        Measurement::alone("paths traced", paths / seconds, "paths/s"),
        Measurement::alone("segments traced", segments / seconds, "segments/s"),
        Measurement::alone("segments of a path", segments / paths, "segments"),
    ])
}

/// Takes shards and forgets them.
struct Discard {
    manifest: Manifest,
    records: AtomicU64,
}

impl ShardSink for Discard {
    fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    fn is_complete(&self, _tile: usize, _pass: usize) -> bool {
        false
    }

    fn write(&self, _tile: usize, _pass: usize, samples: &TileSamples) -> Result<(), DumpError> {
        self.records.fetch_add(samples.record_count() as u64, Ordering::Relaxed);
        Ok(())
    }
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
            let mesh = &scene.meshes[instance.mesh];
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

fn rays_per_second(rays: &[Ray], trace: impl Fn(&Ray) -> bool) -> f64 {
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

/// Rays through pixel centres, spread evenly over the picture.
fn camera_rays(scene: &Scene, count: usize) -> Vec<Ray> {
    let camera = CameraSampler::new(&scene.camera, PixelFilter::Box);
    let pixels = scene.camera.width * scene.camera.height;
    let step = (pixels / count.max(1)).max(1);
    (0..pixels)
        .step_by(step)
        .map(|pixel| {
            let ray = camera.ray(pixel % scene.camera.width, pixel / scene.camera.width, [0.5; 4]);
            Ray::new(ray.origin, ray.direction)
        })
        .collect()
}

/// Cosine-distributed rays off whatever the rays hit.
fn bounce(scene: &Scene, bvh: &SceneBvh, rays: &[Ray]) -> Vec<Ray> {
    let hits = rays.iter().enumerate().filter_map(|(index, ray)| Some((index, ray, bvh.intersect(ray)?)));
    hits.map(|(index, ray, hit)| {
        let normal = normal_towards(scene, &hit, ray.direction);
        let [u, v, ..] = PixelSampler::new(0, index as u32, 0).draw(0, 0);
        let (x, y) = normal.any_orthonormal_pair();
        let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
        let direction = (x * cos + y * sin) * v.sqrt() + normal * (1.0 - v).sqrt();
        let origin = ray.origin + ray.direction * hit.distance + normal * (hit.distance * 1e-5);
        Ray { lobe: Lobe::Diffuse, from: Some((hit.instance, hit.triangle)), ..Ray::new(origin, direction) }
    })
    .collect()
}

fn normal_towards(scene: &Scene, hit: &Hit, direction: Vec3) -> Vec3 {
    let instance = &scene.instances[hit.instance as usize];
    let mesh = &scene.meshes[instance.mesh];
    let [a, b, c] = mesh.triangles[hit.triangle as usize]
        .map(|vertex| instance.world_from_object.transform_point3(mesh.positions[vertex as usize]));
    let normal = (b - a).cross(c - a).normalize_or(-direction);
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;
    use relume_scene::{Instance, Mesh};

    use super::*;

    #[test]
    fn every_stage_is_measured_against_both_peers() {
        let mut scene = Scene::default();
        scene.meshes.push(Mesh {
            positions: vec![
                Vec3::new(-9.0, -9.0, -1.0),
                Vec3::new(9.0, -9.0, -1.0),
                Vec3::new(0.0, 9.0, -1.0),
            ],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        });
        for height in [0.0, 5.0] {
            let place = Affine3A::from_translation(Vec3::Z * height);
            scene.instances.push(Instance::new("plane", 0, place, vec![]));
        }
        let rays = measure_rays(&scene, 1000).unwrap();
        assert_eq!(rays.len(), 1 + 3 * 2);
        assert!(rays[1..].iter().all(|m| m.ratio().is_some_and(|ratio| ratio > 0.0)));
        let paths = measure_paths(&scene, &TraceSettings { samples: 2, ..TraceSettings::default() }).unwrap();
        assert!(paths.iter().all(|m| m.value > 0.0), "{paths:?}");
    }
}
