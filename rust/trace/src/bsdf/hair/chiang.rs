//! Chiang et al., "A Practical and Controllable Hair and Fur Model for Production Path Tracing" (EG 2016), after Marschner
//! et al. (2003) and d'Eon et al. (2011): reflection, transmission, internal reflection and the rest, each the product of a
//! distribution along the fibre and one about it.

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::Vec3;
use relume_dump::Lobe;

use super::scattering::{Azimuthal, longitudinal, sample_longitudinal};
use super::{Fibre, HairResponse};
use crate::bsdf::fresnel;
use crate::shading::luminance;

/// Settings of a [`Chiang`].
#[derive(Clone, Copy, Debug)]
pub struct ChiangParameters {
    /// Perceptual roughness along the fibre, 0..1.
    pub roughness: f32,
    /// Perceptual roughness about it, 0..1.
    pub radial_roughness: f32,
    /// Share of `roughness` that first reflection lacks, 0..1.
    pub coat: f32,
    /// Index of refraction.
    pub ior: f32,
    /// Angle by which the cuticle's scales are tilted, radians.
    pub tilt: f32,
    /// Absorption in units of the inverse radius.
    pub absorption: Vec3,
}

/// Fibre of circular cross-section, met at a place across it.
#[derive(Clone, Copy, Debug)]
pub struct Chiang {
    fibre: Fibre,
    /// Sine and cosine of the ray's angle to the cross-section.
    theta_o: (f32, f32),
    /// Reflectance where the ray enters.
    reflectance: f32,
    /// Transmittance of one way through the fibre.
    transmittance: Vec3,
    /// Angle to the normal in the cross-section, outside and within.
    gamma: (f32, f32),
    tilt: f32,
    /// Variance along the fibre: of the first reflection, and of the others before each one's factor.
    variances: (f32, f32),
    /// Scale of the azimuthal distribution.
    scale: f32,
}

/// Lobes: reflection, transmission, one internal reflection, and more.
const LOBES: usize = 4;
/// Turns of the ray's angle for the tilt of scales, in units of it: Marschner et al. (2003), table 1, as in Chiang et al.
const TILTS: [f32; LOBES] = [2.0, -1.0, -4.0, 0.0];
/// Factors on the variance of roughness.
const WIDTHS: [f32; LOBES] = [1.0, 0.25, 4.0, 4.0];

impl Chiang {
    /// Fibre met by the ray back along the unit `wo`.
    pub fn new(fibre: Fibre, parameters: &ChiangParameters, wo: Vec3) -> Self {
        let roughness = parameters.roughness.clamp(0.001, 1.0);
        let radial = parameters.radial_roughness.clamp(0.001, 1.0);
        let first = (roughness * (1.0 - parameters.coat.clamp(0.0, 1.0))).clamp(0.001, 1.0);
        let (sin_o, cos_o, _) = fibre.angles(wo);
        let ior = parameters.ior.max(1e-3);
        let gamma_o = fibre.offset.asin();
        // Bravais' index of the cross-section.
        let apparent = (ior * ior - sin_o * sin_o).max(1e-12).sqrt() / cos_o.max(1e-6);
        let sin_gamma_t = (fibre.offset / apparent).clamp(-1.0, 1.0);
        let sin_t = (sin_o / ior).clamp(-1.0, 1.0);
        let length = 2.0 * cos_from_sin(sin_gamma_t) / cos_from_sin(sin_t).max(1e-4);
        let (reflectance, _) = fresnel::dielectric(cos_o * cos_from_sin(fibre.offset), ior);
        Self {
            fibre,
            theta_o: (sin_o, cos_o),
            reflectance,
            transmittance: (parameters.absorption.max(Vec3::ZERO) * -length).map(f32::exp),
            gamma: (gamma_o, sin_gamma_t.asin()),
            tilt: parameters.tilt,
            variances: (variance(first), variance(roughness)),
            scale: scale(radial),
        }
    }

    /// Share of light that each lobe carries.
    fn attenuations(&self) -> [Vec3; LOBES] {
        let (f, t) = (self.reflectance, self.transmittance);
        let through = (1.0 - f) * (1.0 - f) * t;
        let once = through * t * f;
        // Sum of all further internal reflections.
        let rest = once * (t * f) / (1.0 - t * f).max(Vec3::splat(f32::MIN_POSITIVE));
        [Vec3::splat(f), through, once, rest]
    }

