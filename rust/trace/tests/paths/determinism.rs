//! Determinism: a seed gives the same paths, however the work is divided.

use relume_dump::{Dump, MemoryWriter};
use relume_scene::{
    Light, LightShape, Scene,
    glam::{Affine3A, Vec3},
};
use relume_trace::{Control, TraceOutcome, TraceSettings, Tracer, settings::PassSchedule};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::support::*;

fn scene() -> Scene {
    let mut scene = Scene::default();
    scene.world.color = [0.3, 0.4, 0.5];
    add(&mut scene, cube(), Affine3A::from_scale(Vec3::splat(3.0)), diffuse(0.7));
    add(&mut scene, sphere(), Affine3A::IDENTITY, diffuse(0.4));
    scene.camera = look_at_origin(Vec3::new(2.0, -1.5, 1.0), 20, 1.0);
    scene
}

fn settings() -> TraceSettings {
    TraceSettings {
        samples: 6,
        seed: 5,
        tile_size: 8,
        passes: PassSchedule { first: 2, largest: 4 },
        ..TraceSettings::default()
    }
}

fn shards(scene: &Scene, settings: &TraceSettings) -> Vec<Vec<u8>> {
    let tracer = Tracer::new(scene, settings).unwrap();
    let writer = MemoryWriter::new(tracer.manifest()).unwrap();
    assert_eq!(tracer.trace(&writer, &Control::default()).unwrap(), TraceOutcome::Complete);
    let dump = writer.snapshot();
    assert_eq!(dump.missing(), []);
    dump.shards().map(|shard| shard.as_bytes().to_vec()).collect()
}

#[test]
fn thread_count_does_not_change_the_dump() {
    let scene = scene();
    let one = shards(&scene, &TraceSettings { threads: 1, ..settings() });
    let four = shards(&scene, &TraceSettings { threads: 4, ..settings() });
    assert!(one.len() == 9 * 3 && one == four);
}

#[test]
fn division_into_passes_does_not_change_the_paths() {
    let scene = scene();
    let tracer = Tracer::new(&scene, &settings()).unwrap();
    for (x, y) in [(0, 0), (7, 12), (19, 19)] {
        let whole = pixel_paths(&tracer, x, y, 0..9);
        let parts: Vec<Path> =
            [0..1, 1..5, 5..9].into_iter().flat_map(|range| pixel_paths(&tracer, x, y, range)).collect();
        assert_eq!(whole, parts);
    }
}

#[test]
fn seeds_change_the_paths() {
    let scene = scene();
    let [a, b] = [1, 2].map(|seed| {
        let tracer = Tracer::new(&scene, &TraceSettings { seed, ..settings() }).unwrap();
        pixel_paths(&tracer, 3, 3, 0..4)
    });
    assert_ne!(a, b);
}

#[test]
fn cancelled_traces_leave_whole_shards_and_go_on_later() {
    let scene = scene();
    let settings = TraceSettings { threads: 1, ..settings() };
    let tracer = Tracer::new(&scene, &settings).unwrap();
    let writer = MemoryWriter::new(tracer.manifest()).unwrap();
    let watched = Control {
        on_progress: Some(Box::new(|progress| assert!(progress.paths <= progress.paths_total))),
        ..Control::default()
    };
    std::thread::scope(|scope| {
        let running = scope.spawn(|| tracer.trace(&writer, &watched).unwrap());
        while writer.snapshot().missing().len() > 20 {
            std::thread::yield_now();
        }
        watched.cancel.store(true, Ordering::Relaxed);
        let outcome = running.join().unwrap();
        assert_eq!(outcome == TraceOutcome::Complete, writer.snapshot().missing().is_empty());
    });
    assert_eq!(tracer.trace(&writer, &Control::default()).unwrap(), TraceOutcome::Complete);
    let resumed: Vec<Vec<u8>> = writer.snapshot().shards().map(|shard| shard.as_bytes().to_vec()).collect();
    assert_eq!(resumed, shards(&scene, &settings));
}

#[test]
fn every_pass_looks_for_the_lights_of_its_time() {
    let scene = scene();
    let settings = TraceSettings { threads: 1, guiding: 0.5, ..settings() };
    let lamp = |x: f32| Light {
        name: "lamp".into(),
        ..Light::unit(LightShape::Sphere { center: Vec3::new(x, 0.3, 1.5), radius: 0.05 })
    };
    let traced = |settings: &TraceSettings, control: &Control| {
        let tracer = Tracer::new(&scene, settings).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, control).unwrap();
        writer.snapshot()
    };
    let asked = AtomicUsize::new(0);
    let moving = |pass: usize| {
        asked.fetch_add(1, Ordering::Relaxed);
        vec![lamp(pass as f32)]
    };
    let control = Control { lights: Some(Box::new(moving)), ..Control::default() };
    let found = traced(&settings, &control);
    let passes = found.manifest().passes.len();
    assert_eq!((asked.load(Ordering::Relaxed), passes > 1), (passes, true));
    let of = |dump: &Dump, pass: usize| -> Vec<Vec<u8>> {
        dump.passes(pass..pass + 1).shards().map(|shard| shard.as_bytes().to_vec()).collect()
    };
    for time in 0..passes {
        let towards = vec![lamp(time as f32)];
        let still =
            traced(&TraceSettings { guide_targets: towards, ..settings.clone() }, &Control::default());
        for pass in 0..passes {
            assert_eq!(of(&found, pass) == of(&still, pass), pass == time, "pass {pass}, lamp {time}");
        }
    }
}
