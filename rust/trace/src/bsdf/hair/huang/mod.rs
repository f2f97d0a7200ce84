//! Huang, Hullin and Hanika, "A Microfacet-Based Hair Scattering Model" (EGSR 2022): a fibre of elliptical cross-section with
//! a rough surface of tilted scales. Light goes through it from facet to facet; what is seen is the mean over the fibre's
//! width, or over a pixel where that is narrower.

mod ellipse;
mod walk;

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::Vec3;
use relume_dump::Lobe;

use self::ellipse::Ellipse;
use self::walk::{Randoms, Walk};
use super::scattering::{longitudinal, sample_longitudinal};
use super::{Chiang, ChiangParameters, Fibre, HairResponse};

/// Settings of a [`Huang`].
#[derive(Clone, Copy, Debug)]
pub struct HuangParameters {
    /// Width of the facets' GGX distribution, 0..1.
    pub roughness: f32,
    /// Minor over major axis of the cross-section; its inverse is taken for the same.
    pub aspect_ratio: f32,
    /// Direction of the major axis, of any length; 0 for any.
    pub major: Vec3,
    /// Index of refraction.
    pub ior: f32,
    /// Angle by which the cuticle's scales are tilted, radians.
    pub tilt: f32,
    /// Absorption in units of the inverse radius.
    pub absorption: Vec3,
    /// Factors on reflection, transmission and internal reflection.
    pub factors: [f32; 3],
    /// Half of what a pixel covers of the fibre, in units of its radius; 1 and above for all of it.
    pub coverage: f32,
}

/// Fibre of elliptical cross-section.
#[derive(Clone, Copy, Debug)]
pub struct Huang {
    fibre: Fibre,
    /// Unit direction of the major axis.
    major: Vec3,
    /// The ray's origin in the frame of major axis, tangent and minor axis.
    wo: Vec3,
    ellipse: Ellipse,
    roughness: f32,
    ior: f32,
    tilt: f32,
    absorption: Vec3,
    factors: [f32; 3],
    coverage: f32,
}

/// Places across the fibre that directions are drawn for.
const PLACES: usize = 4;
/// Share of directions that are drawn evenly: the model's tails are longer than those of the lobes that they are drawn from.
const EVEN: f32 = 0.1;
/// Least and most walks for a value.
const WALKS: [f32; 2] = [6.0, 48.0];

impl Huang {
    /// Fibre met by the ray back along the unit `wo`; nothing where the ray misses the ellipse within the circle that was hit.
    pub fn new(fibre: Fibre, parameters: &HuangParameters, wo: Vec3) -> Option<Self> {
        let aspect = parameters.aspect_ratio;
        let minor = if aspect > 1.0 { 1.0 / aspect } else { aspect.max(0.01) };
        let across = parameters.major - fibre.along * parameters.major.dot(fibre.along);
        // Of a circle every axis is a major one.
        let major = if minor < 1.0 { across.try_normalize() } else { None }.unwrap_or_else(|| fibre.side());
        let local = Vec3::new(major.dot(wo), fibre.along.dot(wo), major.cross(fibre.along).dot(wo));
        let ellipse = Ellipse::new(minor, local);
        (fibre.offset.abs() < ellipse.radius() || minor == 1.0).then_some(Self {
            fibre,
            major,
            wo: local,
            ellipse,
            roughness: parameters.roughness.clamp(0.001, 1.0),
            ior: parameters.ior.max(1e-3),
            tilt: -parameters.tilt,
            absorption: parameters.absorption.max(Vec3::ZERO),
            factors: parameters.factors.map(|factor| factor.max(0.0)),
            coverage: parameters.coverage,
        })
    }
}

impl Huang {
    /// Angles of places across the fibre that are seen, as their arc sines in units of the radius: the whole width, or that of
    /// a pixel.
    fn seen(&self) -> (f32, f32) {
        let radius = self.ellipse.radius();
        if self.coverage >= radius {
            return (-1.0f32.asin(), 1.0f32.asin());
        }
        let edge = |offset: f32| (offset / radius).clamp(-1.0, 1.0).asin();
        (edge(self.fibre.offset - self.coverage), edge(self.fibre.offset + self.coverage))
    }

    fn world(&self, local: Vec3) -> Vec3 {
        let minor = self.major.cross(self.fibre.along);
        (self.major * local.x + self.fibre.along * local.y + minor * local.z).normalize_or(self.fibre.front)
    }

    /// See [`super::Hair::eval`]: all of it is glossy, as Cycles has it. The value is an estimate, of random numbers that
    /// depend on the direction alone.
    pub fn eval(&self, wi: Vec3) -> HairResponse {
        HairResponse { glossy: self.value(wi), glossy_pdf: self.pdf(wi), ..HairResponse::default() }
    }

