//! Sources of each light's picture, and the cost of an edit.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{RAW, Warnings, baked, baked_with, room, sphere, trained, training};
use glam::{Affine3A, Vec3};
use relume_session::proxy::LightKind;
use relume_session::scene::{Instance, Light, LightShape, LobeFactors, Mesh, ReceiverSet, Scene};
use relume_session::trace::TraceSettings;
use relume_session::{
    Cancel, Compute, LightSet, Listener, Method, Monitor, ObjView, Progress, RelightOptions, Relighter,
    Stage, UnitSource, bake, default_sizes, difference, obj_scene, train,
};
use std::sync::{Arc, Mutex};

fn sources(relighter: &Relighter, lights: &[Light], options: RelightOptions) -> Vec<UnitSource> {
    let relit = relighter.relight(lights, &options, &Monitor::default()).unwrap();
    relit.lights.iter().map(|light| light.source).collect()
}

/// Remembers how many pictures of lights had to be made.
#[derive(Default)]
struct Gathers(Mutex<Vec<u64>>);

impl Listener for Gathers {
    fn progress(&self, progress: &Progress) {
        if progress.stage == Stage::Gather && progress.done == 0 {
            self.0.lock().unwrap().push(progress.total);
        }
    }
    fn warning(&self, _: &str) {}
}

/// Stops a training as soon as it has learned something.
struct StopsTraining(Cancel);

impl Listener for StopsTraining {
    fn progress(&self, progress: &Progress) {
        if progress.stage == Stage::Train && progress.done > 0 {
            self.0.request();
        }
    }
    fn warning(&self, _: &str) {}
}

#[test]
fn a_bake_goes_on_under_a_brighter_world() {
    let view = ObjView { width: 20, height: 16, world: [0.5, 1.0, 0.25], ..ObjView::default() };
    let scene = obj_scene(&room(), &view).unwrap();
    let mut brighter = scene.clone();
    brighter.world.color = [5.0, 3.0, 1.0];
    let settings = |samples| TraceSettings { samples, ..TraceSettings::default() };
    let [mixed, whole] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let monitor = Monitor::default();
    bake(&scene, &settings(4), mixed.path(), false, &monitor).unwrap();
    assert_eq!(difference(&brighter, &settings(16), mixed.path()).unwrap(), None);
    bake(&brighter, &settings(16), mixed.path(), true, &monitor).unwrap();
    bake(&scene, &settings(16), whole.path(), false, &monitor).unwrap();
    let [mixed_bake, whole_bake] = [&mixed, &whole].map(|folder| Relighter::open(folder.path()).unwrap());
    assert_eq!(mixed_bake.world_color(), Some(scene.world.color));
    assert_eq!(mixed_bake.aovs().world, whole_bake.aovs().world, "each path is of the colour at the start");

    brighter.world.color[1] = 0.0;
    assert_eq!(difference(&brighter, &settings(17), mixed.path()).unwrap(), Some("map of the world"));
}

#[test]
fn edits_cost_what_they_change() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let relighter = Relighter::open(folder.path()).unwrap();
    let gathers = Arc::new(Gathers::default());
    let monitor = Monitor::new(gathers.clone(), Cancel::default());
    let mut lights: Vec<Light> = (0..5).map(|i| sphere(&format!("{i}"), 0.1 + 0.02 * i as f32)).collect();
    let first = relighter.relight(&lights, &RAW, &monitor).unwrap();

    lights[1].radiance = [8.0, 4.0, 2.0];
    let brighter = relighter.relight(&lights, &RAW, &monitor).unwrap();
    for (a, b) in brighter.lights[1].image.data.iter().zip(&first.lights[1].image.data) {
        assert!((a - 4.0 * b).abs() <= 1e-5 * a.abs());
    }
    lights.remove(0);
    relighter.relight(&lights, &RAW, &monitor).unwrap();
    lights[2].shape = LightShape::Sphere { center: Vec3::Z, radius: 0.2 };
    relighter.relight(&lights, &RAW, &monitor).unwrap();
    // All at first; none for a colour or a removal; one that moved.
    assert_eq!(*gathers.0.lock().unwrap(), [5, 0, 0, 1]);
}

#[test]
fn sun_too_narrow_for_the_samples_is_named() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let relighter = Relighter::open(folder.path()).unwrap();
    let sun = |name: &str, half_angle: f32| Light {
        shape: LightShape::Sun { direction: Vec3::Z, half_angle },
        ..sphere(name, 0.2)
    };
    let warnings = Arc::new(Warnings::default());
    let monitor = Monitor::new(warnings.clone(), Cancel::default());
    // 16 samples: 0.0003 paths of a pixel find the one, 1.4 the other.
    relighter.relight(&[sun("noon", 0.0046), sun("haze", 0.3)], &RAW, &monitor).unwrap();
    let warnings = warnings.0.lock().unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(
        warnings[0].starts_with("light 'noon': its direct light is found by one path in")
            && warnings[0].ends_with("paths look for it there"),
        "{warnings:?}"
    );
}

