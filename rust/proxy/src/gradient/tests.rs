use std::sync::Arc;

use super::*;
use crate::encoding::LightEncoding;
use crate::light::random_light_facing_down;
use crate::network::{FastNetwork, ReferenceNetwork};
use crate::params::ParamLayout;
use crate::scene_cache::{Normalisation, SceneCache};
use crate::simd::Isa;
use crate::synthetic::SyntheticRoom;
use crate::{GridConfig, LightKind, Rng, SizeRange};

pub(crate) const SIZE: SizeRange = SizeRange { min: 0.1, max: 0.5 };

pub(crate) fn tiny_grid() -> GridConfig {
    // Eight bits make the finest levels hash.
    GridConfig { levels: 3, log2_hashmap_size: 8, finest_cells_per_pixel: 1.0, ..GridConfig::default() }
}

pub(crate) struct Setup {
    pub scene: Arc<SceneCache>,
    pub encoding: LightEncoding,
    pub size: [usize; 2],
}

pub(crate) fn setup(kind: LightKind) -> Setup {
    let features = SyntheticRoom::new(40, 24).features();
    let normalisation = Normalisation::of(&features);
    Setup {
        scene: Arc::new(SceneCache::new(&features, normalisation)),
        encoding: LightEncoding::new(kind, normalisation, SIZE),
        size: [features.width, features.height],
    }
}

pub(crate) fn batch(setup: &Setup, chunks: usize, slots: usize) -> Batch {
    let mut rng = Rng::stream(3, 1, 4);
    let tiles = chunks * CHUNK_TILES;
    let count = (setup.size[0] * setup.size[1]) as u32;
    let light = |rng: &mut Rng| {
        let center = glam::Vec3::new(rng.next_f32() - 0.5, rng.next_f32() - 0.5, 1.0 + rng.next_f32());
        random_light_facing_down(setup.encoding.kind, center, SIZE, rng)
    };
    Batch {
        pixels: (0..tiles / slots * LANES).map(|_| rng.below(count)).collect(),
        slots,
        lights: (0..tiles).map(|_| light(&mut rng)).collect(),
        targets: (0..tiles * TILE).map(|_| 2.0 * rng.next_f32()).collect(),
        weights: (0..tiles).map(|_| 0.5 + rng.next_f32()).collect(),
    }
}

fn loss_and_gradient<N: Network>(
    network: &N,
    setup: &Setup,
    isa: Isa,
    params: &[f32],
    batch: &Batch,
) -> (f64, Vec<f32>) {
    let context = NetworkContext { isa, scene: &setup.scene, params };
    let mut buffers = GradientBuffers::new(network);
    let loss = batch_gradient(network, &network.pack(params), context, batch, &mut buffers);
    (loss, buffers.total.to_vec())
}

/// Small weights behind the inputs, and biases of plus or minus 10, so that every unit is on for all samples or off for all samples: no step
/// of a difference quotient meets a kink. What is added to a unit that is not followed by a ReLU stays small.
pub(crate) fn params_away_from_kinks(layout: &ParamLayout, width: usize) -> Vec<f32> {
    let mut params = layout.start_values(5);
    for tensor in &layout.tensors {
        let mut rng = Rng::stream(9, tensor.start as u64, 9);
        for row in params[tensor.range()].chunks_mut(tensor.stride) {
            for (index, value) in row[..tensor.cols].iter_mut().enumerate() {
                let linear = tensor.cols == 3
                    || tensor.name == "trunk.2.bias"
                    || (tensor.name == "encoder.2.bias" && index % (2 * width) < width);
                *value = match tensor.role {
                    Role::Grid => 0.5 * rng.next_normal(),
                    Role::Bias if linear => 0.2 * rng.next_normal(),
                    Role::Bias => 10.0 * if rng.next_f32() < 0.6 { 1.0 } else { -1.0 },
                    Role::Edge if tensor.name.ends_with(".0.weight") || tensor.name.starts_with("head") => {
                        *value
                    }
                    Role::Hidden | Role::Edge => 0.25 * *value,
                };
            }
        }
    }
    params
}

