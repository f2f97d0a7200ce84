//! Training on a GPU: weights, moments, targets and gradients stay there; the host draws pixels and lights and says
//! which chunks each step takes.
//!
//! A step is a row of dispatches, recorded for several steps at once: inputs; layers of pixels and of lights; layers of samples,
//! loss, and backwards through them; sums over the lights of each pixel; backwards through the layers of pixels and of
//! lights; gradients by weights; by the grid; their sums; optimiser. Layers take a part of the batch whose activations fit the
//! cache of a large card; each is a product of matrices with what follows it (modulation, ReLU, or their derivatives).
//!
//! # What bounds a step
//!
//! A batch of 16,384 samples with 32 lights a pixel, counted for a card of 3 TB/s and 30 TFLOP/s (half of an H200's
//! peak without matrices) that needs 5 us from one dispatch to the next that waits for it:
//!
//! | | fast 64x2 | reference 256/8 |
//! | --- | --- | --- |
//! | products, 6 operations a weight and sample | 1.0 GFLOP, 35 us | 47 GFLOP, 1.6 ms |
//! | the same by matrices, bound by what tiles read of the cache (16 operations a byte, 5.5 TB/s) | 12 us | 0.5 ms |
//! | activations, written once and read three times | 0.14 GB, 45 us at most (they fit the cache) | 1.1 GB, 0.35 ms |
//! | dispatches, each layer on its own, Muon as 17 products | 39, 195 us | 26, 130 us |
//! | dispatches as they are | 10, 50 us | 24, 120 us |
//!
//! So dispatches are what a narrow network waits for: up to 128 neurons a layer, a workgroup takes 64 samples through all
//! layers forwards, the loss, and all layers backwards. Wide networks are bound by products, and their layers have more tiles
//! than columns alone: they run layer by layer. From 128 neurons on they multiply 16-bit floats by matrices where the device
//! can ([`matrices`]); factors are rounded on their way into workgroup memory, so that weights have no second copy. Activations
//! in 16 bits too would save at most half of their time, a sixth of a step of 256/8.

mod arguments;
mod kernels;
mod matrices;
mod optimise;
mod plan;
mod pool;
mod steps;
mod store;

use std::sync::Arc;

use relume_gpu::{Buffer, Commands, Gpu, GpuError, Submission};

use self::arguments::{Batch, Chains, Loss, Scatter, TrainProgress, Weights};
use self::kernels::Kernels;
use self::optimise::Optimise;
use self::plan::{NetworkShape, Plan, Space, TILE};
pub(crate) use self::steps::DeviceCore;
use self::store::Store;
use crate::encoding::OutputScale;
use crate::gradient::Batch as Samples;
use crate::grid::DeviceLevel;
use crate::network::{CHUNK, Network};
use crate::optim::StepRates;
use crate::replay::BLOCK;
use crate::scene_cache::SceneCache;
use crate::simd::LANES;
use crate::{DeviceTargets, GroupQueries, LightParams, ProxyError, TrainConfig};

/// Most samples that run together; more do not fill a card better, and their activations leave its cache.
const MOST_SAMPLES: u32 = 32_768;
/// Bytes that activations may take.
const MOST_ACTIVATIONS: u64 = 120 << 20;
/// Bytes that the pieces of a gradient may take.
const MOST_PIECES: u64 = 64 << 20;
/// Fewest columns of such a piece.
const LEAST_PIECE: u32 = 256;

/// Requirements of a training on its device.
pub(crate) struct Demand<'a> {
    pub config: &'a TrainConfig,
    pub scene: &'a Arc<SceneCache>,
    /// Chunks that the store has room for.
    pub chunks: usize,
    /// Most chunks that the steps of one [`GpuTraining::run`] draw together.
    pub draws: usize,
    /// True if the device may multiply matrices of 16-bit floats, if it can.
    pub matrices: bool,
}

