use bytemuck::{Zeroable, bytes_of};
use relume_gpu::{Binding, Bound, Buffer, Commands, Gpu, GpuError};

use super::TrainStep;
use super::arguments::{Batch, Muon, Rates, Reduction, TrainProgress};
use super::plan::Space;
use crate::optim::{NEWTON_SCHULZ, ROUNDS, corrections, muon_step_length};
use crate::params::{ParamLayout, Role};
use crate::simd::PAD;

/// Threads of a workgroup in `train/reduce.wgsl` and `train/optimise.wgsl`.
const THREADS: u32 = 256;
/// Largest matrices of Muon that `train/optimise.wgsl` moves: two squares of them fill 32 KiB.
const LARGEST_SIDE: u32 = 64;
/// Rows and columns of a workgroup's share of a product in `train/muon.wgsl`.
const TILE: u32 = 16;

/// Low byte of a block's word, besides the numbers of [`Space`], as in `train/parameters.wgsl`.
const GRID: u32 = 3;
const NONE: u32 = 4;
/// Second byte.
const ADAM: u32 = 0;
const MUON: u32 = 1;
const SPARSE_ADAM: u32 = 2;

/// Parameters and their moments, and the kernels that move them.
#[derive(Debug)]
pub(super) struct Optimise {
    pub params: Buffer<f32>,
    /// Sums of the gradient by the grid, two words each.
    pub grid: Buffer<u32>,
    pub gradient: Buffer<f32>,
    #[expect(dead_code, reason = "bound to kernels, and counted against the memory budget while it lives")]
    blocks: Buffer<u32>,
    mean: Buffer<f32>,
    first: Buffer<f32>,
    second: Buffer<f32>,
    pub progress: Buffer<TrainProgress>,
    parameters: u32,
    dense: u32,
    reduce: Bound,
    optimise: Bound,
    hidden: Hidden,
    muon: Option<MuonKernels>,
}

/// The matrices that Muon moves, which are all of one size; there may be none.
#[derive(Debug)]
struct Hidden {
    /// First parameter of each.
    starts: Buffer<u32>,
    matrices: u32,
    size: u32,
    stride: u32,
}

/// Muon for matrices that are too large to move with all else.
#[derive(Debug)]
struct MuonKernels {
    #[expect(dead_code, reason = "bound to kernels, and counted against the memory budget while it lives")]
    squares: Buffer<f32>,
    start: Bound,
    multiply: Bound,
    finish: Bound,
}

impl Optimise {
    /// Optimiser of the gradient in `pieces` of `dense` values each, and the loss in `losses`; with Muon for hidden
    /// matrices or Adam for all.
    pub fn new(
        gpu: &Gpu,
        layout: &ParamLayout,
        (dense, muon): (u32, bool),
        [pieces, losses]: [&Buffer<f32>; 2],
    ) -> Result<Self, GpuError> {
        let len = layout.len;
        let vector = |label: &str| gpu.zeros::<f32>(label, len);
        let (params, gradient, mean) = (vector("weights")?, vector("gradient")?, vector("mean weights")?);
        let (first, second) = (vector("first moments")?, vector("second moments")?);
        let grid = gpu.zeros::<u32>("gradient by the grid", 2 * (len - dense as usize))?;
        let progress = gpu.zeros::<TrainProgress>("progress", 1)?;
        let blocks = gpu.buffer_of("blocks", &block_words(layout, muon))?;
        let (b, g, p) = (blocks.whole(), gradient.whole(), progress.whole());
        let reduced = [b, pieces.whole(), grid.whole(), g, p, losses.whole()];
        let hidden = Hidden::new(gpu, layout, muon)?;
        let side = hidden.side();
        let moved =
            [b, p, g, params.whole(), first.whole(), second.whole(), mean.whole(), hidden.starts.whole()];
        let constants = [("SIDE", side.unwrap_or(4)), ("ROUNDS", ROUNDS as u32)];
        Ok(Self {
            reduce: gpu.kernel("train/reduce", "reduce", &[])?.bind(&reduced)?,
            optimise: gpu.kernel("train/optimise", "optimise", &constants)?.bind(&moved)?,
            muon: match side {
                Some(_) => None,
                None => Some(MuonKernels::new(gpu, &hidden, p, [&params, &first, &gradient, &mean])?),
            },
            hidden,
            parameters: len as u32,
            dense,
            params,
            grid,
            gradient,
            blocks,
            mean,
            first,
            second,
            progress,
        })
    }

    /// Adds up gradient and loss of a batch, of which `batch` is the first part.
    pub fn record_reduction(&self, commands: &mut Commands<'_>, batch: Batch, piece: u32, losses: u32) {
        let reduction = Reduction { batch, piece, dense: self.dense, parameters: self.parameters, losses };
        commands.run(&self.reduce, 1 + self.parameters.div_ceil(THREADS), bytes_of(&reduction));
    }

    /// Moves the parameters along the gradient.
    pub fn record_update(&self, commands: &mut Commands<'_>, step: &TrainStep) {
        let hidden = &self.hidden;
        let [first_correction, second_correction] = corrections(step.number);
        let [linear, cubic, quintic] = NEWTON_SCHULZ;
        let mean_share = step.mean_share.unwrap_or(0.0);
        let length = muon_step_length(step.rates.muon, hidden.size as usize);
        let rates = Rates {
            parameters: self.parameters,
            adam: step.rates.adam,
            grid: step.rates.grid,
            first_correction,
            second_correction,
            mean_share,
            matrices: if self.muon.is_some() { 0 } else { hidden.matrices },
            size: hidden.size,
            stride: hidden.stride,
            muon: length,
            linear,
            cubic,
            quintic,
        };
        let groups = rates.matrices + self.parameters.div_ceil(THREADS);
        commands.run(&self.optimise, groups, bytes_of(&rates));
        if let Some(muon) = &self.muon {
            muon.record(commands, hidden, (length, mean_share));
        }
    }

