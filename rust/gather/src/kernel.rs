//! The crossing test over packed records: decodes a block of segments into the first-level cache, then loops over the
//! lights. A fast test on eight segments at a time picks candidates for a [`Visitor`]. The one for exact lights evaluates
//! the few that remain one by one by [`Profile::evaluate`](crate::light::Profile::evaluate), the same code on every machine,
//! so results do not depend on the instruction set.

mod block;
mod crossing;
mod isa;

use std::ops::Range;

use glam::Vec3;
use relume_dump::{Flags, Grid, Shard, decode_rgb9e5};

pub use block::SegmentBlock;
#[cfg(target_arch = "x86_64")]
use block::decode_listed;
use block::{BLOCK, decode};
use crossing::{along, collect, near_ball, through_plane, through_slab};
pub use isa::Isa;

#[cfg(target_arch = "x86_64")]
use crate::cull_avx2::{BoxCull, CHUNK, CullWork};
#[cfg(target_arch = "x86_64")]
use crate::cull_avx512::BallCull;
use crate::emission_map::PreparedMap;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Avx2Lanes;
use crate::lanes::{Lanes, Portable, Vec3x, WIDTH};
#[cfg(target_arch = "x86_64")]
use crate::light::Ball;
use crate::light::{PreparedLight, Reach};
use crate::piece::RayPiece;

/// Receiver of contributions.
pub trait Sink {
    /// Contributions of the records from `first_record` on follow, for one light after the other.
    fn begin_block(&mut self, first_record: usize);
    /// Contributions of this light follow, in the order of the records.
    fn begin_light(&mut self, light: usize);
    /// A segment has crossed the light: profile, factors and throughput multiplied, RGB.
    fn add(&mut self, record: usize, contribution: Vec3);
}

/// Consumer of the segments that may cross lights.
pub trait Visitor {
    /// Number of lights.
    fn lights(&self) -> usize;
    /// The region that crossings of a light touch.
    fn reach(&self, light: usize) -> &Reach;
    /// True if few segments come near any of the lights.
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "first tests are AVX's"))]
    fn is_selective(&self) -> bool;
    /// Segments of the records from `first_record` on follow, for one light after the other.
    fn begin_block(&mut self, first_record: usize);
    /// The numbers, rising, of all segments of a block that may cross a light.
    fn candidates<L: Lanes>(&mut self, shard: &Shard, block: &SegmentBlock, light: usize, numbers: &[u16]);
}

/// Working memory, to be kept between calls.
#[derive(Debug, Default)]
pub struct KernelWork {
    block: SegmentBlock,
    #[cfg(target_arch = "x86_64")]
    cull: CullWork,
}

/// Adds what each light gives to the records of a range, which starts with a path.
pub fn visit(
    isa: Isa,
    shard: &Shard,
    records: Range<usize>,
    work: &mut KernelWork,
    lights: &[PreparedLight],
    sink: &mut impl Sink,
) {
    visit_candidates(isa, shard, records, work, &mut Exact { lights, sink });
}

