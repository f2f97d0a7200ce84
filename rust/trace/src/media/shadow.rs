use glam::Vec3;

use super::{Flight, HullCrossing, MediaScratch, MediaSpace, TrackingNumbers, VolumeStack};
use crate::{bvh::Ray, shading::Hit, vertex::Vertex};

/// Media along a shadow ray.
pub(crate) struct ShadowMedia<'a> {
    pub space: MediaSpace<'a>,
    /// Media around the ray's present start.
    pub stack: VolumeStack,
    pub crossing: HullCrossing,
    pub numbers: TrackingNumbers,
    pub scratch: &'a mut MediaScratch,
}

impl ShadowMedia<'_> {
    /// Leaves a vertex: a ray to the other side of a surface goes into or out of what is behind it.
    pub fn leave_vertex(&mut self, vertex: Vertex<'_>, direction: Vec3) {
        if let Vertex::Surface { point, .. } = vertex
            && point.geometric_normal.dot(direction) < 0.0
        {
            let triangle = (point.instance, point.primitive);
            self.space.media.cross_at(self.space.scene, triangle, point.backfacing, &mut self.stack);
        }
    }

    /// Share of light that gets from a hit, or the end of a ray without one, to the start of the ray.
    pub fn transmittance(&mut self, ray: &Ray, hit: Option<&Hit>) -> Vec3 {
        if hit.is_none() && ray.t_max == f32::INFINITY {
            self.stack = self.space.media.outside();
        }
        let length = hit.map_or(ray.t_max, |hit| hit.distance);
        let (origin, direction) = (ray.origin, ray.direction);
        let flight = Flight { space: self.space, stack: &self.stack, origin, direction, length };
        flight.transmittance(&mut self.numbers, self.scratch)
    }

    /// Takes the ray through a surface that it hit, if that is but a hull; returns whether it is.
    pub fn pass_hull(&mut self, ray: &mut Ray, hit: &Hit) -> bool {
        if !self.space.media.is_hull(self.space.scene, hit) || self.crossing.is_worn_out() {
            return false;
        }
        self.cross(hit, ray.direction);
        self.crossing.pass(ray, hit);
        true
    }

    /// Takes the ray through a transparent surface.
    pub fn cross(&mut self, hit: &Hit, direction: Vec3) {
        self.space.media.cross(self.space.scene, hit, direction, &mut self.stack);
    }
}
