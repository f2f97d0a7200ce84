//! A light set of any text is refused, or gives finite images.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_dump::{Dump, Manifest, Shard};
use relume_gather::{Gather, SampleSplit};
use relume_session::LightSet;
use std::path::Path;
use std::sync::{Arc, LazyLock};

static GATHER: LazyLock<Gather> = LazyLock::new(|| {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let manifest = Manifest::read(&corpus.join("manifest")).expect("seeds, as scripts/fuzz makes them");
    let mut dump = Dump::in_memory(manifest).expect("a valid manifest");
    let shard = Shard::open(&Manifest::shard_path(&corpus.join("shard"), 0, 0)).expect("seeds");
    dump.insert(0, 0, Arc::new(shard)).expect("of this manifest");
    Gather::new(dump)
});

fuzz_target!(|text: &str| {
    let Ok(set) = LightSet::parse(text) else { return };
    let Ok(lights) = GATHER.prepare_all(&set.lights) else { return };
    for (light, image) in set.lights.iter().zip(GATHER.unit_images(&lights, SampleSplit::All)) {
        assert!(image.data.iter().all(|value| value.is_finite()), "{light:?}");
    }
});
