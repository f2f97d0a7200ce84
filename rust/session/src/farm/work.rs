//! Does parts of a plan.

use crate::bake;
use crate::error::SessionError;
use crate::farm::plan::Plan;
use crate::files::names::SCENE_FILE;
use crate::files::scene_file::SceneFile;
use crate::progress::Monitor;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// Report of parts that were done.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkReport {
    /// Numbers of the parts.
    pub parts: Vec<usize>,
    /// Shards that were traced.
    pub traced: usize,
    /// Shards of these parts.
    pub shards: usize,
    /// Seconds of this run.
    pub seconds: f64,
}

/// Traces parts of a job, and writes their shards alone. What is there and whole stays: a part that is done, stopped or
/// done twice gives the same bytes.
///
/// # Errors
/// If the plan is of another version of Relume or not as it was written, there is no such part, or a file cannot be read
/// or written ([`SessionError::may_pass`]).
pub fn work(path: &Path, parts: &[usize], monitor: &Monitor) -> Result<WorkReport, SessionError> {
    let start = Instant::now();
    let (plan, job) = Plan::read(path)?;
    let mut by_bake = BTreeMap::<usize, Vec<usize>>::new();
    for part in parts {
        by_bake.entry(plan.bake_of(*part)?).or_default().push(*part);
    }
    let mut report = WorkReport { parts: parts.to_vec(), traced: 0, shards: 0, seconds: 0.0 };
    for (number, parts) in by_bake {
        let bake = &plan.bakes[number];
        let (folder, manifest) = (job.join(&bake.folder), bake.manifest(&job)?);
        let tiles = manifest.tile_count();
        let count = tiles * manifest.passes.len();
        let ranges: Vec<_> = parts.iter().map(|part| plan.shards_of_part(*part, count)).collect();
        let is_mine =
            |tile: usize, pass: usize| ranges.iter().any(|range| range.contains(&(pass * tiles + tile)));
        let scene = SceneFile::read(&folder.join(SCENE_FILE))?.scene;
        let [traced, shards] = bake::trace_part(&scene, &bake.settings, &folder, &is_mine, monitor)?;
        report.traced += traced;
        report.shards += shards;
    }
    report.seconds = start.elapsed().as_secs_f64();
    Ok(report)
}