    fn value(&self, wi: Vec3) -> Vec3 {
        let minor = self.major.cross(self.fibre.along);
        let local = Vec3::new(self.major.dot(wi), self.fibre.along.dot(wi), minor.dot(wi));
        let mut random = Randoms::new(wi.to_array());
        let (low, high) = self.seen();
        let width = high.sin() - low.sin();
        let count = ((high - low) / (0.8 * self.roughness)).clamp(WALKS[0], WALKS[1]).ceil();
        let step = (high - low) / count;
        let (mut sum, mut rest) = (Vec3::ZERO, Vec3::ZERO);
        for index in 0..count as u32 {
            // Even in the angle, where lobes are as wide everywhere; weighted for places that are even in the width.
            let angle = low + step * (index as f32 + random.next());
            let share = angle.cos() * step / width;
            if let Some(walk) = Walk::new(self, self.ellipse.gamma(angle)) {
                let (direct, residual) = walk.towards(self, local, &mut random);
                sum += direct * share;
                rest += residual * share;
            }
        }
        let about = longitudinal(sin_cos(local), sin_cos(self.wo), 4.0 * self.roughness) * 0.5 * FRAC_1_PI;
        let value = sum + rest * about;
        if value.is_finite() { value } else { Vec3::ZERO }
    }

    /// Density of [`Self::sample`].
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let places = (0..PLACES).map(|place| self.smooth(place).eval(wi).pdf());
        (1.0 - EVEN) * places.sum::<f32>() / PLACES as f32 + EVEN * 0.25 * FRAC_1_PI
    }

    /// Model of a place across the fibre by lobes with a density.
    fn smooth(&self, place: usize) -> Chiang {
        let (low, high) = self.seen();
        let share = (place as f32 + 0.5) / PLACES as f32;
        let offset = low.sin() + (high.sin() - low.sin()) * share;
        let parameters = ChiangParameters {
            roughness: self.roughness,
            radial_roughness: self.roughness.max(0.4),
            coat: 0.0,
            ior: self.ior,
            tilt: -self.tilt,
            absorption: self.absorption,
        };
        let wo = self.world(self.wo);
        Chiang::new(Fibre { offset, ..self.fibre }, &parameters, wo)
    }

    /// See [`super::Hair::sample`]: directions for which [`Self::eval`] has a density.
    pub fn sample(&self, u: [f32; 3]) -> Option<(Vec3, Lobe)> {
        if u[2] < EVEN {
            let (sin_phi, cos_phi) = (TAU * u[0]).sin_cos();
            let z = 1.0 - 2.0 * u[1];
            let sin = (1.0 - z * z).max(0.0).sqrt();
            return Some((Vec3::new(sin * cos_phi, sin * sin_phi, z), Lobe::Glossy));
        }
        let rest = (u[2] - EVEN) / (1.0 - EVEN) * PLACES as f32;
        let place = (rest as usize).min(PLACES - 1);
        let remapped = (rest - place as f32).clamp(0.0, 1.0 - f32::EPSILON);
        let (wi, _) = self.smooth(place).sample([u[0], u[1], remapped])?;
        Some((wi, Lobe::Glossy))
    }

    /// Direction that light takes through the fibre, and its value over its density; the paper's section 4. Without a
    /// density: [`Self::eval`]'s is another one.
    pub fn walk(&self, u: [f32; 3]) -> Option<(Vec3, Vec3)> {
        let mut random = Randoms::new(u);
        let (low, high) = self.seen();
        let place = low.sin() + (high.sin() - low.sin()) * u[0];
        let walk = Walk::new(self, self.ellipse.gamma(place.clamp(-1.0, 1.0).asin()))?;
        let exits = walk.exits(self, &mut random);
        let means = exits.map(|exit| exit.weight.element_sum() / 3.0);
        let total: f32 = means.iter().sum();
        let mut rest = u[2] * total;
        let chosen = means.iter().position(|mean| {
            let is_chosen = *mean > 0.0 && rest < *mean;
            rest -= mean;
            is_chosen
        });
        let index = chosen.or_else(|| means.iter().rposition(|mean| *mean > 0.0))?;
        let direction = if index == exits.len() - 1 {
            let theta = sin_cos(self.wo);
            let (sin, cos) = sample_longitudinal(theta, 4.0 * self.roughness, [random.next(), random.next()]);
            let (sin_phi, cos_phi) = (TAU * random.next()).sin_cos();
            Vec3::new(sin_phi * cos, sin, cos_phi * cos)
        } else {
            exits[index].direction
        };
        let weight = exits[index].weight * (total / means[index]);
        weight.is_finite().then(|| (self.world(direction), weight))
    }

    /// See [`super::Hair::albedo`].
    pub fn albedo(&self) -> Vec3 {
        (0..PLACES).map(|place| self.smooth(place).albedo()).sum::<Vec3>() / PLACES as f32
    }

    /// See [`super::Hair::widen`].
    pub fn widen(&mut self, roughness: f32) {
        self.roughness = self.roughness.max(roughness);
    }
}

/// Sine and cosine of the angle to the cross-section.
fn sin_cos(local: Vec3) -> (f32, f32) {
    (local.y.clamp(-1.0, 1.0), local.x.hypot(local.z))
}