    /// Probabilities of the lobes; all 0 if the fibre is black.
    fn probabilities(attenuations: &[Vec3; LOBES]) -> [f32; LOBES] {
        let energies = attenuations.map(luminance);
        let total: f32 = energies.iter().sum();
        if total > 0.0 { energies.map(|energy| energy / total) } else { [0.0; LOBES] }
    }

    fn variance(&self, lobe: usize) -> f32 {
        if lobe == 0 { self.variances.0 } else { self.variances.1 * WIDTHS[lobe] }
    }

    /// The ray's angle as a lobe sees it, turned by the scales.
    fn tilted(&self, lobe: usize) -> (f32, f32) {
        let (sin, cos) = (self.tilt * TILTS[lobe]).sin_cos();
        let (sin_o, cos_o) = self.theta_o;
        (sin_o * cos + cos_o * sin, (cos_o * cos - sin_o * sin).abs())
    }

    /// Azimuth that a lobe leaves in, after refraction and reflection in the cross-section.
    fn azimuth(&self, lobe: usize) -> f32 {
        let (gamma_o, gamma_t) = self.gamma;
        let order = lobe as f32;
        2.0 * order * gamma_t - 2.0 * gamma_o + order * PI
    }

    /// See [`super::Hair::eval`].
    pub fn eval(&self, wi: Vec3) -> HairResponse {
        let (sin_i, cos_i, phi) = self.fibre.angles(wi);
        let attenuations = self.attenuations();
        let probabilities = Self::probabilities(&attenuations);
        let azimuthal = Azimuthal::new(self.scale);
        let mut response = HairResponse::default();
        for lobe in 0..LOBES {
            let along = longitudinal((sin_i, cos_i), self.tilted(lobe), self.variance(lobe));
            let about = if lobe == 3 { 0.5 * FRAC_1_PI } else { azimuthal.density(phi - self.azimuth(lobe)) };
            let density = along * about;
            let (value, pdf) = (attenuations[lobe] * density, probabilities[lobe] * density);
            if lobe == 0 {
                (response.glossy, response.glossy_pdf) = (value, pdf);
            } else {
                response.transmitted += value;
                response.transmitted_pdf += pdf;
            }
        }
        response
    }

    /// See [`super::Hair::sample`].
    pub fn sample(&self, u: [f32; 3]) -> Option<(Vec3, Lobe)> {
        let probabilities = Self::probabilities(&self.attenuations());
        let mut rest = u[2];
        let mut lobe = None;
        for (index, probability) in probabilities.into_iter().enumerate() {
            if probability > 0.0 {
                lobe = Some((index, (rest / probability).clamp(0.0, 1.0 - f32::EPSILON)));
                if rest < probability {
                    break;
                }
            }
            rest -= probability;
        }
        let (lobe, remapped) = lobe?;
        let (sin_i, cos_i) = sample_longitudinal(self.tilted(lobe), self.variance(lobe), [remapped, u[1]]);
        let phi =
            if lobe == 3 { TAU * u[0] } else { self.azimuth(lobe) + Azimuthal::new(self.scale).sample(u[0]) };
        let class = if lobe == 0 { Lobe::Glossy } else { Lobe::Transmission };
        Some((self.fibre.direction(sin_i, cos_i, phi), class))
    }

    /// See [`super::Hair::albedo`].
    pub fn albedo(&self) -> Vec3 {
        self.attenuations().into_iter().sum()
    }

    /// See [`super::Hair::widen`].
    pub fn widen(&mut self, roughness: f32) {
        self.variances.0 = self.variances.0.max(roughness);
        self.variances.1 = self.variances.1.max(roughness);
        self.scale = self.scale.max(roughness);
    }
}

fn cos_from_sin(sin: f32) -> f32 {
    (1.0 - sin * sin).max(0.0).sqrt()
}

/// Variance along the fibre of a perceptual roughness: Chiang et al., equation 7.
fn variance(roughness: f32) -> f32 {
    let root = 0.726 * roughness + 0.812 * roughness * roughness + 3.7 * roughness.powi(20);
    root * root
}

/// Scale of the azimuthal distribution of a perceptual roughness: Chiang et al., equation 8.
fn scale(roughness: f32) -> f32 {
    (PI / 8.0).sqrt() * (0.265 * roughness + 1.194 * roughness * roughness + 5.372 * roughness.powi(22))
}
