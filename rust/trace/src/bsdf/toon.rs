//! Toon shading: light from within a cone counts in full, with a soft rim, as Cycles has it.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::Vec3;

use super::frame::ShadingFrame;

/// A cone of directions.
#[derive(Clone, Copy, Debug)]
pub struct Toon {
    axis: Vec3,
    /// Half angle within which light counts in full.
    angle: f32,
    /// Angle of the rim over which it fades.
    rim: f32,
    /// Half angle of the sampled cone; light beyond it does not count.
    reach: f32,
    /// True if the axis is the mirror direction.
    pub is_glossy: bool,
}

impl Toon {
    /// Cone about the normal; `size` and `smooth` are shares of a right angle. Nothing if no direction counts.
    pub fn diffuse(normal: Vec3, size: f32, smooth: f32) -> Option<Self> {
        Self::new(normal, size, smooth, false)
    }

    /// Cone about the mirror direction of `wo`. Nothing if no direction counts.
    pub fn glossy(normal: Vec3, size: f32, smooth: f32, wo: Vec3) -> Option<Self> {
        let cos = normal.dot(wo);
        if cos <= 0.0 {
            return None;
        }
        Self::new((normal * (2.0 * cos) - wo).normalize(), size, smooth, true)
    }

    fn new(axis: Vec3, size: f32, smooth: f32, is_glossy: bool) -> Option<Self> {
        let (angle, rim) = (size.clamp(0.0, 1.0) * FRAC_PI_2, smooth.clamp(0.0, 1.0) * FRAC_PI_2);
        let reach = (angle + rim).min(FRAC_PI_2);
        // In a narrower cone cosines of 32 bits do not differ.
        (reach > 1e-3).then_some(Self { axis, angle, rim, reach, is_glossy })
    }

    /// `f |cos|` and density of a direction above the surface: no cosine is in either.
    pub fn eval(&self, wi: Vec3) -> (f32, f32) {
        let angle = self.axis.dot(wi).clamp(-1.0, 1.0).acos();
        if angle >= self.reach {
            return (0.0, 0.0);
        }
        let counts = if angle < self.angle { 1.0 } else { 1.0 - (angle - self.angle) / self.rim };
        let pdf = 1.0 / (TAU * (1.0 - self.reach.cos()));
        (pdf * counts, pdf)
    }

    /// A direction of the cone, all alike.
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let cos = 1.0 - u[0] * (1.0 - self.reach.cos());
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        ShadingFrame::from_normal(self.axis).world(Vec3::new(sin * cos_phi, sin * sin_phi, cos))
    }
}