#[test]
fn a_light_too_small_for_a_bake_that_looks_far_is_named() {
    let backdrop = |scene: &mut Scene| {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let positions = corners.map(|(x, z)| 1000.0 * Vec3::new(x, -1.0, z)).to_vec();
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mesh = Mesh { name: "backdrop".into(), positions, triangles, ..Mesh::default() };
        let number = scene.meshes.len();
        scene.instances.push(Instance::new("backdrop", number, Affine3A::IDENTITY, vec![0]));
        scene.meshes.push(mesh);
    };
    let named = |change: &dyn Fn(&mut Scene)| {
        let folder = tempfile::tempdir().unwrap();
        baked_with(folder.path(), change);
        let warnings = Arc::new(Warnings::default());
        let monitor = Monitor::new(warnings.clone(), Cancel::default());
        let lights = [sphere("pin", 0.001), sphere("lamp", 0.2)];
        Relighter::open(folder.path()).unwrap().relight(&lights, &RAW, &monitor).unwrap();
        let mut warnings = warnings.0.lock().unwrap().clone();
        warnings.retain(|text| text.contains("too small for this bake"));
        warnings
    };
    assert!(named(&|_| ()).is_empty());
    let warnings = named(&backdrop);
    assert!(warnings.len() == 1 && warnings[0].starts_with("light 'pin' is too small"), "{warnings:?}");
}

#[test]
fn proxies_take_only_what_they_learned() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    trained(folder.path(), folder.path(), LightKind::Sphere);
    let relighter = Relighter::open(folder.path()).unwrap();
    let usual = sphere("usual", 0.2);
    let huge = sphere("huge", 0.9);
    let linked = Light { receivers: Some(ReceiverSet { receivers: vec![0] }), ..usual.clone() };
    let sun = Light { shape: LightShape::Sun { direction: Vec3::Z, half_angle: 0.1 }, ..usual.clone() };
    let matte = Light { lobes: LobeFactors { glossy: 0.0, ..LobeFactors::default() }, ..usual.clone() };
    let lights = [usual.clone(), huge, matte, linked, sun];
    let by_proxy = RelightOptions { method: Method::Proxy, ..RAW };
    let expected =
        [UnitSource::Proxy, UnitSource::Gather, UnitSource::Gather, UnitSource::Gather, UnitSource::Gather];
    assert_eq!(sources(&relighter, &lights, by_proxy), expected);
    let gathered = RelightOptions { method: Method::Gather, ..RAW };
    assert_eq!(sources(&relighter, &lights, gathered), [UnitSource::Gather; 5]);

    // The camera sees the lamp itself as it is gathered, over what the proxy knows.
    let seen = Light { lobes: LobeFactors { camera: 1.0, ..LobeFactors::default() }, ..usual.clone() };
    let picture = |light: &Light, options: &RelightOptions| {
        let relit = relighter.relight(std::slice::from_ref(light), options, &Monitor::default()).unwrap();
        relit.lights[0].clone()
    };
    assert_eq!(picture(&seen, &by_proxy).source, UnitSource::Proxy);
    let lamp = |options: &RelightOptions| {
        let (with, without) = (picture(&seen, options).image.data, picture(&usual, options).image.data);
        with.iter().zip(without).map(|(a, b)| a - b).collect::<Vec<f32>>()
    };
    let (by_proxy, gathered) = (lamp(&by_proxy), lamp(&gathered));
    assert!(gathered.iter().copied().fold(0.0, f32::max) > 1.0, "the lamp is in the picture");
    assert!(by_proxy.iter().zip(&gathered).all(|(a, b)| (a - b).abs() < 1e-4));
}

#[test]
fn sizes_to_learn_take_in_the_scenes_own_lights() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let usual = default_sizes(folder.path(), LightKind::Sphere).unwrap();
    let usual_edges = default_sizes(folder.path(), LightKind::Quad).unwrap();
    assert!(usual.min < 0.2 && usual.max > 0.2);
    let mut set = LightSet::read(&folder.path().join("lights.json")).unwrap();
    set.lights.push(sphere("Moon", 5.0));
    set.write(&folder.path().join("lights.json")).unwrap();
    let wide = default_sizes(folder.path(), LightKind::Sphere).unwrap();
    assert_eq!((wide.min, wide.max), (usual.min, 7.5));
    assert_eq!(default_sizes(folder.path(), LightKind::Quad).unwrap(), usual_edges);
}

