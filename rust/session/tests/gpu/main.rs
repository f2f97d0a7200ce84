//! GPU and CPU give the same, also if the GPU is lost on the way.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

#[path = "../common/mod.rs"]
mod common;
mod training;

use common::{RAW, Warnings, baked, baked_with, matters, sphere, trained, training};
use glam::{Mat3, Vec3};
use relume_session::gpu::{Gpu, GpuChoice, adapters};
use relume_session::live::{Live, LiveOptions, LiveRequest, LiveState};
use relume_session::proxy::{GroupQueries, LightKind, TargetMode, TargetSource};
use relume_session::scene::{Alpha, ColorEncoding, LightShape, Texels, Texture, World};
use relume_session::{
    Cancel, Compute, Denoise, Device, DumpTargets, GpuTargets, Listener, Method, Monitor, Pictures, Progress,
    RelightOptions, Relighter, SessionError, SolveRequest, Stage, TrainReport, TrainSettings, evaluate,
    solve_lights, train,
};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

const SKY: World = World {
    color: [1.0, 2.0, 0.5],
    texture: Some(0),
    texture_from_world: Mat3::IDENTITY,
    visible_camera: true,
    parts: Vec::new(),
    volume: None,
    receiver: 0,
};

/// 8 x 4 texels that grow brighter.
fn sky() -> Texture {
    let texels = Texels::Float((0..128).map(|i| 0.1 * i as f32).collect());
    let (encoding, alpha) = (ColorEncoding::Linear, Alpha::None);
    Texture { name: "Sky".into(), width: 8, height: 4, texels, encoding, alpha }
}

/// A device that no other test loses.
fn unshared() -> Compute {
    Compute::with(Gpu::open(&GpuChoice::Best).unwrap(), false)
}

/// Lock for tests that lose the device which the process shares.
static SHARED: Mutex<()> = Mutex::new(());

#[test]
fn pictures_of_the_gpu_are_those_of_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    trained(folder.path(), folder.path(), LightKind::Sphere);
    let compute = unshared();
    let has_matrices = compute.gpu.as_ref().unwrap().matrices().is_some();
    let gpu = Relighter::open(folder.path()).unwrap().on(&compute);
    let cpu = Relighter::open(folder.path()).unwrap();
    for with in [Method::Gather, Method::Proxy] {
        let options = RelightOptions { method: with, denoise: false, lobes: false };
        let picture = |relighter: &Relighter| {
            relighter.relight(&[sphere("Own", 0.2)], &options, &Monitor::default()).unwrap().combined()
        };
        let (a, b) = (picture(&gpu), picture(&cpu));
        let pairs = || a.data.iter().zip(&b.data);
        if with == Method::Gather {
            // A segment that grazes the light may be decided otherwise.
            let mean = b.data.iter().sum::<f32>() / b.data.len() as f32;
            let different = pairs().filter(|(a, b)| (*a - *b).abs() > 1e-3 * mean).count();
            assert!(different * 100 < a.data.len(), "{different} of {}", a.data.len());
        } else {
            // Networks run on matrices of 16-bit floats where there are such (`GpuProxy::unit_image`).
            let bound = if has_matrices { 2e-2f32 } else { 1e-5 };
            let error = pairs().map(|(a, b)| (a - b).powi(2)).sum::<f32>();
            let whole = b.data.iter().map(|b| b.powi(2)).sum::<f32>();
            assert!(error < bound.powi(2) * whole, "{error} of {whole}");
        }
    }
    let [a, b] = [gpu, cpu].map(|mut relighter| {
        relighter.set_world(&SKY, &[sky()], &Monitor::default()).unwrap();
        relighter.aovs().world.clone()
    });
    let brightest = b.data.iter().fold(0.0_f32, |most, value| most.max(*value));
    assert!(brightest > 0.1 && a.data.iter().zip(&b.data).all(|(a, b)| (a - b).abs() < 1e-5 * brightest));
}

