//! First test of segments on processors with AVX-512, in place of [`crate::cull_avx2`]: which come within a ball around the light, sixteen
//! packed records at a time and in registers only, for one light. It leaves hardly more than what really comes near, so that
//! the gather of one light costs this test alone.

use std::arch::x86_64::*;
use std::ops::Range;

use glam::Vec3;
use relume_dump::{Flags, Shard};

use crate::light::{Ball, FAR, Reach};

/// Records at a time, and room that [`BallCull::run`] needs behind as many numbers as it has records.
pub const WIDTH: usize = 16;
/// Number of records between the one tested and the one prefetched.
const AHEAD: usize = 256;
/// Bound of the rounding of squared distances and their differences, relative to the largest one.
const ROUNDING: f32 = 1.5e-6;
/// Bound of the rounding of the Gram determinant in [`BallRegisters::near`], relative to the product of the squared distances.
const GRAM_SLACK: f32 = 4e-6;
/// Bound of the rounding of positions and directions in [`BallRegisters::ends`], relative to the largest distance.
const PLACING: f32 = 4e-5;
/// A float whose low 16 bits are an integer: or them in, and the sum is exact.
const WHOLE: f32 = 8_388_608.0;

/// A ball that holds all that a light reaches, in the coordinates of a shard.
#[derive(Debug)]
pub struct BallCull {
    step: Vec3,
    /// Lower corner of the position grid and camera, seen from the centre.
    min: Vec3,
    camera: Vec3,
    radius2: f32,
}

impl BallCull {
    /// A ball around what a light reaches, widened by `slack` metres; `None` for a sun, which is everywhere.
    pub fn new(shard: &Shard, reach: &Reach, slack: f32) -> Option<Self> {
        let Ball { center, radius } = reach.ball()?;
        let grid = shard.grid();
        let (min, max, camera) = (grid.min - center, grid.max - center, shard.camera_position() - center);
        let farthest = min.abs().max(max.abs()).max(camera.abs()).length();
        let radius = radius * 1.000_01 + slack + PLACING * farthest;
        let largest2 = farthest * farthest + radius * radius;
        Some(Self { step: grid.step(), min, camera, radius2: radius * radius + ROUNDING * largest2 })
    }

    /// Writes the numbers of those of the `records`, which start with a path or follow the ones before, that may touch the
    /// ball to `found`, and returns how many these are. `found` has to be longer than `records` by [`WIDTH`].
    #[target_feature(enable = "avx512f,popcnt,bmi1")]
    pub fn run(&self, shard: &Shard, records: Range<usize>, found: &mut [u32]) -> usize {
        let registers = self.registers();
        let (xy, z_flags) = (shard.position_xy(), shard.position_z_flags());
        // The first record of all starts a path, so that what stands for its predecessor is not used.
        let before = records.start.saturating_sub(1);
        let mut last = registers.ends(&[xy[before]; WIDTH], &[z_flags[before]; WIDTH]);
        let (xy_whole, xy_rest) = xy[records.clone()].as_chunks::<WIDTH>();
        let (z_whole, z_rest) = z_flags[records.clone()].as_chunks::<WIDTH>();
        let mut count = 0;
        let mut keep = |first: usize, bits: __mmask16| {
            // Small lights leave most groups without any.
            if bits != 0 {
                let room = found[count..].first_chunk_mut().expect("room behind the records");
                count += write_set_lanes(bits, first as u32, room);
            }
        };
        for (group, (xy, z_flags)) in xy_whole.iter().zip(z_whole).enumerate() {
            prefetch(xy, AHEAD);
            prefetch(z_flags, AHEAD);
            let ends = registers.ends(xy, z_flags);
            keep(records.start + group * WIDTH, registers.near(&last, &ends));
            last = ends;
        }
        if !xy_rest.is_empty() {
            let [mut xy, mut z_flags] = [[0; WIDTH]; 2];
            xy[..xy_rest.len()].copy_from_slice(xy_rest);
            z_flags[..z_rest.len()].copy_from_slice(z_rest);
            let bits = registers.near(&last, &registers.ends(&xy, &z_flags));
            keep(records.end - xy_rest.len(), bits & ((1 << xy_rest.len()) - 1));
        }
        count
    }

