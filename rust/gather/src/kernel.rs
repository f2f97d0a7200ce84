//! The crossing test over packed records: decodes a block of segments into the first-level cache, then loops over the
//! lights. A fast test on eight segments at a time picks candidates for a [`Visitor`]. The one for exact lights evaluates
//! the few that remain one by one by [`Profile::evaluate`](crate::light::Profile::evaluate), the same code on every machine,
//! so results do not depend on the instruction set.

use std::ops::Range;

use glam::Vec3;
use relume_dump::{Flags, Grid, Shard, decode_rgb9e5};

#[cfg(target_arch = "x86_64")]
use crate::lanes::Avx2;
use crate::lanes::{Lanes, Portable, Vec3x, WIDTH};
use crate::light::{Ball, FAR, Plane, PreparedLight, Reach};
#[cfg(target_arch = "x86_64")]
use crate::scan::Scan;
#[cfg(target_arch = "x86_64")]
use crate::sieve::{CHUNK, Sieve, SieveWork};

/// Records decoded at a time: 14 KiB.
const BLOCK: usize = GROUPS * WIDTH;
const GROUPS: usize = 64;
/// How many records ahead are fetched: a block, which is what is computed while they come.
const AHEAD: usize = BLOCK;

/// Which instructions the kernels use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512F on top of what [`Isa::Avx2`] has.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX2, FMA, POPCNT and BMI1.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Whatever the compiler makes of plain arrays.
    Portable,
}

impl Isa {
    /// The best that this processor has.
    pub fn detect() -> Self {
        Self::available()[0]
    }

    /// All that this processor has, the best first.
    pub fn available() -> Vec<Self> {
        #[cfg_attr(
            not(target_arch = "x86_64"),
            expect(unused_mut, reason = "nothing else is known of others")
        )]
        let mut all = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("popcnt")
            && is_x86_feature_detected!("bmi1")
        {
            all.insert(0, Self::Avx2);
            if is_x86_feature_detected!("avx512f") {
                all.insert(0, Self::Avx512);
            }
        }
        all
    }
}

/// Where contributions go.
pub trait Sink {
    /// Contributions of the records from `first_record` on follow, for one light after the other.
    fn begin_block(&mut self, first_record: usize);
    /// Contributions of this light follow, in the order of the records.
    fn begin_light(&mut self, light: usize);
    /// A segment has crossed the light: profile, factors and throughput multiplied, RGB.
    fn add(&mut self, record: usize, contribution: Vec3);
}

/// What is done with the segments that may cross lights.
pub trait Visitor {
    /// Number of lights.
    fn lights(&self) -> usize;
    /// The region that crossings of a light touch.
    fn reach(&self, light: usize) -> &Reach;
    /// Whether few segments come near any of the lights.
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "first tests are AVX's"))]
    fn is_selective(&self) -> bool;
    /// Segments of the records from `first_record` on follow, for one light after the other.
    fn begin_block(&mut self, first_record: usize);
    /// The numbers, rising, of all segments of a block that may cross a light.
    fn candidates<L: Lanes>(&mut self, shard: &Shard, block: &Block, light: usize, numbers: &[u16]);
}

/// Working memory, to be kept between calls.
#[derive(Debug, Default)]
pub struct Work {
    block: Block,
    #[cfg(target_arch = "x86_64")]
    sieve: SieveWork,
}

/// Decoded segments.
#[derive(Debug)]
pub struct Block {
    groups: Box<[Group; GROUPS]>,
    /// Segments that may cross the light at hand, a bit each.
    candidates: [u8; GROUPS],
    /// The numbers of those bits.
    hits: Vec<u16>,
    len: usize,
    records: Records,
}

/// Which records a block holds.
#[derive(Debug)]
enum Records {
    /// Consecutive ones from this on.
    From(usize),
    /// Those with these numbers, rising.
    #[cfg(target_arch = "x86_64")]
    Listed(Vec<u32>),
}

impl Records {
    fn number(&self, index: usize) -> usize {
        match self {
            Self::From(first) => first + index,
            #[cfg(target_arch = "x86_64")]
            Self::Listed(numbers) => numbers[index] as usize,
        }
    }
}

/// Eight segments.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Group {
    origin: [[f32; WIDTH]; 3],
    edge: [[f32; WIDTH]; 3],
    inverse_length2: [f32; WIDTH],
}

impl Default for Block {
    fn default() -> Self {
        let group =
            Group { origin: [[0.0; WIDTH]; 3], edge: [[0.0; WIDTH]; 3], inverse_length2: [0.0; WIDTH] };
        Self {
            groups: Box::new([group; GROUPS]),
            candidates: [0; GROUPS],
            hits: Vec::with_capacity(BLOCK),
            len: 0,
            records: Records::From(0),
        }
    }
}