#[test]
fn a_proxy_is_measured_on_the_gpu_as_on_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    trained(folder.path(), folder.path(), LightKind::Sphere);
    let bake = Relighter::open(folder.path()).unwrap();
    let proxy = bake.proxies().iter().next().unwrap().proxy.clone();
    let on = |compute: &Compute| {
        let proxies = std::slice::from_ref(&proxy);
        evaluate(proxies, &bake, Some(&bake), (3, 1), None, compute, &Monitor::default())
    };
    let cpu = on(&Compute::default()).unwrap();
    let gpu = on(&unshared()).unwrap();
    assert_eq!((gpu.lights, cpu.lights), (3, 3));
    for (gpu, cpu) in [
        (&gpu.proxies[0], &cpu.proxies[0]),
        (&gpu.reference_noise, &cpu.reference_noise),
        (gpu.gather.as_ref().unwrap(), cpu.gather.as_ref().unwrap()),
    ] {
        // A few values may be decided otherwise, and denoisers differ between devices.
        assert!(
            (gpu.psnr - cpu.psnr).abs() < 0.3 && (gpu.smape - cpu.smape).abs() < 0.01,
            "{gpu:?}, {cpu:?}"
        );
    }
    let lost = Gpu::open(&GpuChoice::Best).unwrap();
    lost.lose();
    let on_lost = |may_fall_back| on(&Compute::with(lost.clone(), may_fall_back));
    assert_eq!(on_lost(true).unwrap(), cpu);
    assert!(matches!(
        on_lost(false),
        Err(SessionError::Gather(_) | SessionError::Gpu(_) | SessionError::Proxy(_))
    ));
}

#[test]
fn the_cpu_goes_on_where_the_gpu_fails_unless_that_one_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let lost = Gpu::open(&GpuChoice::Best).unwrap();
    lost.lose();
    let warnings = Arc::new(Warnings::default());
    let monitor = Monitor::new(warnings.clone(), Cancel::default());
    let on = |may_fall_back: bool| {
        let compute = Compute::with(lost.clone(), may_fall_back);
        Relighter::open(folder.path()).unwrap().on(&compute)
    };
    let lights = [sphere("Own", 0.2)];
    let error = on(false).relight(&lights, &RAW, &monitor).unwrap_err();
    assert!(error.to_string().contains("the GPU was lost"), "{error}");
    assert_eq!(on(false).set_world(&SKY, &[sky()], &monitor).unwrap_err().to_string(), error.to_string());
    let [relit, cpu] = [on(true), Relighter::open(folder.path()).unwrap()].map(|mut relighter| {
        relighter.set_world(&SKY, &[sky()], &monitor).unwrap();
        relighter.relight(&lights, &RAW, &monitor).unwrap()
    });
    assert_eq!(relit.combined(), cpu.combined());
    let warned = warnings.0.lock().unwrap();
    assert!(warned.len() == 1 && warned[0].contains("The CPU goes on"), "{warned:?}");
}

#[test]
fn a_gpu_that_is_lost_between_pictures_is_opened_again_with_its_budget() {
    let _alone = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    trained(folder.path(), folder.path(), LightKind::Sphere);
    let choice = GpuChoice::Named(adapters()[0].name.clone());
    let compute = Device::Gpu(choice.clone()).open(Some(1 << 28)).unwrap();
    let warnings = Arc::new(Warnings::default());
    let monitor = Monitor::new(warnings.clone(), Cancel::default());
    let mut relighter = Relighter::open(folder.path()).unwrap().on(&compute);
    let picture = |relighter: &Relighter, radius: f32, with: Method| {
        let options = RelightOptions { method: with, denoise: false, lobes: false };
        relighter.relight(&[sphere("Own", radius)], &options, &monitor).unwrap().combined()
    };
    let unharmed = Relighter::open(folder.path()).unwrap().on(&unshared());
    picture(&relighter, 0.25, Method::Gather);
    picture(&relighter, 0.25, Method::Proxy);
    let mut lost = compute.gpu.unwrap();
    for (times, radius) in [(1, 0.2), (2, 0.15)] {
        lost.lose();
        for with in [Method::Gather, Method::Proxy] {
            assert!(picture(&relighter, radius, with) == picture(&unharmed, radius, with), "{with:?}");
        }
        // Once for the dump, once for the proxy.
        assert_eq!(warnings.0.lock().unwrap().len(), 2 * times);
        let opened = Gpu::shared(&choice).unwrap();
        assert!(!Arc::ptr_eq(&opened, &lost) && opened.free_memory() < 1 << 28);
        lost = opened;
    }
    lost.lose();
    relighter.set_world(&SKY, &[sky()], &monitor).unwrap();
    let warned = warnings.0.lock().unwrap();
    assert!(warned.len() == 5 && warned.iter().all(|text| text.contains("was lost (")), "{warned:?}");
    assert!(warned.iter().all(|text| text.ends_with("it was opened again and goes on")), "{warned:?}");
}

