//! A job whose plan is of any text, with a checksum that fits, is refused, or its first part can be done and brought home; it
//! never panics, and nothing is written outside of the job's folder.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_session::{Monitor, PLAN_FILE, Plan, collect, work};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = copied();
}

/// Name of the job in the folder that nothing else may come into.
const JOB: &str = "job";
/// Name of the bake of the job that seeds have.
const BAKE: &str = "plane";

/// A copy of the tiny job.
fn copied() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/job").join(BAKE);
    let bake = folder.path().join(JOB).join(BAKE);
    fs::create_dir_all(&bake).expect("a folder");
    for entry in fs::read_dir(seeds).expect("seeds, as scripts/fuzz makes them").flatten() {
        fs::copy(entry.path(), bake.join(entry.file_name())).expect("copied");
    }
    folder
}

/// The text with a checksum that fits, where it has a place for one.
fn with_checksum(text: &str) -> String {
    const FIELD: &str = "\"checksum\": \"";
    let Some((before, after)) = text.split_once(FIELD) else { return text.to_owned() };
    let Some((_, after)) = after.split_once('"') else { return text.to_owned() };
    let empty = format!("{before}{FIELD}\"{after}");
    let checksum = crc32fast::hash(empty.as_bytes());
    format!("{before}{FIELD}{checksum:08x}\"{after}")
}

fuzz_target!(|text: &str| FOLDER.with(|folder| {
    let job = folder.path().join(JOB);
    fs::write(job.join(PLAN_FILE), with_checksum(text)).expect("written");
    let Ok((plan, _)) = Plan::read(&job) else { return };
    assert!(plan.bakes.iter().all(|bake| job.join(&bake.folder).parent() == Some(&job)));
    drop(work(&job, &[1], &Monitor::default()));
    drop(collect(&job, &Monitor::default()));
    let beside = fs::read_dir(folder.path()).expect("a folder").flatten().count();
    assert_eq!(beside, 1, "only the job");
}));
