use std::time::Instant;

use crate::{Bound, Buffer, Commands, Gpu, GpuError, Matrices};

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

impl Gpu {
    /// Seconds that work takes, the best of some rounds: on the device's own clock if it has one, else with submitting and
    /// waiting.
    ///
    /// # Errors
    /// Errors of `work`, or if the device was lost.
    pub fn seconds<E: From<GpuError>>(
        &self,
        mut work: impl FnMut(&mut Commands<'_>) -> Result<(), E>,
    ) -> Result<f64, E> {
        let mut timer = self.timer(2)?;
        let mut best = f64::INFINITY;
        // The first is for drivers that compile on first use.
        for round in 0..=ROUNDS {
            let mut commands = self.commands("timed");
            let start = Instant::now();
            timer.iter_mut().for_each(|timer| commands.mark(timer));
            work(&mut commands)?;
            timer.iter_mut().for_each(|timer| commands.mark(timer));
            commands.submit()?;
            let seconds = match &mut timer {
                Some(timer) => timer.seconds(self)?.iter().sum(),
                None => {
                    self.wait()?;
                    start.elapsed().as_secs_f64()
                }
            };
            if round > 0 {
                best = best.min(seconds);
            }
        }
        Ok(best)
    }

    /// All that limits kernels.
    ///
    /// # Errors
    /// If the device has not the memory, or was lost.
    pub fn peaks(&self) -> Result<Peaks, GpuError> {
        let limits = self.limits();
        Ok(Peaks {
            multiply_adds: self.peak_multiply_adds()?,
            half: limits.f16.then(|| self.peak_of("peak_half")).transpose()?,
            matrices: self.peak_of_matrices("peak_matrices"),
            wide_matrices: self.peak_of_matrices("peak_matrices_with_wide_sums"),
            read: self.peak_read()?,
        })
    }

    /// Multiply-adds of 32-bit floats per second, measured: the limit of what kernels without matrices can do.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn peak_multiply_adds(&self) -> Result<f64, GpuError> {
        self.peak_of("peak")
    }

    /// Rate of a module whose entry point has its name, and which does what `peak.wgsl` does.
    fn peak_of(&self, module: &str) -> Result<f64, GpuError> {
        let results = self.zeros::<f32>("results", GROUP as usize)?;
        let bound = self.kernel(module, module, &[])?.bind(&[results.whole()])?;
        let factors = bytemuck::bytes_of(&PeakArguments { factor: [0.999, 0.001] }).to_vec();
        let seconds = self.seconds_of_groups(&bound, self.peak_groups(), &factors)?;
        Ok(f64::from(self.peak_groups()) * f64::from(GROUP * MULTIPLY_ADDS) / seconds)
    }

    /// Enough to fill the largest cards for milliseconds.
    fn peak_groups(&self) -> u32 {
        if self.summary().software { 64 } else { 1 << 14 }
    }

    fn seconds_of_groups(&self, bound: &Bound, groups: u32, arguments: &[u8]) -> Result<f64, GpuError> {
        self.seconds(|commands| {
            commands.run(bound, groups, arguments);
            Ok(())
        })
    }

    /// Rate of matrices; nothing where the device has no such ones, or its driver refuses them all the same.
    fn peak_of_matrices(&self, entry: &str) -> Option<f64> {
        self.matrices().and_then(|matrices| self.rate_of_matrices(matrices, entry).ok())
    }

    fn rate_of_matrices(&self, matrices: Matrices, entry: &str) -> Result<f64, GpuError> {
        let values = matrices.side.pow(2);
        // 16-bit floats of either sign from 1/8 to 1/2, in an order without pattern.
        let half = |i: u32| {
            let random = i.wrapping_mul(0x9e37_79b1) >> 16;
            ((random & 0x8000) | (0x3000 + (random & 0x7ff))) as u16
        };
        let halves = |len: u32| (0..len).map(half).collect::<Vec<u16>>();
        let factors = self.buffer_of("factors", &halves(FACTORS * values))?;
        let kernel = self.kernel("peak_matrices", entry, &matrices.constants())?;
        // Starts of the sums; of either type, small numbers.
        let bound = if entry.ends_with("wide_sums") {
            let small: Vec<f32> = (0..RESULTS * values).map(|i| i as f32 * 1e-3).collect();
            kernel.bind(&[factors.whole(), self.buffer_of("wide results", &small)?.whole()])?
        } else {
            kernel.bind(&[factors.whole(), self.buffer_of("results", &halves(RESULTS * values))?.whole()])?
        };
        let seconds = self.seconds_of_groups(&bound, self.peak_groups(), &[])?;
        let subgroups = f64::from(self.peak_groups() * (GROUP / matrices.subgroup));
        Ok(subgroups * f64::from(PRODUCTS * matrices.side.pow(3)) / seconds)
    }