/// Compares the gradient by each tensor, along a random direction, with the difference quotient of the loss whose
/// denominator is frozen, which is what the stop-gradient differentiates. The predictions come from the inference
/// kernels, so that both ways through the network are held against each other.
fn check_weight_gradients<N: Network>(network: &N, setup: &Setup, width: usize, what: &str) {
    let batch = batch(setup, 1, 4);
    let params = params_away_from_kinks(network.layout(), width);
    let (_, gradient) = loss_and_gradient(network, setup, Isa::detect(), &params, &batch);
    for tensor in &network.layout().tensors {
        let mut rng = Rng::stream(11, tensor.start as u64, 0);
        let mut direction = vec![0.0f32; params.len()];
        for row in direction[tensor.range()].chunks_mut(tensor.stride) {
            for value in &mut row[..tensor.cols] {
                *value = rng.next_normal();
            }
        }
        let expected: f64 = direction.iter().zip(&gradient).map(|(d, g)| f64::from(*d) * f64::from(*g)).sum();
        let norm = direction.iter().map(|d| d * d).sum::<f32>().sqrt();
        let step = 1e-2 / norm;
        let moved = |sign: f32| -> Vec<f32> {
            params.iter().zip(&direction).map(|(p, d)| p + sign * step * d).collect()
        };
        let base = predictions(network, setup, &params, &batch);
        let frozen =
            |params: &[f32]| frozen_loss(&predictions(network, setup, params, &batch), &base, &batch);
        let found = (frozen(&moved(1.0)) - frozen(&moved(-1.0))) / f64::from(2.0 * step);
        let scale = expected.abs().max(1e-2);
        assert!(
            (found - expected).abs() < 0.01 * scale,
            "{what}: {}: difference quotient {found}, gradient {expected}",
            tensor.name
        );
    }
}

/// Outputs of all samples, by inference.
pub(crate) fn predictions<N: Network>(network: &N, setup: &Setup, params: &[f32], batch: &Batch) -> Vec<f32> {
    let context = NetworkContext { isa: Isa::Portable, scene: &setup.scene, params };
    let packed = network.pack(params);
    let mut scratch = network.light_scratch();
    let mut encoded = AlignedVec::zeros(network.pixel_rows() * LANES);
    let mut out = vec![0.0; batch.targets.len()];
    for (tile, y) in out.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
        let group = tile / batch.slots;
        let pixels = &batch.pixels[group * LANES..(group + 1) * LANES];
        network.encode_pixels(context, &packed, pixels, &mut encoded);
        let lit = network.light(context.isa, params, &packed, &batch.lights[tile]);
        network.infer(context.isa, &packed, &lit, &mut scratch, &encoded, y);
    }
    out
}

fn frozen_loss(predictions: &[f32], base: &[f32], batch: &Batch) -> f64 {
    let term = |(i, p): (usize, &f32)| {
        let error = f64::from(*p) - f64::from(batch.targets[i]);
        f64::from(batch.weights[i / TILE]) * error.powi(2) / (f64::from(base[i]).powi(2) + 0.01)
    };
    predictions.iter().enumerate().map(term).sum::<f64>() / batch.targets.len() as f64
}

#[test]
fn weight_gradients_of_the_reference_network_equal_difference_quotients() {
    for kind in LightKind::ALL {
        let setup = setup(kind);
        let network = ReferenceNetwork::new(24, 3, &tiny_grid(), setup.size, setup.encoding);
        check_weight_gradients(&network, &setup, 24, &format!("reference, {kind}"));
    }
}

#[test]
fn weight_gradients_of_the_fast_network_equal_difference_quotients() {
    for kind in LightKind::ALL {
        let setup = setup(kind);
        let network = FastNetwork::new(20, 2, &tiny_grid(), setup.size, setup.encoding);
        check_weight_gradients(&network, &setup, 20, &format!("fast, {kind}"));
    }
}

/// The light with one parameter moved.
pub(crate) fn moved(light: &LightParams, lane: usize, by: f32) -> LightParams {
    let mut values = light.as_slice().to_vec();
    values[lane] += by;
    LightParams::from_slice(light.kind(), &values).expect("same length")
}

/// Derivative by central differences of two steps, extrapolated: small lights bend the logarithm of their size.
pub(crate) fn difference_quotient(mut value: impl FnMut(f32) -> f64, step: f32) -> f64 {
    let mut quotient = |step: f32| (value(step) - value(-step)) / f64::from(2.0 * step);
    (4.0 * quotient(step) - quotient(2.0 * step)) / 3.0
}

