//! The tracer at work on shards: which are there, how far it is, and who watches.

use crate::error::SessionError;
use crate::progress::{Monitor, Stage};
use relume_dump::{Dump, DumpError, DumpWriter, Manifest, Shard, ShardSink, TileSamples};
use relume_scene::Light;
use relume_trace::{Control, TraceOutcome, Tracer};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Shards that a tracer is to have in the end, for its progress.
pub(super) struct Work {
    /// Samples of the whole bake.
    pub samples: u32,
    /// Number of them.
    pub shards: usize,
    /// Those that are not there yet.
    pub missing: usize,
    /// Paths that are there already.
    there: u64,
    /// Paths of other shards, which the tracer counts as done.
    others: u64,
}

impl Work {
    /// Work on some of a dump's shards.
    pub fn of(sink: &dyn ShardSink, is_mine: &dyn Fn(usize, usize) -> bool) -> Self {
        let manifest = sink.manifest();
        let mut work = Self { samples: manifest.samples(), shards: 0, missing: 0, there: 0, others: 0 };
        for pass in 0..manifest.passes.len() {
            for tile in 0..manifest.tile_count() {
                let pixels = manifest.tile_rect(tile).pixel_count() as u64;
                let paths = pixels * u64::from(manifest.passes[pass].samples);
                if !is_mine(tile, pass) {
                    work.others += paths;
                    continue;
                }
                work.shards += 1;
                match sink.is_complete(tile, pass) {
                    true => work.there += paths,
                    false => work.missing += 1,
                }
            }
        }
        work
    }
}

/// Runs the tracer with its progress, and the cancel flag passed on.
pub(super) fn trace(
    tracer: &Tracer,
    sink: &dyn ShardSink,
    lights: &(dyn Fn(usize) -> Vec<Light> + Sync),
    work: &Work,
    monitor: &Monitor,
) -> Result<(), SessionError> {
    let Manifest { width, height, .. } = *sink.manifest();
    let total = u64::from(work.samples) * (width * height) as u64 - work.others;
    // The tracer tells of what is there, too, as it goes over it: that takes no time.
    let stage = monitor.stage(Stage::Trace, work.there, total);
    let on_progress = |progress: relume_trace::TraceProgress| {
        let others = progress.shards_total - work.shards;
        stage.set(
            progress.paths.saturating_sub(work.others).max(work.there),
            &format!("{} of {} shards", progress.shards.saturating_sub(others), work.shards),
        );
    };
    let cancel = monitor.cancel().flag().clone();
    let control =
        Control { cancel, on_progress: Some(Box::new(on_progress)), lights: Some(Box::new(lights)) };
    match tracer.trace(sink, &control)? {
        TraceOutcome::Complete => Ok(()),
        TraceOutcome::Cancelled => Err(SessionError::Cancelled),
    }
}

/// A writer that opens what it has written and tells of every whole pass.
pub(super) struct ObservedWriter<'a> {
    pub writer: DumpWriter,
    folder: &'a Path,
    observe: &'a (dyn Fn(Dump) + Sync),
    /// Dump so far, and the number of whole passes that were reported.
    dump: Mutex<(Dump, usize)>,
}

impl<'a> ObservedWriter<'a> {
    pub fn new(
        writer: DumpWriter,
        folder: &'a Path,
        observe: &'a (dyn Fn(Dump) + Sync),
    ) -> Result<Self, SessionError> {
        let mut dump = (Dump::open(folder)?, 0);
        tell(&mut dump, observe);
        Ok(Self { writer, folder, observe, dump: Mutex::new(dump) })
    }
}

impl ShardSink for ObservedWriter<'_> {
    fn manifest(&self) -> &Manifest {
        self.writer.manifest()
    }

    fn is_complete(&self, tile: usize, pass: usize) -> bool {
        self.writer.is_complete(tile, pass)
    }

    fn write(&self, tile: usize, pass: usize, samples: &TileSamples) -> Result<(), DumpError> {
        self.writer.write(tile, pass, samples)?;
        let shard = Arc::new(Shard::open(&Manifest::shard_path(self.folder, tile, pass))?);
        let mut dump = self.dump.lock().unwrap_or_else(PoisonError::into_inner);
        dump.0.insert(tile, pass, shard)?;
        tell(&mut dump, self.observe);
        Ok(())
    }
}

fn tell((dump, told): &mut (Dump, usize), observe: &dyn Fn(Dump)) {
    let complete = dump.complete_passes();
    if complete > *told {
        *told = complete;
        observe(dump.passes(0..complete));
    }
}
