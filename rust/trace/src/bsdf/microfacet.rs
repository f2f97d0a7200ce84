//! Reflection and refraction by microfacets: glossy, metallic, glass.
//!
//! Sampling follows the visible normals (Heitz, JCGT 2018), reflection or refraction is chosen in proportion to what
//! each carries. As in Cycles, the geometric normal only rejects samples on the wrong side; it is not consulted in
//! evaluation, which would show the triangles at the shadow terminator.

use glam::Vec3;
use relume_dump::Lobe;

use super::closure::ClosureSample;
use super::distribution::MicrofacetDistribution;
use super::energy;
use super::film::Film;
use super::frame::ShadingFrame;
use super::fresnel::{self, Conductor, F82};
use super::normal::{SampleReach, SideNormals};

/// Least width of facets that lights are connected to. Narrower ones scatter to so few directions that points on a light miss them.
const LEAST_ROUGH_ALPHA: f32 = 0.1;

/// Side that light can leave to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interface {
    /// Reflection only.
    Reflection,
    /// Refraction only.
    Refraction,
    /// Both sides.
    Glass,
}

/// Reflectance of a facet.
#[derive(Clone, Copy, Debug)]
pub enum Fresnel {
    /// All; an interface that refracts lets through all that is not totally reflected.
    None,
    /// The closure's index of refraction, untinted.
    Dielectric,
    /// The dielectric's curve stretched to begin at `f0`, and tinted.
    Tinted {
        /// Reflectance at normal incidence.
        f0: Vec3,
        /// Factor on what is reflected.
        reflection: Vec3,
        /// Factor on what is transmitted.
        transmission: Vec3,
        /// Film upon it.
        film: Option<Film>,
    },
    /// A metal by its colours.
    Metal(F82, Option<Film>),
    /// A metal by its index of refraction.
    Conductor(Conductor, Option<Film>),
}

/// A rough interface.
#[derive(Clone, Copy, Debug)]
pub struct Microfacet {
    /// Statistics of the facets.
    pub distribution: MicrofacetDistribution,
    /// Side that light leaves to.
    pub interface: Interface,
    /// Index of refraction beyond the surface over that on the side of `wo`.
    pub ior: f32,
    /// Share of light that is reflected.
    pub fresnel: Fresnel,
    /// Tangents and normal.
    pub frame: ShadingFrame,
    /// Factor that makes up for single scattering, see [`energy::Compensation`].
    pub energy_scale: f32,
}

impl Microfacet {
    /// Blackens a side of glass, with the split between the sides unchanged.
    pub fn keep_sides(&mut self, reflection: bool, transmission: bool) {
        let (f0, old_reflection, old_transmission, film) = match self.fresnel {
            Fresnel::Tinted { f0, reflection, transmission, film } => (f0, reflection, transmission, film),
            _ => (Vec3::splat(fresnel::f0_from_ior(self.ior)), Vec3::ONE, Vec3::ONE, None),
        };
        let keep = |keep: bool, tint: Vec3| if keep { tint } else { Vec3::ZERO };
        self.fresnel = Fresnel::Tinted {
            f0,
            reflection: keep(reflection, old_reflection),
            transmission: keep(transmission, old_transmission),
            film,
        };
    }

    /// Perceptual roughness, the square root of the mean width.
    pub fn roughness(&self) -> f32 {
        (self.distribution.alpha_x * self.distribution.alpha_y).sqrt().sqrt()
    }

    /// True if it scatters so widely that lights are connected to it.
    pub fn is_rough(&self) -> bool {
        let MicrofacetDistribution { alpha_x, alpha_y, .. } = self.distribution;
        alpha_x.min(alpha_y) >= LEAST_ROUGH_ALPHA
    }

    /// True if only single directions scatter, so that [`Self::eval`] is zero everywhere.
    pub fn is_singular(&self) -> bool {
        self.distribution.is_singular()
    }

    /// True if the two sides have the same index, so that refraction is a straight line however rough the surface.
    pub fn is_unbending(&self) -> bool {
        fresnel::is_unbending(self.ior)
    }

    /// Reflected and transmitted part at a facet seen at `cos`, and cosine of the refracted angle.
    fn split(&self, cos: f32) -> (Vec3, Vec3, f32) {
        let (reflected, transmitted, cos_t) = match self.fresnel {
            Fresnel::None => match self.interface {
                Interface::Reflection => (Vec3::ONE, Vec3::ZERO, 0.0),
                _ => {
                    let (f, cos_t) = fresnel::dielectric(cos, self.ior);
                    (Vec3::ONE, if f < 1.0 { Vec3::ONE } else { Vec3::ZERO }, cos_t)
                }
            },
            Fresnel::Dielectric => {
                let (f, cos_t) = fresnel::dielectric(cos, self.ior);
                (Vec3::splat(f), Vec3::splat(1.0 - f), cos_t)
            }
            Fresnel::Tinted { f0, reflection, transmission, film: Some(film) } => {
                let (f, cos_t) = film.stretched(cos, self.ior, f0);
                (f * reflection, (1.0 - f) * transmission, cos_t)
            }
            Fresnel::Tinted { f0, reflection, transmission, film: None } => {
                let (f, cos_t) = fresnel::stretched(cos, self.ior, f0);
                (f * reflection, (1.0 - f) * transmission, cos_t)
            }
            Fresnel::Metal(metal, film) => {
                let bare = || metal.reflectance(cos);
                (film.map_or_else(bare, |film| film.on_metal(cos, &metal)), Vec3::ZERO, 0.0)
            }
            Fresnel::Conductor(metal, film) => {
                let bare = || metal.reflectance(cos);
                (film.map_or_else(bare, |film| film.on_conductor(cos, &metal)), Vec3::ZERO, 0.0)
            }
        };
        match self.interface {
            Interface::Reflection => (reflected, Vec3::ZERO, cos_t),
            Interface::Refraction => (Vec3::ZERO, transmitted, cos_t),
            Interface::Glass => (reflected, transmitted, cos_t),
        }
    }