    #[target_feature(enable = "avx512f")]
    fn registers(&self) -> BallRegisters {
        let splat = |v: Vec3| [_mm512_set1_ps(v.x), _mm512_set1_ps(v.y), _mm512_set1_ps(v.z)];
        BallRegisters {
            step: splat(self.step),
            offset: splat(self.min - self.step * WHOLE),
            camera: splat(self.camera),
            camera_distance2: _mm512_set1_ps(self.camera.length_squared()),
            radius2: _mm512_set1_ps(self.radius2),
        }
    }
}

/// [`BallCull`] in registers.
struct BallRegisters {
    step: [__m512; 3],
    /// Place of grid coordinates of minus [`WHOLE`].
    offset: [__m512; 3],
    camera: [__m512; 3],
    camera_distance2: __m512,
    radius2: __m512,
}

/// Ends of sixteen segments, seen from the centre of the ball; those of escapes are about [`FAR`] away.
struct EndLanes {
    place: [__m512; 3],
    /// Squared distances.
    distance2: __m512,
    /// Lanes whose segment starts at the end of the one before, not at the camera.
    joined: __mmask16,
}

impl BallRegisters {
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn ends(&self, xy: &[u32; WIDTH], z_flags: &[u32; WIDTH]) -> EndLanes {
        /// Bits of the flags in `position_z_flags`.
        const NOT_FROM_CAMERA: i32 = (Flags::NOT_FROM_CAMERA as i32) << 16;
        const ESCAPED: i32 = 1 << 17;
        // SAFETY: 64 bytes are read from arrays of sixteen words.
        let (xy, z_flags) =
            unsafe { (_mm512_loadu_si512(xy.as_ptr().cast()), _mm512_loadu_si512(z_flags.as_ptr().cast())) };
        let whole = _mm512_castps_si512(_mm512_set1_ps(WHOLE));
        let low = |words| {
            /// `(words & 0xffff) | whole`.
            const AND_OR: i32 = 0b1110_1010;
            let mask = _mm512_set1_epi32(0xffff);
            _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<AND_OR>(words, mask, whole))
        };
        let high = _mm512_castsi512_ps(_mm512_or_si512(_mm512_srli_epi32::<16>(xy), whole));
        let (x, y, z) = (low(xy), high, low(z_flags));
        let escaped = _mm512_test_epi32_mask(z_flags, _mm512_set1_epi32(ESCAPED));
        let far = octahedral(x, y);
        let at = |axis: usize, v| {
            let vertex = _mm512_fmadd_ps(v, self.step[axis], self.offset[axis]);
            _mm512_mask_mov_ps(vertex, escaped, far[axis])
        };
        let place = [at(0, x), at(1, y), at(2, z)];
        let joined = _mm512_test_epi32_mask(z_flags, _mm512_set1_epi32(NOT_FROM_CAMERA));
        EndLanes { place, distance2: dot(&place, &place), joined }
    }

    /// Bits of the segments that may come within the ball; `before` holds the end of the record before in its last lane.
    ///
    /// Given the squared distances `a` and `b` of both ends from the centre and their dot product `c`, seen from there,
    /// the line through them passes the centre at the squared distance `(a b - c^2) / (a + b - 2 c)`, between them
    /// where `c` is below both `a` and `b`.
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn near(&self, before: &EndLanes, ends: &EndLanes) -> __mmask16 {
        // The lane before, out of the sixteen before for the first.
        let origin = |camera, end, before| {
            _mm512_castsi512_ps(_mm512_mask_alignr_epi32::<15>(
                _mm512_castps_si512(camera),
                ends.joined,
                _mm512_castps_si512(end),
                _mm512_castps_si512(before),
            ))
        };
        let place = |axis: usize| origin(self.camera[axis], ends.place[axis], before.place[axis]);
        let (a, b) = (origin(self.camera_distance2, ends.distance2, before.distance2), ends.distance2);
        let c = dot(&[place(0), place(1), place(2)], &ends.place);
        let nearer = _mm512_min_ps(a, b);
        let length2 = _mm512_fnmadd_ps(_mm512_set1_ps(2.0), c, _mm512_add_ps(a, b));
        let gram =
            _mm512_fmsub_ps(_mm512_mul_ps(a, b), _mm512_set1_ps(1.0 - GRAM_SLACK), _mm512_mul_ps(c, c));
        // Not a number, where squares overflow, may be anything: it counts as near.
        let at_an_end = _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(nearer, self.radius2);
        let passes = _mm512_cmp_ps_mask::<_CMP_NGE_UQ>(c, nearer);
        let between =
            _mm512_mask_cmp_ps_mask::<_CMP_NGT_UQ>(passes, gram, _mm512_mul_ps(self.radius2, length2));
        at_an_end | between
    }
}

