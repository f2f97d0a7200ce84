//! A first test on packed records, for one light at a time: segments that lie on the outer side of a face of the light's
//! bounding box are left out. It works on the 16-bit grid coordinates as they are stored, about one cycle a record, so that
//! the gather of one light is bound by memory.

use std::arch::x86_64::*;

use glam::{DVec3, Vec3};
use relume_dump::{Flags, Shard};

use crate::kept::{ROOM, write_set_bits};
use crate::light::{Plane, Reach};

/// Records that are tested at a time.
pub const CHUNK: usize = 8192;
/// Number of records between the one tested and the one prefetched.
const AHEAD: usize = 1024;
/// Bytes in front of the codes, of which the last is that of the record before the chunk.
const LEAD: usize = 32;
/// Code bit: the segment starts at the camera; the bit that byte blends look at.
const START: u8 = 0x80;
/// Code bits: beyond the upper faces in x, y, z (1, 2, 4) and the lower ones (8, 16, 32).
const SIDES: u8 = 0x3f;

/// A box on the grid of a shard.
#[derive(Debug)]
pub struct BoxCull {
    /// Coordinates from here on are beyond the upper face.
    above: [u16; 3],
    /// Coordinates up to here are beyond the lower face.
    below: [u16; 3],
    /// Sides that can be judged: the others lie outside the range of coordinates.
    judged: u8,
    /// Code of where the camera is.
    camera: u8,
}

/// Working memory.
#[derive(Debug)]
pub struct CullWork {
    /// After [`LEAD`], a code for each record.
    codes: Box<[u8; LEAD + CHUNK]>,
    /// Numbers of records, and room for what is written too much.
    pub found: Box<[u32; CHUNK + ROOM]>,
}

impl Default for CullWork {
    fn default() -> Self {
        Self { codes: Box::new([0; LEAD + CHUNK]), found: Box::new([0; CHUNK + ROOM]) }
    }
}

impl BoxCull {
    /// A box around what a light reaches, widened by `slack` metres; `None` for what is everywhere, as suns.
    pub fn new(shard: &Shard, reach: &Reach, slack: f32) -> Option<Self> {
        let around = |plane: &Plane| {
            let half_edge = |inverse: Vec3| 0.5 * inverse.abs() / inverse.length_squared();
            half_edge(plane.inverse_u) + half_edge(plane.inverse_v)
        };
        let (center, half) = match reach {
            Reach::Ball(ball) => (ball.center, Vec3::splat(ball.radius)),
            Reach::Plane(plane) => (plane.center, around(plane)),
            Reach::Slab { plane, ends } => (plane.center, around(plane) + Vec3::splat(*ends)),
            Reach::Cone { .. } | Reach::Everywhere => return None,
        };
        let half = half.as_dvec3() * 1.001 + f64::from(slack);
        let (center, grid) = (center.as_dvec3(), shard.grid());
        // Two steps more for the rounding of coordinates.
        let on_grid = |point: DVec3| (point - grid.min.as_dvec3()) / grid.step().as_dvec3();
        let upper = on_grid(center + half).to_array().map(|v| v.ceil() + 2.0);
        let lower = on_grid(center - half).to_array().map(|v| v.floor() - 2.0);
        let camera = shard.camera_position().as_dvec3();
        let camera_above = camera.cmpgt(center + half).bitmask() as u8;
        let camera_below = camera.cmplt(center - half).bitmask() as u8;
        let mut cull =
            Self { above: [0; 3], below: [0; 3], judged: 0, camera: camera_above | camera_below << 3 };
        for axis in 0..3 {
            // Escapes stand at 0 or 65535, whichever side they go to, so these must not be judged by place.
            // Comparisons with NaN, of an axis without extent, judge nothing.
            if upper[axis] <= 65535.0 {
                cull.above[axis] = upper[axis].max(1.0) as u16;
                cull.judged |= 1 << axis;
            }
            if lower[axis] >= 0.0 {
                cull.below[axis] = lower[axis].min(65534.0) as u16;
                cull.judged |= 8 << axis;
            }
        }
        Some(cull)
    }

