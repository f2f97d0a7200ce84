use glam::{Vec3, Vec4};
use relume_dump::Lobe;
use relume_scene::{BumpShadowing, MOST_RADIANCE};

use super::classes::{Classes, LightClass};
use super::closure::{Closure, Scatter, Sharpness};
use super::normal::Terminator;
use super::{BsdfSample, Interface, SampleReach, SideNormals};
use crate::{guide::Horizon, shading::SurfacePoint};

/// Most closures that one point keeps; further ones are dropped.
const MAX_CLOSURES: usize = 16;
/// Closures with a smaller mean weight are dropped (Cycles' `CLOSURE_WEIGHT_CUTOFF`).
pub const WEIGHT_CUTOFF: f32 = 1e-5;

/// Closures that diffuse rays see of the surfaces they hit (Cycles' caustics options).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caustics {
    /// Glossy reflection.
    pub reflective: bool,
    /// Refraction.
    pub refractive: bool,
}

impl Caustics {
    /// Everything is seen.
    pub const ALL: Self = Self { reflective: true, refractive: true };

    /// Remaining part of a closure; nothing if all of it is left out. A layer that is left out darkens none below it.
    fn filter(self, mut scatter: Scatter) -> Option<Scatter> {
        let is_seen = match &mut scatter {
            Scatter::AshikhminShirley(_) => self.reflective,
            Scatter::ThroughSheet(_) => self.refractive,
            Scatter::Toon(model) if model.is_glossy => self.reflective,
            Scatter::Microfacet(facets) => match facets.interface {
                Interface::Reflection => self.reflective,
                Interface::Refraction => self.refractive,
                Interface::Glass => {
                    facets.keep_sides(self.reflective, self.refractive);
                    self.reflective || self.refractive
                }
            },
            _ => true,
        };
        is_seen.then_some(scatter)
    }
}

/// The closures and the emission of one surface point. Reused from hit to hit: nothing is allocated.
#[derive(Clone, Debug)]
pub struct Surface {
    pub(super) closures: Vec<Closure>,
    wo: Vec3,
    sides: SideNormals,
    emission: Vec3,
    transparency: Vec3,
    holdout: Vec3,
    wavelength_weight: Option<Vec3>,
    caustics: Caustics,
    /// True if the path has scattered diffusely before it met the surface.
    pub(super) is_after_diffuse: bool,
    /// True if there is a [`Scatter::Subsurface`].
    pub(super) has_body: bool,
    pub(super) terminator: Terminator,
    /// Law of closures that are added from now on.
    bumps: BumpShadowing,
    /// True if one of the closures is hair.
    scatters_around: bool,
    /// Scratch for the values of shader nodes.
    values: Vec<Vec4>,
}

impl Default for Surface {
    fn default() -> Self {
        Self {
            closures: Vec::with_capacity(MAX_CLOSURES),
            wo: Vec3::Z,
            sides: SideNormals { geometric: Vec3::Z, shading: Vec3::Z },
            emission: Vec3::ZERO,
            transparency: Vec3::ZERO,
            holdout: Vec3::ZERO,
            wavelength_weight: None,
            caustics: Caustics::ALL,
            is_after_diffuse: false,
            has_body: false,
            terminator: Terminator::default(),
            bumps: BumpShadowing::default(),
            scatters_around: false,
            values: Vec::new(),
        }
    }
}

impl Surface {
    /// Sets what is seen of the closures that are added from now on.
    pub fn show(&mut self, caustics: Caustics) {
        self.caustics = caustics;
    }

    /// Sets whether the path has scattered diffusely before, for closures that are added from now on.
    pub(crate) fn set_after_diffuse(&mut self, is_after_diffuse: bool) {
        self.is_after_diffuse = is_after_diffuse;
    }

    /// Empties the surface and takes the frame of `point`.
    pub fn reset(&mut self, point: &SurfacePoint) {
        self.closures.clear();
        self.has_body = false;
        self.scatters_around = false;
        self.wo = point.wo;
        self.sides = SideNormals { geometric: point.horizon_normal(), shading: point.shading_normal };
        self.emission = Vec3::ZERO;
        self.transparency = Vec3::ZERO;
        self.holdout = Vec3::ZERO;
        self.wavelength_weight = None;
    }

    /// Takes the weight of a path whose wavelength counts here.
    pub(crate) fn take_wavelength(&mut self, weight: Vec3) {
        self.wavelength_weight = Some(weight);
    }

    /// Weight of a path whose wavelength counts here; nothing where all of them take the same way.
    pub(crate) fn wavelength_weight(&self) -> Option<Vec3> {
        self.wavelength_weight
    }

    /// Takes another shading normal than the mesh's (Cycles' `sd->N` behind bump by displacement): closures of that normal are
    /// not dimmed as bumped ones.
    pub(crate) fn take_normal(&mut self, normal: Vec3) {
        self.sides.shading = normal;
    }

