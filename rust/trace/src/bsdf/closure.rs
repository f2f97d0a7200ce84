use glam::Vec3;
use relume_dump::Lobe;
use relume_scene::BumpShadowing;

use super::frame::{cosine_pdf, sample_cosine};
use super::normal::{SampleReach, SideNormals, bump_shadowing};
use super::{AshikhminShirley, Bssrdf, Hair, Interface, Microfacet, OrenNayar, Sheen, Toon, Velvet};

/// One way in which a surface scatters, and how much of it there is.
#[derive(Clone, Copy, Debug)]
pub struct Closure {
    /// Factor on the model's value.
    pub weight: Vec3,
    /// Relative probability of being sampled: the mean of `weight`, times what the model reflects or transmits.
    pub sample_weight: f32,
    /// Unit normal of the model.
    pub normal: Vec3,
    /// The model.
    pub scatter: Scatter,
    /// Dimming of what it reflects diffusely about a bent normal.
    pub bumps: BumpShadowing,
}

/// Scattering models, white.
#[derive(Clone, Copy, Debug)]
pub enum Scatter {
    /// Lambert's diffuse reflection.
    Diffuse,
    /// Rough diffuse reflection.
    OrenNayar(OrenNayar),
    /// Lambert's law on the other side.
    Translucent,
    /// Rough diffuse scattering to the other side.
    RoughTranslucent(OrenNayar),
    /// Facets of a sheet, whose reflection is mirrored to the other side.
    ThroughSheet(Microfacet),
    /// Straight through.
    Transparent,
    /// To another place.
    Portal(Portal),
    /// Reflection and refraction by facets.
    Microfacet(Microfacet),
    /// Phong-like reflection.
    AshikhminShirley(AshikhminShirley),
    /// Cloth.
    Sheen(Sheen),
    /// Velvet.
    Velvet(Velvet),
    /// A cone of light, about the normal or the mirror direction.
    Toon(Toon),
    /// Into the body behind the surface: the path goes on where it leaves that, so that no direction is sampled.
    Subsurface(Bssrdf),
    /// Fibre, which scatters to all sides. Its normal is not consulted.
    Hair(Hair),
}

/// Place and direction in which rays go on.
#[derive(Clone, Copy, Debug)]
pub struct Portal {
    /// World space.
    pub position: Vec3,
    /// Unit direction.
    pub direction: Vec3,
}

/// A direction that one closure chose. `value` is its `f |cos|` without the closure's weight and `pdf` its density;
/// for a `singular` one, the closure's reflectance and the probability of the choice.
#[derive(Clone, Copy, Debug)]
pub struct ClosureSample {
    /// Unit direction.
    pub wi: Vec3,
    /// See above.
    pub value: Vec3,
    /// See above.
    pub pdf: f32,
    /// True if the direction has no density.
    pub singular: bool,
    /// Class of the direction.
    pub lobe: Lobe,
    /// Reach of the direction.
    pub reach: SampleReach,
}

/// Density of a closure's directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sharpness {
    /// Every direction has one.
    Dull,
    /// No direction has one.
    Singular,
    /// Reflected directions have one, transmitted ones go straight on.
    Both,
}

