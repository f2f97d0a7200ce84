//! Velvet: Ashikhmin, Premoze and Shirley, "A Microfacet-Based BRDF Generator" (2000), with the shadowing of Cook and
//! Torrance, as Cycles has it.

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::Vec3;

use super::frame::ShadingFrame;

/// Fibres that stand on the surface.
#[derive(Clone, Copy, Debug)]
pub struct Velvet {
    normal: Vec3,
    inverse_variance: f32,
}

impl Velvet {
    /// Velvet of perceptual `roughness` 0..1.
    pub fn new(normal: Vec3, roughness: f32) -> Self {
        let sigma = roughness.clamp(0.01, 1.0);
        Self { normal, inverse_variance: 1.0 / (sigma * sigma) }
    }

    /// `f |cos|` and density, which is 0 where the value is.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> (f32, f32) {
        let (cos_o, cos_i) = (self.normal.dot(wo), self.normal.dot(wi));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return (0.0, 0.0);
        }
        let half = (wo + wi).normalize_or(self.normal);
        let (cos_h, cos_half) = (self.normal.dot(half), half.dot(wo).abs());
        if cos_h.abs() >= 1.0 - 1e-5 || cos_half <= 1e-5 {
            return (0.0, 0.0);
        }
        let ratio = 2.0 * (cos_h / cos_half).max(1e-5);
        let shadowing = (ratio * cos_o.min(cos_i)).min(1.0);
        let sin_squared = 1.0 - cos_h * cos_h;
        let exponent = -cos_h * cos_h / sin_squared * self.inverse_variance;
        let density = exponent.exp() * self.inverse_variance * FRAC_1_PI / (sin_squared * sin_squared);
        let value = 0.25 * density * shadowing / cos_o;
        (value, if value > 0.0 { 0.5 * FRAC_1_PI } else { 0.0 })
    }

    /// A direction of the hemisphere about the normal, all alike.
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let (sin, cos) = ((1.0 - u[0] * u[0]).max(0.0).sqrt(), u[0]);
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        ShadingFrame::from_normal(self.normal).world(Vec3::new(sin * cos_phi, sin * sin_phi, cos))
    }
}
