//! Gradient noise after Ken Perlin ("Improving Noise", 2002) with hashed gradients, scaled and repeated as in Cycles, and
//! sums of its octaves after F. Kenton Musgrave ("Texturing and Modeling: A Procedural Approach").

use glam::{Vec3, Vec4};
use relume_scene::NoiseKind;

use super::arrays::{add, lerp, scale};
use super::hash::{hash, random};

/// Factors that bring noise of one to four dimensions to about -1..1.
const AMPLITUDES: [f32; 4] = [0.25, 0.6616, 0.982, 0.8344];

/// Noise repeats after this many cells, so that floats keep enough digits within one.
const PERIOD: f32 = 100_000.0;

/// Combination of octaves.
#[derive(Clone, Copy, Debug)]
pub struct Octaves {
    pub kind: NoiseKind,
    pub normalize: bool,
    pub detail: f32,
    pub roughness: f32,
    pub lacunarity: f32,
    pub offset: f32,
    pub gain: f32,
}

impl Octaves {
    /// A sum in 0..1 whose octaves double in frequency.
    pub fn doubling(detail: f32, roughness: f32) -> Self {
        let (kind, normalize, lacunarity) = (NoiseKind::Fbm, true, 2.0);
        Self { kind, normalize, detail, roughness, lacunarity, offset: 0.0, gain: 1.0 }
    }
}

/// The Noise Texture node: colour and, in w, factor. Green and blue are left out unless `colored`.
pub fn texture<const N: usize>(at: [f32; N], octaves: &Octaves, distortion: f32, colored: bool) -> Vec4 {
    let mut at = at;
    if distortion != 0.0 {
        let shifts: [f32; N] = std::array::from_fn(|i| signed(add(at, shift(i))) * distortion);
        at = add(at, shifts);
    }
    let value = octaves.sum(at);
    if !colored {
        return Vec4::splat(value);
    }
    let (green, blue) = (octaves.sum(add(at, shift(N))), octaves.sum(add(at, shift(N + 1))));
    Vec3::new(value, green, blue).extend(value)
}

/// Offset from which the number `seed` of unrelated noises is taken.
#[inline(always)]
fn shift<const N: usize>(seed: usize) -> [f32; N] {
    let seed = seed as f32;
    std::array::from_fn(|i| 100.0 + 100.0 * if N == 1 { random([seed]) } else { random([seed, i as f32]) })
}

impl Octaves {
    /// All octaves at a point.
    pub fn sum<const N: usize>(&self, at: [f32; N]) -> f32 {
        match self.kind {
            NoiseKind::Fbm => self.fbm(at),
            NoiseKind::Multifractal => self.multifractal(at),
            NoiseKind::RidgedMultifractal => self.ridged_multifractal(at),
            NoiseKind::HybridMultifractal => self.hybrid_multifractal(at),
            NoiseKind::HeteroTerrain => self.hetero_terrain(at),
        }
    }

    /// Number of whole octaves after the first.
    fn whole(&self) -> u32 {
        self.detail as u32
    }

    /// The part of one more octave.
    fn remainder(&self) -> f32 {
        self.detail - self.detail.floor()
    }

    fn fbm<const N: usize>(&self, at: [f32; N]) -> f32 {
        let (mut sum, mut total, mut amplitude, mut frequency) = (0.0, 0.0, 1.0, 1.0);
        for _ in 0..=self.whole() {
            sum += signed(scale(at, frequency)) * amplitude;
            total += amplitude;
            amplitude *= self.roughness;
            frequency *= self.lacunarity;
        }
        let shown = |sum: f32, total: f32| if self.normalize { 0.5 * sum / total + 0.5 } else { sum };
        let remainder = self.remainder();
        if remainder == 0.0 {
            return shown(sum, total);
        }
        let more = sum + signed(scale(at, frequency)) * amplitude;
        lerp(shown(sum, total), shown(more, total + amplitude), remainder)
    }

    fn multifractal<const N: usize>(&self, mut at: [f32; N]) -> f32 {
        let (mut value, mut amplitude) = (1.0, 1.0);
        for _ in 0..=self.whole() {
            value *= amplitude * signed(at) + 1.0;
            amplitude *= self.roughness;
            at = scale(at, self.lacunarity);
        }
        let remainder = self.remainder();
        if remainder != 0.0 {
            value *= remainder * amplitude * signed(at) + 1.0;
        }
        value
    }

    fn hetero_terrain<const N: usize>(&self, mut at: [f32; N]) -> f32 {
        let mut amplitude = self.roughness;
        let mut value = self.offset + signed(at);
        at = scale(at, self.lacunarity);
        let octave = |at, amplitude: f32, value: f32| (signed(at) + self.offset) * amplitude * value;
        for _ in 0..self.whole() {
            value += octave(at, amplitude, value);
            amplitude *= self.roughness;
            at = scale(at, self.lacunarity);
        }
        let remainder = self.remainder();
        if remainder != 0.0 {
            value += remainder * octave(at, amplitude, value);
        }
        value
    }

