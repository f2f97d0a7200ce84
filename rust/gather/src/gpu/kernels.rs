//! The kernels of the gather; a device compiles each once, when it is first asked for.

use relume_gpu::{Gpu, GpuError, Kernel};

use crate::soft::OUTPUTS;

/// Lights that one pass over the records can take, by the kernels that there are.
pub const LIGHTS: [usize; 5] = [1, 2, 4, 8, 16];
/// Numbers of lights that one pass over sorted segments can take, by the kernels that there are.
pub const SORTED_LIGHTS: [usize; 2] = [1, 4];
/// Threads of a workgroup (`shaders/gather/records.wgsl`).
pub const GROUP_SIZE: u32 = 64;

/// `shaders/gather/images.wgsl` for at least so many lights.
pub fn images(gpu: &Gpu, lights: usize, lanes: u32) -> Result<Kernel, GpuError> {
    gpu.kernel("gather/images", "add_images", &[("LIGHTS", fitting(lights, &LIGHTS)), ("LANES", lanes)])
}

/// `shaders/gather/targets.wgsl` for at least so many lights.
pub fn targets(gpu: &Gpu, lights: usize, lanes: u32) -> Result<Kernel, GpuError> {
    gpu.kernel("gather/targets", "add_targets", &[("LIGHTS", fitting(lights, &LIGHTS)), ("LANES", lanes)])
}

/// `shaders/gather/numbers.wgsl`.
pub fn numbers(gpu: &Gpu) -> Result<Kernel, GpuError> {
    gpu.kernel("gather/numbers", "number_pixels", &[])
}

/// `shaders/gather/blocks.wgsl` for at least so many lights.
pub fn blocks(gpu: &Gpu, lights: usize) -> Result<Kernel, GpuError> {
    gpu.kernel("gather/blocks", "add_blocks", &[("LIGHTS", fitting(lights, &SORTED_LIGHTS))])
}

/// `shaders/gather/world.wgsl`.
pub fn world(gpu: &Gpu, lanes: u32) -> Result<Kernel, GpuError> {
    gpu.kernel("gather/world", "add_world", &[("LIGHTS", 1), ("LANES", lanes)])
}

/// `shaders/gather/slopes.wgsl` with so many threads for a pixel at a time: a workgroup of it sums a whole cell.
pub fn slopes(gpu: &Gpu, pixel_lanes: u32) -> Result<Kernel, GpuError> {
    gpu.kernel("gather/slopes", "add_slopes", &[("LIGHTS", OUTPUTS as u32), ("PIXEL_LANES", pixel_lanes)])
}

/// The smallest of the kernels that takes so many lights.
fn fitting(lights: usize, kernels: &[usize]) -> u32 {
    kernels.iter().copied().find(|&most| most >= lights).unwrap_or(kernels[kernels.len() - 1]) as u32
}

/// Threads of a pixel whose parts have so many records: each should have two loads of four.
pub fn lanes(part_length: usize) -> u32 {
    (part_length as u32 / 8).next_power_of_two().clamp(8, GROUP_SIZE)
}