impl Block {
    /// Number of the record that a segment is of.
    #[inline(always)]
    pub fn record(&self, index: usize) -> usize {
        self.records.number(index)
    }

    /// Origin and edge of a segment.
    #[inline(always)]
    pub fn segment(&self, index: usize) -> ([f32; 3], [f32; 3]) {
        let Group { origin: [x, y, z], edge: [u, v, w], .. } = &self.groups[index / WIDTH];
        let lane = index % WIDTH;
        ([x[lane], y[lane], z[lane]], [u[lane], v[lane], w[lane]])
    }
}

/// Adds what each light gives to the records of a range, which starts with a path.
pub fn visit(
    isa: Isa,
    shard: &Shard,
    records: Range<usize>,
    work: &mut Work,
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
    work: &mut Work,
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
fn visit_avx512(shard: &Shard, records: Range<usize>, work: &mut Work, visitor: &mut impl Visitor) {
    let Some(scans) = first_tests(shard, visitor, Scan::new) else {
        return visit_avx2(shard, records, work, visitor);
    };
    for (lights, scan) in scans {
        let find =
            |chunk: Range<usize>, work: &mut SieveWork| scan.run(shard, chunk, work.found.as_mut_slice());
        visit_found(shard, records.clone(), work, lights, find, visitor);
    }
}

// Not inlined: compiled for AVX-512, the loops over eight lanes are slower.
#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx2,fma,popcnt,bmi1")]
fn visit_avx2(shard: &Shard, records: Range<usize>, work: &mut Work, visitor: &mut impl Visitor) {
    let Some(sieves) = first_tests(shard, visitor, Sieve::new) else {
        return visit_lanes::<Avx2>(shard, records, &mut work.block, visitor);
    };
    for (lights, sieve) in sieves {
        let find = |chunk: Range<usize>, work: &mut SieveWork| {
            let (xy, z_flags) =
                (&shard.position_xy()[chunk.clone()], &shard.position_z_flags()[chunk.clone()]);
            sieve.run(xy, z_flags, chunk.start as u32, chunk.start > records.start, work)
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

/// Decodes and tests only the records that `find` leaves of each chunk: their numbers are in [`SieveWork::found`], as many as
/// it returns.
#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx2,fma,popcnt,bmi1")]
fn visit_found(
    shard: &Shard,
    records: Range<usize>,
    work: &mut Work,
    lights: Range<usize>,
    find: impl Fn(Range<usize>, &mut SieveWork) -> usize,
    visitor: &mut impl Visitor,
) {
    for first in records.clone().step_by(CHUNK) {
        let count = find(first..records.end.min(first + CHUNK), &mut work.sieve);
        for numbers in work.sieve.found[..count].chunks(BLOCK) {
            decode_listed::<Avx2>(shard, numbers, &mut work.block);
            visitor.begin_block(numbers[0] as usize);
            for light in lights.clone() {
                cross::<Avx2>(shard, &mut work.block, light, visitor);
            }
        }
    }
}

#[inline(always)]
fn visit_lanes<L: Lanes>(
    shard: &Shard,
    records: Range<usize>,
    block: &mut Block,
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

/// Decodes consecutive records; `before` holds the end of the last record in its lane 7.
#[inline(always)]
fn decode<L: Lanes>(shard: &Shard, records: Range<usize>, block: &mut Block, before: &mut Vec3x<L>) {
    let (xy, z_flags) = (&shard.position_xy()[records.clone()], &shard.position_z_flags()[records.clone()]);
    (block.records, block.len) = (Records::From(records.start), records.len());
    let (xy_groups, xy_rest) = xy.as_chunks::<WIDTH>();
    let (z_groups, z_rest) = z_flags.as_chunks::<WIDTH>();
    let decoder = Decoder::<L>::new(shard);
    let mut last = *before;
    for ((xy, z_flags), group) in xy_groups.iter().zip(z_groups).zip(block.groups.iter_mut()) {
        L::prefetch(xy, AHEAD);
        L::prefetch(z_flags, AHEAD);
        let end = decoder.end(xy, z_flags);
        decoder.decode(xy, z_flags, end.shift_in(last), group);
        last = end;
    }
    if !xy_rest.is_empty() {
        let [mut xy, mut z_flags] = [[0; WIDTH]; 2];
        xy[..xy_rest.len()].copy_from_slice(xy_rest);
        z_flags[..z_rest.len()].copy_from_slice(z_rest);
        let end = decoder.end(&xy, &z_flags);
        decoder.decode(&xy, &z_flags, end.shift_in(last), &mut block.groups[xy_groups.len()]);
        last = end;
    }
    *before = last;
}

/// Decodes records by number.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn decode_listed<L: Lanes>(shard: &Shard, numbers: &[u32], block: &mut Block) {
    let (xy, z_flags) = (shard.position_xy(), shard.position_z_flags());
    let decoder = Decoder::<L>::new(shard);
    for (numbers, group) in numbers.chunks(WIDTH).zip(block.groups.iter_mut()) {
        let [mut xy_here, mut z_here, mut xy_before, mut z_before] = [[0; WIDTH]; 4];
        for (lane, &number) in numbers.iter().enumerate() {
            // The first record starts a path, so that what stands for its predecessor is not used.
            let (number, before) = (number as usize, (number as usize).saturating_sub(1));
            (xy_here[lane], z_here[lane]) = (xy[number], z_flags[number]);
            (xy_before[lane], z_before[lane]) = (xy[before], z_flags[before]);
        }
        decoder.decode(&xy_here, &z_here, decoder.end(&xy_before, &z_before), group);
    }
    block.len = numbers.len();
    match &mut block.records {
        Records::Listed(list) => {
            list.clear();
            list.extend_from_slice(numbers);
        }
        other => *other = Records::Listed(numbers.to_vec()),
    }
}

struct Decoder<L> {
    step: Vec3x<L>,
    min: Vec3x<L>,
    camera: Vec3x<L>,
}

impl<L: Lanes> Decoder<L> {
    #[inline(always)]
    fn new(shard: &Shard) -> Self {
        Self {
            step: Vec3x::splat(shard.grid().step()),
            min: Vec3x::splat(shard.grid().min),
            camera: Vec3x::splat(shard.camera_position()),
        }
    }

    /// Where records end that do not escape.
    #[inline(always)]
    fn end(&self, xy: &[u32; WIDTH], z_flags: &[u32; WIDTH]) -> Vec3x<L> {
        let ((x, y), (z, _)) = (L::unpack(xy), L::unpack(z_flags));
        Vec3x { x, y, z }.mul(self.step).add(self.min)
    }

    /// Decodes records; `before` holds the ends of their predecessors.
    #[inline(always)]
    fn decode(&self, xy: &[u32; WIDTH], z_flags: &[u32; WIDTH], before: Vec3x<L>, group: &mut Group) {
        /// Bits of the flags in `position_z_flags`.
        const PATH_START: u32 = 16;
        const ESCAPED: u32 = 17;
        // An origin record has no segment of its own: its lobe makes nothing of what it seems to cross.
        let origin = Vec3x::select(L::bit::<PATH_START>(z_flags), self.camera, before);
        // Without a branch: escapes come in no order that a processor could predict.
        let (low, high) = L::unpack(xy);
        let edge = self.end(xy, z_flags).sub(origin);
        let edge = Vec3x::select(L::bit::<ESCAPED>(z_flags), octahedral::<L>(low, high), edge);
        let length2 = edge.dot_fused(edge).max(L::splat(f32::MIN_POSITIVE));
        origin.store(&mut group.origin);
        edge.store(&mut group.edge);
        L::splat(1.0).div(length2).store(&mut group.inverse_length2);
    }
}

/// [`FAR`] times the octahedral direction of [`relume_dump::decode_direction`] before it is normalised: its length, 0.57 to
/// 1, does not matter there.
#[inline(always)]
fn octahedral<L: Lanes>(low: L, high: L) -> Vec3x<L> {
    let (far, scale) = (L::splat(FAR), L::splat(FAR * 2.0 / 65535.0));
    let (u, v) = (low.mul(scale).sub(far), high.mul(scale).sub(far));
    let z = far.sub(u.abs()).sub(v.abs());
    let fold = z.min(L::splat(0.0));
    Vec3x { x: u.add(fold.flip_sign_by(u)), y: v.add(fold.flip_sign_by(v)), z }
}

#[inline(always)]
fn cross<L: Lanes>(shard: &Shard, block: &mut Block, light: usize, visitor: &mut impl Visitor) {
    let count = block.len.div_ceil(WIDTH);
    let groups = block.groups[..count].iter().zip(&mut block.candidates[..count]);
    match visitor.reach(light) {
        Reach::Ball(ball) => near_ball::<L>(groups, ball, ROUNDING * magnitude(shard, ball.center)),
        Reach::Plane(plane) => through_plane::<L>(groups, plane),
        Reach::Slab { plane, ends } => through_slab::<L>(groups, plane, *ends),
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

/// Replaces `numbers` by the numbers of the bits that are set.
#[inline(always)]
fn collect(bits: &[u8], numbers: &mut Vec<u16>) {
    numbers.clear();
    for (chunk, bytes) in bits.chunks(8).enumerate() {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        let mut word = u64::from_le_bytes(word);
        while word != 0 {
            numbers.push((chunk * 64) as u16 + word.trailing_zeros() as u16);
            word &= word - 1;
        }
    }
}

type Tested<'a> = std::iter::Zip<std::slice::Iter<'a, Group>, std::slice::IterMut<'a, u8>>;

/// The segments that come within the radius of the centre, and some more for rounding.
#[inline(always)]
fn near_ball<L: Lanes>(groups: Tested<'_>, ball: &Ball, slack: f32) {
    let radius = ball.radius * 1.000_01 + slack;
    let (center, radius2) = (Vec3x::<L>::splat(ball.center), L::splat(radius * radius));
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let to_center = center.sub(Vec3x::load(&group.origin));
        let share = to_center.dot_fused(edge).mul(L::load(&group.inverse_length2)).max(zero).min(one);
        let nearest = to_center.sub_scaled(edge, share);
        *candidates = nearest.dot_fused(nearest).le(radius2).sign_bits();
    }
}

/// The segments that cross a rectangle from its front: the operations of `Plane::crossing_cosine`.
#[inline(always)]
fn through_plane<L: Lanes>(groups: Tested<'_>, plane: &Plane) {
    let (center, normal) = (Vec3x::<L>::splat(plane.center), Vec3x::splat(plane.normal));
    let (inverse_u, inverse_v) = (Vec3x::splat(plane.inverse_u), Vec3x::splat(plane.inverse_v));
    let (zero, half) = (L::splat(0.0), L::splat(0.5));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let to_center = center.sub(Vec3x::load(&group.origin));
        let (height, slope) = (to_center.dot(normal), edge.dot(normal));
        let passed = slope.lt(zero).and(height.lt(zero)).and(slope.lt(height));
        let in_plane = edge.scale(height.div(slope)).sub(to_center);
        let (u, v) = (in_plane.dot(inverse_u), in_plane.dot(inverse_v));
        *candidates = passed.and(u.abs().le(half)).and(v.abs().le(half)).sign_bits();
    }
}

/// The segments that come from the front of a rectangle and cross it before or after they end, by up to `ends` metres.
#[inline(always)]
fn through_slab<L: Lanes>(groups: Tested<'_>, plane: &Plane, ends: f32) {
    let (center, normal) = (Vec3x::<L>::splat(plane.center), Vec3x::splat(plane.normal));
    let (inverse_u, inverse_v) = (Vec3x::splat(plane.inverse_u), Vec3x::splat(plane.inverse_v));
    let (half, ends) = (L::splat(0.5), L::splat(ends));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let to_center = center.sub(Vec3x::load(&group.origin));
        let slope = edge.dot_fused(normal);
        let share = to_center.dot_fused(normal).div(slope);
        let beyond = ends.mul(L::load(&group.inverse_length2).sqrt());
        // How far the crossing is from the middle, in lengths.
        let along = share.sub(half).abs().le(half.add(beyond));
        let in_plane = edge.scale(share).sub(to_center);
        let (u, v) = (in_plane.dot_fused(inverse_u), in_plane.dot_fused(inverse_v));
        let inside = u.abs().le(half).and(v.abs().le(half));
        *candidates = slope.lt(L::splat(0.0)).and(along).and(inside).sign_bits();
    }
}

/// The segments within a chord of a direction: the operations of the sun's profile, which also checks that they escape.
#[inline(always)]
fn along<L: Lanes>(groups: Tested<'_>, direction: Vec3, chord2: f32) {
    let (direction, chord2) = (Vec3x::<L>::splat(direction), L::splat(chord2));
    for (group, candidates) in groups {
        let edge = Vec3x::<L>::load(&group.edge);
        let length = edge.dot(edge).sqrt();
        let apart =
            Vec3x { x: edge.x.div(length), y: edge.y.div(length), z: edge.z.div(length) }.sub(direction);
        *candidates = apart.dot(apart).le(chord2).sign_bits();
    }
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
    fn candidates<L: Lanes>(&mut self, shard: &Shard, block: &Block, light: usize, numbers: &[u16]) {
        self.sink.begin_light(light);
        for &index in numbers {
            evaluate(shard, block, usize::from(index), &self.lights[light], self.sink);
        }
    }
}

fn evaluate(shard: &Shard, block: &Block, index: usize, light: &PreparedLight, sink: &mut impl Sink) {
    let record = block.record(index);
    let flags = Flags((shard.position_z_flags()[record] >> 16) as u16);
    let factor = light.factor(flags);
    if factor == 0.0 {
        return;
    }
    let (origin, edge) = block.segment(index);
    let weight = factor * light.profile.evaluate(origin.into(), edge.into(), flags.escaped());
    if weight != 0.0 {
        sink.add(record, decode_rgb9e5(shard.throughput()[record]) * weight);
    }
}
