use glam::Vec3;
use relume_dump::Lobe;

use super::classes::LightClass;

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Unit direction in which the path goes on.
    pub wi: Vec3,
    /// `f |cos| / pdf` of the whole surface: multiply the throughput by it.
    pub weight: Vec3,
    /// Density of `wi` over solid angle, all closures together; [`BsdfSample::SINGULAR_PDF`] times the probability
    /// of the choice for singular ones.
    pub pdf: f32,
    /// Class of the sampled closure. Of no meaning where `transparent` is set: the segment keeps the class of the
    /// ray that met the surface.
    pub lobe: Lobe,
    /// Class that lights are collected under along `wi`: chosen by what each class contributes there, so that the light
    /// of a class is that of its own closures, as when Cycles samples lights, however directions were chosen.
    pub light: LightClass,
    /// True if the closure is diffuse, on either side of the surface: the criterion of Cycles' caustics options.
    pub diffuse: bool,
    /// True if the closure is a mirror or perfectly smooth refraction.
    pub singular: bool,
    /// See [`super::closure::Closure::alpha_squared`].
    pub alpha_squared: f32,
    /// True if the ray goes straight through (Transparent BSDF and alpha); counts as a transparent bounce.
    pub transparent: bool,
    /// Place in which the path goes on, if not at the surface; counts as a transparent bounce.
    pub portal: Option<Vec3>,
    /// True if `wi` is between the true and the shading surface: the ray then only lights the surface, see
    /// [`super::SampleReach::Lights`].
    pub lights_only: bool,
    /// True if lights along `wi` do not count, see [`super::SampleReach::Unlit`].
    pub unlit: bool,
}

impl BsdfSample {
    /// Density that Cycles gives to directions that are not chosen from a density.
    pub const SINGULAR_PDF: f32 = 1e6;
}
