//! Bit packing of segments: 16-bit grid positions, octahedral directions, shared-exponent throughput, flags.

use glam::{Vec2, Vec3};

use crate::Lobe;

/// Highest receiver number that fits into the flags, plus one.
pub const RECEIVER_LIMIT: u16 = 1 << 11;

/// Steps of the position grid along each axis.
const GRID_STEPS: f32 = 65535.0;

/// The 16 flag bits of a record.
///
/// Bit 0: first record of a path. Bit 1: the segment escapes. Bits 2-4: lobe, 7 for an origin record (not a
/// segment: it carries the vertex that the next segment starts from). Bits 5-15: receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flags(pub u16);

impl Flags {
    const ORIGIN: u16 = 7;

    /// Flags of a segment.
    pub fn segment(path_start: bool, escaped: bool, lobe: Lobe, receiver: u16) -> Self {
        Self(u16::from(path_start) | u16::from(escaped) << 1 | (lobe as u16) << 2 | receiver << 5)
    }

    /// Flags of an origin record.
    pub fn origin(path_start: bool) -> Self {
        Self(u16::from(path_start) | Self::ORIGIN << 2)
    }

    /// True if this is the first record of a path.
    pub fn path_start(self) -> bool {
        self.0 & 1 != 0
    }

    /// True if the segment leaves the scene; `position_xy` then holds an octahedral direction.
    pub fn escaped(self) -> bool {
        self.0 & 2 != 0
    }

    /// True if this is an origin record.
    pub fn is_origin(self) -> bool {
        self.lobe_code() == Self::ORIGIN
    }

    /// The lobe bits as they are.
    pub fn lobe_code(self) -> u16 {
        self.0 >> 2 & 7
    }

    /// The lobe of a segment; none for origin records and illegal codes.
    pub fn lobe(self) -> Option<Lobe> {
        Lobe::ALL.get(self.lobe_code() as usize).copied()
    }

    /// Receiver number.
    pub fn receiver(self) -> u16 {
        self.0 >> 5
    }
}

/// Maps 16-bit grid coordinates to world space and back. The error is at most half a step: 1/131070 of the
/// box's extent along each axis, plus float rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Lower corner of the box, metres.
    pub min: Vec3,
    /// Upper corner of the box, metres.
    pub max: Vec3,
}

impl Grid {
    /// World-space size of one step along each axis.
    pub fn step(&self) -> Vec3 {
        (self.max - self.min) / GRID_STEPS
    }

    /// Nearest grid coordinates of a point inside the box.
    pub fn encode(&self, point: Vec3) -> [u16; 3] {
        // `max` turns the NaN of an axis without extent into 0.
        let scaled = ((point - self.min) / (self.max - self.min) * GRID_STEPS).max(Vec3::ZERO);
        scaled.to_array().map(|v| (v + 0.5).min(GRID_STEPS) as u16)
    }

    /// World-space point of grid coordinates.
    pub fn decode(&self, grid: [u16; 3]) -> Vec3 {
        Vec3::from(grid.map(f32::from)) * self.step() + self.min
    }
}

/// Octahedral map of a unit direction to 2 x 16 bits (x in the low half); the angular error is below 1e-4.
/// Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014.
pub fn encode_direction(direction: Vec3) -> u32 {
    let n = direction / (direction.x.abs() + direction.y.abs() + direction.z.abs());
    let folded = Vec2::new((1.0 - n.y.abs()).copysign(n.x), (1.0 - n.x.abs()).copysign(n.y));
    let uv = if n.z >= 0.0 { Vec2::new(n.x, n.y) } else { folded };
    let quantised = (uv * 0.5 + 0.5).clamp(Vec2::ZERO, Vec2::ONE) * 65535.0 + 0.5;
    quantised.x as u32 | (quantised.y as u32) << 16
}

/// Inverse of [`encode_direction`]; unit length.
pub fn decode_direction(bits: u32) -> Vec3 {
    let u = (bits & 0xffff) as f32 * (2.0 / 65535.0) - 1.0;
    let v = (bits >> 16) as f32 * (2.0 / 65535.0) - 1.0;
    let z = 1.0 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    // Never zero: |x| + |y| + |z| = 1 before normalisation.
    let direction = Vec3::new(u - fold.copysign(u), v - fold.copysign(v), z);
    direction / direction.length()
}

/// Largest value of a channel in rgb9e5.
pub const RGB9E5_MAX: f32 = 65408.0;

/// Packs non-negative RGB into 9-bit mantissas with a shared 5-bit exponent (Vulkan specification, "Shared
/// Exponent to RGB"), but rounded up or down at random, with `dither` values in 0..1, so that the expected value
/// is exact: nearest rounding would shift the small channels of saturated colours by several percent on
/// every path alike. Values above [`RGB9E5_MAX`] are clamped, negative ones and NaN become 0.
pub fn encode_rgb9e5(rgb: Vec3, dither: Vec3) -> u32 {
    let rgb = rgb.max(Vec3::ZERO).min(Vec3::splat(RGB9E5_MAX));
    let largest = rgb.max_element();
    // Exponent of the largest channel from its bits, at least -16 (denormals of the format); one more if dithering
    // could round that channel up to 512.
    let floor_log2 = ((largest.to_bits() >> 23) as i32 - 127).max(-16);
    let mut exponent = floor_log2 + 1;
    if exponent < 16 && largest * scale_to_mantissa(exponent) > 511.0 {
        exponent += 1;
    }
    let mantissas = rgb * scale_to_mantissa(exponent) + dither;
    let [r, g, b] = mantissas.to_array().map(|mantissa| (mantissa as u32).min(511));
    r | g << 9 | b << 18 | ((exponent + 15) as u32) << 27
}

