use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use relume_gpu::{CompareKernel, Gpu, GpuError, Kernel};

use crate::soft::OUTPUTS;

/// Lights that one pass over the records can take, by the kernels that there are.
pub const LIGHTS: [usize; 3] = [1, 4, 16];
/// The same for sorted segments.
pub const SORTED_LIGHTS: [usize; 2] = [1, 4];
/// Threads of a workgroup (`shaders/gather/records.wgsl`).
pub const GROUP_SIZE: u32 = 64;

/// A workgroup of it sums a whole cell, with fewer threads for each pixel.
const SLOPES: &str = "gather/slopes";

/// The kernels, each compiled when first asked for.
#[derive(Debug, Default)]
pub struct Kernels {
    known: Mutex<HashMap<Key, Arc<Kernel>>>,
    compare: OnceLock<CompareKernels>,
}

/// From what `slopes.wgsl` leaves to a loss and the gradients by lights.
#[derive(Debug)]
pub struct CompareKernels {
    pub compare: CompareKernel,
    /// `shaders/gather/pull.wgsl`.
    pub pull: Kernel,
}

/// Module, lights, and threads of a pixel.
type Key = (&'static str, usize, Option<u32>);

impl Kernels {
    /// `shaders/gather/images.wgsl` for at least so many lights.
    pub fn images(&self, gpu: &Gpu, lights: usize, lanes: u32) -> Result<Arc<Kernel>, GpuError> {
        self.get(gpu, "add_images", ("gather/images", fitting(lights, &LIGHTS), Some(lanes)))
    }

    /// `shaders/gather/targets.wgsl` for at least so many lights.
    pub fn targets(&self, gpu: &Gpu, lights: usize, lanes: u32) -> Result<Arc<Kernel>, GpuError> {
        self.get(gpu, "add_targets", ("gather/targets", fitting(lights, &LIGHTS), Some(lanes)))
    }

    /// `shaders/gather/blocks.wgsl` for at least so many lights.
    pub fn blocks(&self, gpu: &Gpu, lights: usize) -> Result<Arc<Kernel>, GpuError> {
        self.get(gpu, "add_blocks", ("gather/blocks", fitting(lights, &SORTED_LIGHTS), None))
    }

    /// `shaders/gather/world.wgsl`.
    pub fn world(&self, gpu: &Gpu, lanes: u32) -> Result<Arc<Kernel>, GpuError> {
        self.get(gpu, "add_world", ("gather/world", 1, Some(lanes)))
    }

    /// `shaders/gather/slopes.wgsl` with so many threads for a pixel at a time.
    pub fn slopes(&self, gpu: &Gpu, pixel_lanes: u32) -> Result<Arc<Kernel>, GpuError> {
        self.get(gpu, "add_slopes", (SLOPES, OUTPUTS, Some(pixel_lanes)))
    }

    pub fn compare(&self, gpu: &Gpu) -> Result<&CompareKernels, GpuError> {
        if let Some(kernels) = self.compare.get() {
            return Ok(kernels);
        }
        let compare = CompareKernel::new(gpu, 1, 3 * OUTPUTS)?;
        let kernels = CompareKernels { compare, pull: gpu.kernel("gather/pull", "pull_back", &[])? };
        Ok(self.compare.get_or_init(|| kernels))
    }

    fn get(&self, gpu: &Gpu, entry: &str, key: Key) -> Result<Arc<Kernel>, GpuError> {
        let mut kernels = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kernel) = kernels.get(&key) {
            return Ok(Arc::clone(kernel));
        }
        let (module, lights, lanes) = key;
        let mut constants = vec![("LIGHTS", lights as u32)];
        let of_pixel = if module == SLOPES { "PIXEL_LANES" } else { "LANES" };
        constants.extend(lanes.map(|lanes| (of_pixel, lanes)));
        let kernel = Arc::new(gpu.kernel(module, entry, &constants)?);
        kernels.insert(key, Arc::clone(&kernel));
        Ok(kernel)
    }
}

/// The smallest of the kernels that takes so many lights.
fn fitting(lights: usize, kernels: &[usize]) -> usize {
    kernels.iter().copied().find(|&most| most >= lights).unwrap_or(kernels[kernels.len() - 1])
}

/// Threads of a pixel whose parts have so many records: each should have two loads of four.
pub fn lanes(part_length: usize) -> u32 {
    (part_length as u32 / 8).next_power_of_two().clamp(8, GROUP_SIZE)
}
