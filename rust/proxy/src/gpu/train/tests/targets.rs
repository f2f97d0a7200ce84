//! Targets that the device gathers for itself.

use super::*;

/// The room on the device: gathers on the CPU what it is asked there.
struct DeviceRoom {
    room: SyntheticRoom,
    gpu: Arc<Gpu>,
    /// True if targets are not finite from now on: those on the device, or all.
    spoiled: AtomicBool,
    spoils_all: bool,
}

fn device_room(gpu: &Arc<Gpu>) -> DeviceRoom {
    DeviceRoom { room: room(), gpu: Arc::clone(gpu), spoiled: false.into(), spoils_all: false }
}

impl TargetSource for DeviceRoom {
    fn bounds(&self) -> (glam::Vec3, glam::Vec3) {
        self.room.bounds()
    }
    fn segment_point(&self, pixel: u32, rng: &mut Rng) -> Option<glam::Vec3> {
        self.room.segment_point(pixel, rng)
    }
    fn pixel_targets(&self, queries: &PixelQueries<'_>, out: &mut [[f32; 3]]) -> Result<(), ProxyError> {
        let spoiled = self.spoiled.load(Ordering::Relaxed);
        assert!(spoiled || out.len() == 8192, "only the scale of outputs is measured on the CPU");
        self.room.pixel_targets(queries, out)?;
        if spoiled && self.spoils_all {
            out[0] = [f32::NAN; 3];
        }
        Ok(())
    }
    fn images(&self, lights: &[LightShape], denoised: bool) -> Result<Vec<Image>, ProxyError> {
        self.room.images(lights, denoised)
    }
    fn on_device(&self) -> Option<&dyn DeviceTargets> {
        Some(self)
    }
}

impl DeviceTargets for DeviceRoom {
    fn pixel_targets(&self, queries: &GroupQueries<'_>, out: &Buffer<f32>) -> Result<(), ProxyError> {
        let lights: Vec<LightShape> = (0..queries.pixels.len())
            .flat_map(|pixel| {
                let group = pixel / queries.group;
                &queries.lights[group * queries.lights_per_pixel..(group + 1) * queries.lights_per_pixel]
            })
            .copied()
            .collect();
        let mut values = vec![[0.0; 3]; lights.len()];
        let lights_per_pixel = queries.lights_per_pixel;
        self.room.pixel_targets(
            &PixelQueries { pixels: queries.pixels, lights_per_pixel, lights: &lights },
            &mut values,
        )?;
        if self.spoiled.load(Ordering::Relaxed) {
            values.fill([f32::NAN; 3]);
        }
        self.gpu.write(out, 0, values.as_flattened());
        Ok(())
    }
}

#[test]
fn targets_gathered_on_the_device_train_as_those_of_the_cpu() {
    let config = TrainConfig { sample_reuse: 1, ..short(40_000) };
    let config =
        TrainConfig { network: NetworkConfig::Fast { width: 8, layers: 1, grid: tiny_grid() }, ..config };
    let gpu = gpu();
    let source = device_room(&gpu);
    let mut there = trainer(&config, 3).on_gpu(Arc::clone(&gpu)).expect("room");
    while !there.done() {
        there.step(&source).expect("a step");
    }
    let mut here = trainer(&config, 3).on_gpu(gpu).expect("room");
    run(&mut here);
    let (here_state, there_state) =
        (here.whole_state().expect("weights"), there.whole_state().expect("weights"));
    // Targets are scaled there and here, with one rounding more or less.
    let apart = norm(here_state.params.iter().zip(&there_state.params).map(|(a, b)| a - b));
    let size = norm(here_state.params.iter().copied());
    assert!(apart < 1e-2 * size, "{apart} apart, weights {size}");
}