/// Hands out the segments of a range of records, which starts with a path, that may cross lights.
pub fn visit_candidates(
    isa: Isa,
    shard: &Shard,
    records: Range<usize>,
    work: &mut KernelWork,
    visitor: &mut impl Visitor,
) {
    match isa {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a gather only keeps what `Isa::available` gives, which is after it has found the features.
        Isa::Avx512 => unsafe { visit_avx512(shard, records, work, visitor) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        Isa::Avx2 => unsafe { visit_avx2(shard, records, work, visitor) },
        Isa::Portable => visit_lanes::<Portable>(shard, records, &mut work.block, visitor),
    }
}

/// Most lights for each of which a first test on all packed records costs less than decoding them once for all.
#[cfg(target_arch = "x86_64")]
const FEW: usize = 2;
/// Largest radius of a ball around many lights, by the diagonal of the scene, for which one first test for all of them pays.
#[cfg(target_arch = "x86_64")]
const SMALL: f32 = 0.25;

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma,popcnt,bmi1")]
fn visit_avx512(shard: &Shard, records: Range<usize>, work: &mut KernelWork, visitor: &mut impl Visitor) {
    let Some(balls) = first_tests(shard, visitor, BallCull::new) else {
        return visit_avx2(shard, records, work, visitor);
    };
    for (lights, ball) in balls {
        let find =
            |chunk: Range<usize>, work: &mut CullWork| ball.run(shard, chunk, work.found.as_mut_slice());
        visit_found(shard, records.clone(), work, lights, find, visitor);
    }
}

// Not inlined: compiled for AVX-512, the loops over eight lanes are slower.
#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx2,fma,popcnt,bmi1")]
fn visit_avx2(shard: &Shard, records: Range<usize>, work: &mut KernelWork, visitor: &mut impl Visitor) {
    let Some(boxes) = first_tests(shard, visitor, BoxCull::new) else {
        return visit_lanes::<Avx2Lanes>(shard, records, &mut work.block, visitor);
    };
    for (lights, cull) in boxes {
        let find = |chunk: Range<usize>, work: &mut CullWork| {
            let (xy, z_flags) =
                (&shard.position_xy()[chunk.clone()], &shard.position_z_flags()[chunk.clone()]);
            cull.run(xy, z_flags, chunk.start as u32, chunk.start > records.start, work)
        };
        visit_found(shard, records.clone(), work, lights, find, visitor);
    }
}

/// First tests, each for some of the lights: one for all of many that are near each other, as those are from which derivatives
/// are taken, or one for each of a few. Nothing if they are many and far apart, or one of them is everywhere.
#[cfg(target_arch = "x86_64")]
fn first_tests<T>(
    shard: &Shard,
    visitor: &impl Visitor,
    test: impl Fn(&Shard, &Reach, f32) -> Option<T>,
) -> Option<Vec<(Range<usize>, T)>> {
    let test = |reach: &Reach| test(shard, reach, ROUNDING * magnitude(shard, reach.center()));
    let count = visitor.lights();
    if !visitor.is_selective() {
        return None;
    }
    if count <= FEW {
        return (0..count).map(|light| Some((light..light + 1, test(visitor.reach(light))?))).collect();
    }
    let balls = (0..count).map(|light| visitor.reach(light).ball()).collect::<Option<Vec<_>>>()?;
    let (common, Grid { min, max }) = (Ball::around(&balls), shard.grid());
    if common.radius > SMALL * min.distance(max) {
        return None;
    }
    Some(vec![(0..count, test(&Reach::Ball(common))?)])
}

/// Decodes and tests only the records that `find` leaves of each chunk: their numbers are in [`CullWork::found`], as many as
/// it returns.
#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx2,fma,popcnt,bmi1")]
fn visit_found(
    shard: &Shard,
    records: Range<usize>,
    work: &mut KernelWork,
    lights: Range<usize>,
    find: impl Fn(Range<usize>, &mut CullWork) -> usize,
    visitor: &mut impl Visitor,
) {
    for first in records.clone().step_by(CHUNK) {
        let count = find(first..records.end.min(first + CHUNK), &mut work.cull);
        for numbers in work.cull.found[..count].chunks(BLOCK) {
            decode_listed::<Avx2Lanes>(shard, numbers, &mut work.block);
            visitor.begin_block(numbers[0] as usize);
            for light in lights.clone() {
                cross::<Avx2Lanes>(shard, &mut work.block, light, visitor);
            }
        }
    }
}

#[inline(always)]
fn visit_lanes<L: Lanes>(
    shard: &Shard,
    records: Range<usize>,
    block: &mut SegmentBlock,
    visitor: &mut impl Visitor,
) {
    let mut before = Vec3x::<L>::splat(shard.camera_position());
    for first in records.clone().step_by(BLOCK) {
        let next = records.end.min(first + BLOCK);
        decode::<L>(shard, first..next, block, &mut before);
        visitor.begin_block(first);
        for light in 0..visitor.lights() {
            cross::<L>(shard, block, light, visitor);
        }
    }
}

/// Error of computed distances relative to the coordinates: a few units in the last place.
pub const ROUNDING: f32 = 4e-6;

/// Largest coordinate that a test of this shard against a light at `center` meets.
pub fn magnitude(shard: &Shard, center: Vec3) -> f32 {
    let Grid { min, max } = shard.grid();
    min.abs().max(max.abs()).max(shard.camera_position().abs()).max(center.abs()).max_element()
}

#[inline(always)]
fn cross<L: Lanes>(shard: &Shard, block: &mut SegmentBlock, light: usize, visitor: &mut impl Visitor) {
    let count = block.len.div_ceil(WIDTH);
    let groups = block.groups[..count].iter().zip(&mut block.candidates[..count]);
    match visitor.reach(light) {
        Reach::Ball(ball) => near_ball::<L>(groups, ball, ROUNDING * magnitude(shard, ball.center)),
        Reach::Plane(plane) => through_plane::<L>(groups, plane),
        Reach::Slab { plane, ends } => through_slab::<L>(groups, plane, *ends),
        Reach::Everywhere => groups.for_each(|(_, candidates)| *candidates = u8::MAX),
        Reach::Cone { direction, chord2 } => along::<L>(groups, *direction, *chord2),
    }
    // The lanes beyond the last record.
    block.candidates[count - 1] &= u8::MAX >> (count * WIDTH - block.len);
    let mut hits = std::mem::take(&mut block.hits);
    collect(&block.candidates[..count], &mut hits);
    // Hits are rare and far apart: fetch what they need together, not one after the other.
    let throughput = shard.throughput();
    for &index in hits.iter() {
        L::prefetch(throughput, block.record(usize::from(index)));
    }
    visitor.candidates::<L>(shard, block, light, &hits);
    block.hits = hits;
}

/// Lights without softness, whose hits go to a sink.
struct Exact<'a, S> {
    lights: &'a [PreparedLight],
    sink: &'a mut S,
}