impl Closure {
    /// `f |cos|` without the weight, and density. `smooth` is the surface's shading normal before any bump.
    pub fn eval(&self, smooth: Vec3, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        match &self.scatter {
            Scatter::Diffuse => {
                let pdf = cosine_pdf(self.normal.dot(wi));
                (Vec3::splat(pdf * self.shadowing(smooth, wi)), pdf)
            }
            Scatter::OrenNayar(model) => {
                (model.eval(wo, wi) * self.shadowing(smooth, wi), cosine_pdf(self.normal.dot(wi)))
            }
            Scatter::Translucent => {
                let pdf = cosine_pdf(-self.normal.dot(wi));
                (Vec3::splat(pdf), pdf)
            }
            Scatter::RoughTranslucent(model) => {
                (model.eval(wo, self.mirrored(wi)), cosine_pdf(-self.normal.dot(wi)))
            }
            Scatter::ThroughSheet(model) => model.eval(wo, self.mirrored(wi)),
            Scatter::Transparent | Scatter::Portal(_) | Scatter::Subsurface(_) => (Vec3::ZERO, 0.0),
            Scatter::Microfacet(model) => model.eval(wo, wi),
            Scatter::AshikhminShirley(model) => {
                let (value, pdf) = model.eval(wo, wi);
                (Vec3::splat(value), pdf)
            }
            Scatter::Sheen(model) => {
                let pdf = model.pdf(wi);
                (Vec3::splat(pdf * self.shadowing(smooth, wi)), pdf)
            }
            Scatter::Velvet(model) => {
                let (value, pdf) = model.eval(wo, wi);
                (Vec3::splat(value * self.shadowing(smooth, wi)), pdf)
            }
            Scatter::Toon(_) if self.normal.dot(wi) <= 0.0 => (Vec3::ZERO, 0.0),
            Scatter::Toon(model) => {
                let (value, pdf) = model.eval(wi);
                let shadowing = if model.is_glossy { 1.0 } else { self.shadowing(smooth, wi) };
                (Vec3::splat(value * shadowing), pdf)
            }
            Scatter::Hair(model) => {
                let response = model.eval(wi);
                (response.value(), response.pdf())
            }
        }
    }

    /// Chooses a direction; nothing if it is on the wrong side of the surface. `is_mixed` if other closures have densities.
    pub fn sample(
        &self,
        sides: SideNormals,
        wo: Vec3,
        u: [f32; 3],
        is_mixed: impl FnOnce() -> bool,
    ) -> Option<ClosureSample> {
        let (wi, lobe, singular) = match &self.scatter {
            Scatter::Microfacet(model) => return model.sample(wo, sides, u),
            Scatter::ThroughSheet(model) => {
                let [geometric, shading] =
                    [sides.geometric, sides.shading].map(|normal| -self.mirrored(normal));
                let sample = model.sample(wo, SideNormals { geometric, shading }, u)?;
                let wi = self.mirrored(sample.wi);
                return Some(ClosureSample { wi, lobe: Lobe::Transmission, ..sample });
            }
            Scatter::Subsurface(_) => return None,
            Scatter::Hair(model) => {
                let (wi, lobe, response) = model.sample(u, is_mixed())?;
                let (value, pdf) = (response.value(), response.pdf());
                let reach = if model.is_lit(wi) { SampleReach::Path } else { SampleReach::Unlit };
                return Some(ClosureSample { wi, value, pdf, singular: false, lobe, reach });
            }
            Scatter::Transparent | Scatter::Portal(_) => {
                let wi = self.portal().map_or(-wo, |portal| portal.direction);
                return Some(ClosureSample {
                    wi,
                    value: Vec3::ONE,
                    pdf: 1.0,
                    singular: true,
                    lobe: Lobe::Transmission,
                    reach: SampleReach::Path,
                });
            }
            Scatter::Diffuse | Scatter::OrenNayar(_) => {
                (sample_cosine(self.normal, [u[0], u[1]]), Lobe::Diffuse, false)
            }
            Scatter::Translucent | Scatter::RoughTranslucent(_) => {
                (sample_cosine(-self.normal, [u[0], u[1]]), Lobe::Transmission, false)
            }
            Scatter::AshikhminShirley(model) => {
                (model.sample(wo, [u[0], u[1]])?, Lobe::Glossy, model.is_singular())
            }
            Scatter::Sheen(model) => (model.sample([u[0], u[1]]), Lobe::Diffuse, false),
            Scatter::Velvet(model) => (model.sample([u[0], u[1]]), Lobe::Diffuse, false),
            Scatter::Toon(model) => (model.sample([u[0], u[1]]), toon_lobe(model), false),
        };
        let reach = self.reach(sides, wi, lobe == Lobe::Transmission)?;
        if singular {
            let mirrored = ClosureSample { wi, value: Vec3::ONE, pdf: 1.0, singular, lobe, reach };
            return (reach == SampleReach::Path).then_some(mirrored);
        }
        let (value, pdf) = self.eval(sides.shading, wo, wi);
        (pdf > 0.0).then_some(ClosureSample { wi, value, pdf, singular, lobe, reach })
    }

