//! Trainings: on a GPU as on the CPU, where it is lost, and where it has not the memory.

use super::*;

/// Listener that acts once a training has got so far, in thousandths.
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
