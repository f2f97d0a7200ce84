//! Nodes that look around by rays of their own: Ambient Occlusion and Bevel, as in Cycles' `svm/ao.h` and `svm/bevel.h`.

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::Vec3;

use super::SurfacePoint;
use super::coordinates::footprint_axes;
use super::evaluate::ShadingContext;
use crate::bsdf::sample_cosine;
use crate::bvh::{Ray, RayKind, SceneBvh};
use crate::sampler::Draws;

/// Groups of the sampler, from a vertex's own.
const OCCLUSION_GROUP: u32 = 1 << 28;
const BEVEL_GROUP: u32 = OCCLUSION_GROUP + 1;
/// Smallest density of a path's directions up to which edges are rounded.
const BLURRY_PDF: f32 = 8.0;
/// Most places along one ray that count.
const MOST_HITS: usize = 64;

/// Rays from a point that a path has met. Shadow rays, lights and displacement know none.
#[derive(Clone, Copy)]
pub(crate) struct Probes<'a> {
    pub bvh: &'a SceneBvh,
    pub point: &'a SurfacePoint,
    /// Numbers of the path's vertex.
    pub draws: Draws,
    /// Smallest density of the path's directions so far.
    pub min_pdf: f32,
}

/// Rays of an Ambient Occlusion node.
pub(super) struct Occlusion {
    /// Unit axis of the rays.
    pub axis: Vec3,
    /// Distance up to which they look, metres.
    pub distance: f32,
    pub samples: usize,
    /// True if they meet the object itself alone.
    pub only_local: bool,
}

impl Probes<'_> {
    /// Share of rays that meet nothing.
    pub(super) fn openness(&self, context: &ShadingContext, occlusion: &Occlusion) -> f32 {
        let &Occlusion { axis, distance, samples, only_local } = occlusion;
        if distance <= 0.0 || samples == 0 {
            return 1.0;
        }
        let Self { bvh, point, .. } = self;
        let is_blocked = |ray: &Ray| match only_local {
            false => bvh.is_blocked(ray),
            true => context.mesh().is_some() && bvh.intersect_within(ray, point.instance).is_some(),
        };
        let is_open = |part: &usize| {
            let [u, v, ..] = self.draws.part(OCCLUSION_GROUP, *part as u32, samples as u32);
            !is_blocked(&Ray {
                kind: RayKind::Shadow,
                t_max: distance,
                from: Some((point.instance, point.primitive)),
                ..Ray::new(point.position, sample_cosine(axis, [u, v])).at(point.time)
            })
        };
        (0..samples).filter(is_open).count() as f32 / samples as f32
    }

    /// Unit normal on the side of the ray that is the mean of those within `radius` on the surface of the object, by King et
    /// al., "BSSRDF Importance Sampling" (2013), with a kernel `(radius - r)^3`.
    pub(super) fn rounded_normal(&self, context: &ShadingContext, radius: f32, samples: usize) -> Vec3 {
        let point = self.point;
        if radius <= 0.0 || self.min_pdf < BLURRY_PDF || context.mesh().is_none() {
            return context.point.shading_normal;
        }
        let normal = point.geometric_normal;
        let (x, y) = footprint_axes(normal);
        let mut sum = Vec3::ZERO;
        for part in 0..samples {
            let [u, v, pick, _] = self.draws.part(BEVEL_GROUP, part as u32, samples as u32);
            // The axis of the disk, then those in its plane, each with the share of rays along it.
            let axes = match pick {
                pick if pick < 0.5 => [(normal, 0.5), (x, 0.25), (y, 0.25)],
                pick if pick < 0.75 => [(x, 0.25), (normal, 0.5), (y, 0.25)],
                _ => [(y, 0.25), (x, 0.25), (normal, 0.5)],
            };
            sum += self.normals_along(context, radius, axes, [u, v]);
        }
        let side = if point.backfacing { -1.0 } else { 1.0 };
        sum.try_normalize().map_or(context.point.shading_normal, |mean| mean * side)
    }

    /// Sum of the weighted normals that a ray meets which starts at a point of the disk across the first axis.
    fn normals_along(
        &self,
        context: &ShadingContext,
        radius: f32,
        axes: [(Vec3, f32); 3],
        [u, v]: [f32; 2],
    ) -> Vec3 {
        let point = self.point;
        let [(axis, _), (across_x, _), (across_y, _)] = axes;
        let place = cubic_quantile(v) * radius;
        let height = (radius * radius - place * place).max(0.0).sqrt();
        let drawn_with = cubic_density(radius, place);
        if drawn_with <= 0.0 {
            return Vec3::ZERO;
        }
        let (sin, cos) = (TAU * u).sin_cos();
        let origin = point.position + axis * height + (across_x * cos + across_y * sin) * place;
        let mut ray = Ray { t_max: 2.0 * height, ..Ray::new(origin, -axis).at(point.time) };
        let mut sum = Vec3::ZERO;
        for _ in 0..MOST_HITS {
            let Some(hit) = self.bvh.intersect_within(&ray, point.instance) else { break };
            let met = context.prepared.surface_point(context.scene, &hit, origin, ray.direction, 0.0);
            let [along, others @ ..] =
                axes.map(|(axis, share): (Vec3, f32)| share * axis.dot(met.geometric_normal).abs());
            let squares = along * along + others.iter().map(|pdf| pdf * pdf).sum::<f32>();
            let density = cubic_density(radius, met.position.distance(point.position));
            let side = if met.backfacing { -1.0 } else { 1.0 };
            if squares > 0.0 {
                sum += met.shading_normal * (side * along / squares * density / drawn_with);
            }
            ray.t_min = hit.distance;
            ray.from = Some((hit.instance, hit.primitive));
        }
        sum
    }
}

