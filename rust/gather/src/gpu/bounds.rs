//! Boxes around the ends of the segments of a block, and whether a light may touch them: the mirror of
//! `shaders/gather/bounds.wgsl`, where the test is described.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use relume_dump::Dump;

use super::light::GpuLight;
use crate::kernel::{ROUNDING, magnitude};
use crate::light::FAR;

/// Steps that sides are rounded outwards by: their own rounding, and that of directions.
const MARGIN: f32 = 1.0;
const STEPS: f32 = 65535.0;

/// `Frame` of the WGSL module.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BoundsFrame {
    pub(super) minimum: [f32; 3],
    pub(super) slack: f32,
    pub(super) step: [f32; 3],
    unused: u32,
}

/// `Bounds` of the WGSL module.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SegmentBounds {
    start: [u32; 4],
    end: [u32; 4],
}

/// A segment for sorting: its start, and its end or, if it escapes, its direction with |x| + |y| + |z| = 1.
#[derive(Clone, Copy, Debug)]
pub struct SegmentEnds {
    pub start: Vec3,
    pub end: Vec3,
}

/// A box; empty if the lower corner is above the upper one.
#[derive(Clone, Copy, Debug)]
pub struct Aabb {
    pub low: Vec3,
    pub high: Vec3,
}

impl Aabb {
    const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn with(self, point: Vec3) -> Self {
        Self { low: self.low.min(point), high: self.high.max(point) }
    }

    /// Around where segments start, and where they end.
    pub fn around<'a>(ends: impl Iterator<Item = &'a SegmentEnds>) -> [Self; 2] {
        ends.fold([Self::EMPTY; 2], |[starts, ends], s| [starts.with(s.start), ends.with(s.end)])
    }
}

impl BoundsFrame {
    /// A frame that holds all vertices and cameras of a dump.
    pub fn new(dump: &Dump) -> Self {
        let mut all = Aabb::EMPTY;
        for shard in dump.shards() {
            all = all.with(shard.grid().min).with(shard.grid().max).with(shard.camera_position());
        }
        if all.low.cmpgt(all.high).any() {
            return Self::default();
        }
        // An axis without extent still needs a step that can be divided by.
        let step = ((all.high - all.low) / (STEPS - 4.0 * MARGIN)).max(Vec3::splat(1e-9));
        let slack =
            2.0 * ROUNDING * dump.shards().map(|shard| magnitude(shard, Vec3::ZERO)).fold(0.0, f32::max);
        Self { minimum: (all.low - 2.0 * MARGIN * step).into(), slack, step: step.into(), unused: 0 }
    }

    fn step(&self) -> Vec3 {
        self.step.into()
    }

    /// Middle of the box.
    pub fn middle(&self) -> Vec3 {
        Vec3::from(self.minimum) + 0.5 * STEPS * self.step()
    }

    /// Length of the diagonal, metres.
    pub fn diagonal(&self) -> f32 {
        (self.step() * STEPS).length()
    }
}

impl SegmentBounds {
    /// Bounds of segments of which all escape or none does.
    pub fn new([starts, ends]: [Aabb; 2], escape: bool, frame: &BoundsFrame) -> Self {
        let encode = |bounds: Aabb, minimum: Vec3, step: Vec3| {
            let low = ((bounds.low - minimum) / step).floor() - MARGIN;
            let high = ((bounds.high - minimum) / step).ceil() + MARGIN;
            // Saturates at both ends.
            [0, 1, 2].map(|axis| u32::from(low[axis] as u16) | u32::from(high[axis] as u16) << 16)
        };
        let minimum = Vec3::from(frame.minimum);
        let [x, y, z] = encode(starts, minimum, frame.step());
        let [u, v, w] = match escape {
            true => encode(ends, Vec3::NEG_ONE, Vec3::splat(2.0 / STEPS)),
            false => encode(ends, minimum, frame.step()),
        };
        Self { start: [x, y, z, u32::from(escape)], end: [u, v, w, 0] }
    }

