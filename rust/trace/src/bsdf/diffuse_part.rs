//! Diffuse reflection of a surface apart from the rest: the closures of [`relume_dump::Lobe::Diffuse`].

use glam::Vec3;
use relume_scene::BumpShadowing;

use super::normal::{Terminator, bump_shadowing};
use super::{Closure, Scatter, Surface};

/// Diffuse reflection of a surface.
#[derive(Clone, Debug)]
pub(crate) enum DiffusePart {
    /// Lambert's law about one normal: `weight` is the sum of the closures' weights.
    Lambert { weight: Vec3, normal: Vec3, bumps: BumpShadowing },
    /// Other laws, or several normals.
    Closures(DiffuseClosures),
}

/// Closures of diffuse reflection, with what they depend on.
#[derive(Clone, Debug)]
pub(crate) struct DiffuseClosures {
    closures: Box<[Closure]>,
    wo: Vec3,
    shading_normal: Vec3,
    terminator: Terminator,
}

impl DiffuseClosures {
    /// `f |cos|` of all of them for light from the unit direction `wi`.
    pub fn eval(&self, wi: Vec3) -> Vec3 {
        let of = |closure: &Closure| {
            let (value, _) = closure.eval(self.shading_normal, self.wo, wi);
            closure.weight * value * self.terminator.factor(closure.normal, wi)
        };
        self.closures.iter().map(of).sum()
    }

    /// Unit normal of the first of them.
    pub fn normal(&self) -> Vec3 {
        self.closures[0].normal
    }

    /// Sum of their weights.
    pub fn weight(&self) -> Vec3 {
        self.closures.iter().map(|closure| closure.weight).sum()
    }
}

impl Surface {
    /// Its diffuse reflection; nothing if it has none.
    pub(crate) fn diffuse_part(&self) -> Option<DiffusePart> {
        let reflects = |closure: &&Closure| {
            let is_behind = matches!(closure.scatter, Scatter::Translucent | Scatter::RoughTranslucent(_));
            closure.is_diffuse() && !is_behind
        };
        let mut closures = self.closures.iter().filter(reflects);
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
        Some(DiffusePart::Closures(DiffuseClosures {
            closures: closures.by_ref().copied().collect(),
            wo: self.wo(),
            shading_normal: self.shading_normal(),
            terminator: self.terminator,
        }))
    }
}

/// `f |cos|` of Lambert's law of reflectance 1 about `normal`, which may be bent from the surface's `shading_normal`.
pub(crate) fn lambert(bumps: BumpShadowing, shading_normal: Vec3, normal: Vec3, wi: Vec3) -> f32 {
    normal.dot(wi).max(0.0) * std::f32::consts::FRAC_1_PI * bump_shadowing(bumps, shading_normal, normal, wi)
}