    /// The code of one record.
    fn code(&self, xy: u32, z_flags: u32) -> u8 {
        let flags = Flags((z_flags >> 16) as u16);
        let escaped = flags.escaped();
        // An escape goes on for ever in the direction that the sign of its octahedral coordinate says.
        let far = |v: u16| {
            if !escaped {
                v
            } else if v >= 0x8000 {
                u16::MAX
            } else {
                0
            }
        };
        let coordinates = [far(xy as u16), far((xy >> 16) as u16), z_flags as u16];
        let mut code = 0;
        for (axis, coordinate) in coordinates.into_iter().enumerate().take(if escaped { 2 } else { 3 }) {
            code |= u8::from(coordinate >= self.above[axis]) << axis;
            code |= u8::from(coordinate <= self.below[axis]) << (axis + 3);
        }
        code & self.judged | if flags.starts_at_camera() { START } else { 0 }
    }

    /// Writes the numbers of the records, at most [`CHUNK`], that may touch the box, plus `first`, to [`CullWork::found`] and
    /// returns how many these are. `continues` says that the chunk follows the one that `work` was last used for.
    #[target_feature(enable = "avx2,popcnt,bmi1")]
    pub fn run(
        &self,
        xy: &[u32],
        z_flags: &[u32],
        first: u32,
        continues: bool,
        work: &mut CullWork,
    ) -> usize {
        let len = xy.len().min(z_flags.len()).min(CHUNK);
        let codes = work.codes.as_mut_slice();
        // A range starts with a path, whose predecessor is not looked at.
        codes[LEAD - 1] = if continues { codes[LEAD + CHUNK - 1] } else { 0 };
        self.encode(&xy[..len], &z_flags[..len], &mut codes[LEAD..LEAD + len]);
        let mut count = 0;
        for start in (0..len).step_by(32) {
            let mut bits = self.touching(&codes[LEAD - 1 + start..][..33]);
            if len - start < 32 {
                bits &= (1 << (len - start)) - 1;
            }
            // Small lights leave most groups without any.
            if bits != 0 {
                let room = work.found[count..].first_chunk_mut().expect("room behind a chunk");
                count += write_set_bits(bits, first + start as u32, room);
            }
        }
        count
    }

    /// Bits of the 32 records after the first of 33 codes that may touch the box.
    #[target_feature(enable = "avx2")]
    fn touching(&self, codes: &[u8]) -> u32 {
        let codes: &[u8; 33] = codes.try_into().expect("33 codes");
        // SAFETY: 32 bytes are read from byte 0 and from byte 1 of 33.
        let (before, current) = unsafe {
            (_mm256_loadu_si256(codes.as_ptr().cast()), _mm256_loadu_si256(codes.as_ptr().add(1).cast()))
        };
        let origin = _mm256_blendv_epi8(before, _mm256_set1_epi8(self.camera as i8), current);
        let common = _mm256_and_si256(_mm256_and_si256(origin, current), _mm256_set1_epi8(SIDES as i8));
        _mm256_movemask_epi8(_mm256_cmpeq_epi8(common, _mm256_setzero_si256())) as u32
    }

    /// Codes of records.
    #[target_feature(enable = "avx2")]
    fn encode(&self, xy: &[u32], z_flags: &[u32], codes: &mut [u8]) {
        let registers = self.registers();
        let (xy_whole, xy_rest) = xy.as_chunks::<32>();
        let (z_whole, z_rest) = z_flags.as_chunks::<32>();
        let (codes_whole, codes_rest) = codes.as_chunks_mut::<32>();
        for ((xy, z_flags), codes) in xy_whole.iter().zip(z_whole).zip(codes_whole) {
            // A line of the cache has 16 words.
            for words in [xy, z_flags] {
                for ahead in [AHEAD, AHEAD + 16] {
                    _mm_prefetch::<_MM_HINT_T0>(words.as_ptr().wrapping_add(ahead).cast());
                }
            }
            let group = |i: usize| registers.group(&xy[i * 8..i * 8 + 8], &z_flags[i * 8..i * 8 + 8]);
            // Each group has the bits of a record in the halves of 32; adding them joins them.
            let join = |a, b| _mm256_maddubs_epi16(_mm256_packus_epi16(a, b), _mm256_set1_epi8(1));
            let packed = _mm256_packus_epi16(join(group(0), group(1)), join(group(2), group(3)));
            // Packing works on halves of the register: put the four records of each back in order.
            let order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
            let ordered = _mm256_permutevar8x32_epi32(packed, order);
            // SAFETY: 32 bytes are written to an array of 32.
            unsafe { _mm256_storeu_si256(codes.as_mut_ptr().cast(), ordered) };
        }
        for ((&xy, &z_flags), code) in xy_rest.iter().zip(z_rest).zip(codes_rest) {
            *code = self.code(xy, z_flags);
        }
    }