/// [`write_set_bits`](crate::kept::write_set_bits) of sixteen bits: the numbers are compressed in a register, then written all.
#[inline]
#[target_feature(enable = "avx512f,popcnt")]
fn write_set_lanes(bits: __mmask16, first: u32, room: &mut [u32; WIDTH]) -> usize {
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let numbers = _mm512_add_epi32(_mm512_set1_epi32(first as i32), lanes);
    let kept = _mm512_maskz_compress_epi32(bits, numbers);
    // SAFETY: 64 bytes are written to an array of sixteen words.
    unsafe { _mm512_storeu_si512(room.as_mut_ptr().cast(), kept) };
    bits.count_ones() as usize
}

#[inline]
#[target_feature(enable = "avx512f")]
fn dot(a: &[__m512; 3], b: &[__m512; 3]) -> __m512 {
    _mm512_fmadd_ps(a[2], b[2], _mm512_fmadd_ps(a[1], b[1], _mm512_mul_ps(a[0], b[0])))
}

/// Hints that `words[index]`, if there is such a word, will be read soon.
#[inline]
fn prefetch(words: &[u32], index: usize) {
    // SAFETY: a prefetch of any address is allowed, so the pointer may leave its array.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(words.as_ptr().wrapping_add(index).cast()) }
}

