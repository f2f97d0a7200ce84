use std::time::Instant;

use crate::{Commands, Gpu, GpuError};

/// Rounds of which the best counts.
const ROUNDS: usize = 5;
/// Multiply-adds of an invocation of `peak.wgsl`: its `ROUNDS` times its `LANES`.
const MULTIPLY_ADDS: u32 = 256 * 32;
/// Invocations of a workgroup there.
const GROUP: u32 = 128;

impl Gpu {
    /// Seconds that work takes, the best of some rounds: on the device's own clock if it has one, else with submitting and
    /// waiting.
    ///
    /// # Errors
    /// What `work` says, or if the device was lost.
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

    /// Multiply-adds of 32-bit floats per second, measured: the limit of what kernels without matrices can do.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn peak_multiply_adds(&self) -> Result<f64, GpuError> {
        let results = self.zeros::<f32>("results", GROUP as usize)?;
        let bound = self.kernel("peak", "peak", &[])?.bind(&[results.whole()])?;
        let groups = if self.summary().software { 64 } else { 1 << 14 };
        let factors = bytemuck::bytes_of(&[0.999_f32, 0.001]).to_vec();
        let seconds = self.seconds(|commands| {
            commands.run(&bound, groups, &factors);
            Ok::<(), GpuError>(())
        })?;
        Ok(f64::from(groups) * f64::from(GROUP * MULTIPLY_ADDS) / seconds)
    }
}