/// Inverse of [`encode_rgb9e5`]: always finite.
pub fn decode_rgb9e5(bits: u32) -> Vec3 {
    // mantissa * 2^(e - 15 - 9); the float with exponent bits e - 24 + 127 is that power of two.
    let scale = f32::from_bits(((bits >> 27) + 103) << 23);
    let [r, g, b] = [bits & 511, bits >> 9 & 511, bits >> 18 & 511].map(|v| v as f32);
    Vec3::new(r, g, b) * scale
}

/// `2^(9 - exponent)`: what takes a channel to its 9-bit mantissa.
fn scale_to_mantissa(exponent: i32) -> f32 {
    f32::from_bits(((127 + 9 - exponent) as u32) << 23)
}

/// Three values in 0..1 from a counter: fixed for a seed, whatever the thread. PCG3D of Jarzynski and Olano,
/// "Hash Functions for GPU Rendering", JCGT 2020.
pub fn dither(seed: u32, index: u32) -> Vec3 {
    let mut v =
        [seed, index, seed ^ 0x9e37_79b9].map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    for _ in 0..2 {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v = v.map(|x| x ^ x >> 16);
    }
    Vec3::from(v.map(|x| (x >> 8) as f32 * (1.0 / 16_777_216.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random_points(count: u32) -> impl Iterator<Item = Vec3> {
        (0..count).map(|i| dither(7, i))
    }

    #[test]
    fn grid_error_is_at_most_half_a_step() {
        let grid = Grid { min: Vec3::new(-3.0, 100.0, -0.5), max: Vec3::new(17.0, 130.0, -0.5 + 1e-3) };
        let extent = grid.max - grid.min;
        for u in random_points(100_000) {
            let point = grid.min + u * extent;
            let error = (grid.decode(grid.encode(point)) - point).abs() / extent;
            assert!(error.max_element() < 1.0 / 30_000.0, "{point} {error}");
            // Half a step and the rounding of a float near 130 (1.5e-5 m of 30 m).
            assert!(error.x < 1.01 / 131_070.0 && error.y < 1.1 / 131_070.0, "{point} {error}");
        }
    }

    #[test]
    fn grid_without_extent_returns_its_corner() {
        let grid = Grid { min: Vec3::splat(2.0), max: Vec3::splat(2.0) };
        assert_eq!(grid.decode(grid.encode(Vec3::splat(2.0))), Vec3::splat(2.0));
    }

    #[test]
    fn directions_return_within_1e_4_radians() {
        for u in random_points(100_000) {
            let (z, phi) = (2.0 * u.x - 1.0, std::f32::consts::TAU * u.y);
            let r = (1.0 - z * z).max(0.0).sqrt();
            let direction = Vec3::new(r * phi.cos(), r * phi.sin(), z);
            let decoded = decode_direction(encode_direction(direction));
            assert!((decoded - direction).length() < 1e-4, "{direction} {decoded}");
        }
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert!((decode_direction(encode_direction(axis)) - axis).length() < 1e-4);
        }
        for bits in [0, u32::MAX, 0xffff, 0xffff_0000, 0x8000_7fff] {
            assert!((decode_direction(bits).length() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn rgb9e5_is_exact_on_average_and_close_each_time() {
        for rgb in [
            Vec3::new(0.8, 0.0102, 0.031),
            Vec3::new(1.0, 0.99, 3e-3),
            Vec3::splat(0.9999),
            Vec3::new(900.3, 1.0, 7.7),
        ] {
            let count = 200_000;
            let mut mean = glam::DVec3::ZERO;
            for i in 0..count {
                let decoded = decode_rgb9e5(encode_rgb9e5(rgb, dither(1, i)));
                assert!(
                    ((decoded - rgb).abs() / rgb.max_element()).max_element() < 1.0 / 255.0,
                    "{rgb} {decoded}"
                );
                mean += decoded.as_dvec3() / f64::from(count);
            }
            // Standard error of the mean: below half a step / sqrt(count), a step being at most 1/256 of the largest.
            let tolerance = 5.0 * f64::from(rgb.max_element()) / 512.0 / f64::from(count).sqrt();
            assert!((mean - rgb.as_dvec3()).abs().max_element() < tolerance, "{rgb} {mean}");
        }
    }

    #[test]
    fn rgb9e5_keeps_representable_values_and_survives_bad_ones() {
        for value in [0.0, 1.0, 0.5, 0.25, 2.0, 1.0 / 1024.0, RGB9E5_MAX] {
            assert_eq!(
                decode_rgb9e5(encode_rgb9e5(Vec3::splat(value), Vec3::splat(0.999))),
                Vec3::splat(value)
            );
        }
        let bad = Vec3::new(f32::NAN, -1.0, f32::INFINITY);
        assert_eq!(decode_rgb9e5(encode_rgb9e5(bad, Vec3::ZERO)), Vec3::new(0.0, 0.0, RGB9E5_MAX));
        for bits in [0, u32::MAX, 1 << 27, 31 << 27 | 511] {
            assert!(decode_rgb9e5(bits).is_finite());
        }
    }

    #[test]
    fn flags_keep_their_fields() {
        let flags = Flags::segment(true, false, Lobe::Volume, RECEIVER_LIMIT - 1);
        assert!(flags.path_start() && !flags.escaped() && !flags.is_origin());
        assert_eq!((flags.lobe(), flags.receiver()), (Some(Lobe::Volume), RECEIVER_LIMIT - 1));
        assert!(Flags::origin(false).is_origin());
        assert_eq!(Flags::origin(true).lobe(), None);
        assert_eq!(Flags(5 << 2).lobe(), None);
    }
}
