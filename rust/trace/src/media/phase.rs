//! Phase functions, all sampled exactly. `cos` is that of the angle between the directions of travel before and after; densities
//! are over solid angle.

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::Vec3;

use super::inversion::invert;
use crate::bsdf::ShadingFrame;

/// Anisotropies that are smaller scatter evenly, as in Cycles.
const ISOTROPIC: f32 = 1e-3;
/// Largest anisotropy: beyond, a medium would hardly scatter at all.
const MOST_ANISOTROPY: f32 = 0.999;

/// Squared sine of half the smallest angle whose cosine single precision tells from 1 well enough for a peak.
const NARROWEST: f64 = 1e-6;

/// A phase function with its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// Henyey and Greenstein (1941), of this mean cosine; isotropic at 0.
    HenyeyGreenstein(f32),
    /// Rayleigh's.
    Rayleigh,
    /// Draine (2003), "Scattering by interstellar dust grains", equation 7.
    Draine {
        /// Parameter of the Henyey-Greenstein factor.
        g: f32,
        /// Weight of the squared cosine.
        alpha: f32,
    },
    /// Fournier and Jonasz (1999), "Computer-based underwater imaging analysis".
    FournierForand(FournierForand),
}

/// Parameters of Fournier and Forand's phase function, by those of the particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FournierForand {
    /// `delta` of the squared sine of half the angle, over that.
    scale: f64,
    /// Minus Fournier's `v`, positive.
    power: f64,
    /// Share of the second term.
    correction: f64,
}

impl Phase {
    /// Henyey-Greenstein of mean cosine `g`.
    pub fn henyey_greenstein(g: f32) -> Self {
        let g = g.clamp(-MOST_ANISOTROPY, MOST_ANISOTROPY);
        Self::HenyeyGreenstein(if g.abs() < ISOTROPIC { 0.0 } else { g })
    }

    /// Draine's function, or one of its limits.
    pub fn draine(g: f32, alpha: f32) -> Self {
        let g = g.clamp(-MOST_ANISOTROPY, MOST_ANISOTROPY);
        if alpha < ISOTROPIC {
            Self::henyey_greenstein(g)
        } else if g.abs() < ISOTROPIC && alpha > 0.999 && alpha < 1.001 {
            Self::Rayleigh
        } else {
            Self::Draine { g: if g.abs() < ISOTROPIC { 0.0 } else { g }, alpha }
        }
    }

    /// Fournier and Forand's function of particles by their refractive index and the share that they scatter backwards.
    pub fn fournier_forand(ior: f32, backscatter: f32) -> Self {
        let n = f64::from(ior.max(1.001)) - 1.0;
        let backscatter = f64::from(backscatter.clamp(1e-6, 0.499));
        let scale = 4.0 / (3.0 * n * n);
        let power = (2.0 * backscatter * (0.5 * scale - 1.0) + 1.0).ln() / (0.5 * scale).ln();
        let correction = (scale.powf(power) - 1.0) / (scale - 1.0);
        Self::FournierForand(FournierForand { scale, power, correction })
    }

    /// The two parts of Mie scattering by droplets of `diameter` micrometres, with their shares.
    pub fn mie(diameter: f32) -> [(f32, Self); 2] {
        let fit = MieFit::new(f64::from(diameter.max(0.0)));
        let share = (fit.draine_share as f32).clamp(0.0, 1.0);
        let hazy = Self::draine(fit.draine_g as f32, fit.alpha as f32);
        [(1.0 - share, Self::henyey_greenstein(fit.henyey_greenstein_g as f32)), (share, hazy)]
    }

    /// Density of a direction.
    pub fn eval(&self, cos: f32) -> f32 {
        match self {
            Self::HenyeyGreenstein(0.0) => 0.25 * FRAC_1_PI,
            Self::HenyeyGreenstein(g) => henyey_greenstein(*g, cos),
            Self::Rayleigh => 0.1875 * FRAC_1_PI * (1.0 + cos * cos),
            Self::Draine { g, alpha } => {
                let norm = 1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0;
                henyey_greenstein(*g, cos) * (1.0 + alpha * cos * cos) / norm
            }
            Self::FournierForand(function) => function.density(f64::from(cos)) as f32,
        }
    }

    /// Cosine of a direction's angle, by a number in 0..1.
    fn sample_cos(&self, u: f32) -> f32 {
        let cos = match self {
            Self::HenyeyGreenstein(0.0) => 1.0 - 2.0 * u,
            Self::HenyeyGreenstein(g) => sample_henyey_greenstein(*g, u),
            Self::Rayleigh => {
                // Frisvad (2011), "Importance sampling the Rayleigh phase function".
                let a = 2.0 - 4.0 * u;
                let v = -((1.0 + a * a).sqrt() + a).cbrt().recip();
                v.recip() - v
            }
            Self::Draine { g, alpha } => sample_draine(f64::from(*g), f64::from(*alpha), f64::from(u)) as f32,
            Self::FournierForand(function) => function.sample_cos(f64::from(u)) as f32,
        };
        cos.clamp(-1.0, 1.0)
    }

