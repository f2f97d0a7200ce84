//! A bake in which one of the small files (the first byte says which) is of any bytes can be validated, and relit where it can be
//! opened; neither ever panics.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_session::{Monitor, Relighter, validate};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const FILES: [&str; 8] = [
    "guided.json",
    "contents.json",
    "lights.json",
    "proxy_sphere.json",
    "base.exr",
    "shot.json",
    "wanted.json",
    "world.exr",
];

thread_local! {
    static FOLDER: TempDir = copied();
}

/// A copy of the tiny bake.
fn copied() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let bake = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/bake");
    for entry in fs::read_dir(bake).expect("seeds, as scripts/fuzz makes them").flatten() {
        fs::copy(entry.path(), folder.path().join(entry.file_name())).expect("copied");
    }
    folder
}

fuzz_target!(|bytes: &[u8]| FOLDER.with(|folder| {
    let Some((number, bytes)) = bytes.split_first() else { return };
    let path = folder.path().join(FILES[*number as usize % FILES.len()]);
    let before = fs::read(&path).ok();
    fs::write(&path, bytes).expect("written");
    validate(folder.path(), &Monitor::default()).expect("a bake");
    drop(Relighter::open(folder.path()));
    match before {
        Some(before) => fs::write(&path, before).expect("written"),
        None => fs::remove_file(&path).expect("removed"),
    }
}));
