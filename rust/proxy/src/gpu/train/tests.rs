use relume_gpu::GpuChoice;

use super::*;
use crate::encoding::LightEncoding;
use crate::gradient::{Batch as Samples, GradientBuffers, batch_gradient};
use crate::light::random_light;
use crate::loss::TILE as TARGET_TILE;
use crate::network::{CHUNK_TILES, Context, FastNetwork, ReferenceNetwork};
use crate::scene_cache::Normalisation;
use crate::simd::{Isa, LANES};
use crate::synthetic::SyntheticRoom;
use crate::{GridConfig, LightParams, NetworkConfig, Rng, SizeRange};

const SIZE: SizeRange = SizeRange { min: 0.1, max: 0.5 };

/// Any device will do, a software driver included; that there is none is a failure.
fn gpu() -> Arc<Gpu> {
    Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver, like Debian's mesa-vulkan-drivers")
}

fn tiny_grid() -> GridConfig {
    // Eight bits make the finest levels hash.
    GridConfig { levels: 3, log2_hashmap_size: 8, finest_cells_per_pixel: 1.0, ..GridConfig::default() }
}

struct Setup {
    scene: SceneCache,
    encoding: LightEncoding,
    size: [usize; 2],
}

fn setup(kind: LightKind) -> Setup {
    let features = SyntheticRoom::new(40, 24).features();
    let normalisation = Normalisation::of(&features);
    Setup {
        scene: SceneCache::new(&features, normalisation),
        encoding: LightEncoding::new(kind, normalisation, SIZE),
        size: [features.width, features.height],
    }
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
    TrainConfig { network, muon, batch_start: batch, batch_end: batch, lights_per_pixel: slots, ..TrainConfig::fast(SIZE) }
}

/// A training on the device that holds these weights, and the samples of a batch in its first chunks.
fn on_device(network: &impl Network, setup: &Setup, config: &TrainConfig, params: &[f32], batch: &Samples) -> GpuTraining {
    let chunks = batch.lights.len() / CHUNK_TILES;
    let demand = Demand { config, scene: &setup.scene, chunks, draws: 8 * chunks };
    let training = GpuTraining::new(gpu(), network, &demand).expect("room on the device");
    let zeros = vec![0.0; params.len()];
    training.upload([params, params, &zeros, &zeros]);
    training.write_chunks(0, batch);
    training
}

/// Loss and gradient of the chunks in their order.
fn loss_and_gradient(training: &GpuTraining, chunks: u32) -> (f32, Vec<f32>) {
    let draws: Vec<u32> = (0..chunks).collect();
    training.gpu.write(&training.draws, 0, &draws);
    let mut commands = training.gpu.commands("gradient");
    training.record_gradient(&mut commands, 0, chunks);
    commands.submit().expect("submitted");
    let gradient = &training.optimise.gradient;
    let loss = training.take_progress().expect("progress").loss;
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
    let context = Context { isa: Isa::detect(), scene: &setup.scene, params: &params };
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
    for (kind, width, slots) in [(LightKind::Sphere, 20, 8), (LightKind::Quad, 72, 32), (LightKind::FacingDisk, 16, 1)] {
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