    /// The vectors of a state, in the order of [`Optimise::upload`].
    fn vectors(&self) -> [&Buffer<f32>; 4] {
        [&self.params, &self.mean, &self.first, &self.second]
    }

    /// Replaces weights, their running mean, and first and second moments.
    pub fn upload(&self, gpu: &Gpu, state: [&[f32]; 4]) {
        for (buffer, values) in self.vectors().into_iter().zip(state) {
            gpu.write(buffer, 0, values);
        }
    }

    /// Weights, their running mean, and first and second moments.
    pub fn download(&self, gpu: &Gpu) -> Result<[Vec<f32>; 4], GpuError> {
        let [params, mean, first, second] = self.vectors().map(|vector| gpu.read(vector, 0..vector.len()));
        Ok([params?, mean?, first?, second?])
    }

    /// Progress of the steps since the last [`Optimise::forget_progress`].
    pub fn progress(&self, gpu: &Gpu) -> Result<TrainProgress, GpuError> {
        Ok(gpu.read(&self.progress, 0..1)?[0])
    }

    /// Lets steps count from zero, and have an effect again after a bad one.
    pub fn forget_progress(&self, gpu: &Gpu) {
        gpu.write(&self.progress, 0, &[TrainProgress::default()]);
    }
}

/// Kind of each block of parameters.
fn block_words(layout: &ParamLayout, muon: bool) -> Vec<u32> {
    let mut blocks = vec![NONE; layout.len / PAD];
    for tensor in &layout.tensors {
        let space = match tensor.name.split('.').next() {
            Some("trunk") => Space::Pixels as u32,
            Some("encoder") => Space::Lights as u32,
            Some("grid") => GRID,
            _ => Space::Samples as u32,
        };
        let optimiser = match tensor.role {
            Role::Hidden if muon => MUON,
            Role::Grid => SPARSE_ADAM,
            Role::Hidden | Role::Edge | Role::Bias => ADAM,
        };
        let range = tensor.range();
        blocks[range.start / PAD..range.end.div_ceil(PAD)].fill(space | optimiser << 8);
    }
    blocks
}

impl Hidden {
    /// Those of a layout; none without Muon.
    fn new(gpu: &Gpu, layout: &ParamLayout, muon: bool) -> Result<Self, GpuError> {
        let hidden = || layout.tensors.iter().filter(|tensor| muon && tensor.role == Role::Hidden);
        let starts: Vec<u32> = hidden().map(|tensor| tensor.start as u32).collect();
        let (size, stride) = hidden().next().map_or((0, 0), |matrix| (matrix.rows, matrix.stride));
        Ok(Self {
            matrices: starts.len() as u32,
            // A buffer cannot be empty.
            starts: gpu.buffer_of("hidden matrices", if starts.is_empty() { &[0] } else { &starts })?,
            size: size as u32,
            stride: stride as u32,
        })
    }

    /// Sides of the squares in which `train/optimise.wgsl` moves them, if they are small enough.
    fn side(&self) -> Option<u32> {
        (self.size <= LARGEST_SIDE).then_some(self.size.next_multiple_of(4).max(4))
    }
}

impl MuonKernels {
    fn new(
        gpu: &Gpu,
        hidden: &Hidden,
        progress: Binding<'_>,
        [params, momentum, gradient, mean]: [&Buffer<f32>; 4],
    ) -> Result<Self, GpuError> {
        let squares =
            gpu.zeros::<f32>("squares of Muon", (hidden.matrices * 4 * hidden.size.pow(2)) as usize)?;
        let (x, starts) = (squares.whole(), hidden.starts.whole());
        let kernel = |entry: &str| gpu.kernel("train/muon", entry, &[]);
        let start = [x, starts, progress, momentum.whole(), gradient.whole()];
        let finish = [x, starts, progress, params.whole(), mean.whole()];
        Ok(Self {
            start: kernel("start")?.bind(&start)?,
            multiply: kernel("multiply")?.bind(&[x])?,
            finish: kernel("finish")?.bind(&finish)?,
            squares,
        })
    }

    fn record(&self, commands: &mut Commands<'_>, hidden: &Hidden, (step, mean_share): (f32, f32)) {
        let &Hidden { size, stride, matrices, .. } = hidden;
        let own = Muon { size, stride, matrices, ..Zeroable::zeroed() };
        commands.run(&self.start, matrices, bytes_of(&own));
        let tiles = matrices * size.div_ceil(TILE) * size.div_ceil(TILE);
        let mut multiply = |product: Muon| commands.run(&self.multiply, tiles, bytes_of(&product));
        let [a, b, c] = NEWTON_SCHULZ;
        let (gram, polynomial) = (1, 2);
        let (mut x, mut next) = (0, 3);
        for _ in 0..ROUNDS {
            multiply(Muon { left: x, right: x, turned: 1, plus: x, to: gram, factor: 1.0, ..own });
            let squared = Muon { left: gram, right: gram, plus: gram, to: polynomial, ..own };
            multiply(Muon { factor: c, share: b, ..squared });
            multiply(Muon { left: polynomial, right: x, plus: x, to: next, factor: 1.0, share: a, ..own });
            std::mem::swap(&mut x, &mut next);
        }
        let groups = (matrices * size * size).div_ceil(THREADS);
        commands.run(&self.finish, groups, bytes_of(&Muon { left: x, step, mean_share, ..own }));
    }
}
