//! A shard of any bytes is refused or can be read from end to end.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_dump::Shard;
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(shard) = Shard::from_bytes(Path::new("fuzz"), bytes) {
        shard.problems(usize::MAX);
        for pixel in 0..shard.pixel_offsets().len().saturating_sub(1) {
            shard.segments(pixel).count();
        }
    }
});