    /// Bytes read per second from several buffers, each as large as can be bound: the limit of what kernels can read.
    ///
    /// # Errors
    /// If the device has not the memory, or was lost.
    pub fn peak_read(&self) -> Result<f64, GpuError> {
        let all = (self.free_memory() as f64 * READ_SHARE) as u64 / READ_BUFFERS as u64;
        let most = if self.summary().software { SOFTWARE_BYTES } else { READ_BYTES };
        let bytes = most.min(self.limits().buffer).min(all) & !15;
        let sums = self.zeros::<u32>("sums", 1)?;
        let kernel = self.kernel("peak_read", "read_all", &[])?;
        let make = |_| {
            let words = self.zeros::<u32>("words", (bytes / 4) as usize)?;
            Ok((kernel.bind(&[words.whole(), sums.whole()])?, words))
        };
        let buffers = (0..READ_BUFFERS).map(make).collect::<Result<Vec<_>, GpuError>>()?;
        let groups = (bytes / 16 / 256 / 16).clamp(1, 16_384) as u32;
        let seconds = self.seconds(|commands| {
            buffers.iter().for_each(|(bound, _)| commands.run(bound, groups, &[]));
            Ok::<(), GpuError>(())
        })?;
        Ok((bytes * READ_BUFFERS as u64) as f64 / seconds)
    }

    /// Bytes read and bytes written per second by a copy of the driver's own.
    ///
    /// # Errors
    /// See [`Gpu::peak_read`].
    pub fn peak_copy(&self) -> Result<f64, GpuError> {
        let free = (self.free_memory() as f64 * READ_SHARE) as u64 / 2;
        let most = if self.summary().software { 16 * SOFTWARE_BYTES } else { READ_BYTES };
        let words = (most.min(self.limits().buffer).min(free) / 4) as usize & !3;
        let make = |what| self.zeros::<u32>(what, words);
        let (from, to) = (make("source")?, make("destination")?);
        let seconds = self.seconds(|commands| {
            commands.copy(&from, &to);
            Ok::<(), GpuError>(())
        })?;
        Ok(2.0 * words as f64 * 4.0 / seconds)
    }

    /// Bytes per second from the CPU to the device, and back.
    ///
    /// # Errors
    /// See [`Gpu::peak_read`].
    pub fn transfers(&self) -> Result<[f64; 2], GpuError> {
        let values = vec![1u32; TRANSFER_BYTES / 4];
        let buffer: Buffer<u32> = self.zeros("words", values.len())?;
        let upload = best_of_rounds(ROUNDS, || {
            self.write(&buffer, 0, &values);
            self.commands("upload").submit()?;
            self.wait()
        })?;
        let read = best_of_rounds(ROUNDS, || self.read(&buffer, 0..values.len()).map(drop))?;
        Ok([upload, read].map(|seconds| TRANSFER_BYTES as f64 / seconds))
    }

    /// Measures dispatches and submissions that do next to nothing.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn costs(&self) -> Result<Costs, GpuError> {
        let (values, total) = (self.zeros::<u32>("values", 1)?, self.zeros::<u32>("total", 1)?);
        let bound = self.kernel("selftest", "sum", &[])?.bind(&[values.whole(), total.whole()])?;
        let chain = |dispatches: u32| {
            self.seconds(|commands| {
                (0..dispatches).for_each(|_| commands.run(&bound, 1, &[]));
                Ok::<(), GpuError>(())
            })
        };
        let (one, many) = (chain(1)?, chain(1 + CHAIN)?);
        let submit_one = || {
            let mut commands = self.commands("one");
            commands.run(&bound, 1, &[]);
            commands.submit()
        };
        let submit = best_of_rounds(ROUNDS, || {
            (0..CHAIN).try_for_each(|_| submit_one())?;
            self.wait()
        })?;
        let wait = best_of_rounds(ROUNDS, || submit_one().and_then(|()| self.wait()))?;
        let each = f64::from(CHAIN);
        Ok(Costs { dispatch: (many - one).max(0.0) / each, submit: submit / each, wait })
    }
}

/// Seconds of the quickest of some calls, by the clock on the wall. One more goes before: drivers compile on first use.
///
/// # Errors
/// Those of the calls.
pub fn best_of_rounds<E>(rounds: usize, mut call: impl FnMut() -> Result<(), E>) -> Result<f64, E> {
    call()?;
    let mut best = f64::INFINITY;
    for _ in 0..rounds {
        let start = Instant::now();
        call()?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_have_the_layout_of_their_wgsl_twins() {
        crate::assert_mirror!(PeakArguments as "peak", "Arguments", { factor });
        crate::assert_mirror!(PeakArguments as "peak_half", "Arguments", { factor });
    }
}