    /// Estimates of the reflected and the transmitted part of uniform light, seen at `cos` to the normal, without
    /// the closure's weight.
    pub fn albedo(&self, cos: f32) -> (Vec3, Vec3) {
        let transmitted =
            if self.interface == Interface::Reflection { Vec3::ZERO } else { self.split(cos).1 };
        if self.interface == Interface::Refraction {
            return (Vec3::ZERO, transmitted);
        }
        let roughness = self.roughness();
        let rough_dielectric = |f0: Vec3| f0 + (1.0 - f0) * energy::dielectric_rise(roughness, cos, self.ior);
        let reflected = match self.fresnel {
            Fresnel::None => Vec3::ONE,
            Fresnel::Tinted { film: Some(_), .. } | Fresnel::Metal(_, Some(_)) => self.split(cos).0,
            Fresnel::Tinted { f0, reflection, .. } => rough_dielectric(f0) * reflection,
            Fresnel::Dielectric if self.ior > 1.0 => {
                rough_dielectric(Vec3::splat(fresnel::f0_from_ior(self.ior)))
            }
            Fresnel::Dielectric => Vec3::splat(fresnel::dielectric(cos, self.ior).0),
            Fresnel::Conductor(..) => self.split(cos).0,
            Fresnel::Metal(metal, None) => metal.f0 + (1.0 - metal.f0) * energy::schlick_rise(roughness, cos),
        };
        (reflected, transmitted)
    }

    /// `f |cos|` and density for a pair of directions.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let wo = self.frame.local(wo);
        let wi = self.frame.local(wi);
        if wo.z <= 0.0 || wi.z == 0.0 || self.is_singular() {
            return (Vec3::ZERO, 0.0);
        }
        let is_transmission = wi.z < 0.0;
        if is_transmission && self.is_unbending() {
            return (Vec3::ZERO, 0.0);
        }
        let half = if is_transmission { wi * self.ior + wo } else { wi + wo };
        let Some(h) = half.try_normalize() else { return (Vec3::ZERO, 0.0) };
        let h = if h.z < 0.0 { -h } else { h };
        let (cos_o, cos_i) = (h.dot(wo), h.dot(wi));
        // A facet only joins directions on the sides that it has.
        if cos_o <= 0.0 || (cos_i < 0.0) != is_transmission {
            return (Vec3::ZERO, 0.0);
        }
        let (reflected, transmitted, _) = self.split(cos_o);
        let total = (reflected + transmitted).element_sum();
        let part = if is_transmission { transmitted } else { reflected };
        if part == Vec3::ZERO {
            return (Vec3::ZERO, 0.0);
        }
        let jacobian =
            if is_transmission { self.ior * self.ior * cos_o * -cos_i / half.length_squared() } else { 0.25 };
        let common = self.distribution.density(h) / wo.z * jacobian;
        let (lambda_o, lambda_i) = (self.distribution.lambda(wo), self.distribution.lambda(wi));
        let pdf = common * (part.element_sum() / total) / (1.0 + lambda_o);
        (part * (self.energy_scale * common / (1.0 + lambda_o + lambda_i)), pdf)
    }

    /// Chooses a direction; see [`ClosureSample`].
    pub fn sample(&self, wo_world: Vec3, sides: SideNormals, u: [f32; 3]) -> Option<ClosureSample> {
        let wo = self.frame.local(wo_world);
        if wo.z <= 0.0 {
            return None;
        }
        let is_smooth = self.is_singular();
        let h = if is_smooth { Vec3::Z } else { self.distribution.sample_visible(wo, [u[0], u[1]]) };
        let cos_o = h.dot(wo);
        if cos_o <= 0.0 {
            return None;
        }
        let (reflected, transmitted, cos_t) = self.split(cos_o);
        let total = (reflected + transmitted).element_sum();
        if total == 0.0 {
            return None;
        }
        let reflect_probability = reflected.element_sum() / total;
        let is_transmission = u[2] >= reflect_probability;
        let (wi, part, probability) = if is_transmission {
            let wi = h * (cos_o / self.ior - cos_t) - wo / self.ior;
            (wi, transmitted, 1.0 - reflect_probability)
        } else {
            (h * (2.0 * cos_o) - wo, reflected, reflect_probability)
        };
        let wi_world = self.frame.world(wi).normalize_or_zero();
        let reach = sides.reach(wi_world, is_transmission)?;
        if (wi.z < 0.0) != is_transmission {
            return None;
        }
        let lobe = if is_transmission { Lobe::Transmission } else { Lobe::Glossy };
        if is_smooth || (is_transmission && self.is_unbending()) {
            let value = part * self.energy_scale;
            let single = ClosureSample { wi: wi_world, value, pdf: probability, singular: true, lobe, reach };
            return (reach == SampleReach::Path).then_some(single);
        }
        let jacobian = if is_transmission {
            let cos_i = -h.dot(wi);
            let scaled = cos_i - cos_o / self.ior;
            cos_o * cos_i / (scaled * scaled)
        } else {
            0.25
        };
        let common = self.distribution.density(h) / wo.z * jacobian;
        let (lambda_o, lambda_i) = (self.distribution.lambda(wo), self.distribution.lambda(wi));
        Some(ClosureSample {
            wi: wi_world,
            value: part * (self.energy_scale * common / (1.0 + lambda_o + lambda_i)),
            pdf: common * probability / (1.0 + lambda_o),
            singular: false,
            lobe,
            reach,
        })
    }
}