/// Density over a disk's area of places at distance `r` from its middle.
fn cubic_density(radius: f32, r: f32) -> f32 {
    if r < radius { 10.0 * FRAC_1_PI * (radius - r).powi(3) / radius.powi(5) } else { 0.0 }
}

/// Distance in radii within which a share `u` of [`cubic_density`] lies, by Newton's method.
fn cubic_quantile(u: f32) -> f32 {
    let mut x = 0.25;
    for _ in 0..10 {
        let (x2, rest) = (x * x, 1.0 - x);
        let missing = x2 * (10.0 - 20.0 * x + 15.0 * x2 - 4.0 * x2 * x) - u;
        let slope = 20.0 * x * rest * rest * rest;
        if missing.abs() < 1e-6 || slope == 0.0 {
            break;
        }
        x = (x - missing / slope).clamp(0.0, 1.0);
    }
    x
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;
    use relume_scene::{Input, Instance, Material, Mesh, Node, Output, Scene, VectorMathOp};

    use super::*;
    use crate::bsdf::Surface;
    use crate::sampler::PixelSampler;
    use crate::shading::{Hit, PreparedMaterials};

    /// Meshes of squares 40 m wide, each by its middle and two half edges, that emit an output of a node. One is added to each
    /// component, since nothing emits less than 0.
    fn scene_of(meshes: &[&[[Vec3; 3]]], node: Node, output: Output) -> Scene {
        let zero = Input::Float(0.0);
        let (a, b) = (Input::Link { node: 0, output }, Input::Float(1.0));
        let sum = Node::VectorMath { operation: VectorMathOp::Add, a, b, c: zero, scale: zero };
        let color = Input::Link { node: 1, output: Output::Vector };
        let nodes = vec![node, sum, Node::Emission { color, strength: Input::Float(1.0) }];
        let mesh = |squares: &&[[Vec3; 3]]| Mesh {
            positions: squares
                .iter()
                .flat_map(|[middle, a, b]| {
                    [*middle - *a - *b, *middle + *a - *b, *middle + *a + *b, *middle - *a + *b]
                })
                .collect(),
            triangles: (0..squares.len() as u32)
                .flat_map(|square| {
                    [[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|corner| 4 * square + corner))
                })
                .collect(),
            ..Mesh::default()
        };
        Scene {
            meshes: meshes.iter().map(mesh).collect(),
            instances: (0..meshes.len()).map(|i| Instance::new("", i, Affine3A::IDENTITY, vec![0])).collect(),
            materials: vec![Material { nodes, surface: Some(2), ..Material::default() }],
            ..Scene::default()
        }
    }

    /// Mean emission at a place of a triangle of the first mesh, over some samples.
    fn shown(scene: &Scene, triangle: u32, barycentrics: [f32; 2], min_pdf: f32) -> Vec3 {
        const SAMPLES: u32 = 64;
        let (materials, _) = PreparedMaterials::new(scene);
        let bvh = SceneBvh::new(scene).unwrap();
        let hit = Hit::on(scene, [0, triangle], barycentrics, 1.0);
        let [a, b, c] = scene.meshes[0].triangles[triangle as usize];
        let [a, b, c] = [a, b, c].map(|vertex| scene.meshes[0].positions[vertex as usize]);
        let [u, v] = barycentrics;
        let place = a * (1.0 - u - v) + b * u + c * v;
        let point = materials.surface_point(scene, &hit, place + Vec3::Z, Vec3::NEG_Z, 0.0);
        let mut surface = Surface::default();
        let mut sum = Vec3::ZERO;
        for sample in 0..SAMPLES {
            let draws = Draws::new(PixelSampler::new(0, 0, 0), sample, 0);
            let probes = Probes { bvh: &bvh, point: &point, draws, min_pdf };
            materials.evaluate_with(scene, &point, Some(&probes), &mut surface);
            sum += surface.emission() - 1.0;
        }
        sum / SAMPLES as f32
    }

    const FLOOR: [Vec3; 3] = [Vec3::ZERO, Vec3::new(20.0, 0.0, 0.0), Vec3::new(0.0, 20.0, 0.0)];

    #[test]
    fn a_ceiling_takes_the_share_of_rays_that_reach_it() {
        // At half of the distance, rays up to 60 degrees do: cosine-weighted, 1 - 1/4 of them.
        let ceiling = [Vec3::Z * 0.5, FLOOR[1], FLOOR[2]];
        for (only_local, together, expected) in [(false, false, 0.25), (true, true, 0.25), (true, false, 1.0)]
        {
            let apart: [&[_]; 2] = [&[FLOOR], &[ceiling]];
            let both: [&[_]; 1] = [&[FLOOR, ceiling]];
            let meshes: &[&[_]] = if together { &both } else { &apart };
            let (color, distance) = (Input::Float(1.0), Input::Float(1.0));
            let node = Node::AmbientOcclusion {
                samples: 64,
                inside: false,
                only_local,
                color,
                distance,
                normal: None,
            };
            let open = shown(&scene_of(meshes, node, Output::Factor), 1, [0.3, 0.3], f32::INFINITY).x;
            assert!((open - expected).abs() < 0.01, "local {only_local}, one mesh {together}: {open}");
        }
    }

    #[test]
    fn edges_are_round_for_sharp_rays_and_faces_flat() {
        let bevel = || Node::Bevel { samples: 64, radius: Input::Float(0.5), normal: None };
        let flat = shown(&scene_of(&[&[FLOOR]], bevel(), Output::Normal), 1, [0.3, 0.3], f32::INFINITY);
        assert!((flat - Vec3::Z).abs().max_element() < 1e-4, "{flat}");
        // Beside an edge to a wall that faces -x there is as much of one face as of the other.
        let half = [Vec3::new(20.0, 0.0, 0.0), FLOOR[1], FLOOR[2]];
        let wall = [Vec3::new(0.0, 0.0, -20.0), Vec3::new(0.0, 0.0, 20.0), FLOOR[2]];
        let scene = scene_of(&[&[half, wall]], bevel(), Output::Normal);
        let beside = |min_pdf| shown(&scene, 1, [1e-5, 0.5], min_pdf);
        let round = beside(f32::INFINITY);
        assert!((round - Vec3::new(-1.0, 0.0, 1.0).normalize()).abs().max_element() < 0.05, "{round}");
        assert!((beside(1.0) - Vec3::Z).abs().max_element() < 1e-6);
    }

    #[test]
    fn quantiles_hold_their_share_of_the_kernel() {
        for share in [0.02_f32, 0.3, 0.5, 0.9, 0.98] {
            let end = cubic_quantile(share);
            let steps = 2000;
            let held: f32 = (0..steps)
                .map(|step| {
                    let r = (step as f32 + 0.5) / steps as f32 * end;
                    TAU * r * cubic_density(1.0, r) * end / steps as f32
                })
                .sum();
            assert!((held - share).abs() < 1e-3, "{held} of {share}");
        }
    }
}
