//! A vertex of a path, as light that is sampled from there sees it.

use glam::Vec3;

use crate::{
    bsdf::Surface, bvh::Ray, guide::Horizon, media::MediumSample, ray_offset::offset_origin,
    shading::SurfacePoint,
};

/// Point at which a path scatters.
#[derive(Clone, Copy)]
pub(crate) enum Vertex<'a> {
    /// A point on a surface.
    Surface {
        /// Place on the surface.
        point: &'a SurfacePoint,
        /// Closures there.
        surface: &'a Surface,
    },
    /// A collision in a medium.
    Medium {
        /// World space.
        position: Vec3,
        /// Unit direction in which the path arrived.
        direction: Vec3,
        /// See [`Ray::time`].
        time: f32,
        /// The media there.
        medium: &'a MediumSample,
    },
}

impl Vertex<'_> {
    /// World-space position.
    pub fn position(&self) -> Vec3 {
        match self {
            Self::Surface { point, .. } => point.position,
            Self::Medium { position, .. } => *position,
        }
    }

    /// See [`Ray::time`].
    pub fn time(&self) -> f32 {
        match self {
            Self::Surface { point, .. } => point.time,
            Self::Medium { time, .. } => *time,
        }
    }

    /// What is scattered of light from the unit direction `wi`, its cosine at surfaces included, and the density with which directions
    /// are sampled. Nothing for directions between a true and a shading surface, which only the lights of the dump are met
    /// in.
    pub fn eval(&self, wi: Vec3) -> Option<(Vec3, f32)> {
        match self {
            Self::Surface { point, surface } => {
                let is_between = point.horizon_normal().dot(wi) * surface.shading_normal().dot(wi) <= 0.0;
                (!is_between || surface.scatters_around()).then(|| surface.eval(wi))
            }
            Self::Medium { direction, medium, .. } => Some(medium.eval(*direction, wi)),
        }
    }

    /// Share of the sampled directions that have a density, see [`Surface::dull_share`].
    pub fn dull_share(&self) -> f32 {
        match self {
            Self::Surface { surface, .. } => surface.dull_share(),
            Self::Medium { .. } => 1.0,
        }
    }

    /// True if some directions are drawn from a guide.
    pub fn is_guided(&self) -> bool {
        match self {
            Self::Surface { surface, .. } => surface.is_guided(),
            Self::Medium { .. } => true,
        }
    }

    /// Horizon below which no light comes in.
    pub fn horizon(&self) -> Horizon {
        match self {
            Self::Surface { surface, .. } => surface.horizon(),
            Self::Medium { .. } => Horizon::default(),
        }
    }

    /// A ray that leaves it.
    pub fn ray(&self, direction: Vec3) -> Ray {
        let mut ray = Ray::new(self.position(), direction).at(self.time());
        if let Self::Surface { point, .. } = self {
            offset_origin(&mut ray, point);
        }
        ray
    }
}