    /// Unit shading normal.
    pub fn shading_normal(&self) -> Vec3 {
        self.sides.shading
    }

    /// Makes reflection end before the horizon, by Cycles' Shadow Terminator Shading Offset; 0 for there.
    pub fn end_before_horizon(&mut self, offset: f32) {
        self.terminator = Terminator::new(offset);
    }

    /// Sets how bent normals dim diffuse closures that are added from now on.
    pub(crate) fn shadow_bumps(&mut self, bumps: BumpShadowing) {
        self.bumps = bumps;
    }

    /// Adds a closure unless its weight is negligible or the surface is full; negative weights are taken for none.
    /// `albedo` is the model's own, see [`Closure::sample_weight`]. Returns whether it was added.
    pub fn add(&mut self, weight: Vec3, albedo: Vec3, normal: Vec3, scatter: Scatter) -> bool {
        if self.caustics != Caustics::ALL {
            return self.add_filtered(weight, albedo, normal, scatter);
        }
        self.push(weight, albedo, normal, scatter)
    }

    fn add_filtered(&mut self, weight: Vec3, albedo: Vec3, normal: Vec3, scatter: Scatter) -> bool {
        let Some(scatter) = self.caustics.filter(scatter) else { return false };
        let albedo = match &scatter {
            Scatter::Microfacet(model) if model.interface == Interface::Glass => {
                let (reflected, transmitted) = model.albedo(normal.dot(self.wo));
                reflected + transmitted
            }
            _ => albedo,
        };
        self.push(weight, albedo, normal, scatter)
    }

    fn push(&mut self, weight: Vec3, albedo: Vec3, normal: Vec3, scatter: Scatter) -> bool {
        let weight = weight.max(Vec3::ZERO);
        let mean = weight.element_sum() / 3.0;
        if !mean.is_finite() || mean < WEIGHT_CUTOFF || self.closures.len() == MAX_CLOSURES {
            return false;
        }
        let sample_weight = (weight * albedo).element_sum() / 3.0;
        let closure = Closure { weight, sample_weight, normal, scatter, bumps: self.bumps };
        self.scatters_around |= closure.scatters_around();
        self.closures.push(closure);
        true
    }

    /// Adds light that goes straight through.
    pub fn add_transparent(&mut self, weight: Vec3) {
        let weight = weight.max(Vec3::ZERO);
        let mean = weight.element_sum() / 3.0;
        if !mean.is_finite() || mean < WEIGHT_CUTOFF {
            return;
        }
        self.transparency += weight;
        let existing =
            self.closures.iter_mut().find(|closure| matches!(closure.scatter, Scatter::Transparent));
        if let Some(closure) = existing {
            closure.weight += weight;
            closure.sample_weight += mean;
        } else {
            self.add(weight, Vec3::ONE, self.sides.shading, Scatter::Transparent);
        }
    }

    /// Adds a hole in the film.
    pub fn add_holdout(&mut self, weight: f32) {
        self.holdout += Vec3::splat(weight.max(0.0));
    }

    /// Cuts what is held out from the surface, and tells how much that is: of a holdout object all but what goes straight
    /// through (Cycles' `surface_shader_apply_holdout`).
    pub(crate) fn hold_out(&mut self, is_holdout_object: bool) -> Vec3 {
        if !is_holdout_object {
            return self.holdout;
        }
        self.closures.retain(|closure| matches!(closure.scatter, Scatter::Transparent));
        (self.emission, self.has_body, self.scatters_around) = (Vec3::ZERO, false, false);
        Vec3::ONE - self.transparency
    }

    /// Unit direction back along the ray.
    pub fn wo(&self) -> Vec3 {
        self.wo
    }

    /// Hands out the scratch for `count` values of shader nodes, of undefined content.
    pub(crate) fn take_values(&mut self, count: usize) -> Vec<Vec4> {
        let mut values = std::mem::take(&mut self.values);
        if values.len() < count {
            values.resize(count, Vec4::ZERO);
        }
        values
    }

    /// Takes back what [`Self::take_values`] gave.
    pub(crate) fn give_values(&mut self, values: Vec<Vec4>) {
        self.values = values;
    }

    /// Adds emitted radiance, as far as it can be summed; what is not a finite number is left out.
    pub fn add_emission(&mut self, radiance: Vec3) {
        if radiance.is_finite() {
            self.emission = (self.emission + radiance).min(Vec3::splat(MOST_RADIANCE));
        }
    }

    /// Radiance emitted towards `wo`.
    pub fn emission(&self) -> Vec3 {
        self.emission
    }

    /// Weight of light that goes straight through.
    pub fn transparency(&self) -> Vec3 {
        self.transparency
    }

