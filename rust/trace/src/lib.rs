//! Light-free path tracing: scene -> dump.

pub mod bsdf;
pub mod bvh;
pub mod camera;
pub mod filter;
pub mod sampler;
pub mod shading;
