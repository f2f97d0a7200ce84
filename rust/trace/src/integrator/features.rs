use glam::Vec3;
use relume_dump::AovSample;

use crate::bsdf::Surface;

/// The AOVs of one path while it is traced.
pub(super) struct Features {
    pub sample: AovSample,
    /// Product of the mirrors and glass crossed so far; nothing once the denoiser's surface was found.
    pub tint: Option<Vec3>,
}

impl Features {
    /// The path goes on behind a mirror, glass or a transparent surface.
    pub fn attenuate(&mut self, weight: Vec3) {
        if let Some(tint) = &mut self.tint {
            *tint *= weight;
        }
    }

    /// Makes the film transparent where a part of the path sees no more than what is behind it.
    pub fn open_film(&mut self, weight: Vec3) {
        self.sample.alpha -= weight.element_sum() / 3.0;
    }

    /// Takes albedo and normal from the first surface that is not specular.
    pub fn record_surface(&mut self, surface: &Surface) {
        if let Some(tint) = self.tint.take() {
            self.sample.albedo = (tint * surface.albedo()).clamp(Vec3::ZERO, Vec3::ONE);
            self.sample.normal = surface.normal();
        }
    }

    /// Takes the albedo of a medium, if no surface was found so far; it has no normal.
    pub fn record_medium(&mut self, albedo: Vec3) {
        if let Some(tint) = self.tint.take() {
            self.sample = AovSample {
                albedo: (tint * albedo).clamp(Vec3::ZERO, Vec3::ONE),
                normal: Vec3::ZERO,
                ..self.sample
            };
        }
    }
}