impl<S: Sink> Visitor for Exact<'_, S> {
    fn lights(&self) -> usize {
        self.lights.len()
    }

    fn reach(&self, light: usize) -> &Reach {
        &self.lights[light].reach
    }

    fn is_selective(&self) -> bool {
        true
    }

    fn begin_block(&mut self, first_record: usize) {
        self.sink.begin_block(first_record);
    }

    #[inline(always)]
    fn candidates<L: Lanes>(&mut self, shard: &Shard, block: &SegmentBlock, light: usize, numbers: &[u16]) {
        self.sink.begin_light(light);
        for &index in numbers {
            evaluate(shard, block, usize::from(index), &self.lights[light], self.sink);
        }
    }
}

fn evaluate(shard: &Shard, block: &SegmentBlock, index: usize, light: &PreparedLight, sink: &mut impl Sink) {
    let record = block.record(index);
    let flags = Flags((shard.position_z_flags()[record] >> 16) as u16);
    let factor = light.factor(flags);
    if factor == 0.0 {
        return;
    }
    let (start, edge) = block.segment(index);
    let (start, edge) = (Vec3::from(start), Vec3::from(edge));
    let piece = flags.continues().then(|| RayPiece::new(shard.ray_origin(record), start, edge));
    let collected = match &piece {
        Some(piece) => light.profile.evaluate_piece(piece, flags.escaped()),
        None => light.profile.evaluate(start, edge, flags.escaped()),
    };
    let weight = factor * collected;
    if weight != 0.0 {
        let (origin, edge) = piece.map_or((start, edge), |piece| (piece.origin, piece.to_end));
        let weight = weight * light.crossed_share(flags, origin);
        let contribution = decode_rgb9e5(shard.throughput()[record]) * weight;
        let tint = |map: &PreparedMap| contribution * map.factor(origin, edge);
        sink.add(record, light.map.as_ref().map_or(contribution, tint));
    }
}
