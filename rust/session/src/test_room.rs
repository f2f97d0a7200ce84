use std::path::{Path, PathBuf};

/// File of a small room.
pub fn room() -> PathBuf {
    // At run time: `scripts/gpu-check` runs this where it was not built.
    let package = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").into());
    Path::new(&package).join("../../tests/data/room.obj")
}