#[test]
fn auto_takes_whichever_was_measured_better() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let out = folder.path();
    trained(out, out, LightKind::Sphere);
    let path = out.join("proxy_sphere.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut measured: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (smape, maker) in [(0.01, UnitSource::Proxy), (1.9, UnitSource::Gather)] {
        measured["proxy"]["smape"] = smape.into();
        std::fs::write(&path, measured.to_string()).unwrap();
        let relighter = Relighter::open(out).unwrap();
        assert_eq!(sources(&relighter, &[sphere("Key", 0.2)], RAW), [maker], "SMAPE {smape}");
    }
    // An unmeasured proxy beats nothing; a damaged measurement is none.
    std::fs::remove_file(&path).unwrap();
    assert_eq!(sources(&Relighter::open(out).unwrap(), &[sphere("Key", 0.2)], RAW), [UnitSource::Gather]);
    std::fs::write(&path, "{").unwrap();
    let unmeasured = Relighter::open(out).unwrap();
    assert!(unmeasured.damaged()[0].contains("proxy_sphere.json is damaged"), "{:?}", unmeasured.damaged());
    assert_eq!(sources(&unmeasured, &[sphere("Key", 0.2)], RAW), [UnitSource::Gather]);
}

#[test]
fn proxies_travel_without_their_bake() {
    let folder = tempfile::tempdir().unwrap();
    let (bake_folder, proxies) = (folder.path().join("bake"), folder.path().join("proxies"));
    baked(&bake_folder);
    for kind in [LightKind::Sphere, LightKind::Quad] {
        trained(&bake_folder, &proxies, kind);
    }
    let lights = [sphere("Key", 0.2)];
    let by_proxy = RelightOptions { method: Method::Proxy, ..RAW };
    let alone = Relighter::open(&proxies).unwrap();
    assert_eq!(alone.scene_lights().unwrap().lights[0].name, "Own");
    let relit = alone.relight(&lights, &by_proxy, &Monitor::default()).unwrap();
    assert_eq!(relit.lights[0].source, UnitSource::Proxy);
    assert_eq!(relit.albedo, Relighter::open(&bake_folder).unwrap().aovs().albedo);

    let message =
        alone.relight(&[sphere("Huge", 2.0)], &by_proxy, &Monitor::default()).unwrap_err().to_string();
    assert!(message.contains("'Huge'") && message.contains("bake"), "{message}");
}

#[test]
fn proxy_of_another_scene_is_named_and_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    baked(&one);
    trained(&one, &one, LightKind::Sphere);
    let scene = obj_scene(&room(), &ObjView { width: 20, height: 16, ..ObjView::default() }).unwrap();
    let settings = TraceSettings { samples: 2, ..TraceSettings::default() };
    bake(&scene, &settings, &two, false, &Monitor::default()).unwrap();
    std::fs::copy(one.join("proxy_sphere.safetensors"), two.join("proxy_sphere.safetensors")).unwrap();
    let opened = Relighter::open(&two).unwrap();
    assert!(opened.damaged()[0].contains("another scene") && opened.proxies().is_empty());
}

#[test]
fn cancelled_work_says_so_and_keeps_what_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let cancel = Cancel::default();
    cancel.request();
    let monitor = Monitor::new(Arc::new(Gathers::default()), cancel);
    let relighter = Relighter::open(folder.path()).unwrap();
    let error = relighter.relight(&[sphere("Key", 0.2)], &RAW, &monitor).unwrap_err();
    assert!(matches!(error, relume_session::SessionError::Cancelled));
    let out = folder.path();
    let good = trained(out, out, LightKind::Sphere);
    let error =
        train(out, out, &training(LightKind::Sphere), false, &Compute::default(), &monitor).unwrap_err();
    assert!(matches!(error, relume_session::SessionError::Cancelled));
    // A training that was stopped before its first step, or later, does not replace what was there.
    let cancel = Cancel::default();
    let after_first_steps = Monitor::new(Arc::new(StopsTraining(cancel.clone())), cancel);
    let (settings, compute) = (training(LightKind::Sphere), Compute::default());
    let later = train(out, out, &settings, false, &compute, &after_first_steps).unwrap_err();
    assert!(matches!(later, relume_session::SessionError::Cancelled));
    let relighter = Relighter::open(out).unwrap();
    let kept = relighter.proxies().of(LightKind::Sphere).unwrap();
    assert_eq!(kept.proxy.info().steps, good.steps);
    assert_eq!(kept.measured, good.measured);
    let begun = relume_session::proxy::read_info(&out.join("training_sphere.safetensors")).unwrap();
    assert!((1..good.steps).contains(&begun.steps), "stopped after {} of {} steps", begun.steps, good.steps);
    assert_eq!(LightSet::read(&folder.path().join("lights.json")).unwrap().lights.len(), 1);
}

#[test]
fn the_folder_of_the_bake_by_another_spelling_keeps_its_lights() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let before = std::fs::read(folder.path().join("lights.json")).unwrap();
    trained(folder.path(), &folder.path().join("."), LightKind::Sphere);
    assert_eq!(std::fs::read(folder.path().join("lights.json")).unwrap(), before);
}