#[test]
fn a_target_that_is_not_finite_on_the_device_is_gathered_on_the_cpu() {
    let network = NetworkConfig::Fast { width: 8, layers: 1, grid: tiny_grid() };
    let config = TrainConfig { sample_reuse: 1, network, ..short(40_000) };
    let gpu = gpu();
    let source = device_room(&gpu);
    let mut there = trainer(&config, 3).on_gpu(Arc::clone(&gpu)).expect("room");
    while there.samples() < 16_000 {
        there.step(&source).expect("a step");
    }
    source.spoiled.store(true, Ordering::Relaxed);
    let mut bad = Vec::new();
    while !there.done() {
        // A checkpoint in the meantime is of the last good step.
        let state = there.whole_state().expect("weights");
        assert!(state.params.iter().all(|weight| weight.is_finite()));
        bad.extend(there.step(&source).expect("a step").bad_target);
    }
    assert_eq!(bad.len(), 1, "{bad:?}");
    let mut here = trainer(&config, 3).on_gpu(gpu).expect("room");
    run(&mut here);
    assert_eq!((there.steps(), there.samples()), (here.steps(), here.samples()));
    let moved = |trainer: &Trainer| {
        let state = trainer.whole_state().expect("weights");
        norm(state.params.iter().zip(&self::trainer(&config, 3).state.params).map(|(a, b)| a - b))
    };
    let (there, here) = (moved(&there), moved(&here));
    assert!((there / here - 1.0).abs() < 0.1, "moved by {there} instead of {here}");
}

#[test]
fn a_target_that_is_finite_nowhere_is_an_error() {
    let config = TrainConfig { sample_reuse: 1, ..short(40_000) };
    let gpu = gpu();
    let source = DeviceRoom { spoils_all: true, ..device_room(&gpu) };
    let mut there = trainer(&config, 3).on_gpu(gpu).expect("room");
    while there.steps() == 0 {
        there.step(&source).expect("a step");
    }
    source.spoiled.store(true, Ordering::Relaxed);
    let error = (0..100).find_map(|_| there.step(&source).err()).expect("targets are not finite");
    assert!(matches!(error, ProxyError::BadTarget { .. }), "{error}");
}

#[test]
fn gathered_blocks_begin_anew_at_the_end_of_the_store() {
    let setup = setup(LightKind::Sphere);
    let grid = tiny_grid();
    let network = FastNetwork::new(8, 1, &grid, setup.size, setup.encoding);
    let config = config(NetworkConfig::Fast { width: 8, layers: 1, grid }, 4, 8);
    let chunks = BLOCK as usize / CHUNK;
    let demand =
        Demand { config: &config, scene: &setup.scene, chunks: 3 * chunks, draws: 1, matrices: false };
    let gpu = gpu();
    let training = GpuTraining::new(Arc::clone(&gpu), &network, &demand).expect("room on the device");
    let room = SyntheticRoom::new(setup.size[0], setup.size[1]);
    let source = DeviceRoom { room: room.clone(), ..device_room(&gpu) };
    let sampler = Sampler {
        kind: LightKind::Sphere,
        size: SIZE,
        placement: LightPlacement::Segments,
        area_weight: 0.5,
        pixel_count: (setup.size[0] * setup.size[1]) as u32,
    };
    let scale = OutputScale { factor: 0.3, area: Some(sampler.middling_area()) };
    let (mut bare, mut full) = (Vec::new(), Vec::new());
    for (number, place) in [(0, 2), (1, 0)] {
        let size = (BLOCK as usize, 8);
        bare.push(sampler.drawn(&room, size, (1, number)));
        full.push(sampler.gathered(&room, &scale, size, (1, number)).expect("targets"));
        training.write_chunks(place * chunks, &bare[number as usize], &scale);
    }
    training.gather(&source, 2, &bare.iter().collect::<Vec<_>>()).expect("targets");
    let targets = &training.store.targets;
    let found = training.gpu.read(targets, 0..targets.len()).expect("read back");
    let len = targets.len() / 3;
    for (place, expected) in [(2, &full[0].targets), (0, &full[1].targets), (1, &vec![0.0; len])] {
        for (found, expected) in found[place * len..(place + 1) * len].iter().zip(expected) {
            // One over the scale may be rounded the other way.
            assert!((found - expected).abs() <= 2e-7 * expected.abs(), "{found} instead of {expected}");
        }
    }
}
