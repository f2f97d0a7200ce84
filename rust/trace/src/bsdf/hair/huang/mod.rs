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
/// Longest steps across the fibre for reflection and for what goes through it, in units of half its width and of the roughness.
const REFLECTION_STEP: f32 = 0.7;
const THROUGH_STEP: f32 = 0.8;
/// Most pairs of steps.
const MOST_PAIRS: f32 = 64.0;

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
    /// True if a pixel is narrower than the fibre, so that only a part of it is seen.
    fn is_near(&self) -> bool {
        self.coverage < self.ellipse.radius()
    }

    /// Places across the fibre that are seen, in units of half its seen width: all, or those of a pixel.
    fn seen(&self) -> [f32; 2] {
        if !self.is_near() {
            return [-1.0, 1.0];
        }
        [-self.coverage, self.coverage]
            .map(|by| ((self.fibre.offset + by) / self.ellipse.radius()).clamp(-1.0, 1.0))
    }

    /// Places that are seen, as of [`Self::seen`], and whose scales face the ray; nothing if there are none.
    fn facing(&self) -> Option<[f32; 2]> {
        let (sin, cos) = sin_cos(self.wo);
        let half_span = (-self.tilt.tan() * sin / cos).max(0.0).acos();
        let phi = self.wo.x.atan2(self.wo.z);
        let [low, high] = self.seen();
        // Values grow without limit at the edges.
        let low = low.max(self.ellipse.place(phi + half_span)).max(-0.999);
        let high = high.min(self.ellipse.place(phi - half_span)).min(0.999);
        (low < high).then_some([low, high])
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

    /// Means over the places that are seen, by Simpson's rule with as few of them as Cycles takes: its error shows where hair
    /// is flat or dark.
    fn value(&self, wi: Vec3) -> Vec3 {
        let minor = self.major.cross(self.fibre.along);
        let local = Vec3::new(self.major.dot(wi), self.fibre.along.dot(wi), minor.dot(wi));
        let ((sin_i, cos_i), (sin_o, cos_o)) = (sin_cos(local), sin_cos(self.wo));
        let Some(places) = self.facing() else { return Vec3::ZERO };
        if self.tilt.tan() * sin_i < -cos_i {
            return Vec3::ZERO;
        }
        let mut reflected = 0.0;
        if self.factors[0] > 0.0 {
            for (gamma, weight) in self.nodes(places, REFLECTION_STEP) {
                let walk = Walk::new(self, gamma);
                let lit = walk.map_or(0.0, |walk| walk.reflection(local));
                reflected += self.factors[0] * weight * self.ellipse.arc(gamma) * lit;
            }
        }
        let (mut direct, mut rest) = (Vec3::splat(reflected), Vec3::ZERO);
        if self.factors[1] > 0.0 || self.factors[2] > 0.0 {
            let mut random = Randoms::new(wi.to_array());
            for (gamma, weight) in self.nodes(places, THROUGH_STEP) {
                let Some(walk) = Walk::new(self, gamma) else { continue };
                let lit = walk.towards(self, local, &mut random);
                direct += lit.direct * weight;
                rest += lit.rest * weight;
            }
        }
        let about =
            longitudinal((sin_i, cos_i), (sin_o, cos_o), 4.0 * self.roughness) * FRAC_1_PI * FRAC_1_PI;
        let [low, high] = self.seen();
        let value = (direct + rest * about) / (cos_o * (high - low));
        if value.is_finite() { value } else { Vec3::ZERO }
    }

    /// Places as angles of the outline, each with its weight by Simpson's rule and the angle that a unit of the width has
    /// there.
    fn nodes(&self, [low, high]: [f32; 2], step: f32) -> impl Iterator<Item = (f32, f32)> {
        let pairs = (0.5 * (high - low) / (step * self.roughness)).ceil().clamp(1.0, MOST_PAIRS);
        let step = 0.5 * (high - low) / pairs;
        (0..=2 * pairs as u32).map(move |index| {
            let place = low + step * index as f32;
            let is_end = index == 0 || index == 2 * pairs as u32;
            let simpson = if is_end { 1.0 } else { 2.0 * (1.0 + (index % 2) as f32) };
            let jacobian = 1.0 / (self.ellipse.radius() * (1.0 - place * place).sqrt());
            (self.ellipse.gamma(place.asin()), simpson / 3.0 * step * jacobian)
        })
    }

    /// Density of [`Self::sample`].
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let places = (0..PLACES).map(|place| self.smooth(place).eval(wi).pdf());
        (1.0 - EVEN) * places.sum::<f32>() / PLACES as f32 + EVEN * 0.25 * FRAC_1_PI
    }

    /// Model of a place across the fibre by lobes with a density.
    fn smooth(&self, place: usize) -> Chiang {
        let [low, high] = self.seen();
        let offset = low + (high - low) * (place as f32 + 0.5) / PLACES as f32;
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
        let place = if self.is_near() { self.fibre.offset / self.ellipse.radius() } else { 2.0 * u[0] - 1.0 };
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
