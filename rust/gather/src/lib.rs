//! Sums lights over a dump: dump + lights -> image; denoising.

mod error;
mod gather;
mod half;
mod kernel;
mod lanes;
mod light;

pub use error::GatherError;
pub use gather::{Gather, Scratch};
pub use half::Half;
pub use kernel::Isa;
pub use light::PreparedLight;

#[cfg(test)]
mod tests;