/// A step of training: which chunks of the store it takes, and how far it goes.
#[derive(Clone, Debug)]
pub(crate) struct TrainStep {
    /// Chunks, each of [`CHUNK`] samples.
    pub draws: Vec<u32>,
    pub rates: StepRates,
    /// Number of the step, from 1.
    pub number: u64,
    /// Share of the way that the running mean of weights goes, in steps in which it goes.
    pub mean_share: Option<f32>,
}

/// The state of a training on its device.
#[derive(Debug)]
pub(crate) struct GpuTraining {
    gpu: Arc<Gpu>,
    plan: Plan,
    batch: Batch,
    /// Samples that run together, at most as many as the activations have room for.
    part: u32,
    /// Columns of a piece of the gradient.
    piece: u32,
    store: Store,
    buffers: Buffers,
    kernels: Kernels,
    optimise: Optimise,
}

/// Buffers that kernels work on, besides the samples and those of the optimiser.
#[derive(Debug)]
struct Buffers {
    /// Chunks of the recorded steps, one step after the other.
    draws: Buffer<u32>,
    layers: Buffer<plan::DenseLayer>,
    levels: Buffer<DeviceLevel>,
    activations: Buffer<f32>,
    pieces: Buffer<f32>,
    losses: Buffer<f32>,
}

impl GpuTraining {
    /// Room for all that a training needs; weights are zero.
    ///
    /// # Errors
    /// If it does not fit the device, or that was lost.
    pub fn new(gpu: Arc<Gpu>, network: &impl Network, demand: &Demand<'_>) -> Result<Self, ProxyError> {
        let (config, layout, grid) = (demand.config, network.layout(), network.grid());
        let encoding = *network.light_encoding();
        let shape = NetworkShape {
            layout,
            grid_levels: grid.levels(),
            grid_outputs: grid.outputs(),
            light_inputs: encoding.inputs(),
            image: grid.image(),
        };
        let (slots, chunk) = (config.lights_per_pixel as u32, CHUNK as u32);
        let plan_for = |capacity| Plan::new(&config.network, &shape, capacity, slots);
        let bytes = 4 * u64::from(plan_for(chunk).activations);
        let fitting = (MOST_ACTIVATIONS.min(gpu.limits().buffer) / bytes).max(1) as u32;
        let largest_batch = (config.batch_end as u32).next_multiple_of(chunk);
        let capacity = MOST_SAMPLES.min(largest_batch).min(fitting.saturating_mul(chunk));
        let plan = plan_for(capacity);
        let pieces = MOST_PIECES / (4 * u64::from(plan.dense));
        let pieces = pieces.clamp(1, u64::from(capacity / LEAST_PIECE)) as u32;
        let piece = capacity.div_ceil(pieces).next_multiple_of(LANES as u32);
        let losses = largest_batch.div_ceil(capacity) * capacity.div_ceil(TILE);

        let buffers = Buffers {
            draws: gpu.zeros("draws", demand.draws)?,
            layers: gpu.buffer_of("layers", &plan.layers)?,
            levels: gpu.buffer_of("grid levels", &grid.device_levels(layout))?,
            activations: gpu.zeros("activations", plan.activations as usize)?,
            pieces: gpu.zeros("gradient in pieces", (capacity.div_ceil(piece) * plan.dense) as usize)?,
            losses: gpu.zeros("losses", losses as usize)?,
        };
        let store = Store::new(&gpu, demand.chunks, config.lights_per_pixel, encoding, demand.scene)?;
        let of_optimise = [&buffers.pieces, &buffers.losses];
        let optimise = Optimise::new(&gpu, layout, (plan.dense, config.muon), of_optimise)?;
        let kernels = Kernels::new(&gpu, &buffers, &store, &optimise, encoding.kind.form())?;
        let batch = Batch { samples: capacity, capacity, slots };
        let mut training =
            Self { gpu, plan, batch, part: capacity, piece, store, buffers, kernels, optimise };
        if demand.matrices {
            training.try_matrices(network, config.size)?;
        }
        Ok(training)
    }

    /// Replaces the chunks from `first` on by those of a batch.
    pub fn write_chunks(&self, first: usize, batch: &Samples, scale: &OutputScale) {
        self.store.write(&self.gpu, first, batch, scale);
    }

