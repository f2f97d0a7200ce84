//! A manifest of any bytes is refused, or a dump can be opened by it.
#![no_main]

use relume_dump::{Dump, Manifest};
use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(manifest) = Manifest::from_bytes(Path::new("fuzz"), bytes) else { return };
    let tiles = manifest.tile_count();
    assert!(manifest.tile_rect(0).pixel_count() > 0 && manifest.tile_rect(tiles - 1).pixel_count() > 0);
    manifest.samples();
    manifest.bake_id();
    if tiles * manifest.passes.len() < 1 << 16 {
        assert_eq!(
            Dump::in_memory(manifest.clone()).expect("checked").missing().len(),
            tiles * manifest.passes.len()
        );
    }
    assert_eq!(manifest.difference(&manifest), None);
});
