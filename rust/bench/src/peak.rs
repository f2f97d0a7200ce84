//! Best rates of a device and fixed costs of work on it, measured.

use relume_gpu::{Bound, Buffer, Gpu, GpuError, Matrices};

use crate::shaders::kernel;
use crate::timing::{best_of_rounds, seconds_on};

/// Rounds of which the best counts.
const ROUNDS: usize = 5;
/// Multiply-adds of an invocation of `peak.wgsl` and `peak_half.wgsl`: their `ROUNDS` times `LANES`.
const MULTIPLY_ADDS: u32 = 256 * 32;
/// Invocations of a workgroup there, and in `peak_matrices.wgsl`.
const GROUP: u32 = 128;
/// Products of a subgroup of `peak_matrices.wgsl`: its `ROUNDS` times its sums.
const PRODUCTS: u32 = 256 * 8;
/// Matrices of its factors, and of its starts and results.
const FACTORS: u32 = 2;
const RESULTS: u32 = 9;
/// Buffers that are read in turn, so that no cache holds them all, and bytes of each; less on a small device, and on a software
/// driver.
const READ_BUFFERS: usize = 16;
const READ_BYTES: u64 = 1 << 30;
const SOFTWARE_BYTES: u64 = 4 << 20;
/// Share of the free memory that these buffers take.
const READ_SHARE: f64 = 0.5;
/// Dispatches, and submissions, of which the mean counts.
const CHAIN: u32 = 1000;
/// Bytes that are copied to the device and back.
const TRANSFER_BYTES: usize = 64 << 20;

/// Arguments of `peak.wgsl` and `peak_half.wgsl`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct PeakArguments {
    factor: [f32; 2],
}

/// Best rates of a device, measured: limits of its kernels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peaks {
    /// Multiply-adds of 32-bit floats per second.
    pub multiply_adds: f64,
    /// Operations of 16-bit floats a second; none if kernels cannot have them.
    pub half: Option<f64>,
    /// Operations a second in products of matrices of 16-bit floats; none if it has none ([`Gpu::matrices`]).
    pub matrices: Option<f64>,
    /// Operations a second in products of such matrices with sums of 32 bits.
    pub wide_matrices: Option<f64>,
    /// Bytes read per second from several large buffers.
    pub read: f64,
}

/// Fixed costs of work on a device, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// Cost of one more dispatch that waits for the one before, in one submission.
    pub dispatch: f64,
    /// Cost of one more submission.
    pub submit: f64,
    /// Cost of a submission that is waited for.
    pub wait: f64,
}

/// Measures the limits of kernels.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn measure_peaks(gpu: &Gpu) -> Result<Peaks, GpuError> {
    let limits = gpu.limits();
    Ok(Peaks {
        multiply_adds: multiply_adds(gpu)?,
        half: limits.f16.then(|| rate_of(gpu, "peak_half")).transpose()?,
        matrices: rate_of_matrices_if_any(gpu, "peak_matrices"),
        wide_matrices: rate_of_matrices_if_any(gpu, "peak_matrices_with_wide_sums"),
        read: read(gpu)?,
    })
}

/// Multiply-adds of 32-bit floats per second, measured: the limit of what kernels without matrices can do.
///
/// # Errors
/// If the device was lost.
pub fn multiply_adds(gpu: &Gpu) -> Result<f64, GpuError> {
    rate_of(gpu, "peak")
}

/// Rate of a module whose entry point has its name, and which does what `peak.wgsl` does.
fn rate_of(gpu: &Gpu, module: &str) -> Result<f64, GpuError> {
    let results = gpu.zeros::<f32>("results", GROUP as usize)?;
    let bound = kernel(gpu, module, module, &[])?.bind(&[results.whole()])?;
    let factors = bytemuck::bytes_of(&PeakArguments { factor: [0.999, 0.001] }).to_vec();
    let seconds = seconds_of_groups(gpu, &bound, groups(gpu), &factors)?;
    Ok(f64::from(groups(gpu)) * f64::from(GROUP * MULTIPLY_ADDS) / seconds)
}