#[test]
fn a_live_shot_whose_gpu_is_lost_goes_on_with_the_same_pictures() {
    let _alone = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    trained(folder.path(), folder.path(), LightKind::Sphere);
    let choice = GpuChoice::Named(adapters()[0].name.clone());
    let options = LiveOptions { device: Device::Gpu(choice.clone()), threads: 2, ..LiveOptions::default() };
    let live = Live::new(folder.path(), options);
    live.open(0.0).unwrap();
    // Each level of connections that the work thread makes ready changes pictures.
    while live.status().state != LiveState::Ready {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let picture = |with: &str, gain: f32| {
        let bulb = r#"{"name": "Bulb", "shape": {"type": "sphere", "center": [0, 0, 1], "radius": 0.2}, "radiance": [1, 1, 1]}"#;
        let gains = format!(r#"{{"Bulb": [{gain}, {gain}, {gain}]}}"#);
        let request = format!(r#"{{"lights": [{bulb}], "gains": {gains}, "with": "{with}"}}"#);
        let number = live.relight(LiveRequest::parse(&request).unwrap());
        let shown = || {
            let status = live.status();
            assert_eq!(status.error, None);
            live.frame(0).filter(|frame| frame.shown.request == number && frame.shown.settled)
        };
        loop {
            if let Some(frame) = shown() {
                return frame.image.clone();
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
    };
    for with in ["gather", "proxy"] {
        let [once, twice] = [1.0, 2.0].map(|gain| picture(with, gain));
        assert!(once != twice);
        Gpu::shared(&choice).unwrap().lose();
        assert!(picture(with, 2.0) == twice, "{with}");
        assert!(picture(with, 1.0) == once, "{with}");
    }
    let mut warnings = live.status().warnings;
    warnings.retain(|text| matters(text));
    assert!(warnings.iter().all(|text| text.contains("it was opened again and goes on")), "{warnings:?}");
    assert!(!warnings.is_empty());
}

#[test]
fn lights_solved_on_the_gpu_are_those_of_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    for kind in [LightKind::Sphere, LightKind::Quad] {
        trained(folder.path(), folder.path(), kind);
    }
    let gpu = Relighter::open(folder.path()).unwrap().on(&unshared());
    let cpu = Relighter::open(folder.path()).unwrap();
    let options = RelightOptions { method: Method::Proxy, denoise: false, lobes: false };
    let target = cpu.relight(&[sphere("Hidden", 0.2)], &options, &Monitor::default()).unwrap().combined();
    let pictures = Pictures::named(HashMap::from([("target".into(), target)]));
    // One light, and two of different types.
    let bulb = r#"{"name": "Bulb", "shape": {"type": "sphere", "center": [0, 0, 1], "radius": 0.2}, "radiance": [1, 1, 1]}"#;
    let panel = r#"{"name": "Panel", "kind": {"type": "AREA", "shape": "SQUARE", "size": 0.25}, "energy": 10,
        "world_from_object": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1.5], [0, 0, 0, 1]]}"#;
    let two = format!(
        r#""lights": [{bulb}, {panel}], "free": {{"Bulb": ["position", "strength"], "Panel": ["position", "strength"]}}"#
    );
    let one = r#""add": {"count": 1}"#;
    let part = r#", "where": {"rectangle": [0.1, 0.1, 0.8, 1]}"#;
    // A gradient of few paths is less sure of its way than that of a network.
    for (wish, within, through, steps) in [
        (one, "", "proxy", 25),
        (one, part, "proxy", 25),
        (&two, "", "proxy", 25),
        (one, "", "gather", 120),
        (one, part, "gather", 120),
        (&two, "", "gather", 120),
    ] {
        let request = SolveRequest::parse(&format!(
            r#"{{{wish}, "goals": [{{"goal": "target", "image": "target"{within}}}], "through": "{through}",
                "starts": 1, "candidates": 1, "steps": {steps}, "polish": 0}}"#
        ));
        let request = request.unwrap();
        let solved = [&gpu, &cpu].map(|relighter| {
            solve_lights(&[relighter], &request, &pictures, &Monitor::default(), &|_| ()).unwrap()
        });
        // The same steps, but for the order of sums.
        let ratio = solved[0].loss / solved[1].loss;
        assert!((ratio - 1.0).abs() < 1e-2 && solved[1].loss < 0.9 * solved[1].start_loss, "{solved:?}");
        for (a, b) in solved[0].lights.lights.iter().zip(&solved[1].lights.lights) {
            let (a, b) = (a.shape.center().unwrap(), b.shape.center().unwrap());
            assert!(a.distance(b) < 1e-2, "{a} {b}");
        }
    }
}

