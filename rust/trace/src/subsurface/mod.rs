//! Subsurface scattering: paths enter a body, find where they leave it, and go on from there as from a diffuse surface.
//!
//! The models are Cycles': random walks (Chiang, Kutz and Burley, "Practical and Controllable Subsurface Scattering
//! for Production Path Tracing", SIGGRAPH 2016) and probes of Burley's profile (King et al., "BSSRDF Importance
//! Sampling", SIGGRAPH 2013). Lights inside a body do not count: the segment through it collects nothing.

mod disk;
mod medium;
mod walk;

use glam::Vec3;
use relume_scene::{Scene, SubsurfaceMethod};

use crate::{
    bsdf::{BodyEntry, Scatter, Surface},
    bvh::Ray,
    integrator::Integrator,
    path::PathState,
    sampler::Draws,
    shading::{Hit, SurfacePoint},
};
use medium::Medium;

/// Added to a vertex's group: numbers of its way through a body, one group a step.
const BODY_GROUP: u32 = 1 << 29;
const GROUPS_BETWEEN_STEPS: u32 = 1 << 12;
/// Added to a vertex's group: numbers of the place where the path leaves the body.
const EXIT_GROUP: u32 = 1 << 28;

/// Place where a path leaves a body.
#[derive(Clone, Copy, Debug)]
struct BodyExit {
    hit: Hit,
    position: Vec3,
    /// Unit direction out of the body.
    outwards: Vec3,
    throughput: Vec3,
}

impl Integrator<'_> {
    /// Takes the path from `point` through the body to where it leaves that, and makes `surface` what it goes on from
    /// there; nothing if it ends inside.
    pub fn cross_body(
        &self,
        path: &mut PathState,
        point: &SurfacePoint,
        entry: &BodyEntry,
        draws: Draws,
        surface: &mut Surface,
    ) -> Option<(SurfacePoint, Draws)> {
        let bssrdf = &entry.bssrdf;
        // As in Cycles, strands and points have no inside.
        let start = on_triangle(self.scene, point)?;
        let throughput = path.throughput * entry.weight;
        let find = |ray: &Ray| self.bvh.intersect_within(ray, point.instance);
        let draw = |step: u32| draws.at(BODY_GROUP + step * GROUPS_BETWEEN_STEPS);
        let u = draw(0);
        let exit = if bssrdf.method == SubsurfaceMethod::Disk {
            disk::probe(bssrdf.radius, point, throughput, u, find)?
        } else {
            let direction = bssrdf.enter(entry.normal, point.wo, [u[0], u[1]])?;
            if point.geometric_normal.dot(direction) >= 0.0 {
                return None;
            }
            let (medium, throughput) = Medium::new(bssrdf, throughput);
            let from = Some((point.instance, point.primitive));
            let ray = Ray { from, ..Ray::new(start, direction).at(point.time) };
            walk::walk(&medium, ray, point.shading_normal, throughput, find, |step| draw(step + 1))?
        };
        path.throughput = exit.throughput;
        path.left_out = None;
        // As if the ray had come from outside, so that the side is the outer one.
        let hit = Hit { distance: 0.0, ..exit.hit };
        let exit =
            self.materials.surface_point(self.scene, &hit, exit.position, -exit.outwards, point.footprint);
        let probes = self.probes(path, &exit, draws.moved(EXIT_GROUP));
        let normal = self.materials.exit_normal(self.scene, &exit, probes.as_ref(), surface);
        surface.reset(&exit);
        surface.add(Vec3::ONE, Vec3::ONE, normal, Scatter::Diffuse);
        Some((exit, draws.moved(EXIT_GROUP)))
    }
}

/// A point in the plane of its triangle to within rounding of its coordinates: steps through skin are smaller than what
/// a long ray misses a surface by.
fn on_triangle(scene: &Scene, point: &SurfacePoint) -> Option<Vec3> {
    let mesh = scene.mesh(point.geometry)?;
    let [a, b, c] = mesh.corners_at(point.primitive as usize, point.time);
    let [u, v] = point.barycentrics;
    let in_object = a * (1.0 - u - v) + b * u + c * v;
    let instance = &scene.instances[point.instance as usize];
    Some(instance.world_from_object_at(point.time).transform_point3(in_object))
}
