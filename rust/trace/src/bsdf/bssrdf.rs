//! Subsurface scattering as a closure: what light finds inside, and how it enters.

use glam::{Vec2, Vec3};
use relume_scene::{AlbedoInversion, SubsurfaceMethod};

use super::frame::sample_cosine;
use super::{MicrofacetDistribution, ShadingFrame, SlopeDistribution};

/// Radius below which a channel is diffuse (Cycles' `BSSRDF_MIN_RADIUS`).
pub const MIN_RADIUS: f32 = 1e-8;

/// A body behind the surface. The closure's weight holds its albedo.
#[derive(Clone, Copy, Debug)]
pub struct Bssrdf {
    /// How light finds its way out.
    pub method: SubsurfaceMethod,
    /// How the inside follows from the albedo.
    pub inversion: AlbedoInversion,
    /// Albedo of the whole body.
    pub albedo: Vec3,
    /// Radius of each channel in metres; 0 for those that do not take part.
    pub radius: Vec3,
    /// Mean cosine of scattering inside.
    pub anisotropy: f32,
    /// Index of refraction of the surface.
    pub ior: f32,
    /// Width of the surface's facets.
    pub alpha: f32,
}

/// Choice of a path to enter a body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BodyEntry {
    /// Factor on the throughput; it holds the albedo.
    pub weight: Vec3,
    /// Unit normal of the closure.
    pub normal: Vec3,
    /// The body.
    pub bssrdf: Bssrdf,
}

impl Bssrdf {
    /// Direction in which light goes on inside; nothing if it does not get in. Neither Fresnel's factor nor shadowing
    /// counts: only the distribution of directions is of interest (Cycles' `subsurface_entry_bounce`).
    pub fn enter(&self, normal: Vec3, wo: Vec3, u: [f32; 2]) -> Option<Vec3> {
        let mut u = Vec2::from(u);
        if self.method == SubsurfaceMethod::Skin {
            u.x *= 2.0;
            if u.x < 1.0 {
                return Some(sample_cosine(-normal, u.to_array()));
            }
            u.x -= 1.0;
        }
        if normal.dot(wo) <= 0.0 {
            return None;
        }
        let frame = ShadingFrame::from_normal(normal);
        let distribution = MicrofacetDistribution {
            shape: SlopeDistribution::Ggx,
            alpha_x: self.alpha,
            alpha_y: self.alpha,
        };
        let facet = frame.world(distribution.sample_visible(frame.local(wo), u.to_array()));
        let (eta, cos) = (1.0 / self.ior, facet.dot(wo));
        let cos_inside = (1.0 - eta * eta * (1.0 - cos * cos)).max(0.0).sqrt();
        Some((facet * (eta * cos - cos_inside) - wo * eta).normalize_or(-normal))
    }
}
