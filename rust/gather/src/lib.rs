//! Sums lights over a dump: dump + lights -> image; denoising.
//!
//! [`Gather`] answers for whole images ([`Gather::unit_images`], [`Gather::world_image`]) and for single pixels
//! ([`Gather::pixel_into`]); [`relight`] weighs unit images and sums them; [`Noise`] says how noisy they are;
//! [`Denoiser`] cleans them.
//!
//! Gather of a light: packed records are decoded a block at a time into the first-level cache, where every light tests
//! eight segments at once against a region that holds all its crossings (`kernel`). For one or two lights a first test
//! on the packed records leaves out most of them: those far from a ball around the light (`cull_avx512`), or those
//! beyond a side of its box (`cull_avx2`). What remains is evaluated exactly (`light`). Throughputs are read for hits
//! only.

mod balance;
#[cfg(target_arch = "x86_64")]
mod cull_avx2;
#[cfg(target_arch = "x86_64")]
mod cull_avx512;
mod denoise;
mod emission_map;
mod emitter;
mod environment;
mod error;
mod gather;
mod gpu;
#[cfg(target_arch = "x86_64")]
mod kept;
mod kernel;
mod lanes;
mod light;
mod lobes;
mod piece;
mod positions;
mod relight;
mod rules;
mod sample_split;
mod sheared;
mod soft;

pub use balance::Balance;
pub use denoise::{DenoiseDevice, DenoiseError, DenoiseFeatures, DenoiseQuality, Denoiser, Stop};
pub use emitter::{Emitter, LightSample};
pub use environment::Environment;
pub use error::GatherError;
pub use gather::{Gather, GatherScratch};
pub use gpu::{Goals, GpuGather, GpuLight, GpuLights, GpuWorld, Receivers, SoftCompared};
pub use kernel::Isa;
pub use light::PreparedLight;
pub use lobes::LobePart;
pub use relight::{Noise, relight};
pub use sample_split::SampleSplit;
pub use soft::{SoftGather, UnitValues};

#[cfg(test)]
mod tests;
