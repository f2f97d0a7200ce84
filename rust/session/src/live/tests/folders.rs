//! Bakes in folders that hold something already.

use super::*;

#[test]
fn a_bake_of_another_scene_is_replaced_and_foreign_files_stay() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    bake(&room(48, 32), &settings(4), folder.path(), false, &Monitor::default()).unwrap();
    let live = live(folder.path());
    live.bake(room(16, 16), settings(4), 0.0, false).unwrap();
    state(&live, LiveState::Ready);
    let manifest = Dump::open(folder.path()).unwrap().manifest().clone();
    assert_eq!((manifest.width, manifest.height), (16, 16));
    let shards = std::fs::read_dir(folder.path()).unwrap().filter(|entry| {
        entry.as_ref().is_ok_and(|entry| entry.file_name().to_string_lossy().starts_with("tile_"))
    });
    assert_eq!(shards.count(), manifest.passes.len());
    assert_eq!(std::fs::read_to_string(folder.path().join("notes.txt")).unwrap(), "mine");
}

#[test]
fn samples_that_are_there_stay_whatever_number_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    bake(&room(16, 16), &settings(5), folder.path(), false, &Monitor::default()).unwrap();
    // What is removed where another bake is in the way.
    let trace_of_training = folder.path().join("proxy_sphere.json");
    std::fs::write(&trace_of_training, "{}").unwrap();
    let live = live(folder.path());
    for (asked, found) in [(16, 16), (3, 16)] {
        live.bake(room(16, 16), settings(asked), 0.0, false).unwrap();
        let status = state(&live, LiveState::Ready);
        assert_eq!((status.samples, status.samples_total), (found, found));
        assert_eq!(Dump::open(folder.path()).unwrap().manifest().samples(), found);
    }
    assert!(trace_of_training.exists());
}

#[test]
fn a_stale_proxy_is_said_and_does_not_end_a_bake() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("proxy_sphere.safetensors"), "not a proxy").unwrap();
    let live = live(folder.path());
    live.relight(request(&[lamp(0.0)]));
    live.bake(room(16, 16), settings(4), 0.0, false).unwrap();
    let status = state(&live, LiveState::Ready);
    assert!(status.warnings.iter().any(|warning| warning.contains("proxy_sphere")), "{status:?}");
}

#[test]
fn a_tile_that_was_lost_is_named_and_traced_again() {
    let folder = tempfile::tempdir().unwrap();
    let samples = |live: &Live| {
        let status = state(live, LiveState::Ready);
        (status.samples < status.samples_total, status.warnings)
    };
    let baked = live(folder.path());
    baked.bake(room(16, 16), settings(16), 0.0, false).unwrap();
    assert_eq!(samples(&baked), (false, vec![]));
    drop(baked);
    let lost = relume_dump::Manifest::shard_path(folder.path(), 0, 1);
    std::fs::remove_file(&lost).unwrap();
    let reopened = live(folder.path());
    reopened.open(0.0).unwrap();
    let (lacks, warnings) = samples(&reopened);
    assert!(lacks && warnings.len() == 1, "{warnings:?}");
    assert!(warnings[0].contains(&lost.display().to_string()), "{warnings:?}");
    reopened.bake(room(16, 16), settings(16), 0.0, false).unwrap();
    assert!(!samples(&reopened).0 && lost.exists());
}

#[test]
fn a_rebake_looks_for_lights_that_have_moved() {
    let folder = tempfile::tempdir().unwrap();
    let small = |x: f32| Light {
        shape: LightShape::Sphere { center: Vec3::new(x, 0.0, 1.5), radius: 0.005 },
        ..lamp(x)
    };
    let shards = || -> Vec<Vec<u8>> {
        let dump = Dump::open(folder.path()).unwrap();
        dump.shards().map(|shard| shard.as_bytes().to_vec()).collect()
    };
    let rebaked = |x: f32, anew: bool| {
        let live = live(folder.path());
        live.relight(request(&[small(x)]));
        live.bake(room(24, 16), settings(8), 0.0, anew).unwrap();
        state(&live, LiveState::Ready);
        // The last picture may be older than what makes the shot ready.
        let number = live.relight(request(&[small(x)]));
        wait("a picture of all samples", || (settled(&live, number).shown.samples == 8).then_some(()));
        (shards(), live.status().warnings)
    };
    let (first, warnings) = rebaked(-0.6, false);
    assert!(warnings.is_empty(), "{warnings:?}");
    let (same, warnings) = rebaked(0.6, false);
    assert!(
        same == first && warnings.is_empty(),
        "a light that is connected needs no other paths: {warnings:?}"
    );
    let (moved, warnings) = rebaked(0.6, true);
    assert!(moved != first && warnings.is_empty(), "{warnings:?}");
    assert!(rebaked(0.6, true).0 == moved, "paths that look there already were traced again");
}

#[test]
fn pictures_are_made_in_the_scene_that_a_live_shot_of_the_bake_has_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room(48, 32);
    bake(&scene, &settings(8), folder.path(), false, &Monitor::default()).unwrap();
    let live = opened(folder.path(), Device::Cpu);
    std::fs::remove_file(folder.path().join(SCENE_FILE)).unwrap();
    let mut relighter = Relighter::open(folder.path()).unwrap();
    assert!(!relighter.connect_open(&OpenScenes::default()) && relighter.trees_of(&scene).is_none());
    assert!(relighter.connect_open(&OpenScenes::of([&live])));
    assert!(relighter.trees_of(&scene).is_some() && relighter.trees_of(&room(48, 30)).is_none());
    let lights = [lamp(0.3)];
    let lent = relighter.relight(&lights, &RelightOptions::default(), &Monitor::default()).unwrap();
    assert_eq!(lent.combined(), relit(folder.path(), scene, &lights));

    let other = tempfile::tempdir().unwrap();
    bake(&room(48, 30), &settings(8), other.path(), false, &Monitor::default()).unwrap();
    assert!(!Relighter::open(other.path()).unwrap().connect_open(&OpenScenes::of([&live])), "another scene");
}
