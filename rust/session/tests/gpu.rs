//! What the GPU makes is what the CPU makes, also if it is lost on the way.

mod common;

use common::{RAW, Warnings, baked, baked_with, matters, sphere, trained, training};
use glam::{Mat3, Vec3};
use relume_session::gpu::{Gpu, GpuChoice, adapters};
use relume_session::live::{Live, LiveOptions, LiveRequest};
use relume_session::proxy::{GroupQueries, LightKind, TargetMode, TargetSource};
use relume_session::scene::{Alpha, ColorEncoding, LightShape, Texels, Texture, World};
use relume_session::{
    Cancel, Compute, Denoise, Device, DumpTargets, GpuTargets, Listener, Monitor, Pictures, Progress,
    RelightOptions, Relighter, SessionError, SolveRequest, Stage, TrainReport, TrainSettings, With, evaluate,
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

/// For tests that lose the device which the process shares.
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
    for with in [With::Gather, With::Proxy] {
        let options = RelightOptions { with, denoise: false };
        let picture = |relighter: &Relighter| {
            relighter.relight(&[sphere("Own", 0.2)], &options, &Monitor::default()).unwrap().combined()
        };
        let (a, b) = (picture(&gpu), picture(&cpu));
        let pairs = || a.data.iter().zip(&b.data);
        if with == With::Gather {
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
    let picture = |relighter: &Relighter, radius: f32, with: With| {
        let options = RelightOptions { with, denoise: false };
        relighter.relight(&[sphere("Own", radius)], &options, &monitor).unwrap().combined()
    };
    let unharmed = Relighter::open(folder.path()).unwrap().on(&unshared());
    picture(&relighter, 0.25, With::Gather);
    picture(&relighter, 0.25, With::Proxy);
    let mut lost = compute.gpu.unwrap();
    for (times, radius) in [(1, 0.2), (2, 0.15)] {
        lost.lose();
        for with in [With::Gather, With::Proxy] {
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
    let options = LiveOptions { device: Device::Gpu(choice.clone()), gpu_memory: None, threads: 2 };
    let live = Live::new(folder.path(), options);
    live.open(0.0).unwrap();
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
    let options = RelightOptions { with: With::Proxy, denoise: false };
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
    let options = RelightOptions { with: With::Gather, denoise: false };
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

/// Does something once a training has got so far, in thousandths.
struct At<F>(u64, F, Warnings);

impl<F: Fn() + Send + Sync> Listener for At<F> {
    fn progress(&self, progress: &Progress) {
        if progress.stage == Stage::Train && progress.done >= self.0 {
            self.1();
        }
    }
    fn warning(&self, message: &str) {
        self.2.warning(message);
    }
}

#[test]
fn a_training_on_the_gpu_ends_like_one_on_the_cpu_even_if_the_gpu_is_lost_on_the_way() {
    let _alone = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let mut settings = training(LightKind::Sphere);
    settings.config.samples = 100_000;
    let run = |out: &str, resume: bool, compute: &Compute, monitor: &Monitor| {
        train(folder.path(), &folder.path().join(out), &settings, resume, compute, monitor)
    };
    let quiet = Monitor::default();
    let cpu = run("cpu", false, &Compute::default(), &quiet).unwrap();
    let on = unshared();
    let gpu = run("gpu", false, &on, &quiet).unwrap();

    // Stopped with a checkpoint, resumed, and lost on the way.
    let cancel = Cancel::default();
    let stopping = cancel.clone();
    let stop = Arc::new(At(300, move || stopping.request(), Warnings::default()));
    assert!(matches!(run("lost", false, &on, &Monitor::new(stop, cancel)), Err(SessionError::Cancelled)));
    let lost = Gpu::open(&GpuChoice::Best).unwrap();
    let (losing, compute) = (lost.clone(), |may_fall_back| Compute::with(lost.clone(), may_fall_back));
    let lose = Arc::new(At(600, move || losing.lose(), Warnings::default()));
    let fallen = run("lost", true, &compute(true), &Monitor::new(lose.clone(), Cancel::default())).unwrap();
    assert!(
        lose.2.0.lock().unwrap().iter().any(|text| text.contains("The CPU goes on from a moment before"))
    );
    let error = run("error", false, &compute(false), &quiet).unwrap_err();
    assert!(error.to_string().contains("the GPU was lost"), "{error}");

    // Lost before there is a checkpoint, which is made after ten seconds, and opened again.
    let named = Device::Gpu(GpuChoice::Named(adapters()[0].name.to_uppercase())).open(None).unwrap();
    let losing = named.gpu.clone().unwrap();
    let lose = Arc::new(At(50, move || losing.lose(), Warnings::default()));
    let again = run("again", false, &named, &Monitor::new(lose.clone(), Cancel::default())).unwrap();
    let warned = lose.2.0.lock().unwrap();
    assert!(
        warned.len() == 1 && warned[0].contains("opened again and goes on from a moment before"),
        "{warned:?}"
    );

    // Sums are rounded otherwise, which changes far less than another seed: that makes a decibel or more.
    let psnr = |report: &TrainReport| report.measured.unwrap().proxy.psnr;
    for other in [&gpu, &fallen, &again] {
        let (expected, found) = (psnr(&cpu), psnr(other));
        assert!(other.complete && (found - expected).abs() < 0.05, "{found} dB instead of {expected} dB");
    }
}

/// A training on a GPU with so much memory: what it did, and what it warned of.
fn trained_within(
    budget: u64,
    bake: &Path,
    settings: &TrainSettings,
) -> Result<(TrainReport, Vec<String>), SessionError> {
    let gpu = Gpu::open(&GpuChoice::Best).unwrap();
    gpu.set_memory_budget(Some(budget));
    let compute = Compute::with(gpu, false);
    let warnings = Arc::new(Warnings::default());
    let monitor = Monitor::new(warnings.clone(), Cancel::default());
    let report = train(bake, &bake.join("out"), settings, false, &compute, &monitor)?;
    let warned = warnings.0.lock().unwrap().clone();
    Ok((report, warned))
}

/// The least budget, but for a quarter of a MiB, at which something is so; it is at 128 MiB.
fn least_budget(is_enough: impl Fn(u64) -> bool) -> u64 {
    let (mut few, mut enough) = (0_u64, 1 << 27);
    while enough - few > 1 << 18 {
        let budget = few.midpoint(enough);
        if is_enough(budget) { enough = budget } else { few = budget }
    }
    enough
}

/// A short training.
fn brief() -> TrainSettings {
    let mut settings = training(LightKind::Sphere);
    settings.config.samples = 4096;
    settings
}

#[test]
fn without_memory_on_the_gpu_the_cpu_relights_and_trains_unless_the_gpu_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let gpu = Gpu::open(&GpuChoice::Best).unwrap();
    gpu.set_memory_budget(Some(1000));
    let lights = [sphere("Own", 0.2)];
    let run = |compute: &Compute, out: &str, monitor: &Monitor| {
        let relighter = Relighter::open(folder.path()).unwrap().on(compute);
        let picture = relighter.relight(&lights, &RAW, monitor).map(|relit| relit.combined());
        (picture, train(folder.path(), &folder.path().join(out), &brief(), false, compute, monitor))
    };
    let (picture, trained) = run(&Compute::with(Arc::clone(&gpu), false), "error", &Monitor::default());
    for error in [picture.unwrap_err(), trained.unwrap_err()] {
        let error = error.to_string();
        assert!(error.contains("not enough GPU memory") && error.contains("--gpu-memory"), "{error}");
    }
    let warnings = Arc::new(Warnings::default());
    let monitor = Monitor::new(warnings.clone(), Cancel::default());
    let (picture, trained) = run(&Compute::with(gpu, true), "fallen", &monitor);
    let (expected, by_cpu) = run(&Compute::default(), "cpu", &Monitor::default());
    assert!(picture.unwrap() == expected.unwrap());
    assert_eq!(trained.unwrap().measured, by_cpu.unwrap().measured);
    let warned = warnings.0.lock().unwrap();
    let of_memory =
        |text: &String| text.contains("not enough GPU memory") && text.contains("The CPU goes on");
    assert!(warned.len() == 2 && warned.iter().all(of_memory), "{warned:?}");
}

#[test]
fn a_bake_without_room_beside_its_training_is_gathered_by_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    // Its paths take more than the pictures that the proxy is measured by at the end.
    baked_with(folder.path(), |scene| (scene.camera.width, scene.camera.height) = (60, 48));
    let run = |budget: u64| trained_within(budget, folder.path(), &brief());
    let enough = least_budget(|budget| match run(budget) {
        Ok(_) => true,
        Err(error) => {
            assert!(error.to_string().contains("not enough GPU memory"), "{error}");
            false
        }
    });
    let (report, warned) = run(enough).unwrap();
    assert!(report.complete && warned.len() == 1 && warned[0].contains("leaves no room"), "{warned:?}");
    assert_eq!(report.copied, 0);
}

#[test]
fn a_training_whose_bake_is_streamed_is_gathered_by_the_gpu_and_ends_as_if_all_of_it_fitted() {
    let folder = tempfile::tempdir().unwrap();
    baked_with(folder.path(), |scene| (scene.camera.width, scene.camera.height) = (96, 64));
    let unmeasured = TrainSettings { half_for_measuring: false, ..brief() };
    let is_gathered =
        |budget: u64| trained_within(budget, folder.path(), &unmeasured).is_ok_and(|run| run.1.is_empty());
    let budget = least_budget(is_gathered);
    let mut settings = training(LightKind::Sphere);
    settings.config.samples = 100_000;
    let run = |budget: u64| trained_within(budget, folder.path(), &settings).unwrap();
    let [(whole, _), (streamed, warned)] = [1 << 30, budget].map(run);
    println!("{} bytes copied for {} samples within {budget} bytes", streamed.copied, streamed.samples);
    assert!(whole.copied == 0 && streamed.copied > 0 && warned.is_empty(), "{streamed:?}, {warned:?}");
    // Only the order of sums differs.
    let [expected, found] = [whole, streamed].map(|report| report.measured.unwrap().proxy.psnr);
    assert!((found - expected).abs() < 0.05, "{found} dB instead of {expected} dB");
}

#[test]
fn targets_for_which_the_room_was_taken_are_made_by_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    baked_with(folder.path(), |scene| (scene.camera.width, scene.camera.height) = (128, 80));
    let relighter = Relighter::open(folder.path()).unwrap();
    let (gather, denoise) = (relighter.gather().unwrap(), Denoise::new(relighter.aovs(), None));
    let gpu = Gpu::open(&GpuChoice::Best).unwrap();
    // Streamed (7 MB beside pictures of 4 MB).
    gpu.set_memory_budget(Some(8 << 20));
    let on_gpu = GpuTargets::new(&gpu, gather).unwrap();
    let targets = DumpTargets::new(gather, Default::default(), (Vec3::ZERO, Vec3::ONE), &denoise);
    let targets = targets.on(Some(&on_gpu));
    let pixels: Vec<u32> = (0..64).map(|index| index * 157).collect();
    let center = Vec3::new(0.2, 0.1, 1.3);
    let lights = [0.2, 0.3, 0.4, 0.5].map(|radius| LightShape::Sphere { center, radius });
    let queries = GroupQueries { pixels: &pixels, group: 32, lights_per_pixel: 2, lights: &lights };
    let gathered = || {
        let out = gpu.zeros::<f32>("targets", 64 * 2 * 3).unwrap();
        targets.on_device().unwrap().pixel_targets(&queries, &out).unwrap();
        gpu.read(&out, 0..out.len()).unwrap()
    };
    let expected = gathered();
    let copied = on_gpu.copied_bytes();
    assert!(copied > 0 && !on_gpu.lacked_room() && expected.iter().any(|value| *value > 0.0));
    gpu.set_memory_budget(Some(30_000));
    let found = gathered();
    assert!(on_gpu.lacked_room() && on_gpu.copied_bytes() == copied);
    let differ = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 1e-5 * *b + 6e-5;
    assert_eq!(found.iter().zip(&expected).find(differ), None);
}

#[test]
fn a_pool_of_pictures_without_room_on_the_gpu_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let mut settings = brief();
    settings.config.targets = TargetMode::Pool { size: 20_000, denoised: false };
    let (report, warned) = trained_within(100 << 20, folder.path(), &settings).unwrap();
    assert!(report.complete && warned.len() == 1 && warned[0].contains("the CPU keeps them"), "{warned:?}");
    settings.config.targets = TargetMode::Pool { size: 20, denoised: false };
    assert!(trained_within(100 << 20, folder.path(), &settings).unwrap().1.is_empty());
}
