//! Training on a GPU: weights, moments, targets and gradients stay there; the host draws pixels and lights and says
//! which chunks each step takes.
//!
//! A step is a chain of dispatches, recorded for several steps at once: inputs, layers forwards, loss, layers backwards, sums
//! of the weights' gradients, optimiser. Layers run one after the other over a part of the batch whose activations fit the
//! cache of a large card; each is a product of matrices with what follows it (modulation, ReLU, or their derivatives)
//! in the same kernel.

mod arguments;
mod optimise;
mod plan;
mod steps;
mod store;

use std::sync::Arc;

use relume_gpu::{Binding, Bound, Buffer, Commands, Gpu, GpuError, Kernel};

use self::arguments::{Batch, Layers, Progress, Scatter};
use self::optimise::Optimise;
use self::plan::{Plan, Shape, Space};
pub(crate) use self::steps::DeviceCore;
use self::store::Store;
use crate::encoding::OutputScale;
use crate::gradient::Batch as Samples;
use crate::network::{CHUNK, Network};
use crate::optim::StepRates;
use crate::replay::BLOCK;
use crate::scene_cache::SceneCache;
use crate::simd::LANES;
use crate::{DeviceTargets, GroupQueries, LightKind, LightParams, ProxyError, TrainConfig};

/// Rows and columns of a tile of [`Plan::layers`], as in `train/dense.wgsl` and `train/weights.wgsl`.
const TILE: u32 = 64;
/// Most samples that run together; more do not fill a card better, and their activations leave its cache.
const MOST_SAMPLES: u32 = 32_768;
/// Bytes that activations may take.
const MOST_ACTIVATIONS: u64 = 120 << 20;
/// Bytes that the pieces of a gradient may take.
const MOST_PIECES: u64 = 64 << 20;
/// Fewest columns of such a piece.
const LEAST_PIECE: u32 = 256;
/// Samples of which a workgroup of `train/loss.wgsl` sums up the loss.
const LOSS_GROUP: u32 = 256;

/// What a training needs of its device.
pub(crate) struct Demand<'a> {
    pub config: &'a TrainConfig,
    pub scene: &'a SceneCache,
    /// Chunks that the store has room for.
    pub chunks: usize,
    /// Most chunks that the steps of one [`GpuTraining::run`] draw together.
    pub draws: usize,
}

