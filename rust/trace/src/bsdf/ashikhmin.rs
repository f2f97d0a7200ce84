//! Ashikhmin and Shirley, "An Anisotropic Phong BRDF Model" (2000), without its Fresnel factor, as Cycles has it.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::Vec3;

use super::frame::ShadingFrame;

/// An anisotropic Phong lobe.
#[derive(Clone, Copy, Debug)]
pub struct AshikhminShirley {
    frame: ShadingFrame,
    alpha_x: f32,
    alpha_y: f32,
}

impl AshikhminShirley {
    /// A lobe with the given widths, 0..1.
    pub fn new(frame: ShadingFrame, alpha_x: f32, alpha_y: f32) -> Self {
        Self { frame, alpha_x: alpha_x.clamp(1e-4, 1.0), alpha_y: alpha_y.clamp(1e-4, 1.0) }
    }

    /// Perceptual roughness.
    pub fn roughness(&self) -> f32 {
        (self.alpha_x * self.alpha_y).sqrt().sqrt()
    }

    /// Widens the lobe to at least `alpha`.
    pub fn widen(&mut self, alpha: f32) {
        self.alpha_x = self.alpha_x.max(alpha);
        self.alpha_y = self.alpha_y.max(alpha);
    }

    /// True if the lobe is a mirror.
    pub fn is_singular(&self) -> bool {
        self.alpha_x.max(self.alpha_y) <= 1e-4
    }

    /// Phong exponents along x and y.
    fn exponents(&self) -> (f32, f32) {
        (2.0 / (self.alpha_x * self.alpha_x) - 2.0, 2.0 / (self.alpha_y * self.alpha_y) - 2.0)
    }

    /// `f |cos|` and density, both 0 for a mirror.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> (f32, f32) {
        let (wo, wi) = (self.frame.local(wo), self.frame.local(wi));
        if wo.z <= 0.0 || wi.z <= 0.0 || self.is_singular() {
            return (0.0, 0.0);
        }
        let Some(h) = (wo + wi).try_normalize() else { return (0.0, 0.0) };
        let cos_h = h.dot(wo).abs().max(1e-6);
        let (n_x, n_y) = self.exponents();
        let sin_squared = h.x * h.x + h.y * h.y;
        let exponent =
            if sin_squared > 0.0 { (n_x * h.x * h.x + n_y * h.y * h.y) / sin_squared } else { 0.0 };
        let norm = ((n_x + 1.0) * (n_y + 1.0)).sqrt() / (8.0 * PI);
        let pdf = norm * h.z.max(1e-6).powf(exponent) / cos_h;
        (pdf * wi.z / wo.z.max(wi.z).max(1e-6), pdf)
    }

    /// A direction with the density of [`Self::eval`], or the mirrored one.
    pub fn sample(&self, wo: Vec3, u: [f32; 2]) -> Option<Vec3> {
        let wo = self.frame.local(wo);
        if wo.z <= 0.0 {
            return None;
        }
        let h = if self.is_singular() { Vec3::Z } else { self.sample_half(u) };
        let cos = h.dot(wo);
        (cos > 0.0).then(|| self.frame.world(h * (2.0 * cos) - wo).normalize_or_zero())
    }

    fn sample_half(&self, u: [f32; 2]) -> Vec3 {
        let (n_x, n_y) = self.exponents();
        // One quadrant's angle, mirrored into the four.
        let quadrant = (u[0] * 4.0).min(3.999);
        let within = quadrant.fract();
        let first = (((n_x + 1.0) / (n_y + 1.0)).sqrt() * (FRAC_PI_2 * within).tan()).atan();
        let phi = match quadrant as u32 {
            0 => first,
            1 => PI - first,
            2 => PI + first,
            _ => TAU - first,
        };
        let (sin_phi, cos_phi) = phi.sin_cos();
        let exponent = n_x * cos_phi * cos_phi + n_y * sin_phi * sin_phi;
        let cos = (1.0 - u[1]).max(f32::MIN_POSITIVE).powf(1.0 / (exponent + 1.0));
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        Vec3::new(sin * cos_phi, sin * sin_phi, cos)
    }
}
