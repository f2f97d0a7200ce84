//! Reflectance of smooth interfaces.
//!
//! `eta` is the index of refraction of the side of transmission over that of the side of incidence.

use glam::Vec3;

/// Reflectance of a dielectric for unpolarised light and cosine of the refracted angle (0 when all is reflected).
pub fn dielectric(cos_i: f32, eta: f32) -> (f32, f32) {
    let cos_i = cos_i.abs();
    let eta_cos_t_squared = eta * eta - (1.0 - cos_i * cos_i);
    if eta_cos_t_squared <= 0.0 {
        return (1.0, 0.0);
    }
    let eta_cos_t = eta_cos_t_squared.sqrt();
    let perpendicular = (cos_i - eta_cos_t) / (cos_i + eta_cos_t);
    let cos_t = eta_cos_t / eta;
    let parallel = (cos_t - eta * cos_i) / (cos_t + eta * cos_i);
    (0.5 * (perpendicular * perpendicular + parallel * parallel), cos_t)
}

/// Reflectance of a dielectric whose curve is stretched to begin at `f0`, and cosine of the refracted angle.
pub fn stretched(cos: f32, eta: f32, f0: Vec3) -> (Vec3, f32) {
    let (f, cos_t) = dielectric(cos, eta);
    let real = f0_from_ior(eta);
    let rise = ((f - real) / (1.0 - real)).clamp(0.0, 1.0);
    (f0 + (1.0 - f0) * rise, cos_t)
}

/// True if the two sides have the same index, so that refraction is a straight line however rough the surface.
pub fn is_unbending(eta: f32) -> bool {
    (eta - 1.0).abs() < 1e-4
}

/// Reflectance of a dielectric at normal incidence.
pub fn f0_from_ior(ior: f32) -> f32 {
    let root = (ior - 1.0) / (ior + 1.0);
    root * root
}

/// The index of refraction above 1 with reflectance `f0` at normal incidence.
pub fn ior_from_f0(f0: f32) -> f32 {
    let root = f0.clamp(0.0, 0.99).sqrt();
    (1.0 + root) / (1.0 - root)
}

/// Mean reflectance of a dielectric, cosine weighted: the fit of Kulla and Conty, "Revisiting Physically Based
/// Shading at Imageworks" (2017).
pub fn dielectric_mean(eta: f32) -> f32 {
    if eta < 1.0 {
        0.997_118 + eta * (0.1014 - eta * (0.965_241 + eta * 0.130_607))
    } else {
        (eta - 1.0) / (4.085_67 + 1.000_71 * eta)
    }
}

/// The metallic model of Kutz et al., "Novel Aspects of the Adobe Standard Material" (2023): Schlick's curve from
/// `f0` to 1, darkened about 82 degrees.
#[derive(Clone, Copy, Debug)]
pub struct F82 {
    /// Reflectance at normal incidence.
    pub f0: Vec3,
    /// Strength of the darkening term `cos (1 - cos)^6`.
    b: Vec3,
}

impl F82 {
    /// The angle where the tint applies has cosine 1/7; this is (6/7)^5.
    const SCHLICK_AT_82: f32 = 0.462_664_4;
    /// 1 / (1/7 (6/7)^6).
    const PEAK: f32 = 17.651_384;

    /// Reflectance `f0` head on, and `tint` times Schlick's at 82 degrees.
    pub fn new(f0: Vec3, tint: Vec3) -> Self {
        let schlick = f0 + (1.0 - f0) * Self::SCHLICK_AT_82;
        Self { f0, b: schlick * Self::PEAK * (1.0 - tint) }
    }

    /// Reflectance `f0` head on, and `edge` at 82 degrees, in each channel alike.
    pub fn through(f0: f32, edge: f32) -> Self {
        let schlick = f0 + (1.0 - f0) * Self::SCHLICK_AT_82;
        Self { f0: Vec3::splat(f0), b: Vec3::splat((schlick - edge) * Self::PEAK) }
    }

