//! Scattering along a fibre and about it.

use std::f32::consts::{PI, TAU};

/// Distribution of the angle to the cross-section about the specular cone: d'Eon et al., "An Energy-Conserving Hair
/// Reflectance Model" (2011), equation 7, over solid angle. `variance` is its width, and `o` the direction that the cone
/// belongs to.
pub(super) fn longitudinal((sin_i, cos_i): (f32, f32), (sin_o, cos_o): (f32, f32), variance: f32) -> f32 {
    // exp(-s) I0(c) / (2 v sinh(1/v)), with all exponents in one: c - s - 1/v is the cosine of the deviation less 1, over v.
    let cos_deviation = cos_i * cos_o - sin_i * sin_o;
    let sin_deviation = sin_i * cos_o + cos_i * sin_o;
    // Precise for small deviations, which narrow lobes tell apart.
    let fall = if cos_deviation > 0.0 {
        sin_deviation * sin_deviation / (1.0 + cos_deviation)
    } else {
        1.0 - cos_deviation
    };
    let norm = variance * (1.0 - (-2.0 / variance).exp());
    scaled_bessel_i0(cos_i * cos_o / variance) * (-fall / variance).exp() / norm
}

/// Sine and cosine of an angle with density [`longitudinal`], from two numbers in 0..1 (d'Eon et al., "Importance Sampling
/// for Physically-Based Hair Fiber Models", 2013).
pub(super) fn sample_longitudinal((sin_o, cos_o): (f32, f32), variance: f32, u: [f32; 2]) -> (f32, f32) {
    let uniform = u[0].max(f32::MIN_POSITIVE);
    let below = (variance * (uniform + (1.0 - uniform) * (-2.0 / variance).exp()).ln()).clamp(-2.0, 0.0);
    let cos = 1.0 + below;
    let sin = (-below * (2.0 + below)).max(0.0).sqrt();
    let sin_i = (-cos * sin_o + sin * (TAU * u[1]).cos() * cos_o).clamp(-1.0, 1.0);
    (sin_i, (1.0 - sin_i * sin_i).sqrt())
}

/// `exp(-x) I0(x)` for `x` of 0 and above, relative error below 2e-7: Abramowitz and Stegun 9.8.1 and 9.8.2.
pub(super) fn scaled_bessel_i0(x: f32) -> f32 {
    let (t, coefficients, factor) = if x < 3.75 {
        let t = x / 3.75;
        let low = [0.004_581_3, 0.036_076_8, 0.265_973_2, 1.206_749_2, 3.089_942_4, 3.515_622_9, 1.0];
        return low.into_iter().fold(0.0, |sum: f32, c: f32| sum * (t * t) + c) * (-x).exp();
    } else {
        let high = [
            0.003_923_77,
            -0.016_476_33,
            0.026_355_37,
            -0.020_577_06,
            0.009_162_81,
            -0.001_575_65,
            0.002_253_19,
            0.013_285_92,
            0.398_942_3,
        ];
        (3.75 / x, high, x.sqrt().recip())
    };
    coefficients.into_iter().fold(0.0, |sum: f32, c: f32| sum * t + c) * factor
}

/// Logistic distribution of azimuths within half a turn to either side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Azimuthal {
    scale: f32,
    /// Probability of the logistic distribution below -pi.
    below: f32,
}

impl Azimuthal {
    /// Distribution of this scale.
    pub fn new(scale: f32) -> Self {
        Self { scale, below: 1.0 / (1.0 + (PI / scale).exp()) }
    }

    /// Density at an azimuth, which may be any number of turns off.
    pub fn density(self, phi: f32) -> f32 {
        let turned = phi - TAU * (phi / TAU).round();
        let tail = (-turned.abs() / self.scale).exp();
        tail / (self.scale * (1.0 + tail) * (1.0 + tail) * (1.0 - 2.0 * self.below))
    }

    /// Azimuth from a number in 0..1.
    pub fn sample(self, u: f32) -> f32 {
        let share = u * (1.0 - 2.0 * self.below) + self.below;
        (-self.scale * (1.0 / share - 1.0).ln()).clamp(-PI, PI)
    }
}
