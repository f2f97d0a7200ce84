//! Packed records decoded into segments, a block that fits the first-level cache at a time.

use std::ops::Range;

use relume_dump::{Flags, Shard};

use crate::lanes::{Lanes, Vec3x, WIDTH};
use crate::light::FAR;

/// Records decoded at a time: 14 KiB.
pub const BLOCK: usize = GROUPS * WIDTH;
const GROUPS: usize = 64;
/// Number of records between the one computed and the one prefetched: a block, which is what is computed while they
/// come.
const AHEAD: usize = BLOCK;

/// Decoded segments.
#[derive(Debug)]
pub struct SegmentBlock {
    pub(super) groups: Box<[SegmentGroup; GROUPS]>,
    /// Segments that may cross the light at hand, a bit each.
    pub(super) candidates: [u8; GROUPS],
    /// The numbers of those bits.
    pub(super) hits: Vec<u16>,
    pub(super) len: usize,
    records: Records,
}

/// Records that a block holds.
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
pub struct SegmentGroup {
    pub(super) origin: [[f32; WIDTH]; 3],
    pub(super) edge: [[f32; WIDTH]; 3],
    pub(super) inverse_length2: [f32; WIDTH],
}

impl Default for SegmentBlock {
    fn default() -> Self {
        let group = SegmentGroup {
            origin: [[0.0; WIDTH]; 3],
            edge: [[0.0; WIDTH]; 3],
            inverse_length2: [0.0; WIDTH],
        };
        Self {
            groups: Box::new([group; GROUPS]),
            candidates: [0; GROUPS],
            hits: Vec::with_capacity(BLOCK),
            len: 0,
            records: Records::From(0),
        }
    }
}

impl SegmentBlock {
    /// Number of the record that a segment is of.
    #[inline(always)]
    pub fn record(&self, index: usize) -> usize {
        self.records.number(index)
    }

    /// Origin and edge of a segment.
    #[inline(always)]
    pub fn segment(&self, index: usize) -> ([f32; 3], [f32; 3]) {
        let SegmentGroup { origin: [x, y, z], edge: [u, v, w], .. } = &self.groups[index / WIDTH];
        let lane = index % WIDTH;
        ([x[lane], y[lane], z[lane]], [u[lane], v[lane], w[lane]])
    }
}

/// Decodes consecutive records; `before` holds the end of the last record in its lane 7.
#[inline(always)]
pub fn decode<L: Lanes>(
    shard: &Shard,
    records: Range<usize>,
    block: &mut SegmentBlock,
    before: &mut Vec3x<L>,
) {
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
pub fn decode_listed<L: Lanes>(shard: &Shard, numbers: &[u32], block: &mut SegmentBlock) {
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

    /// Ends of the records that do not escape.
    #[inline(always)]
    fn end(&self, xy: &[u32; WIDTH], z_flags: &[u32; WIDTH]) -> Vec3x<L> {
        let ((x, y), (z, _)) = (L::unpack(xy), L::unpack(z_flags));
        Vec3x { x, y, z }.mul(self.step).add(self.min)
    }

    /// Decodes records; `before` holds the ends of their predecessors.
    #[inline(always)]
    fn decode(&self, xy: &[u32; WIDTH], z_flags: &[u32; WIDTH], before: Vec3x<L>, group: &mut SegmentGroup) {
        /// Bits of the flags in `position_z_flags`.
        const NOT_FROM_CAMERA: u32 = (Flags::NOT_FROM_CAMERA as u32) << 16;
        const ESCAPED: u32 = 17;
        // An origin record has no segment of its own: its lobe makes nothing of what it seems to cross.
        let origin = Vec3x::select(L::none_of::<NOT_FROM_CAMERA>(z_flags), self.camera, before);
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