    /// A unit direction in which a ray of unit `direction` goes on.
    pub fn sample(&self, direction: Vec3, u: [f32; 2]) -> Vec3 {
        let cos = self.sample_cos(u[0]);
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        let local = Vec3::new(sin * cos_phi, sin * sin_phi, cos);
        ShadingFrame::from_normal(direction).world(local).normalize_or(direction)
    }
}

fn henyey_greenstein(g: f32, cos: f32) -> f32 {
    // Of 1 + g^2 - 2 g cos little is left where both are near 1.
    let spread = (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - cos);
    0.25 * FRAC_1_PI * (1.0 - g * g) / (spread * spread.sqrt()).max(f32::MIN_POSITIVE)
}

fn sample_henyey_greenstein(g: f32, u: f32) -> f32 {
    let k = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
    (1.0 + g * g - k * k) / (2.0 * g)
}

/// Inverts the integral of Draine's function. With `y^2 = 1 + g^2 - 2 g cos` it is a polynomial of `y` over `y`.
fn sample_draine(g: f64, alpha: f64, u: f64) -> f64 {
    let norm = 1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0;
    if g == 0.0 {
        let below = |c: f64| 0.5 * (c + 1.0 + alpha * (c * c * c + 1.0) / 3.0) / norm;
        return invert(|c| (below(c), 0.5 * (1.0 + alpha * c * c) / norm), 1.0 - u);
    }
    let a = 1.0 + g * g;
    let integral = |y: f64| {
        let squares = (-a * a / y - 2.0 * a * y + y * y * y / 3.0) * alpha / (4.0 * g * g);
        -(1.0 / y) + squares
    };
    let scale = -(1.0 - g * g) / (2.0 * g * norm);
    let root = |c: f64| (a - 2.0 * g * c).max(0.0).sqrt();
    let start = integral(1.0 + g);
    let density = |c: f64| {
        let y = root(c);
        0.5 * (1.0 - g * g) * (1.0 + alpha * c * c) / (norm * y * y * y)
    };
    invert(|c| (scale * (integral(root(c)) - start), density(c)), 1.0 - u)
}

impl FournierForand {
    fn density(&self, cos: f64) -> f64 {
        let s = 0.5 * (1.0 - cos);
        if s < NARROWEST {
            // All of these have their mean.
            return self.within(1.0 - 2.0 * NARROWEST) / (4.0 * std::f64::consts::PI * NARROWEST);
        }
        let d = self.scale * s;
        let v = -self.power;
        let e = d - 1.0;
        let first = if e.abs() < 1e-4 {
            // Two terms of the series about 1, where what follows is 0 / 0.
            let constant = 0.5 * (v * (v - 1.0) - v * (v + 1.0) / s);
            let linear = (v * (v - 1.0) * (v - 2.0) - v * (v * v - 1.0) / s) / 6.0;
            (constant + linear * e) / (1.0 + v * e)
        } else {
            let dv = d.powf(v);
            (-v * e - (1.0 - dv) + (d * (1.0 - dv) + v * e) / s) / (e * e * dv)
        };
        let tail = 0.25 * self.correction * (3.0 * cos * cos - 1.0);
        ((first + tail) / (4.0 * std::f64::consts::PI)).max(0.0)
    }

    /// Share of what is scattered by less than the angle.
    fn within(&self, cos: f64) -> f64 {
        let s = (0.5 * (1.0 - cos)).max(0.0);
        let d = self.scale * s;
        let e = 1.0 - d;
        let first = if e.abs() < 1e-6 {
            1.0 - self.power + self.power * s
        } else {
            let dw = d.powf(self.power);
            ((dw - d) - (dw - 1.0) * s) / e
        };
        first + 0.125 * self.correction * cos * (1.0 - cos * cos)
    }

    fn sample_cos(&self, u: f64) -> f64 {
        // By the squared sine of half the angle, in which the forward peak is wide.
        let density = |s: f64| 4.0 * std::f64::consts::PI * self.density(1.0 - 2.0 * s);
        let s = super::inversion::invert_between(0.0, 1.0, |s| (self.within(1.0 - 2.0 * s), density(s)), u);
        1.0 - 2.0 * s
    }
}

/// Parameters of the two parts of Mie scattering.
struct MieFit {
    henyey_greenstein_g: f64,
    draine_g: f64,
    alpha: f64,
    draine_share: f64,
}