    /// Gathers the targets of some blocks, which follow each other in the store from number `first` on, but for its end.
    ///
    /// # Errors
    /// The failure of the source or of the device.
    pub fn gather(
        &self,
        source: &dyn DeviceTargets,
        first: usize,
        blocks: &[&Samples],
    ) -> Result<(), ProxyError> {
        let pixels: Vec<u32> = blocks.iter().flat_map(|block| &block.pixels).copied().collect();
        let lights: Vec<_> = blocks.iter().flat_map(|block| &block.lights).map(LightParams::shape).collect();
        let samples = lights.len() * LANES;
        let gathered = self.gpu.zeros::<f32>("gathered targets", 3 * samples)?;
        let slots = self.batch.slots as usize;
        let queries =
            GroupQueries { pixels: &pixels, group: LANES, lights_per_pixel: slots, lights: &lights };
        source.pixel_targets(&queries, &gathered)?;
        let store = &self.store;
        let bound = self.kernels.targets.bind(&[
            gathered.whole(),
            store.pixels.whole(),
            store.lights.whole(),
            store.targets.whole(),
            self.optimise.progress.whole(),
        ])?;
        let arguments = arguments::Targets {
            samples: samples as u32,
            slots: self.batch.slots,
            first_block: first as u32,
            blocks: (store.chunks() * CHUNK / BLOCK as usize) as u32,
            block: BLOCK as u32,
        };
        let mut commands = self.gpu.commands("targets");
        commands.run(&bound, arguments.samples.div_ceil(64), bytemuck::bytes_of(&arguments));
        Ok(commands.submit()?)
    }

