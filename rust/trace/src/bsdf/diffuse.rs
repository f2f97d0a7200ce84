//! Diffuse reflection: Oren and Nayar's model in Fujii's form (mimosa-pudica.net/improved-oren-nayar.html) with the
//! energy that is scattered more than once, as OpenPBR 1.1 specifies it. Roughness 0 is Lambert's.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI, TAU};

use glam::Vec3;

/// A rough diffuse surface.
#[derive(Clone, Copy, Debug)]
pub struct OrenNayar {
    normal: Vec3,
    a: f32,
    b: f32,
    /// Multiply scattered part without the factor that depends on the light's direction.
    multiple: Vec3,
}

impl OrenNayar {
    /// A surface of perceptual `roughness` 0..1 and the given albedo `color`, seen from `wo`.
    pub fn new(normal: Vec3, roughness: f32, color: Vec3, wo: Vec3) -> Self {
        let sigma = roughness.clamp(0.0, 1.0);
        let a = 1.0 / (PI + sigma * (FRAC_PI_2 - 2.0 / 3.0));
        let b = sigma * a;
        let color = color.clamp(Vec3::ZERO, Vec3::ONE);
        let mean = a * PI + (TAU - 5.6) / 3.0 * b;
        let surface = Self { normal, a, b, multiple: Vec3::ZERO };
        let missing = 1.0 - surface.single_albedo(normal.dot(wo).max(0.0));
        let multiple =
            FRAC_1_PI * color * color * (mean / (1.0 - mean)) / (1.0 - color * (1.0 - mean)) * missing;
        Self { multiple, ..surface }
    }

    /// `f |cos|` for a white surface.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        let cos_i = self.normal.dot(wi);
        if cos_i <= 0.0 {
            return Vec3::ZERO;
        }
        let cos_o = self.normal.dot(wo).max(0.0);
        let mut s = wi.dot(wo) - cos_i * cos_o;
        if s > 0.0 {
            s /= cos_i.max(cos_o) + f32::MIN_POSITIVE;
        }
        let missing = 1.0 - self.single_albedo(cos_i);
        (Vec3::splat(self.a + self.b * s) + self.multiple * missing) * cos_i
    }

    /// Albedo of single scattering at `cos` to the normal.
    fn single_albedo(&self, cos: f32) -> f32 {
        let g = if cos < 1e-6 {
            FRAC_PI_2 - 2.0 / 3.0 - cos
        } else {
            let cos = cos.min(1.0);
            let sin = (1.0 - cos * cos).max(0.0).sqrt();
            sin * (cos.acos() - 2.0 / 3.0 - sin * cos) + 2.0 / 3.0 * (sin / cos) * (1.0 - sin * sin * sin)
        };
        self.a * PI + self.b * g
    }
}