    /// Estimate of the light that the closure reflects and transmits out of uniform light, weight included.
    pub fn albedo(&self, wo: Vec3) -> Vec3 {
        match &self.scatter {
            Scatter::Microfacet(model) => {
                let (reflected, transmitted) = model.albedo(self.normal.dot(wo));
                self.weight * (reflected + transmitted)
            }
            Scatter::Hair(model) => self.weight * model.albedo(),
            _ => self.weight,
        }
    }

    /// The portal that it is.
    pub(crate) fn portal(&self) -> Option<Portal> {
        if let Scatter::Portal(portal) = self.scatter { Some(portal) } else { None }
    }

    /// Class that lights along `wi` are collected under, as Cycles parts closures where it samples lights: translucent ones are
    /// diffuse, and Principled Hair is glossy, in all directions.
    pub fn light_lobe(&self, wi: Vec3) -> Lobe {
        let transmission = |is_rough| if is_rough { Lobe::RoughTransmission } else { Lobe::Transmission };
        match &self.scatter {
            Scatter::Microfacet(model) if self.normal.dot(wi) < 0.0 => transmission(model.is_rough()),
            Scatter::Microfacet(model) if model.is_rough() => Lobe::RoughGlossy,
            Scatter::ThroughSheet(model) => transmission(model.is_rough()),
            Scatter::Transparent | Scatter::Portal(_) => Lobe::Transmission,
            Scatter::Hair(Hair::Chiang(_) | Hair::Huang(_)) => Lobe::RoughGlossy,
            Scatter::Hair(Hair::Lobe(model)) => model.light_lobe(),
            _ if self.is_diffuse() => Lobe::Diffuse,
            _ => Lobe::Glossy,
        }
    }

    /// True if lights along some directions that have a density are collected under a lobe of [`Lobe::CONNECTED`].
    pub fn is_connected_by(&self, lobe: Lobe) -> bool {
        match (lobe, &self.scatter) {
            (Lobe::Diffuse, _) => self.is_diffuse(),
            (Lobe::RoughGlossy, Scatter::Microfacet(model)) => {
                model.interface != Interface::Refraction && model.is_rough()
            }
            (Lobe::RoughGlossy, Scatter::Hair(model)) => !matches!(model, Hair::Lobe(_)),
            (Lobe::RoughTransmission, Scatter::Microfacet(model)) => {
                model.interface != Interface::Reflection && !model.is_unbending() && model.is_rough()
            }
            (Lobe::RoughTransmission, Scatter::ThroughSheet(model)) => model.is_rough(),
            _ => false,
        }
    }

    /// True if lights are connected to it.
    pub fn is_connected(&self) -> bool {
        Lobe::CONNECTED.into_iter().any(|lobe| self.is_connected_by(lobe))
    }

    /// True if it scatters to all sides, whatever the surface's normals are.
    pub fn scatters_around(&self) -> bool {
        matches!(self.scatter, Scatter::Hair(_))
    }

    /// True if it is diffuse, on either side of the surface.
    pub fn is_diffuse(&self) -> bool {
        match &self.scatter {
            Scatter::Diffuse | Scatter::OrenNayar(_) | Scatter::Sheen(_) | Scatter::Velvet(_) => true,
            Scatter::Translucent | Scatter::RoughTranslucent(_) => true,
            Scatter::Toon(model) => !model.is_glossy,
            _ => false,
        }
    }

    pub(crate) fn sharpness(&self) -> Sharpness {
        match &self.scatter {
            Scatter::Transparent | Scatter::Portal(_) | Scatter::Subsurface(_) => Sharpness::Singular,
            Scatter::AshikhminShirley(model) if model.is_singular() => Sharpness::Singular,
            Scatter::Microfacet(model) | Scatter::ThroughSheet(model) if model.is_singular() => {
                Sharpness::Singular
            }
            Scatter::Microfacet(model)
                if model.interface != Interface::Reflection && model.is_unbending() =>
            {
                Sharpness::Both
            }
            _ => Sharpness::Dull,
        }
    }

