//! Trains a proxy on a bake.

mod connected;
pub(crate) mod measure;
mod run;
pub(crate) mod settings;
pub(crate) mod sizes;
pub(crate) mod targets;

use crate::device::compute::Compute;
use crate::device::connections::Connections;
use crate::error::SessionError;
use crate::progress::Monitor;
pub(crate) use crate::train::run::TrainJob;
use crate::train::run::{LastTry, TrainBake, TrainRun};
use crate::train::settings::{TrainReport, TrainSettings};
use relume_dump::Dump;
use std::cell::RefCell;
use std::path::Path;
use std::sync::Arc;

/// Trains a proxy on a bake and writes it into `out`, with all that relighting without the bake needs. With `resume` it
/// goes on with a stopped training, and ends as if that had never stopped. A lost GPU is opened again, once. If it
/// fails and the CPU may take over, that goes on from a recent snapshot.
///
/// # Errors
/// [`SessionError::Cancelled`] if stopped, with a checkpoint and a usable proxy written.
pub fn train(
    bake: &Path,
    out: &Path,
    settings: &TrainSettings,
    resume: bool,
    compute: &Compute,
    monitor: &Monitor,
) -> Result<TrainReport, SessionError> {
    let connections = || stored_connections(bake, monitor);
    train_by(&TrainJob { bake, out, settings, resume, connections: &connections }, compute, monitor)
}

/// Connections in the scene that a bake holds, if it does; a warning tells what is wrong with that.
fn stored_connections(bake: &Path, monitor: &Monitor) -> Option<Arc<Connections>> {
    let dump = Dump::open(bake).ok()?;
    let stored = Connections::stored(bake, dump.manifest(), 1);
    let stored = stored.unwrap_or_else(|warning| {
        monitor.warn(&warning);
        None
    });
    stored.map(Arc::new)
}

/// [`train`] with connections of the job's own.
pub(crate) fn train_by(
    job: &TrainJob<'_>,
    compute: &Compute,
    monitor: &Monitor,
) -> Result<TrainReport, SessionError> {
    let last_try = RefCell::default();
    let from = || job.start_of_next_try(&last_try.borrow());
    compute.attempt(monitor, from, |compute| train_on(compute, job, &last_try, monitor))
}

/// [`train`] without another try. An earlier try left `last_try`, which this one replaces.
fn train_on(
    compute: &Compute,
    job: &TrainJob,
    last_try: &RefCell<LastTry>,
    monitor: &Monitor,
) -> Result<TrainReport, SessionError> {
    let bake = TrainBake::open(job, compute, monitor)?;
    let mut run = TrainRun::open(job, &bake, compute, last_try)?;
    // After the training: what is left of the memory is the dump's, which can be streamed, or gathered from on the CPU.
    let on_gpu = bake.on_gpu(compute)?;
    let targets = bake.targets(job.settings, on_gpu.as_ref());
    run.make_references(&targets, monitor)?;
    run.steps(&targets, monitor)?;
    run.finish(&targets, monitor)
}
