//! Shading, from "a ray hit this triangle of this instance" to the closures of the surface there.
//!
//! [`PreparedMaterials`] makes every shader graph of a scene ready once; [`PreparedMaterials::evaluate`] runs one for
//! a [`SurfacePoint`] and fills a caller-owned [`Surface`](crate::bsdf::Surface), without allocation.

mod closures;
mod color;
mod constant;
mod coordinates;
mod displacement;
mod evaluate;
mod fields;
mod graph;
mod hair;
mod image;
mod lamp;
mod math;
mod moving;
mod point;
mod prepared;
mod principled;
mod probes;
mod procedural;
mod raycast;
mod strands;
mod subsurface;
mod tangents;
#[cfg(test)]
mod tests;
mod texture;
mod values;
mod volumes;

pub(crate) use color::luminance;
pub use constant::constant_emission;
pub use lamp::{Lamp, LampKind, emission_map};
pub(crate) use point::MediumPoint;
pub use point::{Hit, RayInfo, StrandPoint, SurfacePoint};
pub use prepared::PreparedMaterials;
pub(crate) use probes::Probes;
pub use strands::{PointInfo, StrandInfo};
pub(crate) use texture::equirectangular;