    /// True if some directions that have a density lead to the other side.
    pub(crate) fn transmits(&self) -> bool {
        match &self.scatter {
            Scatter::Translucent | Scatter::RoughTranslucent(_) => true,
            Scatter::ThroughSheet(_) | Scatter::Hair(_) => true,
            Scatter::Microfacet(model) => model.interface != Interface::Reflection,
            _ => false,
        }
    }

    /// Class of `wi` where this closure scatters there. Of hair, which scatters in more than one there, what is reflected.
    pub(crate) fn lobe_towards(&self, wi: Vec3) -> Lobe {
        match &self.scatter {
            Scatter::Microfacet(_) if self.normal.dot(wi) < 0.0 => Lobe::Transmission,
            Scatter::Microfacet(_) | Scatter::AshikhminShirley(_) | Scatter::Hair(_) => Lobe::Glossy,
            Scatter::Translucent | Scatter::RoughTranslucent(_) => Lobe::Transmission,
            Scatter::ThroughSheet(_) | Scatter::Transparent | Scatter::Portal(_) => Lobe::Transmission,
            Scatter::Toon(model) => toon_lobe(model),
            Scatter::Diffuse | Scatter::OrenNayar(_) | Scatter::Subsurface(_) => Lobe::Diffuse,
            Scatter::Sheen(_) | Scatter::Velvet(_) => Lobe::Diffuse,
        }
    }

    /// Perceptual roughness: 1 for diffuse closures, 0 for what does not blur.
    pub fn roughness(&self) -> f32 {
        match &self.scatter {
            Scatter::Microfacet(model) | Scatter::ThroughSheet(model) => model.roughness(),
            Scatter::AshikhminShirley(model) => model.roughness(),
            Scatter::Transparent | Scatter::Portal(_) => 0.0,
            _ => 1.0,
        }
    }

    /// Product of the two widths of facets, 0 for smooth ones and 1 for other models (Cycles'
    /// `bsdf_get_specular_roughness_squared`).
    pub fn alpha_squared(&self) -> f32 {
        match &self.scatter {
            Scatter::Microfacet(model) if model.is_singular() => 0.0,
            Scatter::Microfacet(model) => model.distribution.alpha_x * model.distribution.alpha_y,
            _ => 1.0,
        }
    }

    /// Widens glossy models to at least `alpha`.
    pub fn widen(&mut self, alpha: f32) {
        match &mut self.scatter {
            Scatter::Microfacet(model) | Scatter::ThroughSheet(model) => {
                model.distribution.alpha_x = model.distribution.alpha_x.max(alpha);
                model.distribution.alpha_y = model.distribution.alpha_y.max(alpha);
            }
            Scatter::AshikhminShirley(model) => model.widen(alpha),
            Scatter::Hair(model) => model.widen(alpha),
            _ => {}
        }
    }

    /// [`SideNormals::reach`]. A translucent closure whose normal is turned away from the ray is lit from the ray's side: as in
    /// Cycles, by lights alone.
    pub(super) fn reach(&self, sides: SideNormals, wi: Vec3, transmission: bool) -> Option<SampleReach> {
        let is_lit = || {
            matches!(self.scatter, Scatter::Translucent | Scatter::RoughTranslucent(_))
                && sides.shading.dot(self.normal) < 0.0
                && self.shadowing(sides.shading, wi) > 0.0
        };
        sides.reach(wi, transmission).or_else(|| is_lit().then_some(SampleReach::Lights))
    }

    /// True if light from the unit direction `wi` counts: a sample might go there ([`Self::reach`]).
    pub(crate) fn is_lit(&self, sides: SideNormals, wi: Vec3) -> bool {
        self.scatters_around() || self.reach(sides, wi, self.lobe_towards(wi) == Lobe::Transmission).is_some()
    }

    /// A direction mirrored in the surface: what goes through a sheet is what a mirror in it would reflect.
    fn mirrored(&self, direction: Vec3) -> Vec3 {
        direction - self.normal * (2.0 * self.normal.dot(direction))
    }

    fn shadowing(&self, smooth: Vec3, wi: Vec3) -> f32 {
        bump_shadowing(self.bumps, smooth, self.normal, wi)
    }
}

fn toon_lobe(model: &Toon) -> Lobe {
    if model.is_glossy { Lobe::Glossy } else { Lobe::Diffuse }
}
