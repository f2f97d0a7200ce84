//! The crossing test over packed records: decodes a block of segments into the first-level cache, then loops over the
//! lights. A fast test on eight segments at a time picks candidates; the few that remain are evaluated one
//! by one by [`Profile::evaluate`](crate::light::Profile::evaluate), the same code on every machine, so results
//! do not depend on the instruction set.

use std::ops::Range;

use glam::Vec3;
use relume_dump::{Flags, Grid, Shard, decode_rgb9e5};

#[cfg(target_arch = "x86_64")]
use crate::lanes::Avx2;
use crate::lanes::{Lanes, Portable, Vec3x, WIDTH};
use crate::light::{Ball, FAR, Plane, PreparedLight, Reach};

/// Records decoded at a time: 14 KiB.
const BLOCK: usize = 512;

/// Which instructions the kernels use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Whatever the compiler makes of plain arrays.
    Portable,
}

impl Isa {
    /// The best that this processor has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return Self::Avx2;
        }
        Self::Portable
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

/// Decoded segments; kept between calls to save its allocation.
#[derive(Debug)]
pub struct Block {
    origin: [Vec<[f32; WIDTH]>; 3],
    edge: [Vec<[f32; WIDTH]>; 3],
    inverse_length2: Vec<[f32; WIDTH]>,
    first: usize,
    len: usize,
}

impl Default for Block {
    fn default() -> Self {
        let lanes = || vec![[0.0; WIDTH]; BLOCK / WIDTH];
        let vector = || [lanes(), lanes(), lanes()];
        Self { origin: vector(), edge: vector(), inverse_length2: lanes(), first: 0, len: 0 }
    }
}

impl Block {
    fn scalar(stream: &[Vec<[f32; WIDTH]>; 3], index: usize) -> Vec3 {
        let at = |axis: usize| stream[axis][index / WIDTH][index % WIDTH];
        Vec3::new(at(0), at(1), at(2))
    }

    #[inline(always)]
    fn load<L: Lanes>(stream: &[Vec<[f32; WIDTH]>; 3], group: usize) -> Vec3x<L> {
        let at = |axis: usize| &stream[axis][group];
        Vec3x { x: L::load(at(0)), y: L::load(at(1)), z: L::load(at(2)) }
    }

    #[inline(always)]
    fn store<L: Lanes>(stream: &mut [Vec<[f32; WIDTH]>; 3], group: usize, v: Vec3x<L>) {
        let [x, y, z] = stream;
        v.x.store(&mut x[group]);
        v.y.store(&mut y[group]);
        v.z.store(&mut z[group]);
    }
}

