//! Failures outside the tracer end in one clear error.

use std::{io, path::PathBuf, sync::Mutex, sync::atomic::Ordering};

use relume_dump::{DumpError, Manifest, MemoryWriter, ShardSink, TileSamples};
use relume_scene::{Scene, glam::Vec3};
use relume_trace::{Control, TraceError, TraceOutcome, TraceSettings, Tracer, trace};

use crate::support::*;

/// A disk that is full after some shards.
struct FullDisk {
    memory: MemoryWriter,
    room: usize,
    writing: Mutex<()>,
}

impl ShardSink for FullDisk {
    fn manifest(&self) -> &Manifest {
        self.memory.manifest()
    }

    fn is_complete(&self, tile: usize, pass: usize) -> bool {
        self.memory.is_complete(tile, pass)
    }

    fn write(&self, tile: usize, pass: usize, samples: &TileSamples) -> Result<(), DumpError> {
        let _one_at_a_time = self.writing.lock().unwrap();
        if self.memory.snapshot().shards().count() >= self.room {
            let path = PathBuf::from("shard");
            return Err(DumpError::Io { action: "write", path, source: io::ErrorKind::StorageFull.into() });
        }
        self.memory.write(tile, pass, samples)
    }
}

fn scene() -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, cube(), relume_scene::glam::Affine3A::IDENTITY, diffuse(0.5));
    scene.camera = look_at_origin(Vec3::new(0.3, -0.8, 0.1), 24, 1.0);
    scene
}

fn settings() -> TraceSettings {
    TraceSettings { samples: 4, tile_size: 8, ..TraceSettings::default() }
}

#[test]
fn a_full_disk_ends_the_trace_with_its_error_and_keeps_what_was_written() {
    let scene = scene();
    let tracer = Tracer::new(&scene, &settings()).unwrap();
    let disk =
        FullDisk { memory: MemoryWriter::new(tracer.manifest()).unwrap(), room: 3, writing: Mutex::new(()) };
    let error = tracer.trace(&disk, &Control::default()).unwrap_err();
    assert!(matches!(error, TraceError::Dump(_)), "{error}");
    assert_eq!(disk.memory.snapshot().shards().count(), 3);
    assert_eq!(tracer.trace(&disk.memory, &Control::default()).unwrap(), TraceOutcome::Complete);
}

#[test]
fn a_dump_of_something_else_is_refused() {
    let scene = scene();
    let tracer = Tracer::new(&scene, &settings()).unwrap();
    for (change, word) in [
        ((|manifest| manifest.seed = 9) as fn(&mut Manifest), "seed"),
        (|manifest| manifest.tile_size = 4, "tile size"),
        (|manifest| manifest.scene_hash = "other".into(), "scene"),
    ] {
        let mut manifest = tracer.manifest();
        change(&mut manifest);
        let error = tracer.trace(&MemoryWriter::new(manifest).unwrap(), &Control::default()).unwrap_err();
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn a_trace_that_is_cancelled_before_it_starts_writes_nothing() {
    let scene = scene();
    let writer = MemoryWriter::new(relume_trace::manifest(&scene, &settings())).unwrap();
    let control = Control::default();
    control.cancel.store(true, Ordering::Relaxed);
    assert_eq!(trace(&scene, &settings(), &writer, &control).unwrap(), TraceOutcome::Cancelled);
    assert_eq!(writer.snapshot().shards().count(), 0);
}

#[test]
fn scenes_without_surfaces_or_with_broken_materials_do_not_panic() {
    let mut empty = Scene::default();
    empty.world.color = [1.0; 3];
    let paths = image_paths(&empty, &TraceSettings { samples: 1, ..TraceSettings::default() });
    assert_close(mean(&paths, |path| path.aovs.world), 1.0, 1e-6, "an empty white world");
    let mut broken = scene();
    broken.materials[0].nodes.clear();
    broken.materials[0].surface = None;
    let paths = image_paths(&broken, &TraceSettings { samples: 1, ..TraceSettings::default() });
    assert!(paths.iter().flatten().all(|path| path.segments.len() == 1), "no shader is a black absorber");
}
