//! Reflection of a surface that lights are connected to, apart from the rest: the closures of [`relume_dump::Lobe::CONNECTED`].

use glam::Vec3;
use relume_dump::Lobe;
use relume_scene::BumpShadowing;

use super::normal::{Terminator, bump_shadowing};
use super::{Closure, Microfacet, Scatter, Surface};

/// Diffuse reflection of a surface.
#[derive(Clone, Debug)]
pub(crate) enum DiffusePart {
    /// Lambert's law about one normal: `weight` is the sum of the closures' weights.
    Lambert { weight: Vec3, normal: Vec3, bumps: BumpShadowing },
    /// Other laws, or several normals.
    Closures(Box<[Closure]>),
}

/// Values that reflection depends on, besides closures and the normals of both sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viewpoint {
    /// Unit direction back along the path.
    pub wo: Vec3,
    terminator: Terminator,
}

impl Viewpoint {
    /// `f |cos|` of a closure for light from the unit direction `wi`, weight included.
    pub fn eval(&self, closure: &Closure, shading_normal: Vec3, wi: Vec3) -> Vec3 {
        let (value, _) = closure.eval(shading_normal, self.wo, wi);
        closure.weight * value * self.terminator.factor(closure.normal, wi)
    }

    /// `f |cos|` of facets of weight 1.
    pub fn eval_facets(&self, facets: &Microfacet, wi: Vec3) -> Vec3 {
        let (value, _) = facets.eval(self.wo, wi);
        value * self.terminator.factor(facets.frame.normal(), wi)
    }
}

impl Surface {
    /// Its diffuse reflection; nothing if it has none.
    pub(crate) fn diffuse_part(&self) -> Option<DiffusePart> {
        let reflects = |closure: &&Closure| {
            let is_behind = matches!(closure.scatter, Scatter::Translucent | Scatter::RoughTranslucent(_));
            closure.is_diffuse() && !is_behind
        };
        let closures = self.closures.iter().filter(reflects);
        let Closure { normal, bumps, .. } = *closures.clone().next()?;
        let is_lambert =
            |closure: &Closure| matches!(closure.scatter, Scatter::Diffuse) && closure.normal == normal;
        if self.terminator.is_at_horizon() && closures.clone().all(is_lambert) {
            return Some(DiffusePart::Lambert {
                weight: closures.map(|closure| closure.weight).sum(),
                normal,
                bumps,
            });
        }
        Some(DiffusePart::Closures(closures.copied().collect()))
    }

    /// Weights and facets of its rough gloss.
    pub(crate) fn rough_gloss(&self) -> impl Iterator<Item = (Vec3, &Microfacet)> {
        self.closures.iter().filter_map(|closure| match &closure.scatter {
            Scatter::Microfacet(facets) if closure.reflected_lobe() == Lobe::RoughGlossy => {
                Some((closure.weight, facets))
            }
            _ => None,
        })
    }

    /// Values that its reflection depends on.
    pub(crate) fn viewpoint(&self) -> Viewpoint {
        Viewpoint { wo: self.wo(), terminator: self.terminator }
    }
}

/// `f |cos|` of Lambert's law of reflectance 1 about `normal`, which may be bent from the surface's `shading_normal`.
pub(crate) fn lambert(bumps: BumpShadowing, shading_normal: Vec3, normal: Vec3, wi: Vec3) -> f32 {
    normal.dot(wi).max(0.0) * std::f32::consts::FRAC_1_PI * bump_shadowing(bumps, shading_normal, normal, wi)
}
