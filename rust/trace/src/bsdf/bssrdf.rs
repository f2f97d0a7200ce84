//! Subsurface scattering as a closure: what light finds inside, and how it enters.

use glam::{BVec3, Vec2, Vec3};
use relume_scene::{AlbedoInversion, SubsurfaceMethod, SubsurfaceModel};

use super::frame::sample_cosine;
use super::{MicrofacetDistribution, Scatter, ShadingFrame, SlopeDistribution, Surface};

/// Radius below which a channel is diffuse (Cycles' `BSSRDF_MIN_RADIUS`).
const MIN_RADIUS: f32 = 1e-8;

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

impl Surface {
    /// Adds a body that light enters, of `weight`, which holds its albedo. `bssrdf` has the radius without the model's
    /// factor. Channels of a radius below `least` are diffuse; all are, where the path has scattered diffusely before and
    /// the model is for such that have not.
    pub fn add_body(
        &mut self,
        weight: Vec3,
        normal: Vec3,
        bssrdf: Bssrdf,
        least: f32,
        model: &SubsurfaceModel,
    ) {
        let is_diffuse = model.is_first_only && self.is_after_diffuse;
        let scatters = bssrdf.radius.cmpge(Vec3::splat(least.max(MIN_RADIUS))) & BVec3::splat(!is_diffuse);
        let channels = scatters.bitmask().count_ones();
        if channels < 3 {
            self.add(Vec3::select(scatters, Vec3::ZERO, weight), Vec3::ONE, normal, Scatter::Diffuse);
        }
        let radius = Vec3::select(scatters, bssrdf.radius * model.radius_factor, Vec3::ZERO);
        let weight = Vec3::select(scatters, weight, Vec3::ZERO);
        // Cycles chooses it as often as there are channels.
        let scatter = Scatter::Subsurface(Bssrdf { radius, ..bssrdf });
        self.has_body |= self.add(weight, Vec3::splat(channels as f32), normal, scatter);
    }

    /// The body that the path enters if the third of [`Surface::sample`]'s numbers chooses one.
    pub(crate) fn enters(&self, u: f32) -> Option<BodyEntry> {
        if !self.has_body {
            return None;
        }
        let total = self.total_weight();
        let closure = &self.closures[self.choose(u, total)?.0];
        let Scatter::Subsurface(bssrdf) = closure.scatter else { return None };
        let weight = closure.weight * (total / closure.sample_weight);
        Some(BodyEntry { weight, normal: closure.normal, bssrdf })
    }

    /// Mean normal of the bodies; nothing if there is none.
    pub(crate) fn body_normal(&self) -> Option<Vec3> {
        let bodies = self.closures.iter().filter(|closure| matches!(closure.scatter, Scatter::Subsurface(_)));
        bodies.map(|body| body.normal * body.weight.element_sum()).sum::<Vec3>().try_normalize()
    }
}
