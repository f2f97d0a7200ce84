//! Files that give a job to a farm. They lie in the job folder and name nothing outside of it.

mod openjd;

use crate::args::Farm;
use anyhow::Context;
use std::path::{Path, PathBuf};

/// Stands for the number of parts in the texts.
const PARTS: &str = "@PARTS@";
const FLAMENCO: &str = include_str!("relume_bake.js");
const SLURM: &str = include_str!("slurm.sh");
const MAKE: &str = include_str!("Makefile");

/// Writes the file of a farm into a job folder with so many parts.
pub fn emit(farm: Farm, job: &Path, parts: usize) -> anyhow::Result<PathBuf> {
    let (name, text) = match farm {
        Farm::Openjd => ("template.json", openjd::template(parts, false)),
        Farm::OpenjdChunks => ("template.json", openjd::template(parts, true)),
        Farm::Flamenco => ("relume_bake.js", FLAMENCO.to_owned()),
        Farm::Slurm => ("slurm.sh", SLURM.replace(PARTS, &parts.to_string())),
        Farm::Make => ("Makefile", MAKE.replace(PARTS, &numbers(parts))),
    };
    let path = job.join(name);
    std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

fn numbers(parts: usize) -> String {
    (1..=parts).map(|part| part.to_string()).collect::<Vec<_>>().join(" ")
}
