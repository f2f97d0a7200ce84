mod matrices;
mod quotients;
mod samples;
mod targets;

use std::sync::atomic::{AtomicBool, Ordering};

use relume_gpu::GpuChoice;
use relume_image::Image;
use relume_scene::LightShape;

use super::*;
use crate::gradient::tests::{SIZE, Setup, setup, tiny_grid};
use crate::gradient::{GradientBuffers, batch_gradient};
use crate::light::random_light;
use crate::loss::TILE as TARGET_TILE;
use crate::network::{CHUNK_TILES, FastNetwork, NetworkContext, ReferenceNetwork};
use crate::optim::Optimiser;
use crate::sampling::Sampler;
use crate::simd::{Isa, LANES};
use crate::synthetic::SyntheticRoom;
use crate::{
    GridConfig, LearningRates, LightKind, LightParams, LightPlacement, NetworkConfig, PixelQueries, Rng,
    TargetMode, TargetSource, Trainer,
};

/// Any device will do, a software driver included; that there is none is a failure.
fn gpu() -> Arc<Gpu> {
    Gpu::open(&GpuChoice::Best)
        .expect("tests need a GPU or a software driver, like Debian's mesa-vulkan-drivers")
}

fn samples(setup: &Setup, chunks: usize, slots: usize) -> Samples {
    let mut rng = Rng::stream(3, 1, 4);
    let tiles = chunks * CHUNK_TILES;
    let light = |rng: &mut Rng| {
        let center = glam::Vec3::new(rng.next_f32() - 0.5, rng.next_f32() - 0.5, 1.0 + rng.next_f32());
        random_light(setup.encoding.kind, center, SIZE, rng)
    };
    let pixels = (setup.size[0] * setup.size[1]) as u32;
    Samples {
        pixels: (0..tiles / slots * LANES).map(|_| rng.below(pixels)).collect(),
        slots,
        lights: (0..tiles).map(|_| light(&mut rng)).collect::<Vec<LightParams>>(),
        targets: (0..tiles * TARGET_TILE).map(|_| 2.0 * rng.next_f32()).collect(),
        weights: (0..tiles).map(|_| 0.5 + rng.next_f32()).collect(),
    }
}

fn config(network: NetworkConfig, chunks: usize, slots: usize) -> TrainConfig {
    let muon = matches!(network, NetworkConfig::Fast { .. });
    let batch = chunks * CHUNK;
    TrainConfig {
        network,
        muon,
        batch_start: batch,
        batch_end: batch,
        lights_per_pixel: slots,
        ..TrainConfig::fast(SIZE)
    }
}

/// A training on the device that holds these weights, and the samples of a batch in its first chunks.
fn on_device(
    network: &impl Network,
    setup: &Setup,
    config: &TrainConfig,
    params: &[f32],
    batch: &Samples,
) -> GpuTraining {
    let chunks = batch.lights.len() / CHUNK_TILES;
    let demand = Demand { config, scene: &setup.scene, chunks, draws: 8 * chunks, matrices: false };
    let training = GpuTraining::new(gpu(), network, &demand).expect("room on the device");
    let zeros = vec![0.0; params.len()];
    training.upload([params, params, &zeros, &zeros]);
    training.write_chunks(0, batch, &OutputScale { factor: 1.0, area: None });
    training
}

/// Loss and gradient of the chunks in their order.
fn loss_and_gradient(training: &GpuTraining, chunks: u32) -> (f32, Vec<f32>) {
    let draws: Vec<u32> = (0..chunks).collect();
    training.gpu.write(&training.buffers.draws, 0, &draws);
    let mut commands = training.gpu.commands("gradient");
    training.record_gradient(&mut commands, 0, chunks);
    commands.submit().expect("submitted");
    let gradient = &training.optimise.gradient;
    let loss = training.progress().expect("progress").loss;
    (loss, training.gpu.read(gradient, 0..gradient.len()).expect("read back"))
}

