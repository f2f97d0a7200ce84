//! Closures and the choice between them: sampling, evaluation and densities of a surface's scattering.
//!
//! The models and their parameters are those of Cycles 4.x, so that the same material looks the same in both; each
//! file names the papers. Directions point away from the surface: `wo` back along the ray, `wi` to where the path
//! goes on. Values include the cosine: `f |cos|`.

mod ashikhmin;
mod bssrdf;
mod classes;
mod closure;
mod connected_part;
mod diffuse;
mod dispersion;
mod distribution;
mod energy;
mod film;
mod frame;
mod fresnel;
mod hair;
mod microfacet;
mod normal;
mod observer;
mod sample;
mod sheen;
mod surface;
#[cfg(test)]
mod tests;
mod toon;
mod velvet;

pub use ashikhmin::AshikhminShirley;
pub(crate) use bssrdf::BodyEntry;
pub use bssrdf::Bssrdf;
pub use classes::LightClass;
pub use closure::{Closure, Portal, Scatter};
pub(crate) use connected_part::{Lambert, Viewpoint, lambert};
pub use diffuse::OrenNayar;
pub(crate) use dispersion::{dispersed_ior, sample_wavelength, wavelength_weight};
pub use distribution::{MicrofacetDistribution, SlopeDistribution};
pub use energy::Compensation;
pub use film::Film;
pub use frame::ShadingFrame;
pub(crate) use frame::sample_cosine;
pub use fresnel::{Conductor, F82, dielectric, dielectric_mean, f0_from_ior, ior_from_f0, stretched};
pub use hair::{
    Chiang, ChiangParameters, Fibre, Hair, HairLobe, HairSide, Huang, HuangParameters, absorption_of_color,
    absorption_of_melanin,
};
pub use microfacet::{Fresnel, Interface, Microfacet};
pub use normal::{SampleReach, SideNormals, ensure_valid_reflection};
pub use sample::BsdfSample;
pub use sheen::Sheen;
pub use surface::{Caustics, Surface, WEIGHT_CUTOFF};
pub use toon::Toon;
pub use velvet::Velvet;
