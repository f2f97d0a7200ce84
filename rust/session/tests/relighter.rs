//! What makes each light's picture, and what an edit costs.

use glam::{Mat3, Vec3};
use relume_session::gpu::{Gpu, GpuChoice};
use relume_session::proxy::{LightKind, SizeRange, TrainConfig};
use relume_session::scene::{
    Alpha, ColorEncoding, Light, LightShape, LobeFactors, ReceiverSet, Texels, Texture, World,
};
use relume_session::trace::TraceSettings;
use relume_session::{
    Cancel, Clock, Compute, Device, LightSet, Listener, Maker, Monitor, ObjView, Pictures, Progress,
    RelightOptions, Relighter, SessionError, SolveRequest, Stage, TrainReport, TrainSettings, With, bake,
    default_sizes, evaluate, obj_scene, solve_lights, train,
};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// A small lit bake in a folder.
fn baked(folder: &Path) {
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/room.obj");
    let view = ObjView {
        up: relume_session::scene::UpAxis::Z,
        eye: Some(Vec3::new(0.0, -4.2, 1.0)),
        target: Some(Vec3::Z),
        width: 20,
        height: 16,
        ..ObjView::default()
    };
    let mut scene = obj_scene(&room, &view).unwrap();
    scene.lights = vec![sphere("Own", 0.2)];
    let settings = TraceSettings { samples: 16, ..TraceSettings::default() };
    bake(&scene, &settings, folder, false, &Monitor::default()).unwrap();
}

fn sphere(name: &str, radius: f32) -> Light {
    Light {
        name: name.into(),
        shape: LightShape::Sphere { center: Vec3::new(0.2, 0.1, 1.3), radius },
        radiance: [2.0, 1.0, 0.5],
        lobes: LobeFactors::default(),
        receivers: None,
    }
}

fn training(kind: LightKind) -> TrainSettings {
    let mut config = TrainConfig::fast(SizeRange { min: 0.1, max: 0.3 });
    config.samples = 8192;
    config.held_out = 2;
    TrainSettings { kind, config, seed: 1, seconds: None, clock: Clock::Wall, half_for_measuring: true }
}

/// Trains on the CPU, from the start.
fn trained(bake: &Path, out: &Path, kind: LightKind) -> TrainReport {
    train(bake, out, &training(kind), false, &Compute::default(), &Monitor::default()).unwrap()
}

const RAW: RelightOptions = RelightOptions { with: With::Auto, denoise: false };

fn makers(relighter: &Relighter, lights: &[Light], options: RelightOptions) -> Vec<Maker> {
    let relit = relighter.relight(lights, &options, &Monitor::default()).unwrap();
    relit.lights.iter().map(|light| light.maker).collect()
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

/// Remembers warnings.
#[derive(Default)]
struct Warnings(Mutex<Vec<String>>);

impl Listener for Warnings {
    fn progress(&self, _: &Progress) {}
    fn warning(&self, message: &str) {
        self.0.lock().unwrap().push(message.into());
    }
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
        warnings[0].contains("'noon': 0.53 degrees") && warnings[0].contains("9.1 degrees"),
        "{warnings:?}"
    );
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
    let by_proxy = RelightOptions { with: With::Proxy, ..RAW };
    let expected = [Maker::Proxy, Maker::Gather, Maker::Gather, Maker::Gather, Maker::Gather];
    assert_eq!(makers(&relighter, &lights, by_proxy), expected);
    let gathered = RelightOptions { with: With::Gather, ..RAW };
    assert_eq!(makers(&relighter, &lights, gathered), [Maker::Gather; 5]);

    // The camera sees the lamp itself as it is gathered, over what the proxy knows.
    let seen = Light { lobes: LobeFactors { camera: 1.0, ..LobeFactors::default() }, ..usual.clone() };
    let picture = |light: &Light, options: &RelightOptions| {
        let relit = relighter.relight(std::slice::from_ref(light), options, &Monitor::default()).unwrap();
        relit.lights[0].clone()
    };
    assert_eq!(picture(&seen, &by_proxy).maker, Maker::Proxy);
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
    for (smape, maker) in [(0.01, Maker::Proxy), (1.9, Maker::Gather)] {
        measured["proxy"]["smape"] = smape.into();
        std::fs::write(&path, measured.to_string()).unwrap();
        let relighter = Relighter::open(out).unwrap();
        assert_eq!(makers(&relighter, &[sphere("Key", 0.2)], RAW), [maker], "SMAPE {smape}");
    }
    // An unmeasured proxy beats nothing; a damaged measurement is an error.
    std::fs::remove_file(&path).unwrap();
    assert_eq!(makers(&Relighter::open(out).unwrap(), &[sphere("Key", 0.2)], RAW), [Maker::Gather]);
    std::fs::write(&path, "{").unwrap();
    assert!(Relighter::open(out).err().unwrap().to_string().contains("proxy_sphere.json"));
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
    let by_proxy = RelightOptions { with: With::Proxy, ..RAW };
    let alone = Relighter::open(&proxies).unwrap();
    assert_eq!(alone.scene_lights().unwrap().lights[0].name, "Own");
    let relit = alone.relight(&lights, &by_proxy, &Monitor::default()).unwrap();
    assert_eq!(relit.lights[0].maker, Maker::Proxy);
    assert_eq!(relit.albedo, Relighter::open(&bake_folder).unwrap().aovs().albedo);

    let message =
        alone.relight(&[sphere("Huge", 2.0)], &by_proxy, &Monitor::default()).unwrap_err().to_string();
    assert!(message.contains("'Huge'") && message.contains("bake"), "{message}");
}

