//! Subsurface scattering of shader nodes: light that enters a body in one place and leaves it in another.

use crate::Input;
use crate::sockets::with_sockets;

/// How light finds the place where it leaves the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SubsurfaceMethod {
    /// Random walk that enters by refraction.
    Walk,
    /// Random walk of skin: every other one enters diffusely, and the radius is that of a dipole.
    Skin,
    /// Probes of the surface around, by Burley's profile.
    Disk,
}

/// Scattering of the inside that gives the body the albedo of its shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlbedoInversion {
    /// Fit by polynomials; the radius is that of the medium without anisotropy. Negative anisotropy takes the other.
    Polynomial,
    /// Van de Hulst's formula; the radius is the mean free path.
    VanDeHulst,
}

/// Meaning of the sockets of subsurface scattering.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SubsurfaceModel {
    /// How light finds its way out.
    pub method: SubsurfaceMethod,
    /// Scattering of the inside; of no meaning for [`SubsurfaceMethod::Disk`].
    pub inversion: AlbedoInversion,
    /// Factor on the radius, at least 0.
    pub radius_factor: f32,
    /// Least and largest anisotropy.
    pub anisotropy_limits: [f32; 2],
    /// Radius, as a share of a pixel's footprint, below which a channel is taken for diffuse; 0 for none.
    pub least_footprint: f32,
    /// True if paths that have scattered diffusely before take it for diffuse.
    pub is_first_only: bool,
}

with_sockets! {
    /// Subsurface scattering of a node, and what its sockets mean.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    pub struct Subsurface {
        /// Reach of each channel, before `scale`.
        pub radius: Input,
        /// Metres to a unit of `radius`, world space.
        pub scale: Input,
        /// Index of refraction of the surface that light enters through. A Principled node has its own but for skin.
        pub ior: Input,
        /// Mean cosine of scattering inside.
        pub anisotropy: Input,
        /// Meaning of the others.
        pub model: SubsurfaceModel,
    }
}