    fn hybrid_multifractal<const N: usize>(&self, mut at: [f32; N]) -> f32 {
        const LEAST_WEIGHT: f32 = 0.001;
        let (mut value, mut amplitude, mut weight) = (0.0, 1.0, 1.0f32);
        for _ in 0..=self.whole() {
            if weight <= LEAST_WEIGHT {
                break;
            }
            weight = weight.min(1.0);
            let signal = (signed(at) + self.offset) * amplitude;
            value += weight * signal;
            weight *= self.gain * signal;
            amplitude *= self.roughness;
            at = scale(at, self.lacunarity);
        }
        let remainder = self.remainder();
        if remainder != 0.0 && weight > LEAST_WEIGHT {
            value += remainder * weight.min(1.0) * (signed(at) + self.offset) * amplitude;
        }
        value
    }

    /// This sum knows whole octaves only.
    fn ridged_multifractal<const N: usize>(&self, mut at: [f32; N]) -> f32 {
        let ridge = |at| {
            let height: f32 = self.offset - signed(at).abs();
            height * height
        };
        let (mut signal, mut amplitude) = (ridge(at), self.roughness);
        let mut value = signal;
        for _ in 0..self.whole() {
            at = scale(at, self.lacunarity);
            signal = ridge(at) * (signal * self.gain).clamp(0.0, 1.0);
            value += signal * amplitude;
            amplitude *= self.roughness;
        }
        value
    }
}

/// One octave of noise in about -1..1.
fn signed<const N: usize>(at: [f32; N]) -> f32 {
    let value = perlin(at.map(within_period)) * AMPLITUDES[N - 1];
    if value.is_finite() { value } else { 0.0 }
}

/// A coordinate within the period. Floats of a million and more hardly have fractions, and noise is 0 at whole numbers.
#[inline(always)]
fn within_period(x: f32) -> f32 {
    if x.abs() < PERIOD {
        return x;
    }
    x % PERIOD + if x.abs() >= 10.0 * PERIOD { 0.5 } else { 0.0 }
}

/// Gradients at the corners of the cell, blended. Bit i of a corner's number says on which side along axis i it is.
#[inline(always)]
fn perlin<const N: usize>(at: [f32; N]) -> f32 {
    let floor = at.map(f32::floor);
    let cell = floor.map(|x| x as i32 as u32);
    let inside: [f32; N] = std::array::from_fn(|i| at[i] - floor[i]);
    let blend = inside.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    let mut values = [0.0; 16];
    for (corner, value) in values.iter_mut().enumerate().take(1 << N) {
        let side = |i: usize| (corner >> i & 1) as u32;
        let hash = hash::<N>(std::array::from_fn(|i| cell[i].wrapping_add(side(i))));
        *value = slope::<N>(hash, std::array::from_fn(|i| inside[i] - side(i) as f32));
    }
    for (axis, t) in blend.into_iter().enumerate() {
        for i in 0..1 << (N - 1 - axis) {
            values[i] = lerp(values[2 * i], values[2 * i + 1], t);
        }
    }
    values[0]
}

/// Product of an offset with the gradient that a hash chooses: one of 16 lengths in one dimension, of 8 directions in
/// two, of the edges of a cube in three and of a tesseract in four.
#[inline(always)]
fn slope<const N: usize>(hash: u32, offset: [f32; N]) -> f32 {
    let [x, y, z, w]: [f32; 4] = std::array::from_fn(|i| offset.get(i).copied().unwrap_or(0.0));
    let negated = |value: f32, bit: u32| f32::from_bits(value.to_bits() ^ u32::from(hash & bit != 0) << 31);
    match N {
        1 => negated(1.0 + (hash & 7) as f32, 8) * x,
        2 => {
            let (u, v) = if hash & 4 == 0 { (x, y) } else { (y, x) };
            negated(u, 1) + negated(2.0 * v, 2)
        }
        3 => {
            let edge = hash & 15;
            let u = if edge < 8 { x } else { y };
            let other = if edge == 12 || edge == 14 { x } else { z };
            let v = if edge < 4 { y } else { other };
            negated(u, 1) + negated(v, 2)
        }
        _ => {
            let edge = hash & 31;
            let u = if edge < 24 { x } else { y };
            let v = if edge < 16 { y } else { z };
            let s = if edge < 8 { z } else { w };
            negated(u, 1) + negated(v, 2) + negated(s, 4)
        }
    }
}
