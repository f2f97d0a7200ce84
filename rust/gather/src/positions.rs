//! Region in which lights are worth training (paper, section 4.4).

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::{End, Lobe, Shard};

use crate::Gather;

impl Gather {
    /// A random point on a random segment of a pixel's paths, from two random numbers in 0..1: each segment is as likely
    /// as the others, each point on it, too. Escaped segments count up to
    /// where they leave the box of all vertices, enlarged by a tenth of its diagonal. `None`
    /// if the pixel has no such segment there.
    pub fn segment_point(&self, x: usize, y: usize, random: [f32; 2]) -> Option<Vec3> {
        let records = |(shard, pixel): (&Arc<Shard>, usize)| shard.pixel(pixel).len();
        let total: usize = self.dump.pixel(x, y).map(records).sum();
        let mut index = ((f64::from(random[0]) * total as f64) as usize).min(total.checked_sub(1)?);
        for (shard, pixel) in self.dump.pixel(x, y) {
            let range = shard.pixel(pixel);
            if index < range.len() {
                return self.point_on_segment(shard, range.start + index, random[1]);
            }
            index -= range.len();
        }
        None
    }

    fn point_on_segment(&self, shard: &Shard, record: usize, share: f32) -> Option<Vec3> {
        // An origin record stands for the segment that starts there.
        let next = (record + 1 < shard.record_count()).then(|| record + 1);
        let segment = shard.segment(record).or_else(|| shard.segment(next?))?;
        match segment.end {
            End::Vertex(vertex) => Some(segment.origin.lerp(vertex, share)),
            End::Escape(direction) => {
                let (min, max) = self.bounds;
                let margin = Vec3::splat(0.1 * min.distance(max));
                let length = box_exit(segment.origin, direction, (min - margin, max + margin));
                Some(segment.origin + direction * (length * share))
            }
        }
    }

    /// Bounding box, corner to corner, of what the camera sees: the ends of camera segments, transparent surfaces passed.
    /// `None` if it sees nothing.
    pub fn visible_bounds(&self) -> Option<(Vec3, Vec3)> {
        let seen = |shard: &Arc<Shard>| {
            let segments = (0..shard.record_count()).filter_map(|record| shard.segment(record));
            let camera = segments.filter(|segment| segment.flags.lobe() == Some(Lobe::Camera));
            let vertices = camera.filter_map(|segment| match segment.end {
                End::Vertex(vertex) => Some((vertex, vertex)),
                End::Escape(_) => None,
            });
            vertices.reduce(join)
        };
        let shards: Vec<_> = self.dump.shards().collect();
        shards.into_par_iter().filter_map(seen).reduce_with(join)
    }
}

fn join(a: (Vec3, Vec3), b: (Vec3, Vec3)) -> (Vec3, Vec3) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Distance at which a ray leaves a box that it starts in.
fn box_exit(origin: Vec3, direction: Vec3, (min, max): (Vec3, Vec3)) -> f32 {
    let far = Vec3::select(direction.cmpge(Vec3::ZERO), max, min);
    // 0 / 0, in the plane of a side and along it, is no limit.
    let distance = ((far - origin) / direction).map(|d| if d.is_nan() { f32::INFINITY } else { d });
    distance.min_element().max(0.0)
}
