//! Light-guided sampling: paths are drawn more often towards where the file's lights stand.
//!
//! A share of the directions is drawn towards the lights (points of area lights, cones around others) instead of from the BSDF,
//! and every direction is weighted by the density of both ways together (one-sample model with the balance heuristic; Veach
//! 1997, section 9.2.4). So paths stay right for any light whatever, and those lights that stand near these are met far more
//! often than by chance: a bulb of 5 cm radius in 3 m distance fills 1/7200 of a hemisphere. Lights that chance meets often
//! enough are left to it.

mod plate;
mod target;

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use relume_scene::{Light, LightShape};

use self::target::{GuideTarget, Narrow, brightness, height};
use crate::bsdf::ShadingFrame;
use crate::settings::MOST_GUIDING;

/// Most guide targets: each costs some arithmetic at every vertex.
const MOST_LIGHTS: usize = 32;
/// Height of the cone from which on a light is left to chance: a solid angle of 0.6.
const LARGE: f32 = 0.1;
/// Least of a light's second cone, which is four times as wide as the light, for lights that are moved a little; 5 degrees.
const WIDE: f32 = 1.0 / 144.0;

/// Lights that directions are guided to.
#[derive(Clone, Debug)]
pub struct Guide {
    /// Most of the directions that are drawn from cones.
    share: f32,
    targets: Vec<GuideTarget>,
}

/// Share of the directions from a matt surface that faces a light which meet it if nothing is in between, with paths that look
/// for what `guide` says. Nothing where the light does not shine to.
pub fn hit_probability(guide: Option<&Guide>, point: Vec3, light: &Light) -> Option<f32> {
    let target = GuideTarget::new(light);
    let seen = target.seen_from(point);
    let mut cones = Cones::default();
    if let Some(guide) = guide {
        guide.fill_cones(point, Horizon::default(), &mut cones);
    }
    let density = (1.0 - cones.share) / PI + cones.share * cones.density(seen.axis);
    let shines = target.beam.reaches(-seen.axis);
    shines.then(|| (TAU * seen.height * density).min(1.0))
}

/// The lights as one point sees them. Reused from point to point: nothing is allocated.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cones {
    lobes: Vec<GuideLobe>,
    /// Share of the directions that are drawn from them, below 1; 0 where chance does as well.
    pub share: f32,
}

/// Directions to a light, and a cone that holds them. A cone is told by its height, 1 less the cosine of its half angle, which
/// stays precise where cosines are all 1.
#[derive(Clone, Copy, Debug)]
struct GuideLobe {
    axis: Vec3,
    narrow: Narrow,
    /// Height of the cone.
    wide: f32,
    /// Probability that one of them is drawn from, where any is; both alike.
    probability: f32,
}

impl Guide {
    /// Guides a share of the directions to the strongest of these lights, at most [`MOST_GUIDING`]; suns go first, since
    /// their power is told in another unit. Nothing if there are no lights or nothing is to be drawn from them.
    pub fn new(lights: &[Light], share: f32) -> Option<Self> {
        let is_sun = |light: &Light| matches!(light.shape, LightShape::Sun { .. });
        let power = |light: &Light| brightness(light) * light.shape.extent();
        let mut strongest: Vec<&Light> = lights.iter().collect();
        strongest.sort_by(|a, b| is_sun(b).cmp(&is_sun(a)).then(power(b).total_cmp(&power(a))));
        let targets: Vec<GuideTarget> =
            strongest.into_iter().take(MOST_LIGHTS).map(GuideTarget::new).collect();
        (share > 0.0 && !targets.is_empty()).then_some(Self { share: share.min(MOST_GUIDING), targets })
    }