    #[target_feature(enable = "avx2")]
    fn registers(&self) -> BoxRegisters {
        let words = |low: u16, high: u16| _mm256_set1_epi32((u32::from(low) | u32::from(high) << 16) as i32);
        let bit = |side: u32| u16::from(self.judged & 1 << side);
        BoxRegisters {
            above_xy: words(self.above[0], self.above[1]),
            below_xy: words(self.below[0], self.below[1]),
            above_z: words(self.above[2], 0),
            below_z: words(self.below[2], 0),
            above_xy_bits: words(bit(0), bit(1)),
            below_xy_bits: words(bit(3), bit(4)),
            above_z_bits: words(bit(2), 0),
            below_z_bits: words(bit(5), 0),
        }
    }
}

/// [`BoxCull`] in registers.
struct BoxRegisters {
    above_xy: __m256i,
    below_xy: __m256i,
    above_z: __m256i,
    below_z: __m256i,
    above_xy_bits: __m256i,
    below_xy_bits: __m256i,
    above_z_bits: __m256i,
    below_z_bits: __m256i,
}

impl BoxRegisters {
    /// [`BoxCull::code`] of eight records, in words of 16 bits: the bits of x and z in the low half of 32, those of y and
    /// [`START`] in the high half.
    #[target_feature(enable = "avx2")]
    fn group(&self, xy: &[u32], z_flags: &[u32]) -> __m256i {
        /// Bit 1 of the flags.
        const ESCAPED: i32 = 1 << 17;
        let (xy, z_flags): (&[u32; 8], &[u32; 8]) =
            (xy.try_into().expect("eight words"), z_flags.try_into().expect("eight words"));
        // SAFETY: 32 bytes are read from arrays of eight words.
        let (xy, z) =
            unsafe { (_mm256_loadu_si256(xy.as_ptr().cast()), _mm256_loadu_si256(z_flags.as_ptr().cast())) };
        let escaped = _mm256_set1_epi32(ESCAPED);
        let escaped = _mm256_cmpeq_epi32(_mm256_and_si256(z, escaped), escaped);
        let place = _mm256_blendv_epi8(xy, _mm256_srai_epi16::<15>(xy), escaped);
        let at_least = |v, limit| _mm256_cmpeq_epi16(_mm256_max_epu16(v, limit), v);
        let at_most = |v, limit| _mm256_cmpeq_epi16(_mm256_min_epu16(v, limit), v);
        let above_xy = _mm256_and_si256(at_least(place, self.above_xy), self.above_xy_bits);
        let below_xy = _mm256_and_si256(at_most(place, self.below_xy), self.below_xy_bits);
        let above_z = _mm256_and_si256(at_least(z, self.above_z), self.above_z_bits);
        let below_z = _mm256_and_si256(at_most(z, self.below_z), self.below_z_bits);
        let z_sides = _mm256_andnot_si256(escaped, _mm256_or_si256(above_z, below_z));
        let not_from_camera = _mm256_set1_epi32(i32::from(Flags::NOT_FROM_CAMERA) << 16);
        let starts = _mm256_cmpeq_epi32(_mm256_and_si256(z, not_from_camera), _mm256_setzero_si256());
        let start = _mm256_and_si256(starts, _mm256_set1_epi32(i32::from(START) << 16));
        _mm256_or_si256(_mm256_or_si256(above_xy, below_xy), _mm256_or_si256(z_sides, start))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_at_a_time_give_the_codes_of_one_at_a_time() {
        if !is_x86_feature_detected!("avx2") {
            println!("skipped: no AVX2");
            return;
        }
        let mut state = 1u32;
        let mut words = || {
            (0..1000)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    state ^ state >> 15
                })
                .collect::<Vec<_>>()
        };
        let (xy, z_flags) = (words(), words());
        for judged in [SIDES, 0, 0b101_010, 0b000_111] {
            let cull =
                BoxCull { above: [1, 40_000, 65_535], below: [0, 20_000, 65_534], judged, camera: 0b1001 };
            let mut codes = vec![0; xy.len()];
            // SAFETY: AVX2 has been detected.
            unsafe { cull.encode(&xy, &z_flags, &mut codes) };
            let expected: Vec<_> = xy.iter().zip(&z_flags).map(|(&xy, &z)| cull.code(xy, z)).collect();
            assert_eq!(codes, expected);
        }
    }
}