/// Enough to fill the largest cards for milliseconds.
fn groups(gpu: &Gpu) -> u32 {
    if gpu.summary().software { 64 } else { 1 << 14 }
}

fn seconds_of_groups(gpu: &Gpu, bound: &Bound, groups: u32, arguments: &[u8]) -> Result<f64, GpuError> {
    seconds_on(gpu, |commands| {
        commands.run(bound, groups, arguments);
        Ok(())
    })
}

/// Rate of matrices; nothing where the device has no such ones, or its driver refuses them all the same.
fn rate_of_matrices_if_any(gpu: &Gpu, entry: &str) -> Option<f64> {
    gpu.matrices().and_then(|matrices| rate_of_matrices(gpu, matrices, entry).ok())
}

fn rate_of_matrices(gpu: &Gpu, matrices: Matrices, entry: &str) -> Result<f64, GpuError> {
    let values = matrices.side.pow(2);
    // 16-bit floats of either sign from 1/8 to 1/2, in an order without pattern.
    let half = |i: u32| {
        let random = i.wrapping_mul(0x9e37_79b1) >> 16;
        ((random & 0x8000) | (0x3000 + (random & 0x7ff))) as u16
    };
    let halves = |len: u32| (0..len).map(half).collect::<Vec<u16>>();
    let factors = gpu.buffer_of("factors", &halves(FACTORS * values))?;
    let kernel = kernel(gpu, "peak_matrices", entry, &matrices.constants())?;
    // Starts of the sums; of either type, small numbers.
    let bound = if entry.ends_with("wide_sums") {
        let small: Vec<f32> = (0..RESULTS * values).map(|i| i as f32 * 1e-3).collect();
        kernel.bind(&[factors.whole(), gpu.buffer_of("wide results", &small)?.whole()])?
    } else {
        kernel.bind(&[factors.whole(), gpu.buffer_of("results", &halves(RESULTS * values))?.whole()])?
    };
    let seconds = seconds_of_groups(gpu, &bound, groups(gpu), &[])?;
    let subgroups = f64::from(groups(gpu) * (GROUP / matrices.subgroup));
    Ok(subgroups * f64::from(PRODUCTS * matrices.side.pow(3)) / seconds)
}

/// Bytes read per second from several buffers, each as large as can be bound: the limit of what kernels can read.
///
/// # Errors
/// If the device has not the memory, or was lost.
pub fn read(gpu: &Gpu) -> Result<f64, GpuError> {
    let all = (gpu.free_memory() as f64 * READ_SHARE) as u64 / READ_BUFFERS as u64;
    let most = if gpu.summary().software { SOFTWARE_BYTES } else { READ_BYTES };
    let bytes = most.min(gpu.limits().buffer).min(all) & !15;
    let sums = gpu.zeros::<u32>("sums", 1)?;
    let kernel = kernel(gpu, "peak_read", "read_all", &[])?;
    let make = |_| {
        let words = gpu.zeros::<u32>("words", (bytes / 4) as usize)?;
        Ok((kernel.bind(&[words.whole(), sums.whole()])?, words))
    };
    let buffers = (0..READ_BUFFERS).map(make).collect::<Result<Vec<_>, GpuError>>()?;
    let groups = (bytes / 16 / 256 / 16).clamp(1, 16_384) as u32;
    let seconds = seconds_on(gpu, |commands| {
        buffers.iter().for_each(|(bound, _)| commands.run(bound, groups, &[]));
        Ok::<(), GpuError>(())
    })?;
    Ok((bytes * READ_BUFFERS as u64) as f64 / seconds)
}

/// Bytes read and bytes written per second by a copy of the driver's own.
///
/// # Errors
/// See [`read`].
pub fn copy(gpu: &Gpu) -> Result<f64, GpuError> {
    let free = (gpu.free_memory() as f64 * READ_SHARE) as u64 / 2;
    let most = if gpu.summary().software { 16 * SOFTWARE_BYTES } else { READ_BYTES };
    let words = (most.min(gpu.limits().buffer).min(free) / 4) as usize & !3;
    let make = |what| gpu.zeros::<u32>(what, words);
    let (from, to) = (make("source")?, make("destination")?);
    let seconds = seconds_on(gpu, |commands| {
        commands.copy(&from, &to);
        Ok::<(), GpuError>(())
    })?;
    Ok(2.0 * words as f64 * 4.0 / seconds)
}