/// A step of training: which chunks of the store it takes, and how far it goes.
#[derive(Clone, Debug)]
pub(crate) struct Step {
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

/// What kernels work on, besides the samples and what the optimiser has.
#[derive(Debug)]
struct Buffers {
    /// Chunks of the recorded steps, one step after the other.
    draws: Buffer<u32>,
    layers: Buffer<plan::Layer>,
    levels: Buffer<[u32; 4]>,
    scene: Buffer<f32>,
    activations: Buffer<f32>,
    pieces: Buffer<f32>,
    losses: Buffer<f32>,
}

#[derive(Debug)]
struct Kernels {
    inputs: Bound,
    features: Bound,
    expand: Bound,
    forward: Bound,
    loss: Bound,
    backward: Bound,
    sum_slots: Bound,
    weights: Bound,
    scatter: Bound,
    targets: Kernel,
}

impl GpuTraining {
    /// Room for all that a training needs; weights are zero.
    ///
    /// # Errors
    /// If it does not fit the device, or that was lost.
    pub fn new(gpu: Arc<Gpu>, network: &impl Network, demand: &Demand<'_>) -> Result<Self, ProxyError> {
        let (config, layout, grid) = (demand.config, network.layout(), network.grid());
        let encoding = *network.light_encoding();
        let shape = Shape {
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
        let losses = largest_batch.div_ceil(capacity) * capacity.div_ceil(LOSS_GROUP);

        let scene: Vec<f32> = demand.scene.rows().collect();
        let buffers = Buffers {
            draws: gpu.zeros("draws", demand.draws)?,
            layers: gpu.buffer_of("layers", &plan.layers)?,
            levels: gpu.buffer_of("grid levels", &grid.level_rows(layout))?,
            scene: gpu.buffer_of("scene", &scene)?,
            activations: gpu.zeros("activations", plan.activations as usize)?,
            pieces: gpu.zeros("gradient in pieces", (capacity.div_ceil(piece) * plan.dense) as usize)?,
            losses: gpu.zeros("losses", losses as usize)?,
        };
        let store = Store::new(&gpu, demand.chunks, config.lights_per_pixel, encoding)?;
        let of_optimise = [&buffers.pieces, &buffers.losses];
        let optimise = Optimise::new(&gpu, layout, (plan.dense, config.muon), of_optimise)?;
        let quads = encoding.kind == LightKind::Quad;
        let kernels = Kernels::new(&gpu, &buffers, &store, &optimise, quads)?;
        let batch = Batch { samples: capacity, capacity, slots };
        Ok(Self { gpu, plan, batch, part: capacity, piece, store, buffers, kernels, optimise })
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
    pub fn run(&self, steps: &[Step]) -> Result<(), GpuError> {
        let draws: Vec<u32> = steps.iter().flat_map(|step| step.draws.iter().copied()).collect();
        self.gpu.write(&self.buffers.draws, 0, &draws);
        let mut commands = self.gpu.commands("training steps");
        let mut first = 0;
        for step in steps {
            self.record_gradient(&mut commands, first, step.draws.len() as u32);
            self.optimise.record_update(&mut commands, step);
            first += step.draws.len() as u32;
        }
        commands.submit()
    }

    /// Gradient and loss of the samples of some chunks.
    fn record_gradient(&self, commands: &mut Commands<'_>, first_draw: u32, chunks: u32) {
        let samples = chunks * CHUNK as u32;
        let weight = 1.0 / (3.0 * samples as f32);
        let mut losses = 0;
        for start in (0..samples).step_by(self.part as usize) {
            let batch = Batch { samples: self.part.min(samples - start), ..self.batch };
            let draw = first_draw + start / CHUNK as u32;
            self.record_forward(commands, batch, draw, weight, losses);
            self.record_backward(commands, batch, draw, start > 0);
            losses += batch.samples.div_ceil(LOSS_GROUP);
        }
        let batch = Batch { samples: samples.min(self.part), ..self.batch };
        self.optimise.record_reduction(commands, batch, self.piece, losses);
    }

    fn record_forward(
        &self,
        commands: &mut Commands<'_>,
        batch: Batch,
        first_draw: u32,
        weight: f32,
        first_sum: u32,
    ) {
        let (plan, kernels) = (&self.plan, &self.kernels);
        let (samples, pixels) = (batch.samples, batch.columns(Space::Pixels));
        let inputs = arguments::Inputs { batch, first_draw, ..plan.inputs };
        let threads = pixels * (inputs.levels + 1) + batch.columns(Space::Lights) * inputs.light_inputs;
        commands.run(&kernels.inputs, threads.div_ceil(64), bytemuck::bytes_of(&inputs));
        if let Some(features) = plan.features {
            let features = arguments::Features { batch, first_draw, ..features };
            commands.run(&kernels.features, samples.div_ceil(64), bytemuck::bytes_of(&features));
        }
        if let Some(expansion) = plan.expansion {
            let expansion = arguments::Expansion { batch, ..expansion };
            let rows = expansion.pixel_rows + expansion.light_rows;
            commands.run(&kernels.expand, (samples * rows).div_ceil(64), bytemuck::bytes_of(&expansion));
        }
        for rows in &plan.forward {
            let groups = self
                .groups(batch, rows, |layer, columns| layer.outputs.div_ceil(TILE) * columns.div_ceil(TILE));
            commands.run(&kernels.forward, groups, bytemuck::bytes_of(&self.layers(batch, rows, false)));
        }
        let loss = arguments::Loss { batch, first_draw, weight, first_sum, ..plan.loss };
        commands.run(&kernels.loss, samples.div_ceil(LOSS_GROUP), bytemuck::bytes_of(&loss));
    }

    fn record_backward(&self, commands: &mut Commands<'_>, batch: Batch, first_draw: u32, add: bool) {
        let (plan, kernels) = (&self.plan, &self.kernels);
        let pixels = batch.columns(Space::Pixels);
        let [head, tail] = &plan.backward;
        let backward = |commands: &mut Commands<'_>, rows: &plan::Rows| {
            let groups = self
                .groups(batch, rows, |layer, columns| layer.inputs.div_ceil(TILE) * columns.div_ceil(TILE));
            commands.run(&kernels.backward, groups, bytemuck::bytes_of(&self.layers(batch, rows, add)));
        };
        head.iter().for_each(|rows| backward(commands, rows));
        let slots = arguments::Slots { batch, ..plan.slots };
        commands.run(&kernels.sum_slots, (pixels * slots.rows).div_ceil(64), bytemuck::bytes_of(&slots));
        tail.iter().for_each(|rows| backward(commands, rows));
        let all = 0..plan.layers.len() as u32;
        let groups = self.groups(batch, &all, |layer, columns| {
            layer.outputs.div_ceil(TILE) * layer.inputs.div_ceil(TILE) * columns.div_ceil(self.piece)
        });
        commands.run(&kernels.weights, groups, bytemuck::bytes_of(&self.layers(batch, &all, add)));
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

    /// Workgroups of some rows of the table.
    fn groups(&self, batch: Batch, rows: &plan::Rows, tiles: impl Fn(&plan::Layer, u32) -> u32) -> u32 {
        let layers = &self.plan.layers[rows.start as usize..rows.end as usize];
        layers.iter().map(|layer| tiles(layer, batch.columns(layer.space()))).sum()
    }

    fn layers(&self, batch: Batch, rows: &plan::Rows, add: bool) -> Layers {
        Layers {
            batch,
            first: rows.start,
            count: rows.end - rows.start,
            piece: self.piece,
            add: u32::from(add),
            parameters: self.plan.dense,
        }
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

    /// What the steps since the last [`GpuTraining::forget_progress`] have come to. Waits for them.
    fn progress(&self) -> Result<Progress, GpuError> {
        self.optimise.progress(&self.gpu)
    }

    /// Lets steps count from zero, and have an effect again after a bad one.
    fn forget_progress(&self) {
        self.optimise.forget_progress(&self.gpu);
    }
}

impl Kernels {
    fn new(
        gpu: &Gpu,
        buffers: &Buffers,
        store: &Store,
        optimise: &Optimise,
        quads: bool,
    ) -> Result<Self, GpuError> {
        let bind = |stage: &str, entry: &str, bindings: &[Binding<'_>]| {
            gpu.kernel(&format!("train/{stage}"), entry, &[])?.bind(bindings)
        };
        let (draws, layers, levels) = (buffers.draws.whole(), buffers.layers.whole(), buffers.levels.whole());
        let (activations, scene) = (buffers.activations.whole(), buffers.scene.whole());
        let (pixels, lights, targets) = (store.pixels.whole(), store.lights.whole(), store.targets.whole());
        let params = optimise.params.whole();
        let inputs = [params, levels, scene, draws, pixels, lights, activations];
        let loss = [params, draws, lights, targets, activations, buffers.losses.whole()];
        let features = gpu.kernel("train/features", "fill", &[("QUAD", u32::from(quads))])?;
        Ok(Self {
            inputs: bind("inputs", "inputs", &inputs)?,
            features: features.bind(&[draws, lights, activations])?,
            expand: bind("expand", "expand", &[activations])?,
            forward: bind("dense", "forward", &[layers, params, activations])?,
            loss: bind("loss", "loss", &loss)?,
            backward: bind("dense", "backward", &[layers, params, activations])?,
            sum_slots: bind("slots", "sum_slots", &[activations])?,
            weights: bind("weights", "weights", &[layers, activations, buffers.pieces.whole()])?,
            scatter: bind(
                "scatter",
                "scatter",
                &[levels, draws, pixels, activations, optimise.grid.whole()],
            )?,
            targets: gpu.kernel("train/targets", "store", &[])?,
        })
    }
}

#[cfg(test)]
mod tests;
