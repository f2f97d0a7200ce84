use relume_gpu::{Gpu, GpuError, Matrices};

use super::kernels::Products;
use super::{GpuTraining, Samples};
use crate::encoding::{LightEncoding, OutputScale};
use crate::light::random_light;
use crate::loss::TILE;
use crate::network::{CHUNK_TILES, Network};
use crate::params::ParamLayout;
use crate::simd::LANES;
use crate::{NetworkConfig, ProxyError, Rng, SizeRange};

/// Narrowest network whose training is worth it (the table at the top of [`super`]): narrower ones wait for dispatches.
const NARROWEST: usize = 128;
/// Bytes of workgroup memory of `train/product_matrices.wgsl`, where it needs most, its invocations, and the side of a tile.
const MEMORY: u32 = 30 << 10;
const INVOCATIONS: u32 = 256;
const TILE_SIDE: u32 = 64;
/// Most error of a tensor's gradient at the start, as a share of its norm. Rounding to 11 bits is off by 3e-4 in the mean, in
/// each of two factors; with that a thousandth of all units or less are on one side of their ReLU instead of the other,
/// each with all of its gradient: the root of that share, 3 %; one to three were seen. Matrices in another order would be off by
/// 100 %.
pub(super) const TOLERANCE: f64 = 0.1;

/// True if a network's products take long enough for matrices to matter.
pub(super) fn are_worth_it(network: &NetworkConfig) -> bool {
    let (NetworkConfig::Fast { width, .. } | NetworkConfig::Reference { width, .. }) = network;
    *width >= NARROWEST
}

/// Factor on gradients while they have 16 bits. The largest by outputs is 200 times the weight of a sample, `1 / (3 samples)`,
/// times the difference to its target; a sixteenth of one over that weight leaves room for differences of thousands
/// above, and below for gradients of a millionth.
pub(super) fn gradient_scale(samples: u32) -> f32 {
    (3 * samples / 16).next_power_of_two() as f32
}

/// True if each subgroup has whole pairs of a tile's matrices, and workgroup memory suffices.
fn fits(matrices: Matrices, gpu: &Gpu) -> bool {
    let pairs = TILE_SIDE * TILE_SIDE / (2 * matrices.side * matrices.side);
    pairs.is_multiple_of(INVOCATIONS / matrices.subgroup) && MEMORY <= gpu.limits().workgroup_memory
}

/// Constants of modules that multiply by matrices.
pub(super) fn constants(matrices: Matrices) -> Vec<(&'static str, u32)> {
    [("MATRICES", 1)].into_iter().chain(matrices.constants()).collect()
}

impl GpuTraining {
    /// Multiplies by matrices of 16-bit floats from here on, if the device has them and they give what the plain kernels
    /// give. Weights are zero after it.
    ///
    /// # Errors
    /// If the plain kernels fail.
    pub(super) fn try_matrices(&mut self, network: &impl Network, size: SizeRange) -> Result<(), ProxyError> {
        let Some(matrices) = self.gpu.matrices().filter(|matrices| fits(*matrices, &self.gpu)) else {
            return Ok(());
        };
        let constants = constants(matrices);
        let compile = |name: &str, entry: &str| self.gpu.kernel(name, entry, &constants);
        // A driver that refuses them is no reason to do without it.
        let Ok(products) = self.products(true, compile) else { return Ok(()) };
        self.adopt(products, network, size)
    }

    /// Multiplies with these kernels from here on, if they give what those before them give.
    pub(super) fn adopt(
        &mut self,
        mut products: Products,
        network: &impl Network,
        size: SizeRange,
    ) -> Result<(), ProxyError> {
        let expected = self.test_gradient(network, size)?;
        std::mem::swap(&mut self.kernels.products, &mut products);
        let found = self.test_gradient(network, size);
        if !found.is_ok_and(|found| error(network.layout(), &found, &expected) < TOLERANCE) {
            self.kernels.products = products;
        }
        let zeros = vec![0.0; network.layout().len];
        self.upload([&zeros; 4]);
        self.forget_progress();
        Ok(())
    }

    /// True if products are made of 16-bit floats.
    pub fn by_matrices(&self) -> bool {
        self.kernels.products.by_matrices
    }

    /// Gradient of a network that has learned nothing by some samples.
    fn test_gradient(&self, network: &impl Network, size: SizeRange) -> Result<Vec<f32>, GpuError> {
        let params = network.layout().start_values(1);
        let zeros = vec![0.0; params.len()];
        self.upload([&params, &zeros, &zeros, &zeros]);
        let [width, height] = network.grid().image();
        let batch = test_samples(width * height, self.batch.slots as usize, network.light_encoding(), size);
        self.write_chunks(0, &batch, &OutputScale { factor: 1.0, area: None });
        self.gpu.write(&self.buffers.draws, 0, &[0]);
        let mut commands = self.gpu.commands("gradient of a test");
        self.record_gradient(&mut commands, 0, 1);
        commands.submit()?;
        let gradient = &self.optimise.gradient;
        self.gpu.read(gradient, 0..gradient.len())
    }
}

/// A chunk of lights around the middle of the scene and of targets without meaning.
fn test_samples(pixels: usize, slots: usize, encoding: &LightEncoding, size: SizeRange) -> Samples {
    let mut rng = Rng::stream(1, 2, 3);
    let normalisation = &encoding.normalisation;
    let light = |rng: &mut Rng| {
        let away = glam::Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) - 0.5;
        let center = glam::Vec3::from(normalisation.center) + normalisation.scale * away;
        random_light(encoding.kind, center, size, rng)
    };
    Samples {
        pixels: (0..CHUNK_TILES / slots * LANES).map(|_| rng.below(pixels as u32)).collect(),
        slots,
        lights: (0..CHUNK_TILES).map(|_| light(&mut rng)).collect(),
        targets: (0..CHUNK_TILES * TILE).map(|_| 2.0 * rng.next_f32()).collect(),
        weights: vec![1.0; CHUNK_TILES],
    }
}

/// Largest error of a tensor, as a share of its norm.
pub(super) fn error(layout: &ParamLayout, found: &[f32], expected: &[f32]) -> f64 {
    let norm =
        |values: &mut dyn Iterator<Item = f32>| values.map(|x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    let of_tensor = |range: std::ops::Range<usize>| {
        let (found, expected) = (&found[range.clone()], &expected[range]);
        let error = norm(&mut found.iter().zip(expected).map(|(a, b)| a - b));
        error / norm(&mut expected.iter().copied())
    };
    layout.tensors.iter().map(|tensor| of_tensor(tensor.range())).fold(0.0, |most, error| {
        // What is no number is no gradient.
        if error.is_nan() { f64::INFINITY } else { error.max(most) }
    })
}