fn norm(values: impl Iterator<Item = f32>) -> f64 {
    values.map(|x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt()
}

/// Sums of a few thousand products in 32 bits differ by some 1e-6 with their order; where a unit's sum is that close to
/// zero, its ReLU may be on for one sample of thousands and off for the other.
fn check_gradient<N: Network>(network: &N, setup: &Setup, config: &TrainConfig, what: &str) {
    let chunks = config.batch_end / CHUNK;
    let batch = samples(setup, chunks, config.lights_per_pixel);
    let params = network.layout().start_values(5);
    let context = NetworkContext { isa: Isa::detect(), scene: &setup.scene, params: &params };
    let mut buffers = GradientBuffers::new(network);
    let expected_loss = batch_gradient(network, &network.pack(&params), context, &batch, &mut buffers);

    let training = on_device(network, setup, config, &params, &batch);
    let (loss, gradient) = loss_and_gradient(&training, chunks as u32);
    let error = (f64::from(loss) - expected_loss).abs() / expected_loss;
    assert!(error < 1e-5, "{what}: loss {loss} instead of {expected_loss}");
    for tensor in &network.layout().tensors {
        let (expected, found) = (&buffers.total[tensor.range()], &gradient[tensor.range()]);
        let size = norm(expected.iter().copied());
        let error = norm(expected.iter().zip(found).map(|(a, b)| a - b)) / size;
        println!("{what}, {}: {size:.2e}, error {error:.1e}", tensor.name);
        assert!(error < 1e-3, "{what}, {}: norm {size}, relative error {error}", tensor.name);
    }
}

#[test]
fn gradients_of_every_tensor_equal_those_of_the_cpu() {
    // Layers in chains, of one tile of rows and of two; layer by layer.
    for (kind, width, slots) in [
        (LightKind::Spot, 20, 8),
        (LightKind::Quad, 72, 32),
        (LightKind::FacingDisk, 16, 1),
        (LightKind::Ellipse, 16, 4),
        (LightKind::Sphere, 132, 16),
    ] {
        let setup = setup(kind);
        let grid = tiny_grid();
        let fast = FastNetwork::new(width, 2, &grid, setup.size, setup.encoding);
        let fast_config = config(NetworkConfig::Fast { width, layers: 2, grid }, 3, slots);
        check_gradient(&fast, &setup, &fast_config, &format!("fast, {kind}"));
        let reference = ReferenceNetwork::new(width, 3, &grid, setup.size, setup.encoding);
        let reference_config = config(NetworkConfig::Reference { width, layers: 3, grid }, 3, slots);
        check_gradient(&reference, &setup, &reference_config, &format!("reference, {kind}"));
    }
}

#[test]
fn a_batch_in_parts_has_the_gradient_of_the_whole() {
    let setup = setup(LightKind::Sphere);
    let grid = tiny_grid();
    let network = FastNetwork::new(16, 1, &grid, setup.size, setup.encoding);
    let config = config(NetworkConfig::Fast { width: 16, layers: 1, grid }, 3, 4);
    let batch = samples(&setup, 3, 4);
    let params = network.layout().start_values(5);
    let mut training = on_device(&network, &setup, &config, &params, &batch);
    let (whole_loss, whole) = loss_and_gradient(&training, 3);
    // Two chunks, then one; activations stay where they are for three.
    training.part = 2 * CHUNK as u32;
    let (loss, gradient) = loss_and_gradient(&training, 3);
    let error = norm(whole.iter().zip(&gradient).map(|(a, b)| a - b)) / norm(whole.iter().copied());
    assert!(
        error < 1e-6 && (loss - whole_loss).abs() < 1e-6 * whole_loss,
        "error {error}, {loss}, {whole_loss}"
    );
}

#[test]
fn the_largest_networks_have_a_plan() {
    let setup = setup(LightKind::Quad);
    let config = config(NetworkConfig::Reference { width: 2048, layers: 64, grid: tiny_grid() }, 4096, 1);
    let network = ReferenceNetwork::new(2048, 64, &tiny_grid(), setup.size, setup.encoding);
    let demand = Demand { config: &config, scene: &setup.scene, chunks: 1, draws: 1, matrices: false };
    let gpu = gpu();
    gpu.set_memory_budget(Some(64 << 20));
    let error = GpuTraining::new(gpu, &network, &demand).expect_err("a gigabyte of weights in 64 MiB");
    let fitting = matches!(error, ProxyError::Gpu(GpuError::OutOfMemory { .. } | GpuError::TooLarge { .. }));
    assert!(fitting, "{error}");
}

#[test]
fn steps_of_adam_and_muon_equal_those_of_the_cpu() {
    // Matrices of Muon that fit workgroup memory, fill it, and do not fit it.
    for width in [20, 64, 68] {
        check_steps(width);
    }
}

fn check_steps(width: usize) {
    let setup = setup(LightKind::Sphere);
    let grid = tiny_grid();
    let network = FastNetwork::new(width, 1, &grid, setup.size, setup.encoding);
    let config = config(NetworkConfig::Fast { width, layers: 1, grid }, 1, 32);
    let batch = samples(&setup, 1, 32);
    let start = network.layout().start_values(5);
    let training = on_device(&network, &setup, &config, &start, &batch);
    let rates = StepRates { adam: 1e-2, muon: 1e-2, grid: 1e-2 };
    let step = |number| TrainStep { draws: vec![0], rates, number, mean_share: Some(0.25) };
    let (mut params, mut mean) = (start.clone(), start.clone());
    let mut optimiser = Optimiser::new(network.layout(), true);
    for number in 1..=2 {
        training.run(&[step(number)]).expect("a step");
        // The gradient is the device's own: this is about what follows it.
        let gradient = &training.optimise.gradient;
        let gradient = training.gpu.read(gradient, 0..gradient.len()).expect("read back");
        optimiser.update(Isa::detect(), network.layout(), &mut params, &gradient, rates, number);
        mean.iter_mut().zip(&params).for_each(|(mean, param)| *mean += 0.25 * (param - *mean));
    }
    let expected = [&params, &mean, &optimiser.first, &optimiser.second];
    let found = training.download().expect("read back");
    for (what, (expected, found)) in
        ["weights", "mean", "first", "second"].iter().zip(expected.into_iter().zip(&found))
    {
        for tensor in &network.layout().tensors {
            let (expected, found) = (&expected[tensor.range()], &found[tensor.range()]);
            let error = norm(expected.iter().zip(found).map(|(a, b)| a - b));
            // Newton-Schulz multiplies rounding errors of its first products by up to 3.4^5 in small singular values.
            let limit = if *what == "second" { 1e-6 } else { 1e-4 } * norm(expected.iter().copied());
            assert!(error <= limit, "{width} wide, {what} of {}: error {error}, limit {limit}", tensor.name);
        }
    }
}

#[test]
fn a_loss_that_is_no_number_leaves_the_weights_alone() {
    let setup = setup(LightKind::Sphere);
    let grid = tiny_grid();
    let network = FastNetwork::new(16, 1, &grid, setup.size, setup.encoding);
    let config = config(NetworkConfig::Fast { width: 16, layers: 1, grid }, 1, 32);
    let mut batch = samples(&setup, 2, 32);
    batch.targets[CHUNK_TILES * TARGET_TILE + 5] = f32::INFINITY;
    let params = network.layout().start_values(5);
    let training = on_device(&network, &setup, &config, &params, &batch);
    let rates = StepRates { adam: 1e-2, muon: 1e-2, grid: 1e-2 };
    let step = |chunk, number| TrainStep { draws: vec![chunk], rates, number, mean_share: None };
    training.run(&[step(0, 1)]).expect("a step");
    let good = training.download().expect("read back");
    assert!(good[0] != params);
    training.run(&[step(1, 2), step(0, 3)]).expect("two steps");
    let progress = training.progress().expect("progress");
    assert_eq!((progress.steps, progress.diverged), (1, 1));
    assert!(training.download().expect("read back") == good);
}

relume_gpu::part_of_mirrors!(super::arguments::Batch as Struct, super::arguments::Chains as Struct);

#[test]
fn arguments_mirror_the_shaders() {
    use super::arguments::*;
    use super::plan::DenseLayer;
    use crate::grid::DeviceLevel;
    use relume_gpu::assert_mirror;
    assert_mirror!(Batch as "train/batch", "Batch", { samples, capacity, slots });
    assert_mirror!(DenseLayer as "train/layers", "Layer", {
        weights, stride, bias, inputs, outputs, space, input, output, d_product, d_input, finish, modulation, product,
        before, before_modulation, before_d_modulation, before_product, pixel_rows, light_rows,
    });
    assert_mirror!(Inputs as "train/inputs", "Inputs", {
        batch, first_draw, pixels, lights, factors, values, known, light_inputs, levels, features, width, height,
    });
    assert_mirror!(Chains as "train/layers", "Chains", { batch, first, length, pitch, count, scale });
    assert_mirror!(Loss as "train/loss", "Loss", { chain, first_draw, factors, weight, first_sum });
    assert_mirror!(Weights as "train/weights", "Weights", { batch, layers, piece, add, parameters, scale });
    assert_mirror!(Slots as "train/slots", "Slots", { batch, samples, pixels, rows, modulation });
    assert_mirror!(Scatter as "train/scatter", "Scatter", {
        batch, first_draw, d_pixels, levels, features, width, height, grid,
    });
    assert_mirror!(Reduction as "train/reduce", "Reduction", { batch, piece, dense, parameters, losses });
    assert_mirror!(Rates as "train/optimise", "Rates", {
        parameters, adam, grid, first_correction, second_correction, mean_share, matrices, size, stride, muon, linear,
        cubic, quintic,
    });
    assert_mirror!(Targets as "train/targets", "Targets", { samples, slots, first_block, blocks, block });
    assert_mirror!(Pool as "train/pool", "Pool", { tiles, slots, first, images, pixels });
    assert_mirror!(Muon as "train/muon", "Muon", {
        size, stride, matrices, left, right, turned, plus, to, factor, share, step, mean_share,
    });
    assert_mirror!(TrainProgress as "train/parameters", "Progress", { loss, loss_sum, steps, diverged, bad_target });
    assert_mirror!(DeviceLevel as "proxy/grid", "Level", { table, resolution, columns, hash_mask });
}

#[test]
fn rows_of_the_store_are_those_of_the_shaders() {
    use super::store::{LIGHT_INPUTS, LIGHT_INVERSE_SCALE, LIGHT_ROW, LIGHT_WEIGHT};
    use crate::scene_cache::{AUX, FACTOR, PIXEL_ROW};
    let constants = ["LIGHT_ROW", "LIGHT_WEIGHT", "LIGHT_INVERSE_SCALE", "LIGHT_INPUTS", "PIXEL_ROW"]
        .into_iter()
        .chain(["PIXEL_SURFACE", "PIXEL_FACTORS", "LANES", "CHUNK"]);
    let found: Vec<_> =
        constants.map(|name| relume_gpu::layout::constant("train/store", name).unwrap() as usize).collect();
    let of_lights = [LIGHT_ROW, LIGHT_WEIGHT, LIGHT_INVERSE_SCALE, LIGHT_INPUTS];
    let of_pixels = [PIXEL_ROW, AUX, AUX + FACTOR, LANES, CHUNK];
    assert_eq!(found, [&of_lights[..], &of_pixels].concat());
}

fn short(samples: u64) -> TrainConfig {
    let grid = GridConfig { levels: 4, ..GridConfig::default() };
    TrainConfig {
        network: NetworkConfig::Fast { width: 32, layers: 2, grid },
        batch_start: 2048,
        batch_end: 4096,
        lights_per_pixel: 8,
        samples,
        rates: LearningRates { adam: 8e-3, muon: 8e-3, grid: 4e-3, final_fraction: 0.01 },
        held_out: 4,
        ..TrainConfig::fast(SIZE)
    }
}

fn room() -> SyntheticRoom {
    SyntheticRoom::new(32, 20).with_noise(0.2)
}

fn trainer(config: &TrainConfig, seed: u64) -> Trainer {
    Trainer::new(Arc::new(room().features()), LightKind::Sphere, config.clone(), seed)
        .expect("a valid configuration")
}

fn run(trainer: &mut Trainer) {
    while !trainer.done() {
        trainer.step(&room()).expect("a step");
    }
}

#[test]
fn training_reaches_the_error_of_the_cpu() {
    let config = short(100_000);
    let score = |mut trainer: Trainer| {
        run(&mut trainer);
        (trainer.validate(&room()).expect("scores").psnr, trainer.steps(), trainer.samples())
    };
    let cpu: Vec<_> = (1..=4).map(|seed| score(trainer(&config, seed))).collect();
    let device = score(trainer(&config, 1).on_gpu(gpu()).expect("room"));
    println!("CPU {cpu:?}, device {device:?}");
    assert_eq!((device.1, device.2), (cpu[0].1, cpu[0].2), "steps and samples");
    // The same seed draws the same lights and starts from the same weights; only rounding tells the two apart.
    let mean = cpu.iter().map(|score| score.0).sum::<f32>() / cpu.len() as f32;
    let spread = (cpu.iter().map(|score| (score.0 - mean).powi(2)).sum::<f32>() / 3.0).sqrt();
    assert!((device.0 - cpu[0].0).abs() < 0.5 * spread, "{} dB, CPU {cpu:?}, spread {spread}", device.0);
}

#[test]
fn trainings_move_between_cpu_and_device() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("training.safetensors");
    for targets in [TargetMode::Raw, TargetMode::Pool { size: 20, denoised: false }] {
        let config = TrainConfig { targets, ..short(40_000) };
        let mut whole = trainer(&config, 3);
        run(&mut whole);
        let mut first = trainer(&config, 3).on_gpu(gpu()).expect("room");
        while first.samples() < 16_000 {
            first.step(&room()).expect("a step");
        }
        first.save(&path).expect("saved");
        let steps = first.steps();
        drop(first);
        let mut second = Trainer::resume(&path).expect("resumed");
        assert_eq!(second.steps(), steps);
        while second.samples() < 28_000 {
            second.step(&room()).expect("a step");
        }
        second.save(&path).expect("saved");
        let mut third = Trainer::resume(&path).expect("resumed").on_gpu(gpu()).expect("room");
        run(&mut third);
        assert_eq!((third.steps(), third.samples()), (whole.steps(), whole.samples()));
        let (whole, third) = (whole.whole_state().expect("here"), third.whole_state().expect("there"));
        let moved = norm(whole.params.iter().zip(&trainer(&config, 3).state.params).map(|(a, b)| a - b));
        let apart = norm(whole.params.iter().zip(&third.params).map(|(a, b)| a - b));
        assert!(apart < 0.05 * moved, "{targets:?}: {apart} apart after a way of {moved}");
        assert_eq!(whole.trained_ranges, third.trained_ranges);
    }
}

#[test]
fn a_lost_device_leaves_the_last_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("training.safetensors");
    let gpu = gpu();
    let mut training = trainer(&short(40_000), 3).on_gpu(Arc::clone(&gpu)).expect("room");
    while training.steps() == 0 {
        training.step(&room()).expect("a step");
    }
    training.save(&path).expect("saved");
    let steps = training.steps();
    gpu.lose();
    let lost = |error: ProxyError| matches!(error, ProxyError::Gpu(GpuError::Lost(_)));
    assert!(lost(training.step(&room()).expect_err("the device is gone")));
    assert!(lost(training.save(&path).expect_err("the weights are gone")));
    assert!(lost(training.proxy().expect_err("the weights are gone")));
    let mut again = Trainer::resume(&path).expect("the file is whole");
    assert_eq!(again.steps(), steps);
    run(&mut again);
}