impl MieFit {
    /// Jendersie and d'Eon (2023), "An Approximate Mie Scattering Function for Fog and Cloud Rendering": equations 4 to 7, and 11
    /// to 22 of the supplemental for droplets below 5 micrometres.
    fn new(d: f64) -> Self {
        let l = d.ln();
        if d <= 0.1 {
            Self {
                henyey_greenstein_g: 13.8 * d * d,
                draine_g: 1.1456 * d * (9.29044 * d).sin(),
                alpha: 250.0,
                draine_share: 0.252977 - 312.983 * d.powf(4.3),
            }
        } else if d < 1.5 {
            let inner = (l - 0.238604) * (l + 1.00667) / (0.507522 - 0.15677 * l);
            Self {
                henyey_greenstein_g: 0.862 - 0.143 * l * l,
                draine_g: 0.379685 * (1.19692 * inner.cos() + 1.37932 * l + 0.0625835).cos() + 0.344213,
                alpha: 250.0,
                draine_share: 0.146209 * (3.38707 * l + 2.11193).cos() + 0.316072 + 0.0778917 * l,
            }
        } else if d < 5.0 {
            Self {
                henyey_greenstein_g: 0.0604931 * l.ln() + 0.940256,
                draine_g: 0.500411 - 0.081287 / (-2.0 * l + l.tan() + 1.27551),
                alpha: 7.30354 * l + 6.31675,
                draine_share: 0.026914 * (l - (5.68947 * (l.ln() - 0.0292149)).cos()) + 0.376475,
            }
        } else {
            Self {
                henyey_greenstein_g: (-0.0990567 / (d - 1.67154)).exp(),
                draine_g: (-2.20679 / (d + 3.91029) - 0.428934).exp(),
                alpha: (3.62489 - 8.29288 / (d + 5.52825)).exp(),
                draine_share: (-0.599085 / (d - 0.641583) - 0.665888).exp(),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Phase> {
        let mut phases = vec![
            Phase::henyey_greenstein(0.0),
            Phase::henyey_greenstein(0.7),
            Phase::henyey_greenstein(-0.4),
            Phase::Rayleigh,
            Phase::draine(0.6, 0.5),
            Phase::draine(-0.3, 2.0),
            Phase::draine(0.0, 0.5),
            Phase::draine(0.002, 1.5),
            Phase::fournier_forand(1.33, 0.1),
            Phase::fournier_forand(1.05, 0.01),
            Phase::fournier_forand(1.6, 0.4),
        ];
        for diameter in [0.05, 0.7, 3.0, 20.0] {
            phases.extend(Phase::mie(diameter).map(|(_, phase)| phase));
        }
        phases
    }

    /// Integral over the sphere, in steps that are even in the angle's half sine to the fourth: forward peaks are narrow.
    fn integral(phase: &Phase, bounds: [f64; 2], steps: usize) -> f64 {
        let at = |i: f64| bounds[0] + (bounds[1] - bounds[0]) * i / steps as f64;
        let cell = |i: usize| {
            let (q, step) = (at(i as f64 + 0.5), (bounds[1] - bounds[0]) / steps as f64);
            let cos = 1.0 - 2.0 * q.powi(4);
            f64::from(phase.eval(cos as f32)) * 8.0 * q.powi(3) * step * std::f64::consts::TAU
        };
        (0..steps).map(cell).sum()
    }

    #[test]
    fn phase_functions_are_densities() {
        for phase in all() {
            let sum = integral(&phase, [0.0, 1.0], 40_000);
            assert!((sum - 1.0).abs() < 2e-3, "{phase:?} {sum}");
        }
    }

    #[test]
    fn henyey_greenstein_has_its_mean_cosine() {
        let phase = Phase::henyey_greenstein(0.7);
        let count = 100_000;
        let mean: f32 = (0..count).map(|i| phase.sample_cos((i as f32 + 0.5) / count as f32)).sum::<f32>();
        assert!((mean / count as f32 - 0.7).abs() < 1e-4);
    }

    /// Chi-squared over 30 bands of the angle. 53.4 is exceeded by chance once in 250.
    #[test]
    fn sampled_angles_have_the_density_that_is_told() {
        for phase in all() {
            let bands = 30;
            let count = 20_000;
            let mut found = vec![0.0; bands];
            let mut state = 0x9e37_79b9_7f4a_7c15_u64;
            for _ in 0..count {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let u = (state >> 40) as f32 / (1_u64 << 24) as f32;
                let q = (0.5 * (1.0 - f64::from(phase.sample_cos(u)))).max(0.0).powf(0.25);
                found[((q * bands as f64) as usize).min(bands - 1)] += 1.0;
            }
            let (mut chi, mut rest) = (0.0, [0.0, 0.0]);
            for (band, found) in found.into_iter().enumerate() {
                let bounds = [band, band + 1].map(|edge| edge as f64 / bands as f64);
                let expected = integral(&phase, bounds, 1000) * f64::from(count);
                if expected < 8.0 {
                    rest = [rest[0] + expected, rest[1] + found];
                } else {
                    chi += (found - expected).powi(2) / expected;
                }
            }
            chi += (rest[1] - rest[0]).powi(2) / rest[0].max(8.0);
            assert!(chi < 53.4, "{phase:?} {chi}");
        }
    }

    #[test]
    fn directions_are_at_the_sampled_angle() {
        let along = Vec3::new(0.6, -0.48, 0.64);
        let phase = Phase::henyey_greenstein(0.5);
        for u in [[0.1, 0.2], [0.7, 0.9], [0.999, 0.5]] {
            let direction = phase.sample(along, u);
            assert!((direction.dot(along) - phase.sample_cos(u[0])).abs() < 1e-5);
            assert!((direction.length() - 1.0).abs() < 1e-5);
        }
    }
}