/// Adds what each light gives to the records of a range, which starts with a path.
pub fn visit(
    isa: Isa,
    shard: &Shard,
    records: Range<usize>,
    block: &mut Block,
    lights: &[PreparedLight],
    sink: &mut impl Sink,
) {
    match isa {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa::detect` has found both features; nothing else makes this value outside tests that detect, too.
        Isa::Avx2 => unsafe { visit_avx2(shard, records, block, lights, sink) },
        Isa::Portable => visit_lanes::<Portable>(shard, records, block, lights, sink),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn visit_avx2(
    shard: &Shard,
    records: Range<usize>,
    block: &mut Block,
    lights: &[PreparedLight],
    sink: &mut impl Sink,
) {
    visit_lanes::<Avx2>(shard, records, block, lights, sink);
}

#[inline(always)]
fn visit_lanes<L: Lanes>(
    shard: &Shard,
    records: Range<usize>,
    block: &mut Block,
    lights: &[PreparedLight],
    sink: &mut impl Sink,
) {
    let Grid { min, max } = shard.grid();
    let magnitude = min.abs().max(max.abs()).max(shard.camera_position().abs()).max_element();
    let mut before = Vec3x::<L>::splat(shard.camera_position());
    let mut first = records.start;
    while first < records.end {
        let next = records.end.min(first + BLOCK);
        decode::<L>(shard, first..next, block, &mut before);
        sink.begin_block(first);
        for (index, light) in lights.iter().enumerate() {
            sink.begin_light(index);
            cross::<L>(shard, block, light, magnitude, sink);
        }
        first = next;
    }
}

/// Decodes records; `before` holds the end of the last record in its lane 7.
#[inline(always)]
fn decode<L: Lanes>(shard: &Shard, records: Range<usize>, block: &mut Block, before: &mut Vec3x<L>) {
    let (xy, z_flags) = (&shard.position_xy()[records.clone()], &shard.position_z_flags()[records.clone()]);
    (block.first, block.len) = (records.start, records.len());
    let (xy_groups, xy_rest) = xy.as_chunks::<WIDTH>();
    let (z_groups, z_rest) = z_flags.as_chunks::<WIDTH>();
    for (group, (xy, z_flags)) in xy_groups.iter().zip(z_groups).enumerate() {
        decode_group(shard, xy, z_flags, block, group, before);
    }
    if !xy_rest.is_empty() {
        let [mut xy, mut z_flags] = [[0; WIDTH]; 2];
        xy[..xy_rest.len()].copy_from_slice(xy_rest);
        z_flags[..z_rest.len()].copy_from_slice(z_rest);
        decode_group(shard, &xy, &z_flags, block, xy_groups.len(), before);
    }
}

#[inline(always)]
fn decode_group<L: Lanes>(
    shard: &Shard,
    xy: &[u32; WIDTH],
    z_flags: &[u32; WIDTH],
    block: &mut Block,
    group: usize,
    before: &mut Vec3x<L>,
) {
    /// Bits of the flags in `position_z_flags`.
    const PATH_START: u32 = 16;
    const ESCAPED: u32 = 17;
    let ((x, y), (z, _)) = (L::unpack(xy), L::unpack(z_flags));
    let end = Vec3x { x, y, z }.mul(Vec3x::splat(shard.grid().step())).add(Vec3x::splat(shard.grid().min));
    let camera = Vec3x::splat(shard.camera_position());
    // An origin record has no segment of its own: what starts at the camera is evaluated to nothing by its lobe.
    let origin = Vec3x::select(L::bit(z_flags, PATH_START), camera, end.shift_in(*before));
    *before = end;
    let mut edge = end.sub(origin);
    let escaped = L::bit(z_flags, ESCAPED);
    if escaped.sign_bits() != 0 {
        let far = direction::<L>(x, y).scale(L::splat(FAR));
        edge = Vec3x::select(escaped, far, edge);
    }
    let length2 = edge.dot(edge).max(L::splat(f32::MIN_POSITIVE));
    Block::store(&mut block.origin, group, origin);
    Block::store(&mut block.edge, group, edge);
    L::splat(1.0).div(length2).store(&mut block.inverse_length2[group]);
}

/// [`relume_dump::decode_direction`], the same operations.
#[inline(always)]
fn direction<L: Lanes>(low: L, high: L) -> Vec3x<L> {
    let (one, scale) = (L::splat(1.0), L::splat(2.0 / 65535.0));
    let (u, v) = (low.mul(scale).sub(one), high.mul(scale).sub(one));
    let z = one.sub(u.abs()).sub(v.abs());
    let fold = L::splat(0.0).sub(z).max(L::splat(0.0));
    let d = Vec3x { x: u.sub(fold.with_sign_of(u)), y: v.sub(fold.with_sign_of(v)), z };
    let length = d.dot(d).sqrt();
    Vec3x { x: d.x.div(length), y: d.y.div(length), z: d.z.div(length) }
}

#[inline(always)]
fn cross<L: Lanes>(
    shard: &Shard,
    block: &Block,
    light: &PreparedLight,
    magnitude: f32,
    sink: &mut impl Sink,
) {
    for group in 0..block.len.div_ceil(WIDTH) {
        let mut candidates = match &light.reach {
            Reach::Ball(ball) => near_ball::<L>(block, group, ball, magnitude),
            Reach::Plane(plane) => through_plane::<L>(block, group, plane),
            Reach::Cone { direction, chord2 } => along::<L>(block, group, *direction, *chord2),
        };
        while candidates != 0 {
            let index = group * WIDTH + candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            if index < block.len {
                evaluate(shard, block, index, light, sink);
            }
        }
    }
}

/// The segments that come within the radius of the centre, and some more for rounding.
#[inline(always)]
fn near_ball<L: Lanes>(block: &Block, group: usize, ball: &Ball, magnitude: f32) -> u8 {
    // The distances here and in the exact test are off by a few units in the last place of the coordinates.
    let radius = ball.radius * 1.000_01 + 4e-6 * (magnitude + ball.center.abs().max_element());
    let edge = Block::load::<L>(&block.edge, group);
    let to_center = Vec3x::splat(ball.center).sub(Block::load::<L>(&block.origin, group));
    let share = to_center.dot_fused(edge).mul(L::load(&block.inverse_length2[group]));
    let share = share.max(L::splat(0.0)).min(L::splat(1.0));
    let nearest = to_center.sub(edge.scale(share));
    nearest.dot_fused(nearest).le(L::splat(radius * radius)).sign_bits()
}

/// The segments that cross a rectangle from its front: the operations of `Plane::crossing_cosine`.
#[inline(always)]
fn through_plane<L: Lanes>(block: &Block, group: usize, plane: &Plane) -> u8 {
    let edge = Block::load::<L>(&block.edge, group);
    let to_center = Vec3x::splat(plane.center).sub(Block::load::<L>(&block.origin, group));
    let (height, slope) = (to_center.dot(Vec3x::splat(plane.normal)), edge.dot(Vec3x::splat(plane.normal)));
    let zero = L::splat(0.0);
    let passed = slope.lt(zero).and(height.lt(zero)).and(slope.lt(height));
    if passed.sign_bits() == 0 {
        return 0;
    }
    let in_plane = edge.scale(height.div(slope)).sub(to_center);
    let (u, v) = (in_plane.dot(Vec3x::splat(plane.inverse_u)), in_plane.dot(Vec3x::splat(plane.inverse_v)));
    let half = L::splat(0.5);
    passed.and(u.abs().le(half)).and(v.abs().le(half)).sign_bits()
}

/// The segments whose edge, measured in [`FAR`], ends within a chord of a direction: the operations of the sun's profile,
/// which also checks that they escape.
#[inline(always)]
fn along<L: Lanes>(block: &Block, group: usize, direction: Vec3, chord2: f32) -> u8 {
    let apart = Block::load::<L>(&block.edge, group).scale(L::splat(1.0 / FAR)).sub(Vec3x::splat(direction));
    apart.dot(apart).le(L::splat(chord2)).sign_bits()
}

fn evaluate(shard: &Shard, block: &Block, index: usize, light: &PreparedLight, sink: &mut impl Sink) {
    let record = block.first + index;
    let flags = Flags((shard.position_z_flags()[record] >> 16) as u16);
    let factor = light.factor(flags);
    if factor == 0.0 {
        return;
    }
    let (origin, edge) = (Block::scalar(&block.origin, index), Block::scalar(&block.edge, index));
    let weight = factor * light.profile.evaluate(origin, edge, flags.escaped());
    if weight != 0.0 {
        sink.add(record, decode_rgb9e5(shard.throughput()[record]) * weight);
    }
}
