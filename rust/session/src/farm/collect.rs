//! Checks what the machines of a job have made.

use crate::error::SessionError;
use crate::farm::plan::Plan;
use crate::files::contents::lost_files;
use crate::files::validate::faults_of_files;
use crate::progress::{Monitor, Stage};
use relume_dump::Dump;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A bake of a job, as it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CollectedBake {
    /// Its folder.
    pub folder: PathBuf,
    /// Paths per pixel that are there for the whole picture.
    pub samples: u32,
    /// Parts that are to be done, again if their files are damaged.
    pub missing: BTreeSet<usize>,
    /// Faults of files that are there or should be beside the paths, in words.
    pub faults: Vec<String>,
}

/// Reads all that the machines of a job have made. A bake without faults is an ordinary one: what killed workers left
/// half-written is removed. May be called at any time, and again.
///
/// # Errors
/// If the plan or a manifest cannot be read, or is not as it was planned.
pub fn collect(path: &Path, monitor: &Monitor) -> Result<Vec<CollectedBake>, SessionError> {
    let (plan, job) = Plan::read(path)?;
    let stage = monitor.stage(Stage::Validate, 0, plan.bakes.len() as u64);
    let mut bakes = Vec::new();
    for (number, bake) in plan.bakes.iter().enumerate() {
        if monitor.cancel().requested() {
            return Err(SessionError::Cancelled);
        }
        let (folder, manifest) = (job.join(&bake.folder), bake.manifest(&job)?);
        let tiles = manifest.tile_count();
        let shards = tiles * manifest.passes.len();
        let of_shards = Dump::faults(&folder)?;
        let whole_passes = of_shards.iter().map(|fault| fault.pass).min().unwrap_or(manifest.passes.len());
        let part = |tile: usize, pass: usize| plan.part_of(number, pass * tiles + tile, shards);
        let missing: BTreeSet<usize> = of_shards.iter().map(|fault| part(fault.tile, fault.pass)).collect();
        let damaged = of_shards.into_iter().filter(|fault| !fault.is_missing).map(|fault| fault.words);
        let faults: Vec<String> =
            damaged.chain(lost_files(&folder)).chain(faults_of_files(&folder, Some(&manifest))).collect();
        if faults.is_empty() && missing.is_empty() {
            remove_half_written(&folder)?;
        }
        let samples = manifest.passes[..whole_passes].iter().map(|pass| pass.samples).sum();
        bakes.push(CollectedBake { folder, samples, missing, faults });
        stage.advance(1, &bake.folder);
    }
    Ok(bakes)
}

/// Removes temporary files of processes that were killed.
fn remove_half_written(folder: &Path) -> Result<(), SessionError> {
    let entries = std::fs::read_dir(folder).map_err(SessionError::io("read the folder", folder))?;
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with(".relume-") && (name.ends_with(".tmp") || name.ends_with(".part")) {
            std::fs::remove_file(&path).map_err(SessionError::io("remove the half-written file", &path))?;
        }
    }
    Ok(())
}
