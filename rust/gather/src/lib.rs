//! Sums lights over a dump: dump + lights -> image; denoising.

pub mod bench;
mod denoise;
mod environment;
mod error;
mod gather;
mod half;
mod kernel;
mod lanes;
mod light;
mod positions;
mod relight;
#[cfg(target_arch = "x86_64")]
mod sieve;

pub use denoise::{DenoiseError, DenoiseQuality, Denoiser};
pub use environment::Environment;
pub use error::GatherError;
pub use gather::{Gather, Scratch};
pub use half::Half;
pub use kernel::Isa;
pub use light::PreparedLight;
pub use relight::{Noise, relight};

#[cfg(test)]
mod tests;
