//! The node Raycast, as in Cycles' `svm/raycast.h`.

use glam::{Vec3, Vec4};
use relume_scene::RaycastOutput;

use super::Hit;
use super::evaluate::ShadingContext;
use crate::bvh::{Ray, RayKind};

/// A ray that a node sends.
pub(super) struct Cast {
    /// Start, world space, metres.
    pub position: Vec3,
    /// Direction of any length, in which the others are measured.
    pub direction: Vec3,
    /// Distance up to which it looks.
    pub length: f32,
    /// True if it meets the object itself alone.
    pub only_local: bool,
}

impl Cast {
    /// A fact about what the ray meets; nothing is met where nodes cannot look around.
    pub fn tell(&self, context: &ShadingContext, asked: RaycastOutput) -> Vec4 {
        let scale = self.direction.length();
        let found = self.hit(context, scale);
        let distance = found.map_or(self.length, |(_, hit)| hit.distance / scale);
        let is_met = |met: bool| Vec4::splat(f32::from(met));
        match (asked, found) {
            (RaycastOutput::IsHit, _) => is_met(found.is_some()),
            (RaycastOutput::SelfHit, _) => {
                is_met(found.is_some_and(|(_, hit)| hit.instance == context.point.instance))
            }
            (RaycastOutput::HitDistance, _) => Vec4::splat(distance),
            (RaycastOutput::HitPosition, Some(_)) => (self.position + self.direction * distance).extend(1.0),
            (RaycastOutput::HitNormal, Some((ray, hit))) => {
                let (scene, prepared) = (context.scene, context.prepared);
                let met = prepared.surface_point(scene, &hit, ray.origin, ray.direction, 0.0);
                met.shading_normal.extend(1.0)
            }
            (RaycastOutput::HitPosition | RaycastOutput::HitNormal, None) => Vec4::W,
        }
    }

    fn hit(&self, context: &ShadingContext, scale: f32) -> Option<(Ray, Hit)> {
        let probes = context.probes.filter(|_| self.length > 0.0 && scale > 0.0 && scale.is_finite())?;
        let point = probes.point;
        // A ray from the surface does not meet it there; from the places of a bump it passes over their shift.
        let shift = context.point.position.distance(point.position);
        let is_from_surface = shift == 0.0 && self.position == point.position;
        let ray = Ray {
            kind: RayKind::Raycast,
            t_min: 1.1 * shift,
            t_max: self.length * scale,
            from: is_from_surface.then_some((point.instance, point.primitive)),
            ..Ray::new(self.position, self.direction / scale).at(point.time)
        };
        let found = match self.only_local {
            false => probes.bvh.intersect(&ray),
            true if context.mesh().is_some() => probes.bvh.intersect_within(&ray, point.instance),
            true => None,
        };
        found.map(|hit| (ray, hit))
    }
}
