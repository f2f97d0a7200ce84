use std::f32::consts::PI;

use glam::Vec3;
use relume_dump::Lobe;

use crate::shading::SurfacePoint;

/// Most closures that one point keeps; further ones are dropped.
const MAX_CLOSURES: usize = 16;

/// One way in which a surface scatters.
#[derive(Clone, Copy, Debug)]
pub enum Closure {
    /// Lambert's.
    Diffuse {
        /// Albedo.
        weight: Vec3,
        /// Shading normal.
        normal: Vec3,
    },
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Unit direction in which the path goes on.
    pub wi: Vec3,
    /// `f |cos| / pdf` of the whole surface: multiply the throughput by it.
    pub weight: Vec3,
    /// Density of `wi` over solid angle, all closures together; [`BsdfSample::SINGULAR_PDF`] for singular ones.
    pub pdf: f32,
    /// Class of the sampled closure. Of no meaning where `transparent` is set: the segment keeps the class of the
    /// ray that met the surface.
    pub lobe: Lobe,
    /// Whether the closure is a mirror or perfectly smooth refraction.
    pub singular: bool,
    /// Whether the ray goes straight through (Transparent BSDF and alpha); counts as a transparent bounce.
    pub transparent: bool,
    /// Whether `wi` is on the other side of the surface.
    pub transmitted: bool,
    /// Roughness (square root of alpha) of the sampled closure; 1 for diffuse ones.
    pub roughness: f32,
}

impl BsdfSample {
    /// What Cycles gives as density of directions that are not chosen from a density.
    pub const SINGULAR_PDF: f32 = 1e6;
}

/// The closures and the emission of one surface point. Reused from hit to hit.
#[derive(Clone, Debug)]
pub struct Surface {
    closures: Vec<Closure>,
    wo: Vec3,
    geometric_normal: Vec3,
    emission: Vec3,
    transparency: Vec3,
}

impl Default for Surface {
    fn default() -> Self {
        Self {
            closures: Vec::with_capacity(MAX_CLOSURES),
            wo: Vec3::Z,
            geometric_normal: Vec3::Z,
            emission: Vec3::ZERO,
            transparency: Vec3::ZERO,
        }
    }
}

impl Surface {
    /// Empties the surface and takes the frame of `point`.
    pub fn reset(&mut self, point: &SurfacePoint) {
        self.closures.clear();
        self.wo = point.wo;
        self.geometric_normal = point.geometric_normal;
        self.emission = Vec3::ZERO;
        self.transparency = Vec3::ZERO;
    }

    /// Adds a closure.
    pub fn add(&mut self, closure: Closure) {
        if self.closures.len() < MAX_CLOSURES {
            self.closures.push(closure);
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

    /// Chooses a closure and a direction from three numbers in 0..1; nothing if the path ends here.
    pub fn sample(&self, u: [f32; 3]) -> Option<BsdfSample> {
        let Closure::Diffuse { normal, .. } = *self.closures.first()?;
        let (x, y) = normal.any_orthonormal_pair();
        let (sin_phi, cos_phi) = (2.0 * PI * u[1]).sin_cos();
        let sin = u[0].sqrt();
        let wi = x * (sin * cos_phi) + y * (sin * sin_phi) + normal * (1.0 - u[0]).max(0.0).sqrt();
        if wi.dot(self.geometric_normal) <= 0.0 {
            return None;
        }
        let (value, pdf) = self.eval(wi);
        (pdf > 0.0).then(|| BsdfSample {
            wi,
            weight: value / pdf,
            pdf,
            lobe: Lobe::Diffuse,
            singular: false,
            transparent: false,
            transmitted: false,
            roughness: 1.0,
        })
    }

    /// `f |cos|` of all closures that are not singular for light from `wi`, and the density with which
    /// [`Surface::sample`] chooses `wi`.
    pub fn eval(&self, wi: Vec3) -> (Vec3, f32) {
        match self.closures.first() {
            Some(Closure::Diffuse { weight, normal }) if wi.dot(self.geometric_normal) > 0.0 => {
                let pdf = normal.dot(wi).max(0.0) / PI;
                (*weight * pdf, pdf)
            }
            _ => (Vec3::ZERO, 0.0),
        }
    }

    /// Estimate of the surface's albedo, for the denoiser.
    pub fn albedo(&self) -> Vec3 {
        self.closures.iter().map(|Closure::Diffuse { weight, .. }| *weight).sum::<Vec3>().min(Vec3::ONE)
    }

    /// Mean shading normal of the closures, for the denoiser.
    pub fn normal(&self) -> Vec3 {
        match self.closures.first() {
            Some(Closure::Diffuse { normal, .. }) => *normal,
            None => self.geometric_normal,
        }
    }

    /// Whether what is seen is mostly a mirror or clear glass, so that the denoiser should look behind it.
    pub fn is_specular(&self) -> bool {
        false
    }

    /// Makes glossy closures at least as rough as `roughness` (Cycles' Filter Glossy).
    pub fn blur(&mut self, _roughness: f32) {}
}
