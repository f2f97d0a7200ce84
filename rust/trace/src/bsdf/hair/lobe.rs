//! Lobes of Blender's Hair BSDF: a Cauchy distribution along the fibre, and one about it. They have no paper; formulas are
//! those of Cycles and Open Shading Language.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;
use relume_dump::Lobe;

use super::{Fibre, HairResponse};

/// Side of the fibre that a [`HairLobe`] scatters to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HairSide {
    /// Back to where the ray came from.
    Reflection,
    /// Beyond the fibre.
    Transmission,
}

/// White lobe of a fibre.
#[derive(Clone, Copy, Debug)]
pub struct HairLobe {
    fibre: Fibre,
    /// Shading normal: light comes from its side, or from the other one.
    normal: Vec3,
    side: HairSide,
    /// Angle of the ray to the cross-section.
    theta_o: f32,
    /// Turn of the cone that light is reflected to, radians.
    tilt: f32,
    /// Width along the fibre and about it, 0..1.
    roughness: (f32, f32),
}

impl HairLobe {
    /// Lobe of a fibre met by the ray back along `wo`, at the unit shading `normal`. `offset` is the tilt of its scales in
    /// radians, `roughness` 0..1 along the fibre and about it.
    pub fn new(
        fibre: Fibre,
        normal: Vec3,
        side: HairSide,
        offset: f32,
        roughness: (f32, f32),
        wo: Vec3,
    ) -> Self {
        let (sin_o, cos_o, _) = fibre.angles(wo);
        let roughness = (roughness.0.clamp(0.001, 1.0), roughness.1.clamp(0.001, 1.0));
        Self { fibre, normal, side, theta_o: sin_o.atan2(cos_o), tilt: -offset, roughness }
    }

    /// Least and most of the angle within the Cauchy distribution.
    fn span(&self) -> (f32, f32) {
        let bound = |end: f32| ((0.5 * (self.theta_o + end) - self.tilt) / self.roughness.0).atan();
        (bound(-FRAC_PI_2), bound(FRAC_PI_2))
    }

    /// Class that lights are collected under.
    pub fn light_lobe(&self) -> Lobe {
        match self.side {
            HairSide::Reflection => Lobe::Glossy,
            HairSide::Transmission => Lobe::Transmission,
        }
    }

    /// See [`super::Hair::eval`].
    pub fn eval(&self, wi: Vec3) -> HairResponse {
        if self.is_lit(wi) { self.response(wi) } else { HairResponse::default() }
    }

    /// True if lights are sampled in this direction. As in Cycles, they are not on the other side of the shading normal,
    /// though paths go there.
    pub fn is_lit(&self, wi: Vec3) -> bool {
        let is_reflected = self.side == HairSide::Reflection;
        let is_beyond = self.fibre.angles(wi).2.abs() > FRAC_PI_2;
        (self.normal.dot(wi) >= 0.0) == is_reflected && !(is_reflected && is_beyond)
    }

    /// Scattering of paths, which reflection also sends where no lights are sampled.
    pub fn response(&self, wi: Vec3) -> HairResponse {
        let (sin_i, cos_i, phi) = self.fibre.angles(wi);
        if cos_i < 1e-3 {
            return HairResponse::default();
        }
        let (low, high) = self.span();
        let (along, about) = self.roughness;
        let off = 0.5 * (sin_i.atan2(cos_i) + self.theta_o) - self.tilt;
        let longitudinal = along / (2.0 * (off * off + along * along) * (high - low) * cos_i);
        match self.side {
            HairSide::Reflection => {
                let pdf = longitudinal * (0.5 * (phi / about).abs().min(PI)).cos() * 0.25 / about;
                HairResponse { glossy: Vec3::splat(pdf), glossy_pdf: pdf, ..HairResponse::default() }
            }
            HairSide::Transmission => {
                let off = PI - phi.abs();
                if !self.is_lit(wi) {
                    return HairResponse::default();
                }
                let cauchy = 0.5 * longitudinal * about / (off * off + about * about);
                HairResponse {
                    // The value is as high as if there were nothing in the half turn about the ray's origin.
                    transmitted: Vec3::splat(cauchy / (FRAC_PI_2 / about).atan()),
                    transmitted_pdf: cauchy / (PI / about).atan(),
                    ..HairResponse::default()
                }
            }
        }
    }

    /// See [`super::Hair::sample`].
    pub fn sample(&self, u: [f32; 3]) -> (Vec3, Lobe) {
        let (low, high) = self.span();
        let (along, about) = self.roughness;
        let off = along * (low + u[0] * (high - low)).tan();
        let theta_i = (2.0 * (off + self.tilt) - self.theta_o).clamp(-FRAC_PI_2, FRAC_PI_2);
        let (phi, class) = match self.side {
            HairSide::Reflection => (2.0 * (1.0 - 2.0 * u[1]).clamp(-1.0, 1.0).asin() * about, Lobe::Glossy),
            HairSide::Transmission => {
                let off = about * (2.0 * (PI / about).atan() * (u[1] - 0.5)).tan();
                (off + PI, Lobe::Transmission)
            }
        };
        let (sin_i, cos_i) = theta_i.sin_cos();
        (self.fibre.direction(sin_i, cos_i, phi), class)
    }
}
