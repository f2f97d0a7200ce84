//! Another world is shown from the same paths.

use super::*;

/// The room under a sky of two colours, turned about the vertical axis.
fn under_a_sky(turn: f32, size: (usize, usize)) -> Arc<Scene> {
    let mut scene = Arc::unwrap_or_clone(room(size.0, size.1));
    let texel = |i: usize| if i % 16 < 8 { [4.0, 1.0, 0.5, 1.0] } else { [0.2, 0.5, 2.0, 1.0] };
    scene.textures.push(relume_scene::Texture {
        name: "sky".into(),
        width: 16,
        height: 8,
        texels: relume_scene::Texels::Float((0..16 * 8).flat_map(texel).collect()),
        encoding: relume_scene::ColorEncoding::Linear,
        alpha: relume_scene::Alpha::None,
    });
    scene.world = relume_scene::World {
        color: [1.0; 3],
        texture: Some(scene.textures.len() - 1),
        texture_from_world: glam::Mat3::from_rotation_z(turn),
        ..relume_scene::World::default()
    };
    Arc::new(scene)
}

fn shown_under(live: &Live, scene: &Scene) -> Arc<Frame> {
    let world = Arc::new(OtherWorld::new(scene).unwrap());
    let frame = settled(live, live.show_world(world, request(&[])).unwrap());
    assert_eq!(live.status().world_map, Some(scene.world_map()));
    assert_eq!(live.status().world_color, Some(scene.world.color));
    frame
}

#[test]
fn a_turned_world_is_shown_stored_and_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let (before, turned) = (under_a_sky(0.0, (24, 16)), under_a_sky(3.0, (24, 16)));
    bake(&before, &settings(64), folder.path(), false, &Monitor::default()).unwrap();
    let stored = folder.path().join(crate::files::names::WORLD_FILE);
    let open = || opened(folder.path(), Device::Cpu);
    let shot = open();
    let own = settled(&shot, shot.relight(request(&[])));
    assert_eq!((own.shown.noise, shot.status().world_is_stored), (None, true));
    let other = shown_under(&shot, &turned);
    assert!(other.shown.noise.is_some_and(|noise| noise > 0.0) && other.shown.samples == 64);
    wait("the stored light", || shot.status().world_is_stored.then_some(()));

    // Under the new world as a bake of that shows it, but for noise.
    let traced = tempfile::tempdir().unwrap();
    bake(&turned, &settings(64), traced.path(), false, &Monitor::default()).unwrap();
    let reference = opened(traced.path(), Device::Cpu);
    let expected = settled(&reference, reference.relight(request(&[])));
    let error = |frame: &Frame| metrics::smape(&frame.image, &expected.image);
    assert!(error(&other) < 0.1 * error(&own), "{} and {}", error(&other), error(&own));

    // Twice as bright is a factor.
    let bright = LiveRequest { world: [2.0; 3], ..request(&[]) };
    let bright = settled(&shot, shot.relight(bright));
    let sum = |frame: &Frame| frame.image.data.chunks_exact(4).map(|rgba| rgba[0]).sum::<f32>();
    assert!((sum(&bright) / sum(&other) - 2.0).abs() < 0.01, "{} {}", sum(&bright), sum(&other));

    // Opened again it is there at once, for the relighter too.
    drop(shot);
    let again = open();
    let found = settled(&again, again.relight(request(&[])));
    assert_eq!(again.status().world_map, Some(turned.world_map()));
    assert_eq!(found.shown.noise, other.shown.noise);
    assert_eq!(found.image, other.image);
    let relighter = crate::Relighter::open(folder.path()).unwrap();
    assert_ne!(relighter.aovs().world, relighter.gather().unwrap().dump().aovs().world);

    // Going back is free and exact.
    assert_eq!(shown_under(&again, &before).image, own.image);
    assert!(!stored.exists() && again.status().world_is_stored);
    assert_eq!(Dump::open(folder.path()).unwrap().manifest().world_map, before.world_map());
}

