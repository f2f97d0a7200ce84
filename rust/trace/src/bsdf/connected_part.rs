//! Scattering of a surface that lights are connected to, apart from the rest: the closures of [`relume_dump::Lobe::CONNECTED`].

use glam::Vec3;
use relume_scene::BumpShadowing;

use super::normal::{Terminator, bump_shadowing};
use super::{Closure, Scatter, Surface};

/// Closures of a surface that lights are connected to.
#[derive(Clone, Debug)]
pub(crate) struct ConnectedPart {
    /// Sum of the diffuse closures of Lambert's law about the first one's normal.
    pub lambert: Option<Lambert>,
    /// All others.
    pub others: Box<[Closure]>,
}

/// Lambert's law about one normal: `weight` is the sum of the closures' weights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lambert {
    pub weight: Vec3,
    pub normal: Vec3,
    pub bumps: BumpShadowing,
}

/// Values that scattering depends on, besides closures and the normals of both sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viewpoint {
    /// Unit direction back along the path.
    pub wo: Vec3,
    terminator: Terminator,
}

impl Viewpoint {
    /// `f |cos|` of a closure for light from the unit direction `wi`, without its weight, and the density of `wi`. `shading_normal`
    /// is the surface's before any bump.
    #[inline]
    pub fn eval(&self, closure: &Closure, shading_normal: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (value, pdf) = closure.eval(shading_normal, self.wo, wi);
        let factor = if closure.scatters_around() { 1.0 } else { self.terminator.factor(closure.normal, wi) };
        (value * factor, pdf)
    }
}

impl Surface {
    /// Its closures that lights are connected to; nothing if it has none.
    pub(crate) fn connected_part(&self) -> Option<ConnectedPart> {
        let connected = || self.closures.iter().filter(|closure| closure.is_connected());
        connected().next()?;
        let is_lambert = |closure: &&Closure| {
            matches!(closure.scatter, Scatter::Diffuse) && self.terminator.is_at_horizon()
        };
        let first = connected().find(is_lambert).map(|closure| (closure.normal, closure.bumps));
        let is_summed = |closure: &&Closure| {
            is_lambert(closure) && first.is_some_and(|(normal, _)| closure.normal == normal)
        };
        let lambert = first.map(|(normal, bumps)| {
            let weight = connected().filter(is_summed).map(|closure| closure.weight).sum();
            Lambert { weight, normal, bumps }
        });
        let others = connected().filter(|closure| !is_summed(closure)).copied().collect();
        Some(ConnectedPart { lambert, others })
    }

    /// Values that its scattering depends on.
    pub(crate) fn viewpoint(&self) -> Viewpoint {
        Viewpoint { wo: self.wo(), terminator: self.terminator }
    }
}

/// `f |cos|` of Lambert's law of reflectance 1 about `normal`, which may be bent from the surface's `shading_normal`.
pub(crate) fn lambert(bumps: BumpShadowing, shading_normal: Vec3, normal: Vec3, wi: Vec3) -> f32 {
    normal.dot(wi).max(0.0) * std::f32::consts::FRAC_1_PI * bump_shadowing(bumps, shading_normal, normal, wi)
}
