//! Hair: scattering by a fibre that is thinner than what is seen of it, into all directions about it.
//!
//! The two models of Blender's Principled Hair and the lobes of its Hair BSDF. Values include the cosine, as those of all
//! closures.

mod chiang;
mod huang;
mod lobe;
mod pigment;
mod scattering;
#[cfg(test)]
pub(super) mod tests;

use glam::Vec3;
use relume_dump::Lobe;

pub use chiang::{Chiang, ChiangParameters};
pub use huang::{Huang, HuangParameters};
pub use lobe::{HairLobe, HairSide};
pub use pigment::{absorption_of_color, absorption_of_melanin};

/// Piece of a fibre as a ray meets it.
#[derive(Clone, Copy, Debug)]
pub struct Fibre {
    /// Unit direction from root to tip.
    along: Vec3,
    /// Unit direction towards the ray's origin, perpendicular to `along`.
    front: Vec3,
    /// Place across the fibre, -1 to 1 from edge to edge.
    offset: f32,
}

impl Fibre {
    /// Fibre along `tangent`, of any length, whose unit `normal` the ray back along the unit `wo` met.
    pub fn new(tangent: Vec3, normal: Vec3, wo: Vec3) -> Self {
        let along = tangent.normalize_or(Vec3::X);
        let side = along.cross(wo).try_normalize().unwrap_or_else(|| along.any_orthonormal_vector());
        Self { along, front: side.cross(along), offset: (-normal.dot(side)).clamp(-1.0, 1.0) }
    }

    /// Unit direction across the fibre, perpendicular to the ray.
    fn side(&self) -> Vec3 {
        self.along.cross(self.front)
    }

    /// Sine of the angle to the cross-section, its cosine, and the azimuth about the fibre from the ray's origin on.
    fn angles(&self, direction: Vec3) -> (f32, f32, f32) {
        let (x, y) = (self.front.dot(direction), self.side().dot(direction));
        (self.along.dot(direction).clamp(-1.0, 1.0), x.hypot(y), y.atan2(x))
    }

    /// Inverse of [`Self::angles`], normalised.
    fn direction(&self, sin_theta: f32, cos_theta: f32, phi: f32) -> Vec3 {
        let (sin_phi, cos_phi) = phi.sin_cos();
        let across = (self.front * cos_phi + self.side() * sin_phi) * cos_theta;
        (self.along * sin_theta + across).normalize_or(self.front)
    }
}

/// Scattering by hair in a direction, parted by the class of light that comes from there.
#[derive(Clone, Copy, Debug, Default)]
pub struct HairResponse {
    /// Value of what is [`Lobe::Glossy`].
    pub glossy: Vec3,
    /// Value of what is [`Lobe::Transmission`].
    pub transmitted: Vec3,
    /// Density of glossy samples over solid angle.
    pub glossy_pdf: f32,
    /// Density of transmitted samples over solid angle.
    pub transmitted_pdf: f32,
}

impl HairResponse {
    /// Value of both classes.
    pub fn value(&self) -> Vec3 {
        self.glossy + self.transmitted
    }

    /// Density of both classes.
    pub fn pdf(&self) -> f32 {
        self.glossy_pdf + self.transmitted_pdf
    }

    /// Class of a sample in this direction, chosen by a number in 0..1.
    pub fn lobe(&self, u: f32) -> Lobe {
        if u * self.pdf() < self.glossy_pdf { Lobe::Glossy } else { Lobe::Transmission }
    }
}

/// Models of hair.
#[derive(Clone, Copy, Debug)]
pub enum Hair {
    /// Principled Hair of Chiang et al.
    Chiang(Chiang),
    /// Principled Hair of Huang et al.
    Huang(Huang),
    /// Hair BSDF.
    Lobe(HairLobe),
}

impl Hair {
    /// Scattering from the unit direction `wi`.
    pub fn eval(&self, wi: Vec3) -> HairResponse {
        match self {
            Self::Chiang(model) => model.eval(wi),
            Self::Huang(model) => model.eval(wi),
            Self::Lobe(model) => model.eval(wi),
        }
    }

    /// Chooses a unit direction by three numbers in 0..1, and its class; nothing where nothing scatters. The value over the
    /// density of the response is an estimate of what comes from there. Where no other closure `is_mixed` with it, the density
    /// need not be that of the choice.
    pub fn sample(&self, u: [f32; 3], is_mixed: bool) -> Option<(Vec3, Lobe, HairResponse)> {
        let (wi, lobe) = match self {
            Self::Chiang(model) => model.sample(u)?,
            Self::Huang(model) if !is_mixed => {
                let (wi, weight) = model.walk(u)?;
                let glossy_pdf = model.pdf(wi);
                let glossy = weight * glossy_pdf;
                return Some((
                    wi,
                    Lobe::Glossy,
                    HairResponse { glossy, glossy_pdf, ..HairResponse::default() },
                ));
            }
            Self::Huang(model) => model.sample(u)?,
            Self::Lobe(model) => model.sample(u),
        };
        let response = match self {
            Self::Lobe(model) => model.response(wi),
            _ => self.eval(wi),
        };
        (response.pdf() > 0.0).then_some((wi, lobe, response))
    }

    /// True if lights count in the direction of a sample.
    pub fn is_lit(&self, wi: Vec3) -> bool {
        match self {
            Self::Lobe(model) => model.is_lit(wi),
            _ => true,
        }
    }

    /// Share of uniform light that is scattered.
    pub fn albedo(&self) -> Vec3 {
        match self {
            Self::Chiang(model) => model.albedo(),
            Self::Huang(model) => model.albedo(),
            Self::Lobe(_) => Vec3::ONE,
        }
    }

    /// Makes lobes at least as wide as `roughness` (Cycles' Filter Glossy, in each model's own unit).
    pub fn widen(&mut self, roughness: f32) {
        match self {
            Self::Chiang(model) => model.widen(roughness),
            Self::Huang(model) => model.widen(roughness),
            Self::Lobe(_) => {}
        }
    }
}
