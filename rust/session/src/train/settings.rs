//! Settings and report of a training.

use crate::files::proxies::Measured;
use cpu_time::ProcessTime;
use relume_proxy::{LightKind, TrainConfig};
use serde::Serialize;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Settings of a training.
#[derive(Clone, Debug)]
pub struct TrainSettings {
    /// Type of light.
    pub kind: LightKind,
    /// Network, targets, rates, number of samples.
    pub config: TrainConfig,
    /// Seed of weights, lights and batches.
    pub seed: u64,
    /// Train for so many seconds instead of so many samples: the schedule is stretched to end with them.
    pub seconds: Option<f64>,
    /// Clock that seconds are counted by.
    pub clock: Clock,
    /// True to train on the earlier half of the paths and measure on the later, independent half. Else all paths are
    /// trained on, and nothing is measured.
    pub half_for_measuring: bool,
}

/// Time as a training counts it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// The clock on the wall.
    #[default]
    Wall,
    /// Time of this process on all processors, divided by the threads: its time on an idle machine, if all threads are
    /// busy.
    Processor,
}

impl Clock {
    /// Runs some work and says how long it took.
    pub(super) fn time<T>(self, work: impl FnOnce() -> T) -> (T, Duration) {
        match self {
            Self::Wall => {
                let start = Instant::now();
                (work(), start.elapsed())
            }
            Self::Processor => {
                let start = ProcessTime::now();
                (work(), start.elapsed() / rayon::current_num_threads() as u32)
            }
        }
    }
}

/// The error of a proxy as training went on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Seconds of training (without measuring) in this run.
    pub seconds: f64,
    /// Samples trained.
    pub samples: u64,
    /// dB on held-out lights.
    pub psnr: f32,
    /// SMAPE on held-out lights.
    pub smape: f32,
}

/// Report of a training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrainReport {
    /// The proxy's file.
    pub proxy: PathBuf,
    /// Steps in all.
    pub steps: u64,
    /// Samples in all.
    pub samples: u64,
    /// Seconds of training in this run, without measuring.
    pub seconds: f64,
    /// True if the configured number of samples was reached.
    pub complete: bool,
    /// Held-out error on the way.
    pub curve: Vec<CurvePoint>,
    /// Bytes of the bake copied to a GPU that gathered single pixels, in this run. 0 if the bake stayed there, or the
    /// CPU gathered.
    pub copied: u64,
    /// The proxy against gathering; none if all paths were trained on, which leaves none to measure on.
    pub measured: Option<Measured>,
}