#[test]
fn a_turned_world_needs_no_texture_again() {
    let (before, turned) = (under_a_sky(0.0, (16, 16)), under_a_sky(2.0, (16, 16)));
    let read = OtherWorld::new(&before).unwrap();
    let untextured = relume_scene::World { color: [3.0, 0.5, 1.0], texture: None, ..turned.world.clone() };
    let again = read.with_texture_for(&untextured).unwrap();
    assert_eq!(
        again.about(),
        &crate::bake::world::WorldAbout { map: turned.world_map(), color: [3.0, 0.5, 1.0] }
    );

    let folder = tempfile::tempdir().unwrap();
    bake(&before, &settings(16), folder.path(), false, &Monitor::default()).unwrap();
    let live = opened(folder.path(), Device::Cpu);
    let show = |world: OtherWorld| settled(&live, live.show_world(Arc::new(world), request(&[])).unwrap());
    let of_new = show(OtherWorld::new(&turned).unwrap());
    let of_before = show(read.with_texture_for(&turned.world).unwrap());
    assert_eq!(of_new.image.data, of_before.image.data);
}

#[test]
fn noise_under_another_world_is_told_truly() {
    let folder = tempfile::tempdir().unwrap();
    let (before, turned) = (under_a_sky(0.0, (32, 24)), under_a_sky(3.0, (32, 24)));
    bake(&before, &settings(16), folder.path(), false, &Monitor::default()).unwrap();
    let many = tempfile::tempdir().unwrap();
    let other_paths = TraceSettings { seed: 7, ..settings(1024) };
    bake(&turned, &other_paths, many.path(), false, &Monitor::default()).unwrap();
    let environment = relume_gather::Environment::new(&turned.world, &turned.textures).unwrap();
    let [seen, reference] = [folder.path(), many.path()]
        .map(|folder| Gather::new(Dump::open(folder).unwrap()).world_image(&environment, SampleSplit::All));
    let live = opened(folder.path(), Device::Cpu);
    let estimate = shown_under(&live, &turned).shown.noise.expect("an estimate");
    let noise = metrics::smape(&seen, &reference) as f32;
    assert!((0.5..2.0).contains(&(estimate / noise)), "estimated {estimate}, it is {noise}");
}

#[test]
fn a_world_turned_while_paths_are_traced_is_gathered_from_all_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let (before, turned) = (under_a_sky(0.0, (24, 16)), under_a_sky(3.0, (24, 16)));
    let shot = live(folder.path());
    let number = shot.relight(request(&[]));
    shot.bake(before.clone(), settings(64), 0.0, false).unwrap();
    wait("a first frame", || shot.frame(0).filter(|frame| frame.shown.request == number));
    let world = Arc::new(OtherWorld::new(&turned).unwrap());
    let number = shot.show_world(world, request(&[])).unwrap();
    assert_eq!(state(&shot, LiveState::Ready).samples, 64);
    wait("a picture of all samples", || {
        (settled(&shot, number).shown.samples == 64 && shot.status().world_is_stored).then_some(())
    });
    let reopened = opened(folder.path(), Device::Cpu);
    let at_once = shown_under(&reopened, &turned);
    let brightest = at_once.image.data.iter().fold(0.0_f32, |a, b| a.max(*b));
    for (a, b) in settled(&shot, number).image.data.iter().zip(&at_once.image.data) {
        // The denoiser has half floats.
        assert!((a - b).abs() <= 2e-3 * brightest, "{a} {b} of {brightest}");
    }
}

#[test]
fn a_bake_under_another_world_keeps_what_it_can() {
    let folder = tempfile::tempdir().unwrap();
    let (before, turned) = (under_a_sky(0.0, (16, 16)), under_a_sky(3.0, (16, 16)));
    bake(&before, &settings(16), folder.path(), false, &Monitor::default()).unwrap();
    let trace_of_training = folder.path().join("proxy_sphere.json");
    std::fs::write(&trace_of_training, "{}").unwrap();
    let traced = |samples: u32, scene: &Arc<Scene>, anew: bool| {
        let live = live(folder.path());
        live.relight(request(&[]));
        live.bake(scene.clone(), settings(samples), 0.0, anew).unwrap();
        let status = state(&live, LiveState::Ready);
        assert_eq!((status.world_map, status.error), (Some(scene.world_map()), None));
        assert!(trace_of_training.exists(), "proxies were removed");
        let dump = Dump::open(folder.path()).unwrap();
        assert!(dump.missing().is_empty());
        (dump.manifest().world_map.clone(), dump.manifest().samples())
    };
    assert_eq!(traced(16, &turned, false), (before.world_map(), 16), "paths that are there are new");
    assert_eq!(traced(8, &turned, false), (before.world_map(), 16));
    assert_eq!(traced(16, &turned, true), (turned.world_map(), 16), "a rebake is of the old world");
    assert_eq!(traced(32, &before, false), (before.world_map(), 32), "two worlds in one bake");
    assert!(!folder.path().join(crate::files::names::WORLD_FILE).exists());
}
