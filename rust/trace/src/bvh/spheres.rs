//! Spheres of point clouds, in object space.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use relume_scene::blend;

use super::{
    traverse::LocalRay,
    tree::{BvhLanes, WIDTH},
};

/// Up to eight spheres.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct SphereBlock {
    center: [BvhLanes; 3],
    /// Negative in empty lanes.
    radius: BvhLanes,
    /// Index of the point.
    pub ids: [u32; WIDTH],
}

impl SphereBlock {
    pub fn empty() -> Self {
        let (zero, none) = (BvhLanes([0.0; WIDTH]), BvhLanes([-1.0; WIDTH]));
        Self { center: [zero; 3], radius: none, ids: [u32::MAX; WIDTH] }
    }

    pub fn set(&mut self, lane: usize, center: Vec3, radius: f32, id: u32) {
        for axis in 0..3 {
            self.center[axis].0[lane] = center[axis];
        }
        self.radius.0[lane] = radius;
        self.ids[lane] = id;
    }

    /// Where the ray enters each sphere, infinite where it does not. Spheres are seen from outside only, as in Cycles.
    #[inline(always)]
    pub fn enter(&self, ray: &LocalRay) -> BvhLanes {
        let mut entries = [f32::INFINITY; WIDTH];
        let inverse = ray.direction.length_squared().recip();
        for (lane, entry) in entries.iter_mut().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|axis| self.center[axis].0[lane]);
            let to_center = Vec3::new(x, y, z) - ray.origin;
            let nearest = to_center.dot(ray.direction) * inverse;
            // From the nearest point of the ray, where squares are small.
            let apart = (to_center - ray.direction * nearest).length_squared();
            let radius = self.radius.0[lane];
            let inside = (radius * radius - apart) * inverse;
            if (inside >= 0.0) & (radius > 0.0) {
                *entry = nearest - inside.sqrt();
            }
        }
        BvhLanes(entries)
    }

    /// The block on its way to a later one of the same spheres. Radii of empty lanes stay negative.
    pub fn on_way(&self, later: &Self, share: f32) -> Self {
        let between = |a: &BvhLanes, b: &BvhLanes| {
            BvhLanes(std::array::from_fn(|lane| blend(a.0[lane], b.0[lane], share)))
        };
        Self {
            center: std::array::from_fn(|axis| between(&self.center[axis], &later.center[axis])),
            radius: between(&self.radius, &later.radius),
            ids: self.ids,
        }
    }

    /// Vector from the centre of a sphere.
    pub fn radius_vector(&self, lane: usize, position: Vec3) -> Vec3 {
        position - Vec3::new(self.center[0].0[lane], self.center[1].0[lane], self.center[2].0[lane])
    }
}
