//! Light-free path tracing: scene -> dump.

pub mod bsdf;
pub mod bvh;
pub mod shading;