/// The direction that [`relume_dump::decode_direction`] gives for two halves, each plus [`WHOLE`], [`FAR`] times and before it
/// is normalised.
#[inline]
#[target_feature(enable = "avx512f")]
fn octahedral(low: __m512, high: __m512) -> [__m512; 3] {
    const SCALE: f32 = FAR * 2.0 / 65535.0;
    let (far, scale, offset) =
        (_mm512_set1_ps(FAR), _mm512_set1_ps(SCALE), _mm512_set1_ps(FAR + WHOLE * SCALE));
    let (u, v) = (_mm512_fmsub_ps(low, scale, offset), _mm512_fmsub_ps(high, scale, offset));
    let z = _mm512_sub_ps(_mm512_sub_ps(far, _mm512_abs_ps(u)), _mm512_abs_ps(v));
    let fold = _mm512_castps_si512(_mm512_min_ps(z, _mm512_setzero_ps()));
    let folded = |w| {
        /// `fold ^ (w & sign)`.
        const XOR_AND: i32 = 0b0111_1000;
        let (sign, bits) = (_mm512_set1_epi32(i32::MIN), _mm512_castps_si512(w));
        _mm512_add_ps(w, _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<XOR_AND>(fold, bits, sign)))
    };
    [folded(u), folded(v), z]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;
    use relume_dump::{End, Lobe};

    use super::*;
    use crate::kept::{masks_for_tests, set_bits_one_by_one};
    use crate::tests::{Random, dump, manifest, segment};

    /// A shard of 4 x 4 pixels with paths of up to six segments in a box around `center`, some far shorter than others.
    fn shard(center: Vec3, extent: f32) -> Arc<Shard> {
        let mut random = Random(8);
        let dump = dump(manifest(4, &[32]), |_, _, samples| {
            let mut last = center;
            for depth in 0..1 + (random.next() * 6.0) as usize {
                let lobe = if depth == 0 { Lobe::Camera } else { Lobe::Diffuse };
                if random.next() < 0.2 {
                    samples.push(segment(End::Escape(random.point(1.0).normalize()), lobe));
                    return;
                }
                let length = if random.next() < 0.3 { 1e-3 } else { 1.0 };
                last = last.lerp(center + random.point(extent), length);
                samples.push(segment(End::Vertex(last), lobe));
            }
        });
        dump.shards().next().unwrap().clone()
    }

    /// Squared distance of a segment from a point, and of its line, its squared length, and those of its ends from the point,
    /// multiplied.
    fn distances2(shard: &Shard, record: usize, point: Vec3) -> [f64; 4] {
        let segment = shard.segment(record).unwrap();
        let edge: DVec3 = match segment.end {
            End::Vertex(vertex) => vertex.as_dvec3() - segment.origin.as_dvec3(),
            End::Escape(direction) => direction.as_dvec3() * 1e8,
        };
        let to_point = point.as_dvec3() - segment.origin.as_dvec3();
        let share = to_point.dot(edge) / edge.length_squared().max(1e-300);
        let at = |share: f64| (to_point - edge * share).length_squared();
        [at(share.clamp(0.0, 1.0)), at(share), edge.length_squared(), at(0.0) * at(1.0)]
    }

    #[test]
    fn set_bits_by_compression_are_those_one_by_one() {
        if !is_x86_feature_detected!("avx512f") {
            println!("skipped: no AVX-512");
            return;
        }
        for (i, bits) in masks_for_tests().into_iter().enumerate() {
            let (bits, first) = (bits as u16, i as u32 * 8191);
            let mut room = [u32::MAX; WIDTH];
            // SAFETY: AVX-512 has been detected, and with it goes the rest.
            let count = unsafe { write_set_lanes(bits, first, &mut room) };
            assert_eq!(room[..count], set_bits_one_by_one(u32::from(bits), first), "{bits:#x}");
        }
    }

    #[test]
    fn what_comes_near_is_found_and_little_else() {
        if !is_x86_feature_detected!("avx512f") {
            println!("skipped: no AVX-512");
            return;
        }
        let mut random = Random(9);
        let (mut near, mut left_out, mut tested) = (0, 0, 0);
        for (center, extent) in [(Vec3::ZERO, 4.0), (Vec3::new(300.0, -20.0, 5.0), 2.0), (Vec3::Y, 1e4)] {
            let shard = shard(center, extent);
            for (share, offset) in [(1e-4, 1.0), (0.01, 1.0), (0.1, 0.5), (0.5, 0.7), (0.01, 30.0)] {
                let ball = Ball { center: center + random.point(extent * offset), radius: extent * share };
                let magnitude = center.abs().max_element() + extent * (1.0 + offset) + 5.0;
                let cull = BallCull::new(&shard, &Reach::Ball(ball), 4e-6 * magnitude).unwrap();
                let mut found = vec![0; shard.record_count() + WIDTH];
                let mut numbers = Vec::new();
                // In chunks that are not multiples of the width.
                for first in (0..shard.record_count()).step_by(100) {
                    let chunk = first..shard.record_count().min(first + 100);
                    // SAFETY: AVX-512 has been detected, and with it goes the rest.
                    let count = unsafe { cull.run(&shard, chunk, &mut found) };
                    numbers.extend_from_slice(&found[..count]);
                }
                let radius = f64::from(ball.radius);
                let largest2 = 12.0 * f64::from(magnitude).powi(2);
                for record in 0..shard.record_count() {
                    let [segment2, line2, length2, ends2] = distances2(&shard, record, ball.center);
                    let is_found = numbers.binary_search(&(record as u32)).is_ok();
                    assert!(is_found || segment2 > radius * radius, "{record}: {segment2} {ball:?}");
                    // Of very short segments far away, single precision cannot tell the direction.
                    let loose2 = (radius + 2e-3 * largest2.sqrt()).powi(2) + 1e-5 * ends2 / length2;
                    assert!(!is_found || line2 < loose2, "{record}: {line2} {length2} {ball:?}");
                    near += usize::from(segment2 <= radius * radius);
                    left_out += usize::from(!is_found);
                    tested += 1;
                }
            }
        }
        assert!(near > 500 && left_out > tested / 2, "{near} near and {left_out} left out of {tested}");
    }
}