    /// Makes `cones` those that are seen from a point above its horizon.
    pub(crate) fn fill_cones(&self, point: Vec3, horizon: Horizon, cones: &mut Cones) {
        cones.lobes.clear();
        let (mut all, mut guided) = (0.0, 0.0);
        for target in &self.targets {
            let seen = target.seen_from(point);
            if !target.beam.reaches(-seen.axis) || horizon.hides(seen.axis, seen.sine_squared) {
                continue;
            }
            // Irradiance is what a light matters by here; by its root, so that weak lights can be turned up later.
            let weight = (target.brightness * seen.height).sqrt();
            let probability = weight * (1.0 - seen.height / LARGE).max(0.0);
            all += weight;
            if probability > 0.0 {
                guided += probability;
                let wide = height((32.0 * seen.height).max(seen.sine_squared).clamp(WIDE, 1.0));
                cones.lobes.push(GuideLobe { axis: seen.axis, narrow: seen.narrow, wide, probability });
            }
        }
        cones.lobes.iter_mut().for_each(|lobe| lobe.probability /= guided);
        cones.share = if guided > 0.0 { self.share * guided / all } else { 0.0 };
    }
}

/// Normals below which a surface gets no light: nothing comes in from below both of them. By default, everything
/// counts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Horizon(pub Option<[Vec3; 2]>);

impl Horizon {
    /// True if a cone of less than a half-space is all below.
    fn hides(self, axis: Vec3, sine_squared: f32) -> bool {
        self.0.is_some_and(|normals| {
            let is_below = |normal: Vec3| {
                let cos = normal.dot(axis);
                cos < 0.0 && cos * cos > sine_squared
            };
            normals.into_iter().all(is_below)
        })
    }
}

impl Cones {
    /// A direction from three numbers in 0..1. There has to be a cone.
    pub fn sample(&self, u: [f32; 3]) -> Vec3 {
        let mut rest = u[0];
        let mut chosen = &self.lobes[0];
        for lobe in &self.lobes {
            chosen = lobe;
            if rest < lobe.probability {
                break;
            }
            rest -= lobe.probability;
        }
        let u = [u[1], u[2]];
        if rest >= 0.5 * chosen.probability {
            return sample_cone(chosen.axis, chosen.wide, u);
        }
        match chosen.narrow {
            Narrow::Cone(height) => sample_cone(chosen.axis, height, u),
            Narrow::Plate { to_center, plate } => (to_center + plate.sample(u)).normalize_or(chosen.axis),
        }
    }

    /// Density of a direction from a vertex that draws the share of these cones from them, and the rest with the density `pdf`. Choices of
    /// mirrors stay choices of mirrors: `dull_share` is that of the others, see [`crate::bsdf::Surface::dull_share`].
    pub fn pdf_with(&self, dull_share: f32, pdf: f32, wi: Vec3) -> f32 {
        (1.0 - self.share) * pdf + self.share * dull_share * self.density(wi)
    }

    /// Density of [`Cones::sample`] over solid angle.
    fn density(&self, direction: Vec3) -> f32 {
        let mut sum = 0.0;
        for lobe in &self.lobes {
            // Of two unit vectors: 1 less their cosine.
            let apart = 0.5 * (direction - lobe.axis).length_squared();
            let narrow = match &lobe.narrow {
                Narrow::Cone(height) if apart <= *height => 1.0 / (TAU * height),
                Narrow::Cone(_) => 0.0,
                Narrow::Plate { to_center, plate } => plate.density(*to_center, direction),
            };
            let wide = if apart <= lobe.wide { 1.0 / (TAU * lobe.wide) } else { 0.0 };
            sum += lobe.probability * 0.5 * (narrow + wide);
        }
        sum
    }
}

fn sample_cone(axis: Vec3, height: f32, u: [f32; 2]) -> Vec3 {
    let height = u[0] * height;
    let sine = (height * (2.0 - height)).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
    let local = Vec3::new(sine * cos_phi, sine * sin_phi, 1.0 - height);
    ShadingFrame::from_normal(axis).world(local).normalize_or(axis)
}

#[cfg(test)]
mod tests;
