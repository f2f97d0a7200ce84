//! Bit packing of segments: 16-bit grid positions, octahedral directions, shared-exponent throughput, flags.

use glam::{Vec2, Vec3};

use crate::Lobe;

/// Highest receiver number that fits into the flags, plus one.
pub const RECEIVER_LIMIT: u16 = 1 << 11;

/// Steps of the position grid along each axis.
const GRID_STEPS: f32 = 65535.0;

/// The 16 flag bits of a record.
///
/// Bit 0: the segment continues the ray of the one before. Bit 1: the segment escapes. Bits 2-4: code of the lobe, or 7: with bit 0
/// an origin record (not a segment: the vertex that the next segment starts from), without it a camera segment that is neither the
/// first record of its path nor continues another. Bits 5-15: receiver.
///
/// The first record of a path needs no bit: it is an origin record, or else the camera's segment, with 0 in
/// [`Flags::NOT_FROM_CAMERA`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flags(pub u16);

/// Place that a segment starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Start {
    /// Position of the camera: the first record of a path.
    Camera,
    /// End of the record before.
    Vertex,
    /// End of the record before, whose ray it continues.
    Ray,
}

impl Flags {
    /// Bits of which a segment that starts at the camera's position has none, and every other record some.
    pub const NOT_FROM_CAMERA: u16 = 0b1_1101;

    /// Code of origin records, and of camera segments behind them.
    const AT_ORIGIN: u16 = 7;
    /// Bit 0 and the code of an origin record.
    const ORIGIN: u16 = 1 | Self::AT_ORIGIN << 2;

    /// Flags of a segment. Only one with [`Lobe::Camera`] can start at the camera.
    pub(crate) fn segment(start: Start, escaped: bool, lobe: Lobe, receiver: u16) -> Self {
        let code = match (start, lobe) {
            (Start::Vertex, Lobe::Camera) => Self::AT_ORIGIN,
            _ => lobe as u16,
        };
        Self(u16::from(start == Start::Ray) | u16::from(escaped) << 1 | code << 2 | receiver << 5)
    }

    /// Flags of an origin record.
    pub(crate) fn origin() -> Self {
        Self(Self::ORIGIN)
    }

    /// True if this is the first record of a path.
    pub fn path_start(self) -> bool {
        self.starts_at_camera() || self.is_origin()
    }

    /// True if this is a segment that starts at the camera's position, not at the end of the record before.
    pub fn starts_at_camera(self) -> bool {
        self.0 & Self::NOT_FROM_CAMERA == 0
    }

    /// True if the segment continues the ray of the one before ([`crate::Segment::continues`]).
    pub fn continues(self) -> bool {
        self.0 & 1 != 0 && !self.is_origin()
    }

    /// True if the segment leaves the scene; `position_xy` then holds an octahedral direction.
    pub fn escaped(self) -> bool {
        self.0 & 2 != 0
    }

    /// True if this is an origin record.
    pub fn is_origin(self) -> bool {
        self.0 & Self::ORIGIN == Self::ORIGIN
    }

    /// The lobe of a segment; none for origin records.
    pub fn lobe(self) -> Option<Lobe> {
        match self.0 >> 2 & 7 {
            Self::AT_ORIGIN => (!self.is_origin()).then_some(Lobe::Camera),
            code => Lobe::ALL.get(usize::from(code)).copied(),
        }
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
        for (start, escaped, lobe) in [Start::Camera, Start::Vertex, Start::Ray]
            .into_iter()
            .flat_map(|start| [false, true].map(|escaped| (start, escaped)))
            .flat_map(|(start, escaped)| Lobe::ALL.map(|lobe| (start, escaped, lobe)))
            .filter(|&(start, _, lobe)| start != Start::Camera || lobe == Lobe::Camera)
        {
            let flags = Flags::segment(start, escaped, lobe, RECEIVER_LIMIT - 1);
            assert_eq!((flags.lobe(), flags.receiver()), (Some(lobe), RECEIVER_LIMIT - 1));
            let from_camera = start == Start::Camera;
            assert_eq!((flags.path_start(), flags.starts_at_camera()), (from_camera, from_camera));
            assert_eq!((flags.escaped(), flags.continues()), (escaped, start == Start::Ray));
            assert!(!flags.is_origin());
        }
        let origin = Flags::origin();
        assert!(
            origin.is_origin() && origin.path_start() && !origin.starts_at_camera() && !origin.continues()
        );
        assert_eq!(origin.lobe(), None);
    }
}