/// Bytes per second from the CPU to the device, and back.
///
/// # Errors
/// See [`read`].
pub fn transfers(gpu: &Gpu) -> Result<[f64; 2], GpuError> {
    let values = vec![1u32; TRANSFER_BYTES / 4];
    let buffer: Buffer<u32> = gpu.zeros("words", values.len())?;
    let upload = best_of_rounds(ROUNDS, || {
        gpu.write(&buffer, 0, &values);
        gpu.commands("upload").submit()?;
        gpu.wait()
    })?;
    let read = best_of_rounds(ROUNDS, || gpu.read(&buffer, 0..values.len()).map(drop))?;
    Ok([upload, read].map(|seconds| TRANSFER_BYTES as f64 / seconds))
}

/// Measures dispatches and submissions that do next to nothing.
///
/// # Errors
/// If the device was lost.
pub fn measure_costs(gpu: &Gpu) -> Result<Costs, GpuError> {
    let (values, total) = (gpu.zeros::<u32>("values", 1)?, gpu.zeros::<u32>("total", 1)?);
    let bound = gpu.kernel("selftest", "sum", &[])?.bind(&[values.whole(), total.whole()])?;
    let chain = |dispatches: u32| {
        seconds_on(gpu, |commands| {
            (0..dispatches).for_each(|_| commands.run(&bound, 1, &[]));
            Ok::<(), GpuError>(())
        })
    };
    let (one, many) = (chain(1)?, chain(1 + CHAIN)?);
    let submit_one = || {
        let mut commands = gpu.commands("one");
        commands.run(&bound, 1, &[]);
        commands.submit()
    };
    let submit = best_of_rounds(ROUNDS, || {
        (0..CHAIN).try_for_each(|_| submit_one())?;
        gpu.wait()
    })?;
    let wait = best_of_rounds(ROUNDS, || submit_one().and_then(|()| gpu.wait()))?;
    let each = f64::from(CHAIN);
    Ok(Costs { dispatch: (many - one).max(0.0) / each, submit: submit / each, wait })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shaders::tests::arguments;
    use relume_gpu::GpuChoice;

    #[test]
    fn arguments_have_the_layout_of_their_wgsl_twins() {
        for name in ["peak", "peak_half"] {
            let factor = ("factor".into(), std::mem::offset_of!(PeakArguments, factor) as u32);
            assert_eq!(arguments(name), (size_of::<PeakArguments>() as u32, vec![factor]));
        }
    }

    #[test]
    fn a_device_has_measurable_peaks_and_costs() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let peaks = measure_peaks(&gpu).unwrap();
        let rates =
            [Some(peaks.multiply_adds), peaks.half, peaks.matrices, peaks.wide_matrices, Some(peaks.read)];
        let copies = transfers(&gpu).unwrap().map(Some);
        for rate in rates.into_iter().chain(copies).chain([Some(copy(&gpu).unwrap())]).flatten() {
            assert!((1e6..1e16).contains(&rate), "{rate}: {peaks:?}");
        }
        assert_eq!(peaks.half.is_some(), gpu.limits().f16);
        // Where a card multiplies matrices at all, it does so faster than by its plain units: else something else was measured.
        let is_card = !gpu.summary().software;
        assert!(!is_card || peaks.matrices.is_none_or(|rate| rate > peaks.multiply_adds), "{peaks:?}");
        assert_eq!(peaks.matrices.is_some(), gpu.matrices().is_some());
        assert_eq!(peaks.wide_matrices.is_some(), gpu.matrices().is_some());
        let costs = measure_costs(&gpu).unwrap();
        for seconds in [costs.submit, costs.wait] {
            assert!((1e-8..1.0).contains(&seconds), "{costs:?}");
        }
        assert!((0.0..0.1).contains(&costs.dispatch), "{costs:?}");
    }
}