    /// True if a light may touch one of the segments.
    pub fn may_be_touched(&self, light: &GpuLight, frame: &BoundsFrame) -> bool {
        let (escape, center) = (self.start[3] != 0, Vec3::from(light.center));
        if light.is_sun() && !escape {
            return false;
        }
        let start = decode(&self.start, frame.minimum.into(), frame.step());
        let reach = light.half_extent() + frame.slack;
        if !escape {
            return boxes_meet(&start, &decode(&self.end, frame.minimum.into(), frame.step()), center, reach);
        }
        let directions = decode(&self.end, Vec3::NEG_ONE, Vec3::splat(2.0 / STEPS));
        if light.is_sun() {
            let sun = Vec3::from(light.direction);
            let seen_from =
                |share: f32| Aabb { low: directions.low - sun * share, high: directions.high - sun * share };
            let chord = Vec3::splat(light.reach2.sqrt() + 1e-4);
            return boxes_meet(&seen_from(0.57), &seen_from(1.0), Vec3::ZERO, chord);
        }
        let end = Aabb { low: start.low + directions.low * FAR, high: start.high + directions.high * FAR };
        boxes_meet(&start, &end, center, reach)
    }
}

fn decode(words: &[u32; 4], minimum: Vec3, step: Vec3) -> Aabb {
    let side = |shift: u32| Vec3::from([0, 1, 2].map(|axis: usize| (words[axis] >> shift & 0xffff) as f32));
    Aabb { low: side(0) * step + minimum, high: side(16) * step + minimum }
}

fn boxes_meet(start: &Aabb, end: &Aabb, center: Vec3, extent: Vec3) -> bool {
    let (above, below) = (center + extent, center - extent);
    let [from, to] = [(start.low - above, end.low - above), (below - start.high, below - end.high)]
        .into_iter()
        .flat_map(|(start, end)| (0..3).map(move |axis| (start[axis], end[axis])))
        .fold([0.0f32, 1.0], |[from, to], (start, end)| match (start > 0.0, end > 0.0) {
            (true, true) => [2.0, to],
            (true, false) => [from.max(start / (start - end)), to],
            (false, true) => [from, to.min(start / (start - end))],
            (false, false) => [from, to],
        });
    from * 0.99999 <= to * 1.00001
}

#[cfg(test)]
mod tests {
    use relume_dump::Flags;

    use super::*;
    use crate::Gather;
    use crate::gpu::sort::{BLOCK, PixelGroup};
    use crate::light::Profile;
    use crate::tests::kernels::{random_lights, random_rays_of};

    #[test]
    fn bounds_have_the_layout_of_their_wgsl_twin() {
        relume_gpu::assert_mirror!(SegmentBounds as "gather/bounds", "Bounds", { start, end });
    }

    #[test]
    fn a_block_that_no_light_touches_has_no_segment_that_crosses_it() {
        let gather = Gather::new(random_rays_of(16, &[5, 9]));
        let (dump, frame) = (gather.dump(), BoundsFrame::new(gather.dump()));
        let lights = gather.prepare_all(&random_lights()).unwrap();
        let (mut touched, mut untouched, mut crossed) = (0, 0, 0);
        for group in PixelGroup::all(dump) {
            let shards: Vec<_> = dump.tile(group.tile).collect();
            let blocks = group.sort(dump, &frame);
            for (bounds, words) in blocks.bounds.iter().zip(blocks.segments.chunks(BLOCK)) {
                for light in &lights {
                    let on_device = GpuLight::new(light, 0.0, 0);
                    let may = bounds.may_be_touched(&on_device, &frame);
                    let crosses = |&words: &[u32; 4]| {
                        let (start, edge, escapes) =
                            decode_words(words, shards[(words[3] >> 24 & 127) as usize]);
                        light.profile.evaluate(start, edge, escapes) > 0.0
                    };
                    let is_segment = |words: &&[u32; 4]| flags(words[1]).lobe().is_some();
                    let crosses = words.iter().filter(is_segment).any(crosses);
                    assert!(may || !crosses, "{light:?} {bounds:?}");
                    if matches!(light.profile, Profile::Sheared(_)) {
                        continue;
                    }
                    touched += usize::from(may);
                    untouched += usize::from(!may);
                    crossed += usize::from(crosses);
                }
            }
        }
        assert!(untouched > touched / 4 && crossed > touched / 4, "{touched} {untouched} {crossed}");
    }

    fn flags(z_flags: u32) -> Flags {
        Flags((z_flags >> 16) as u16)
    }

    /// Start, edge, and whether it escapes.
    fn decode_words(words: [u32; 4], shard: &relume_dump::Shard) -> (Vec3, Vec3, bool) {
        let position = |xy: u32, z: u32| shard.grid().decode([xy as u16, (xy >> 16) as u16, z as u16]);
        let (camera, flags) = (shard.camera_position(), flags(words[1]));
        let start = if flags.starts_at_camera() { camera } else { position(words[2], words[3]) };
        match flags.escaped() {
            true => (start, relume_dump::decode_direction(words[0]) * FAR, true),
            false => (start, position(words[0], words[1]) - start, false),
        }
    }
}