    /// Reflectance at an angle.
    pub fn reflectance(&self, cos: f32) -> Vec3 {
        let s = (1.0 - cos).clamp(0.0, 1.0);
        let s5 = (s * s) * (s * s) * s;
        let schlick = self.f0 + (1.0 - self.f0) * s5;
        (schlick - self.b * (cos * s5 * s)).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Mean reflectance, cosine weighted.
    pub fn mean(&self) -> Vec3 {
        (self.f0 + (1.0 - self.f0) / 21.0 - self.b / 126.0).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// A metal of complex index of refraction.
#[derive(Clone, Copy, Debug)]
pub struct Conductor {
    /// Real part of the index.
    pub ior: Vec3,
    /// Imaginary part of the index.
    pub extinction: Vec3,
}

impl Conductor {
    /// Reflectance for unpolarised light (Born and Wolf, "Principles of Optics", 14.4).
    pub fn reflectance(&self, cos: f32) -> Vec3 {
        let cos_squared = cos * cos;
        let sin_squared = 1.0 - cos_squared;
        let (n_squared, k_squared) = (self.ior * self.ior, self.extinction * self.extinction);
        let difference = n_squared - k_squared - sin_squared;
        let length = (difference * difference + 4.0 * n_squared * k_squared).map(f32::sqrt);
        let a = (0.5 * (length + difference)).max(Vec3::ZERO).map(f32::sqrt);
        let (even, odd) = (length + cos_squared, 2.0 * cos * a);
        let perpendicular = (even - odd) / (even + odd).max(Vec3::splat(f32::MIN_POSITIVE));
        let (even, odd) = (cos_squared * length + sin_squared * sin_squared, odd * sin_squared);
        let ratio = (even - odd) / (even + odd).max(Vec3::splat(f32::MIN_POSITIVE));
        (0.5 * perpendicular * (1.0 + ratio)).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// The metal of the same reflectance head on and at 82 degrees, whose mean has a closed form.
    pub fn as_f82(&self) -> F82 {
        let f0 = self.reflectance(1.0);
        let schlick = f0 + (1.0 - f0) * F82::SCHLICK_AT_82;
        F82::new(f0, self.reflectance(1.0 / 7.0) / schlick.max(Vec3::splat(1e-6)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoint rule for `2 f(cos) cos` over 0..1.
    fn mean_of(f: impl Fn(f32) -> f32) -> f32 {
        (0..2000).map(|i| (i as f32 + 0.5) / 2000.0).map(|cos| 2.0 * f(cos) * cos / 2000.0).sum()
    }

    #[test]
    fn dielectric_matches_closed_forms() {
        assert!((dielectric(1.0, 1.5).0 - 0.04).abs() < 1e-6);
        assert!((dielectric(0.0, 1.5).0 - 1.0).abs() < 1e-6);
        // Brewster's angle: only the perpendicular half remains.
        let brewster = 1.5f32.atan();
        let perpendicular = ((1.0f32 - 2.25) / (1.0 + 2.25)).powi(2);
        assert!((dielectric(brewster.cos(), 1.5).0 - 0.5 * perpendicular).abs() < 1e-6);
        // Beyond the critical angle all is reflected.
        assert_eq!(dielectric(0.7, 1.0 / 1.5), (1.0, 0.0));
    }

    #[test]
    fn dielectric_is_the_same_from_both_sides() {
        for cos in [0.1, 0.4, 0.9] {
            let (entering, cos_t) = dielectric(cos, 1.45);
            let (leaving, cos_back) = dielectric(cos_t, 1.0 / 1.45);
            assert!((entering - leaving).abs() < 1e-5 && (cos_back - cos).abs() < 1e-5);
        }
    }

    #[test]
    fn ior_and_f0_are_inverse() {
        for ior in [1.0, 1.33, 1.5, 2.4] {
            assert!((ior_from_f0(f0_from_ior(ior)) - ior).abs() < 1e-4);
        }
    }

    #[test]
    fn means_equal_their_integrals() {
        for eta in [0.5, 0.7, 1.3, 1.5, 2.5] {
            let exact = mean_of(|cos| dielectric(cos, eta).0);
            assert!((dielectric_mean(eta) - exact).abs() < 0.01, "eta {eta}: {exact}");
        }
        let f82 = F82::new(Vec3::new(0.2, 0.5, 0.9), Vec3::new(1.0, 0.7, 0.9));
        for channel in 0..3 {
            let exact = mean_of(|cos| f82.reflectance(cos)[channel]);
            assert!((f82.mean()[channel] - exact).abs() < 2e-3);
        }
    }

    #[test]
    fn conductors_match_closed_forms() {
        // Without extinction, a dielectric.
        let glass = Conductor { ior: Vec3::splat(1.5), extinction: Vec3::ZERO };
        for cos in [0.1, 0.5, 1.0] {
            assert!((glass.reflectance(cos).x - dielectric(cos, 1.5).0).abs() < 1e-5);
        }
        let copper = Conductor { ior: Vec3::new(0.2, 0.92, 1.1), extinction: Vec3::new(3.9, 2.4, 2.2) };
        let head_on = |n: f32, k: f32| ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
        for channel in 0..3 {
            let expected = head_on(copper.ior[channel], copper.extinction[channel]);
            assert!((copper.reflectance(1.0)[channel] - expected).abs() < 1e-5);
            let exact = mean_of(|cos| copper.reflectance(cos)[channel]);
            assert!((copper.as_f82().mean()[channel] - exact).abs() < 0.01, "{exact}");
        }
        assert!((copper.reflectance(0.0) - 1.0).abs().max_element() < 1e-5);
    }

    #[test]
    fn f82_meets_its_tint_at_82_degrees() {
        let f82 = F82::new(Vec3::splat(0.5), Vec3::splat(0.6));
        let schlick = 0.5 + 0.5 * F82::SCHLICK_AT_82;
        assert!((f82.reflectance(1.0 / 7.0).x - 0.6 * schlick).abs() < 1e-5);
    }
}
