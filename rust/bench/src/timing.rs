//! Best times of some rounds.

use std::time::Instant;

use relume_gpu::{Commands, Gpu, GpuError};

/// Rounds of which the best counts.
const ROUNDS: usize = 5;

/// Seconds that work takes on a device, the best of some rounds: on the device's own clock if it has one, else with submitting
/// and waiting.
///
/// # Errors
/// Errors of `work`, or if the device was lost.
pub fn seconds_on<E: From<GpuError>>(
    gpu: &Gpu,
    mut work: impl FnMut(&mut Commands<'_>) -> Result<(), E>,
) -> Result<f64, E> {
    let mut timer = gpu.timer(2)?;
    let mut best = f64::INFINITY;
    // The first is for drivers that compile on first use.
    for round in 0..=ROUNDS {
        let mut commands = gpu.commands("timed");
        let start = Instant::now();
        timer.iter_mut().for_each(|timer| commands.mark(timer));
        work(&mut commands)?;
        timer.iter_mut().for_each(|timer| commands.mark(timer));
        commands.submit()?;
        let seconds = match &mut timer {
            Some(timer) => timer.seconds(gpu)?.iter().sum(),
            None => {
                gpu.wait()?;
                start.elapsed().as_secs_f64()
            }
        };
        if round > 0 {
            best = best.min(seconds);
        }
    }
    Ok(best)
}

/// Seconds of the quickest of some calls, by the clock on the wall. One more goes before: drivers compile on first use.
///
/// # Errors
/// Errors of the calls.
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