    /// Share of the paths that meet the surface and go straight through.
    pub fn straight_share(&self) -> f32 {
        let straight = self.transparency.element_sum() / 3.0;
        if straight > 0.0 { (straight / self.total_weight()).min(1.0) } else { 0.0 }
    }

    /// Chooses a closure and a direction from three numbers in 0..1; nothing if the path ends here. The density and
    /// the value are those of all closures together (one-sample model with the balance heuristic).
    pub fn sample(&self, u: [f32; 3]) -> Option<BsdfSample> {
        let total = self.total_weight();
        let (index, remapped) = self.choose(u[2], total)?;
        let closure = &self.closures[index];
        let probability = closure.sample_weight / total;
        let is_mixed = || self.is_mixed(index);
        let mut choice = closure.sample(self.sides, self.wo, [u[0], u[1], remapped], is_mixed)?;
        if !closure.scatters_around() {
            choice.value *= self.terminator.factor(closure.normal, choice.wi);
        }
        let mut classes = Classes::default();
        let value = closure.weight * choice.value;
        let mut pdf = choice.pdf * probability;
        let (weight, pdf) = if choice.singular {
            (value / pdf, pdf * BsdfSample::SINGULAR_PDF)
        } else {
            classes.add(value, closure.light_lobe(choice.wi));
            for (other, closure) in self.closures.iter().enumerate() {
                if other != index {
                    let (value, density) = self.eval_closure(closure, choice.wi);
                    classes.add(closure.weight * value, closure.light_lobe(choice.wi));
                    pdf += density * (closure.sample_weight / total);
                }
            }
            (classes.sum() / pdf, pdf)
        };
        let is_valid = weight.is_finite() && weight.max_element() > 0.0 && pdf > 0.0;
        if !is_valid {
            return None;
        }
        let light = if choice.singular {
            LightClass::of(choice.lobe)
        } else {
            // The low bits of a number that chose the direction are as good as a number of their own.
            classes.choose(u[0])
        };
        Some(BsdfSample {
            wi: choice.wi,
            weight,
            pdf,
            lobe: choice.lobe,
            light,
            diffuse: closure.is_diffuse(),
            singular: choice.singular,
            alpha_squared: closure.alpha_squared(),
            transparent: matches!(closure.scatter, Scatter::Transparent),
            portal: closure.portal().map(|portal| portal.position),
            lights_only: choice.reach == SampleReach::Lights,
            unlit: choice.reach == SampleReach::Unlit,
        })
    }

    /// Sample that [`Surface::sample`] gives where it happens to choose `wi`: a number in 0..1 picks the closure, each
    /// as often as there. Nothing if the path ends then.
    pub(crate) fn sample_towards(&self, wi: Vec3, u: f32) -> Option<BsdfSample> {
        let total = self.total_weight();
        let mut densities = [0.0; MAX_CLOSURES];
        let mut classes = Classes::default();
        for (closure, density) in self.closures.iter().zip(&mut densities) {
            let (value, pdf) = self.eval_closure(closure, wi);
            classes.add(closure.weight * value, closure.light_lobe(wi));
            *density = pdf * (closure.sample_weight / total);
        }
        let pdf: f32 = densities.iter().sum();
        let value = classes.sum();
        let is_valid = value.is_finite() && value.max_element() > 0.0 && pdf > 0.0;
        if !is_valid {
            return None;
        }
        let mut rest = u * pdf;
        let is_chosen = |(_, density): &(&Closure, &f32)| {
            rest -= **density;
            **density > 0.0 && rest < 0.0
        };
        let mut candidates = self.closures.iter().zip(&densities);
        // Rounding may leave a rest after the last one.
        let (closure, density) =
            candidates.clone().find(is_chosen).or_else(|| candidates.rfind(|(_, d)| **d > 0.0))?;
        let (lobe, reach) = if let Scatter::Hair(hair) = &closure.scatter {
            (hair.eval(wi).lobe(1.0 + rest / density), SampleReach::Path)
        } else {
            let lobe = closure.lobe_towards(wi);
            (lobe, closure.reach(self.sides, wi, lobe == Lobe::Transmission)?)
        };
        Some(BsdfSample {
            wi,
            weight: value / pdf,
            pdf,
            lobe,
            light: classes.choose(u),
            diffuse: closure.is_diffuse(),
            singular: false,
            alpha_squared: closure.alpha_squared(),
            transparent: false,
            portal: None,
            lights_only: reach == SampleReach::Lights,
            unlit: false,
        })
    }

    /// Share of the choices of [`Surface::sample`] that fall on closures whose directions have a density; 0 where one has a
    /// density on one of its sides alone.
    pub(crate) fn dull_share(&self) -> f32 {
        let (mut dull, total) = (0.0, self.total_weight());
        for closure in &self.closures {
            match closure.sharpness() {
                Sharpness::Dull => dull += closure.sample_weight,
                Sharpness::Singular => {}
                Sharpness::Both => return 0.0,
            }
        }
        if total > 0.0 { dull / total } else { 0.0 }
    }

