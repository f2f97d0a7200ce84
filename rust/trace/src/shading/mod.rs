//! From "a ray hit this triangle of this instance" to the closures of the surface there.
//!
//! [`PreparedMaterials`] compiles every shader graph of a scene once; [`PreparedMaterials::evaluate`] runs one for
//! a [`SurfacePoint`] and fills a caller-owned [`Surface`], without allocation.

mod point;
mod prepared;

pub use point::{Hit, SurfacePoint};
pub use prepared::PreparedMaterials;