    /// Runs some steps, and does not wait for them.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn run(&self, steps: &[TrainStep]) -> Result<Submission, GpuError> {
        let draws: Vec<u32> = steps.iter().flat_map(|step| step.draws.iter().copied()).collect();
        self.gpu.write(&self.buffers.draws, 0, &draws);
        let mut commands = self.gpu.commands("training steps");
        let mut first = 0;
        for step in steps {
            self.record_gradient(&mut commands, first, step.draws.len() as u32);
            self.optimise.record_update(&mut commands, step);
            first += step.draws.len() as u32;
        }
        commands.submit_tracked()
    }

    /// Gradient and loss of the samples of some chunks.
    fn record_gradient(&self, commands: &mut Commands<'_>, first_draw: u32, chunks: u32) {
        let samples = chunks * CHUNK as u32;
        let weight = 1.0 / (3.0 * samples as f32);
        let scale = if self.kernels.products.by_matrices { matrices::gradient_scale(samples) } else { 1.0 };
        let mut losses = 0;
        for start in (0..samples).step_by(self.part as usize) {
            let batch = Batch { samples: self.part.min(samples - start), ..self.batch };
            let draw = first_draw + start / CHUNK as u32;
            self.record_forward(commands, batch, draw);
            let chain = Chains { batch, scale, ..self.plan.samples };
            let loss = Loss { chain, first_draw: draw, weight, first_sum: losses, ..self.plan.loss };
            self.record_samples(commands, &loss);
            self.record_backward(commands, (batch, draw), scale, start > 0);
            losses += batch.samples.div_ceil(TILE);
        }
        let batch = Batch { samples: samples.min(self.part), ..self.batch };
        self.optimise.record_reduction(commands, batch, self.piece, losses);
    }

    fn record_forward(&self, commands: &mut Commands<'_>, batch: Batch, first_draw: u32) {
        let (plan, kernels) = (&self.plan, &self.kernels);
        let inputs = arguments::Inputs { batch, first_draw, ..plan.inputs };
        let columns = |space| batch.columns(space);
        let threads = columns(Space::Pixels) * (inputs.levels + 1)
            + columns(Space::Lights) * inputs.light_inputs
            + columns(Space::Samples);
        commands.run(&kernels.inputs, threads.div_ceil(64), bytemuck::bytes_of(&inputs));
        let chains = |chains: &Chains| Chains { batch, ..*chains };
        plan.forward.iter().for_each(|own| self.record_layers(commands, &chains(own), true));
    }

    /// Layers of samples and the loss, forwards and backwards.
    fn record_samples(&self, commands: &mut Commands<'_>, loss: &Loss) {
        let groups = loss.chain.batch.samples.div_ceil(TILE);
        if self.plan.chained {
            return commands.run(&self.kernels.products.samples, groups, bytemuck::bytes_of(loss));
        }
        let Chains { first, length, .. } = loss.chain;
        let single = |row| Chains { first: row, length: 1, ..loss.chain };
        (first..first + length).for_each(|row| self.record_layers(commands, &single(row), true));
        commands.run(&self.kernels.products.loss, groups, bytemuck::bytes_of(loss));
        (first..=first + length).rev().for_each(|row| self.record_layers(commands, &single(row), false));
    }

    fn record_backward(
        &self,
        commands: &mut Commands<'_>,
        (batch, first_draw): (Batch, u32),
        scale: f32,
        add: bool,
    ) {
        let (plan, kernels) = (&self.plan, &self.kernels);
        let pixels = batch.columns(Space::Pixels);
        let slots = arguments::Slots { batch, ..plan.slots };
        commands.run(&kernels.sum_slots, (pixels * slots.rows).div_ceil(64), bytemuck::bytes_of(&slots));
        let chains = |chains: &Chains| Chains { batch, scale, ..*chains };
        plan.backward.iter().for_each(|own| self.record_layers(commands, &chains(own), false));
        let tiles = |layer: &plan::DenseLayer| {
            let pieces = batch.columns(layer.space()).div_ceil(self.piece);
            layer.outputs.div_ceil(TILE) * layer.inputs.div_ceil(TILE) * pieces
        };
        let weights = Weights {
            batch,
            layers: plan.layers.len() as u32,
            piece: self.piece,
            add: u32::from(add),
            parameters: plan.dense,
            scale,
        };
        let groups = plan.layers.iter().map(tiles).sum();
        commands.run(&kernels.products.weights, groups, bytemuck::bytes_of(&weights));
        let inputs = &plan.inputs;
        let scatter = Scatter {
            batch,
            first_draw,
            d_pixels: plan.d_pixels,
            levels: inputs.levels,
            features: inputs.features,
            width: inputs.width,
            height: inputs.height,
            grid: plan.dense,
        };
        commands.run(&kernels.scatter, (pixels * inputs.levels).div_ceil(64), bytemuck::bytes_of(&scatter));
    }

    fn record_layers(&self, commands: &mut Commands<'_>, chains: &Chains, forwards: bool) {
        let batch = chains.batch;
        let first_layers = self.plan.layers[chains.first as usize..]
            .iter()
            .step_by(chains.pitch.max(1) as usize)
            .take(chains.count as usize);
        // A workgroup takes all rows of a chain; of single layers, a tile.
        let groups = first_layers
            .map(|layer| {
                let rows = if forwards { layer.outputs } else { layer.inputs };
                let tiles = if chains.length == 1 { rows.div_ceil(TILE) } else { 1 };
                tiles * batch.columns(layer.space()).div_ceil(TILE)
            })
            .sum();
        let products = &self.kernels.products;
        let kernel = if forwards { &products.forward } else { &products.backward };
        commands.run(kernel, groups, bytemuck::bytes_of(chains));
    }

    /// Replaces weights and moments.
    pub fn upload(&self, state: [&[f32]; 4]) {
        self.optimise.upload(&self.gpu, state);
    }

    /// Weights, their running mean, and first and second moments.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn download(&self) -> Result<[Vec<f32>; 4], GpuError> {
        self.optimise.download(&self.gpu)
    }

    /// Progress of the steps since the last [`GpuTraining::forget_progress`]. Waits for them.
    fn progress(&self) -> Result<TrainProgress, GpuError> {
        self.optimise.progress(&self.gpu)
    }

    /// Lets steps count from zero, and have an effect again after a bad one.
    fn forget_progress(&self) {
        self.optimise.forget_progress(&self.gpu);
    }
}

#[cfg(test)]
mod tests;