    /// True if some of its directions are drawn from a guide: not where mirrors and glass find the light by themselves.
    pub(crate) fn is_guided(&self) -> bool {
        !self.is_specular() && self.dull_share() > 0.0
    }

    /// Horizon below which no light comes in: a surface that does not transmit gets none from below both of its
    /// normals.
    pub(crate) fn horizon(&self) -> Horizon {
        let transmits = self.closures.iter().any(Closure::transmits);
        Horizon((!transmits).then_some([self.sides.geometric, self.sides.shading]))
    }

    /// True if the closure that the third of [`Surface::sample`]'s numbers chooses has no density.
    pub(crate) fn chooses_singular(&self, u: f32) -> bool {
        let total = self.total_weight();
        let chosen = self.choose(u, total);
        chosen.is_none_or(|(index, _)| self.closures[index].sharpness() != Sharpness::Dull)
    }

    /// `f |cos|` of all closures that are not singular for light from `wi`, and the density with which
    /// [`Surface::sample`] chooses `wi` (before it rejects directions on the wrong side of the geometry).
    pub fn eval(&self, wi: Vec3) -> (Vec3, f32) {
        let total = self.total_weight();
        let mut sum = (Vec3::ZERO, 0.0);
        if total == 0.0 {
            return sum;
        }
        for closure in &self.closures {
            let (value, pdf) = self.eval_closure(closure, wi);
            sum.0 += closure.weight * value;
            sum.1 += pdf * (closure.sample_weight / total);
        }
        sum
    }

    /// [`Closure::eval`] of one of them.
    #[inline]
    fn eval_closure(&self, closure: &Closure, wi: Vec3) -> (Vec3, f32) {
        self.viewpoint().eval(closure, self.sides.shading, wi)
    }

    /// True if other closures than this one have densities.
    fn is_mixed(&self, index: usize) -> bool {
        let others = self.closures.iter().enumerate().filter(|(other, _)| *other != index);
        others.into_iter().any(|(_, closure)| closure.sharpness() != Sharpness::Singular)
    }

    /// True if light also comes from between the surface's normals, as to hair.
    pub(crate) fn scatters_around(&self) -> bool {
        self.scatters_around
    }

    /// Estimate of the surface's albedo, for the denoiser; what goes straight through is not part of it.
    pub fn albedo(&self) -> Vec3 {
        let own = self.closures.iter().filter(|closure| !matches!(closure.scatter, Scatter::Transparent));
        own.map(|closure| closure.albedo(self.wo)).sum::<Vec3>().min(Vec3::ONE)
    }

    /// Mean shading normal of the closures, for the denoiser.
    pub fn normal(&self) -> Vec3 {
        let sum: Vec3 = self.closures.iter().map(|closure| closure.normal * closure.sample_weight).sum();
        sum.normalize_or(self.sides.shading)
    }

    /// True if the surface is mostly a mirror or clear glass, so that the denoiser should look behind it: three
    /// quarters or more of the weight scatter with an alpha below 0.075, as Cycles decides for its denoising passes.
    pub fn is_specular(&self) -> bool {
        let mut total = 0.0;
        let mut rough = 0.0;
        for closure in &self.closures {
            total += closure.sample_weight;
            if closure.roughness().powi(2) > 0.075 {
                rough += closure.sample_weight;
            }
        }
        total > 0.0 && rough * 4.0 <= total
    }

    /// Raises rarely sampled closures to an eighth of the choices each (Cycles' defensive sampling, for the first
    /// surface of a path): highlights of dull reflections become less noisy.
    pub fn sample_defensively(&mut self) {
        let total = self.total_weight();
        for closure in &mut self.closures {
            closure.sample_weight = closure.sample_weight.max(0.125 * total);
        }
    }

    /// Makes glossy closures at least as wide as `alpha` (Cycles' Filter Glossy).
    pub fn blur(&mut self, alpha: f32) {
        for closure in &mut self.closures {
            closure.widen(alpha);
        }
    }

    pub(super) fn total_weight(&self) -> f32 {
        self.closures.iter().map(|closure| closure.sample_weight).sum()
    }

    /// The closure that `u` falls on, and `u` stretched over it to 0..1.
    pub(super) fn choose(&self, u: f32, total: f32) -> Option<(usize, f32)> {
        let mut rest = u * total;
        let last = self.closures.len().checked_sub(1)?;
        for (index, closure) in self.closures.iter().enumerate() {
            if rest < closure.sample_weight || index == last {
                return Some((index, (rest / closure.sample_weight).clamp(0.0, 1.0 - f32::EPSILON)));
            }
            rest -= closure.sample_weight;
        }
        None
    }
}