/// The gradient by the light of `sum c_i y_i`, for fixed random `c`, against difference quotients of every parameter.
fn check_light_gradient<N: Network>(network: &N, setup: &Setup, width: usize, what: &str) {
    let params = params_away_from_kinks(network.layout(), width);
    let context = NetworkContext { isa: Isa::detect(), scene: &setup.scene, params: &params };
    let packed = network.pack(&params);
    let mut scratch = network.light_scratch();
    let mut encoded = AlignedVec::zeros(network.pixel_rows() * LANES);
    // On the floor, well in front of lights that face it.
    let pixels: Vec<u32> = (800..832).collect();
    network.encode_pixels(context, &packed, &pixels, &mut encoded);
    let mut rng = Rng::stream(2, 7, 1);
    let coefficients: Vec<f32> = (0..TILE).map(|_| rng.next_normal()).collect();
    for light in batch(setup, 1, 4).lights.iter().take(4) {
        let lit = network.light(context.isa, &params, &packed, light);
        let mut sums = vec![0.0; network.light_gradient_len()];
        let mut magnitude = 0.0;
        let mut d_of = |y: &[f32], d: &mut [f32]| {
            magnitude = y.iter().zip(&coefficients).map(|(y, c)| f64::from((y * c).abs())).sum();
            d.copy_from_slice(&coefficients);
        };
        network.light_backward(context.isa, &packed, &lit, &mut scratch, &encoded, &mut d_of, &mut sums);
        let gradient = network.finish_light_gradient(context.isa, &packed, &lit, &sums);

        for lane in 0..light.as_slice().len() {
            let step = 8e-3;
            let value = |by: f32| {
                let lit = network.light(context.isa, &params, &packed, &moved(light, lane, by));
                let mut y = [0.0; TILE];
                network.infer(context.isa, &packed, &lit, &mut scratch, &encoded, &mut y);
                y.iter().zip(&coefficients).map(|(y, c)| f64::from(*y) * f64::from(*c)).sum::<f64>()
            };
            let found = difference_quotient(value, step);
            let expected = f64::from(gradient[lane]);
            let largest = gradient.iter().fold(0.0, |m, g| f64::from(g.abs()).max(m));
            let rounding = 2e-7 * magnitude / f64::from(step);
            assert!(largest > 5.0 * rounding, "{what}: gradient {largest} drowns in rounding {rounding}");
            assert!(
                (found - expected).abs() < 0.01 * largest + rounding,
                "{what}, parameter {lane}: difference quotient {found}, gradient {expected}, largest {largest}"
            );
        }
    }
}

#[test]
fn light_gradients_equal_difference_quotients_in_every_parameter() {
    for kind in LightKind::ALL {
        let setup = setup(kind);
        let reference = ReferenceNetwork::new(24, 2, &tiny_grid(), setup.size, setup.encoding);
        check_light_gradient(&reference, &setup, 24, &format!("reference, {kind}"));
        let fast = FastNetwork::new(20, 2, &tiny_grid(), setup.size, setup.encoding);
        check_light_gradient(&fast, &setup, 20, &format!("fast, {kind}"));
    }
}

#[test]
fn gradients_do_not_depend_on_the_number_of_threads() {
    let setup = setup(LightKind::Quad);
    let network = FastNetwork::new(20, 2, &tiny_grid(), setup.size, setup.encoding);
    let params = params_away_from_kinks(network.layout(), 20);
    let batch = batch(&setup, 40, 8);
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| loss_and_gradient(&network, &setup, Isa::detect(), &params, &batch))
    };
    let one = with_threads(1);
    assert!(one == with_threads(3), "three threads change the gradient");
    assert!(one.1.iter().all(|g| g.is_finite()));
}

#[test]
fn all_instruction_sets_agree() {
    let setup = setup(LightKind::Sphere);
    let network = FastNetwork::new(36, 2, &tiny_grid(), setup.size, setup.encoding);
    let params = network.layout().start_values(5);
    let batch = batch(&setup, 2, 4);
    let (loss, gradient) = loss_and_gradient(&network, &setup, Isa::Portable, &params, &batch);
    let largest = gradient.iter().fold(0.0f32, |m, g| m.max(g.abs()));
    for isa in Isa::available() {
        let (other, others) = loss_and_gradient(&network, &setup, isa, &params, &batch);
        assert!((loss - other).abs() < 1e-4 * loss, "{}: loss {other} instead of {loss}", isa.name());
        for (i, (a, b)) in gradient.iter().zip(&others).enumerate() {
            assert!((a - b).abs() < 1e-3 * largest, "{}: gradient {i}: {b} instead of {a}", isa.name());
        }
    }
}