#[test]
fn lights_solved_through_a_streamed_bake_are_those_of_one_that_fits() {
    let folder = tempfile::tempdir().unwrap();
    baked_with(folder.path(), |scene| (scene.camera.width, scene.camera.height) = (128, 80));
    let warnings = Arc::new(Warnings::default());
    let monitor = Monitor::new(warnings.clone(), Cancel::default());
    let cpu = Relighter::open(folder.path()).unwrap();
    let target = cpu.relight(&[sphere("Hidden", 0.2)], &RAW, &Monitor::default()).unwrap().combined();
    let pictures = Pictures::named(HashMap::from([("target".into(), target)]));
    // The last steps alone take all paths.
    let request = SolveRequest::parse(
        r#"{"add": {"count": 1}, "goals": [{"goal": "target", "image": "target"}], "through": "gather",
            "starts": 1, "candidates": 1, "steps": 80, "polish": 1}"#,
    )
    .unwrap();
    let solve = |budget: u64| {
        let compute = unshared();
        compute.gpu.as_ref().unwrap().set_memory_budget(Some(budget));
        let relighter = Relighter::open(folder.path()).unwrap().on(&compute);
        solve_lights(&[&relighter], &request, &pictures, &monitor, &|_| ()).unwrap()
    };
    // Room for the paths of the first samples, and for parts of all (7 MB beside pictures of 4 MB).
    let [whole, streamed] = [1 << 30, 8 << 20].map(solve);
    assert!(warnings.0.lock().unwrap().is_empty(), "{warnings:?}");
    let ratio = streamed.loss / whole.loss;
    assert!((ratio - 1.0).abs() < 1e-2 && whole.loss < 0.9 * whole.start_loss, "{whole:?} {streamed:?}");
    for (a, b) in streamed.lights.lights.iter().zip(&whole.lights.lights) {
        let (a, b) = (a.shape.center().unwrap(), b.shape.center().unwrap());
        assert!(a.distance(b) < 1e-2, "{a} {b}");
    }
}

#[test]
fn a_solve_on_a_lost_gpu_is_done_by_the_cpu_or_says_so() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    trained(folder.path(), folder.path(), LightKind::Sphere);
    let cpu = Relighter::open(folder.path()).unwrap();
    let options = RelightOptions { method: Method::Gather, denoise: false, lobes: false };
    let target = cpu.relight(&[sphere("Hidden", 0.2)], &options, &Monitor::default()).unwrap().combined();
    let pictures = Pictures::named(HashMap::from([("target".into(), target)]));
    for through in ["gather", "proxy"] {
        let request = SolveRequest::parse(&format!(
            r#"{{"add": {{"count": 1}}, "goals": [{{"goal": "target", "image": "target"}}], "through": "{through}",
                "starts": 1, "candidates": 1, "steps": 10, "polish": 1}}"#
        ));
        let solve = |relighter: &Relighter| {
            solve_lights(&[relighter], request.as_ref().unwrap(), &pictures, &Monitor::default(), &|_| ())
        };
        let on_lost = |may_fall_back| {
            let lost = Gpu::open(&GpuChoice::Best).unwrap();
            lost.lose();
            solve(&Relighter::open(folder.path()).unwrap().on(&Compute::with(lost, may_fall_back)))
        };
        assert_eq!(on_lost(true).unwrap().lights, solve(&cpu).unwrap().lights, "{through}");
        let error = on_lost(false).unwrap_err().to_string();
        assert!(error.contains("the GPU was lost"), "{through}: {error}");
    }
}
