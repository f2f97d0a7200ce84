//! A shard of any bytes is refused, or can be read and gathered from end to end.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_dump::{Dump, Manifest, Shard};
use relume_gather::{Gather, Isa, PreparedLight, SampleSplit};
use relume_session::LightSet;
use std::path::Path;
use std::sync::{Arc, LazyLock};

/// Manifest and lights of the bake that the seeds are of.
static BAKE: LazyLock<(Manifest, LightSet)> = LazyLock::new(|| {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let manifest = Manifest::read(&corpus.join("manifest")).expect("seeds, as scripts/fuzz makes them");
    (manifest, LightSet::read(&corpus.join("lights/all.json")).expect("seeds"))
});

fuzz_target!(|bytes: &[u8]| {
    let Ok(shard) = Shard::from_bytes(Path::new("fuzz"), bytes) else { return };
    shard.problems(usize::MAX);
    for pixel in 0..shard.rect().pixel_count() {
        shard.segments(pixel).count();
    }
    let (manifest, set) = &*BAKE;
    let mut dump = Dump::in_memory(manifest.clone()).expect("a valid manifest");
    let pass = manifest.passes.iter().position(|pass| *pass == shard.header().pass);
    if dump.insert(0, pass.unwrap_or(0), Arc::new(shard)).is_err() {
        return;
    }
    dump.aovs();
    for isa in [Isa::detect(), Isa::Portable] {
        let gather = Gather::new(dump.clone()).with_isa(isa);
        let lights: Vec<PreparedLight> = gather.prepare_all(&set.lights).expect("valid lights");
        for half in [SampleSplit::All, SampleSplit::First, SampleSplit::Second] {
            // One and two lights take another way than many.
            gather.unit_images(&lights[..1], half);
            gather.unit_images(&lights, half);
        }
    }
});