#[test]
fn proxy_of_another_scene_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    baked(&one);
    trained(&one, &one, LightKind::Sphere);
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/room.obj");
    let scene = obj_scene(&room, &ObjView { width: 20, height: 16, ..ObjView::default() }).unwrap();
    let settings = TraceSettings { samples: 2, ..TraceSettings::default() };
    bake(&scene, &settings, &two, false, &Monitor::default()).unwrap();
    std::fs::copy(one.join("proxy_sphere.safetensors"), two.join("proxy_sphere.safetensors")).unwrap();
    assert!(Relighter::open(&two).err().unwrap().to_string().contains("another scene"));
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
    // A training that was stopped before its first step does not replace what was there.
    let relighter = Relighter::open(out).unwrap();
    let kept = relighter.proxies().of(LightKind::Sphere).unwrap();
    assert_eq!(kept.proxy.info().steps, good.steps);
    assert_eq!(kept.measured, good.measured);
    assert_eq!(LightSet::read(&folder.path().join("lights.json")).unwrap().lights.len(), 1);
}

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

#[test]
fn pictures_of_the_gpu_are_those_of_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    trained(folder.path(), folder.path(), LightKind::Sphere);
    let compute = Device::Gpu(GpuChoice::Best).open(None).unwrap();
    let has_matrices = compute.gpu.as_ref().unwrap().limits().matrices;
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
    let gpu = on(&Device::Gpu(GpuChoice::Best).open(None).unwrap()).unwrap();
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
    let on_lost = |may_fall_back| on(&Compute { gpu: Some(lost.clone()), may_fall_back });
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
        let compute = Compute { gpu: Some(lost.clone()), may_fall_back };
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
fn lights_solved_on_the_gpu_are_those_of_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    for kind in [LightKind::Sphere, LightKind::Quad] {
        trained(folder.path(), folder.path(), kind);
    }
    let gpu = Relighter::open(folder.path()).unwrap().on(&Device::Gpu(GpuChoice::Best).open(None).unwrap());
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
    for wish in [r#""add": {"count": 1}"#, &two] {
        let request = SolveRequest::parse(&format!(
            r#"{{{wish}, "goals": [{{"goal": "target", "image": "target"}}], "through": "proxy",
                "starts": 1, "candidates": 1, "steps": 25, "polish": 0}}"#
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
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path());
    let mut settings = training(LightKind::Sphere);
    settings.config.samples = 100_000;
    let run = |out: &str, resume: bool, compute: &Compute, monitor: &Monitor| {
        train(folder.path(), &folder.path().join(out), &settings, resume, compute, monitor)
    };
    let quiet = Monitor::default();
    let cpu = run("cpu", false, &Compute::default(), &quiet).unwrap();
    let on = Device::Gpu(GpuChoice::Best).open(None).unwrap();
    let gpu = run("gpu", false, &on, &quiet).unwrap();

    // Stopped with a checkpoint, resumed, and lost on the way.
    let cancel = Cancel::default();
    let stopping = cancel.clone();
    let stop = Arc::new(At(300, move || stopping.request(), Warnings::default()));
    assert!(matches!(run("lost", false, &on, &Monitor::new(stop, cancel)), Err(SessionError::Cancelled)));
    let lost = Gpu::open(&GpuChoice::Best).unwrap();
    let (losing, compute) =
        (lost.clone(), |may_fall_back| Compute { gpu: Some(lost.clone()), may_fall_back });
    let lose = Arc::new(At(600, move || losing.lose(), Warnings::default()));
    let fallen = run("lost", true, &compute(true), &Monitor::new(lose.clone(), Cancel::default())).unwrap();
    assert!(lose.2.0.lock().unwrap().iter().any(|text| text.contains("The CPU goes on")));
    let error = run("error", false, &compute(false), &quiet).unwrap_err();
    assert!(error.to_string().contains("the GPU was lost"), "{error}");

    // Sums are rounded otherwise, which changes far less than another seed: that makes a decibel or more.
    let psnr = |report: &TrainReport| report.measured.unwrap().proxy.psnr;
    for other in [&gpu, &fallen] {
        let (expected, found) = (psnr(&cpu), psnr(other));
        assert!(other.complete && (found - expected).abs() < 0.05, "{found} dB instead of {expected} dB");
    }
}
