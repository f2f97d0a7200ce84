//! Sheen of cloth: Zeltner, Burley and Chiang, "Practical Multiple-Scattering Sheen Using Linearly Transformed
//! Cosines" (SIGGRAPH 2022 talks). Cycles reads their 32x32 tables; here are the closed-form fits to the same tables
//! that MaterialX publishes (`mx_zeltner_sheen_*`).

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::Vec3;

use super::frame::{ShadingFrame, sample_disk};

/// A linearly transformed cosine about the direction of view.
#[derive(Clone, Copy, Debug)]
pub struct Sheen {
    frame: ShadingFrame,
    a: f32,
    b: f32,
}

impl Sheen {
    /// Sheen of perceptual `roughness` 0..1 seen from `wo`, and its albedo. Nothing if that is none. A bent normal that points
    /// away counts as seen from the side, as in Cycles.
    pub fn new(normal: Vec3, roughness: f32, wo: Vec3) -> Option<(Self, f32)> {
        /// Least albedo.
        const CUTOFF: f32 = 1e-5;
        let x = normal.dot(wo).clamp(0.0, 1.0);
        // The fits hold above roughness 0.01 only.
        let y = roughness.clamp(0.01, 1.0);
        let a = (2.58126 * x + 0.813_703 * y) * y / (1.0 + 0.310_327 * x * x + 2.60994 * x * y);
        let b = (1.0 - x).sqrt() * (y - 1.0) * y * y * y
            / (0.000_025_405_3 + 1.71228 * x - 1.71506 * x * y + 1.34174 * y * y);
        let width = y * (0.020_660_7 + 1.58491 * y) / (0.037_942_4 + y * (1.32227 + y));
        let middle = y * (-0.193_854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046_391 + y);
        let offset =
            y * (0.000_654_023 + (-0.020_781_8 + 0.119_681 * y) * y) / (1.26264 + y * (-1.92021 + y));
        let distance = (x - middle) / width;
        let albedo = (-0.5 * distance * distance).exp() / (width * TAU.sqrt()) + offset;
        let sheen = Self { frame: ShadingFrame::from_tangent(normal, wo), a, b };
        (albedo >= CUTOFF).then(|| (sheen, albedo.min(1.0)))
    }

    /// Density over solid angle, which is also `f |cos|` for albedo 1.
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let wi = self.frame.local(wi);
        if wi.z <= 0.0 {
            return 0.0;
        }
        let transformed = Vec3::new(self.a * wi.x + self.b * wi.z, self.a * wi.y, wi.z);
        let ratio = self.a / transformed.length_squared();
        FRAC_1_PI * wi.z * ratio * ratio
    }

    /// A direction with density [`Self::pdf`].
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let (x, y) = sample_disk(u);
        let z = (1.0 - u[0]).max(0.0).sqrt();
        self.frame.world(Vec3::new((x - z * self.b) / self.a, y / self.a, z).normalize_or(Vec3::Z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_points_away_is_seen_from_the_side() {
        let side = Sheen::new(Vec3::Z, 0.5, Vec3::X).unwrap();
        let away = Sheen::new(Vec3::Z, 0.5, Vec3::new(0.8, 0.0, -0.6)).unwrap();
        let wi = Vec3::new(0.6, 0.0, 0.8);
        assert!(side.1 > 0.01 && away.1 == side.1);
        assert!((away.0.pdf(wi) - side.0.pdf(wi)).abs() < 1e-6);
    }
}
