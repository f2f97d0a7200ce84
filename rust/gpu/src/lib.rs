//! A GPU of any vendor through `wgpu`: device, WGSL modules, buffers, read-back, timers. Knows nothing of light or
//! networks; the crates of the stages bring their kernels' arguments, the WGSL is embedded from `shaders/`. What several of
//! them need is here too: pictures compared with what is wanted of them ([`compare`]), and images summed up ([`GpuImage`]).
//!
//! ```no_run
//! # fn main() -> Result<(), relume_gpu::GpuError> {
//! use relume_gpu::{Gpu, GpuChoice};
//! let gpu = Gpu::shared(&GpuChoice::Best)?;                // one device a process, opened on first use
//! let values = gpu.buffer_of("values", &[1u32, 2, 3, 4])?; // counted against the memory budget
//! let sum = gpu.zeros::<u32>("sum", 1)?;
//! let kernel = gpu.kernel("selftest", "sum", &[])?;        // shaders/selftest.wgsl
//! let bound = kernel.bind(&[values.whole(), sum.whole()])?;
//! let mut commands = gpu.commands("sum");
//! commands.run(&bound, 1, &[]);
//! commands.submit()?;
//! assert_eq!(gpu.read(&sum, 0..1)?, [10]);
//! # Ok(())
//! # }
//! ```
//!
//! Only Vulkan, Metal and DX12 are ever asked for: an OpenGL context made in Blender's process ends it.

mod buffer;
mod choice;
mod commands;
pub mod compare;
mod device;
mod error;
mod image;
mod kernel;
pub mod layout;
mod matrices;
mod memory;
pub mod modules;
mod properties;
mod staging;
mod timer;

pub use buffer::{Binding, Buffer};
pub use choice::{AdapterSummary, GpuChoice, adapters};
pub use commands::{Commands, Submission, fold};
pub use device::{DeviceLimits, Gpu};
pub use error::GpuError;
pub use image::GpuImage;
pub use kernel::{Bound, Checks, Kernel};
pub use matrices::Matrices;
pub use properties::Property;
pub use timer::Timer;

#[cfg(test)]
mod gpu_tests;
