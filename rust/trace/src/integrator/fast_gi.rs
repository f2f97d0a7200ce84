//! Cycles' Fast GI Approximation (`kernel/integrator/intersect_closest.h`, `shade_background.h`, `shade_surface.h`).
//!
//! Where it replaces bounces, Cycles cuts a path's own ray after some of them, and lets it meet the world at its end. Light that is
//! sampled from the same vertex comes from afar as ever. So lights have a shadow ray's records there, along which no world counts,
//! and the world has a record of its own, along which no light counts. What Cycles adds by hitting a lamp with the cut ray is counted
//! as if a shadow ray had met it.

use glam::Vec3;
use relume_dump::{End, Segment, Sight};

use super::{Integrator, PathSink, Walk};
use crate::{path::PathState, settings::FastGi, shading::SurfacePoint};

impl Integrator<'_> {
    /// Reach of the ray that leaves a surface, of which what lies before transparent surfaces is a part.
    pub(super) fn reach(&self, path: &mut PathState, point: &SurfacePoint) -> f32 {
        let Some(FastGi::Replace { bounces, distance, .. }) = self.settings.fast_gi else {
            return f32::INFINITY;
        };
        if !path.cut_after(bounces) {
            return f32::INFINITY;
        }
        let own = self.scene.instances[point.instance as usize].occlusion_distance;
        let reach = if own == 0.0 { distance } else { own };
        (reach - point.position.distance(path.origin())).max(0.0)
    }

    /// Records that a path leaves the scene, or that its cut ray ends in the open. Returns the factor of the world there.
    pub(super) fn record_escape(&self, walk: &mut Walk, sink: &mut impl PathSink) -> f32 {
        let ray = walk.ray;
        let Some(FastGi::Replace { factor, .. }) = self.settings.fast_gi.filter(|_| walk.path.is_cut())
        else {
            self.record(walk, End::Escape(ray.direction), sink);
            return 1.0;
        };
        if walk.path.lights_only.is_some() {
            return factor;
        }
        if walk.last.is_none() {
            // No shadow ray looks for lights here: the path finds those that it reaches.
            self.record(walk, End::Vertex(ray.origin + ray.direction * ray.t_max), sink);
        }
        let found = walk.path.segment(End::Escape(ray.direction));
        let bounces = walk.path.bounces_before();
        let class = self.classes.as_ref().map_or(0, |classes| classes.offset(Sight::World, bounces));
        let segment = Segment { continues: false, receiver: found.receiver + class, ..found };
        if let Some(end) = walk.path.left_out.take() {
            sink.push(Segment { end, throughput: Vec3::ZERO, ..segment });
        }
        let weight = if walk.counts { self.settings.film_exposure * factor } else { 0.0 };
        sink.push(Segment { throughput: segment.throughput * weight, ..segment });
        factor
    }
}
