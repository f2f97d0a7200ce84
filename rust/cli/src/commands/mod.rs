//! One file per command.

mod devices;
mod evaluate;
mod farm;
mod inspect;
mod optimise;
mod out_file;
mod relight;
mod shot_pictures;
mod trace;
mod train;

use crate::args::Global;
use crate::console::Console;
use relume_session::{Compute, Monitor, Relighter, lost_files};
use std::path::Path;

pub use devices::devices;
pub use evaluate::evaluate;
pub use farm::{collect, plan, work};
pub use inspect::{info, validate};
pub use optimise::optimise;
pub use relight::{gather, relight};
pub use trace::trace;
pub use train::train;

/// Context of every command.
pub struct CommandContext<'a> {
    pub console: &'a Console,
    pub monitor: &'a Monitor,
    pub global: &'a Global,
}

impl CommandContext<'_> {
    /// The device of `--device`, opened.
    fn compute(&self) -> anyhow::Result<Compute> {
        let compute = self.global.device.open(self.global.gpu_memory.map(|mebibytes| mebibytes << 20))?;
        compute.warn(self.monitor);
        Ok(compute)
    }

    /// A bake or proxies, to be shown by a device; files that are gone from there, or damaged, are said.
    fn relighter(&self, folder: &Path, compute: &Compute) -> anyhow::Result<Relighter> {
        let relighter = Relighter::open(folder)?.on(compute);
        let lost = lost_files(folder);
        lost.iter().chain(relighter.damaged()).for_each(|words| self.monitor.warn(words));
        Ok(relighter)
    }

    /// `--seed`, where nothing else says one.
    fn seed(&self) -> u64 {
        self.global.seed.unwrap_or_default()
    }
}
