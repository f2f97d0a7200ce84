use rayon::prelude::*;

use crate::LightParams;
use crate::loss::TILE;
use crate::network::{CHUNK_TILES, ChunkGradients, Network, NetworkContext, SampleChunk};
use crate::params::Role;
use crate::simd::{AlignedVec, LANES};

/// Most gradient buffers. Chunks are dealt to them by number, never by thread, and they are added up in order, so that
/// the result does not depend on the number of threads.
const PARTS: usize = 32;
/// Parameters that one task adds up.
const REDUCTION_BLOCK: usize = 8192;

/// The samples of a training step: a whole number of chunks. Tile `group * slots + slot` holds the 32 pixels of its
/// group under one light.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// 32 pixels of each group.
    pub(crate) pixels: Vec<u32>,
    /// Lights for which each group is seen, a divisor of 32.
    pub(crate) slots: usize,
    /// One light a tile.
    pub(crate) lights: Vec<LightParams>,
    /// Targets in units of the network's output, tiles of three rows.
    pub(crate) targets: Vec<f32>,
    /// Weight of each tile in the loss, 1 for a middling light.
    pub(crate) weights: Vec<f32>,
}

/// Buffers for the gradient of a batch.
pub(crate) struct GradientBuffers<N: Network> {
    parts: Vec<GradientPart<N>>,
    encoded: Vec<f32>,
    /// Gradient by all parameters.
    pub total: AlignedVec,
}

/// Gradient by some of the chunks, and its buffers.
struct GradientPart<N: Network> {
    scratch: N::TrainScratch,
    grads: AlignedVec,
    loss: f64,
}

impl<N: Network> GradientBuffers<N> {
    /// Empty buffers; they grow with the first batch.
    pub fn new(network: &N) -> Self {
        Self { parts: Vec::new(), encoded: Vec::new(), total: AlignedVec::zeros(network.layout().len) }
    }

    fn reserve(&mut self, network: &N, parts: usize, encoded: usize) {
        let dense = dense_len(network);
        while self.parts.len() < parts {
            let grads = AlignedVec::zeros(dense);
            self.parts.push(GradientPart { scratch: network.train_scratch(), grads, loss: 0.0 });
        }
        self.encoded.resize(encoded, 0.0);
    }
}

/// Parameters before the grid, which comes last.
fn dense_len<N: Network>(network: &N) -> usize {
    let layout = network.layout();
    layout.tensors.iter().find(|t| t.role == Role::Grid).map_or(layout.len, |t| t.start)
}

/// Weighted mean loss of a batch; leaves its gradient in `buffers.total`.
pub(crate) fn batch_gradient<N: Network>(
    network: &N,
    packed: &N::Packed,
    context: NetworkContext<'_>,
    batch: &Batch,
    buffers: &mut GradientBuffers<N>,
) -> f64 {
    let chunks = batch.lights.len() / CHUNK_TILES;
    let groups = CHUNK_TILES / batch.slots;
    let encoded_len = groups * network.grid().outputs() * LANES;
    let per_part = chunks.div_ceil(PARTS);
    let part_count = chunks.div_ceil(per_part);
    buffers.reserve(network, part_count, chunks * encoded_len);
    let weight = 1.0 / (3 * batch.lights.len() * LANES) as f32;

    let parts = &mut buffers.parts[..part_count];
    let encoded = buffers.encoded.par_chunks_mut(per_part * encoded_len);
    parts.par_iter_mut().zip(encoded).enumerate().for_each(|(index, (part, encoded))| {
        part.grads.fill(0.0);
        part.loss = 0.0;
        for (offset, encoded) in encoded.chunks_exact_mut(encoded_len).enumerate() {
            let chunk = chunk_of(batch, index * per_part + offset, weight);
            let mut gradients = ChunkGradients { params: &mut part.grads, encoded };
            part.loss += network.train_chunk(context, packed, &mut part.scratch, &chunk, &mut gradients);
        }
    });

    let (dense, grid) = buffers.total.split_at_mut(dense_len(network));
    dense.par_chunks_mut(REDUCTION_BLOCK).enumerate().for_each(|(block, total)| {
        total.fill(0.0);
        for part in parts.iter() {
            for (sum, value) in total.iter_mut().zip(&part.grads[block * REDUCTION_BLOCK..]) {
                *sum += value;
            }
        }
    });
    grid.fill(0.0);
    network.grid().backward(network.layout(), &batch.pixels, &buffers.encoded, &mut buffers.total);
    parts.iter().map(|part| part.loss).sum::<f64>()
}

fn chunk_of(batch: &Batch, index: usize, weight: f32) -> SampleChunk<'_> {
    let tiles = index * CHUNK_TILES..(index + 1) * CHUNK_TILES;
    let pixels = CHUNK_TILES / batch.slots * LANES;
    SampleChunk {
        pixels: &batch.pixels[index * pixels..(index + 1) * pixels],
        slots: batch.slots,
        lights: &batch.lights[tiles.clone()],
        targets: &batch.targets[tiles.start * TILE..tiles.end * TILE],
        weights: &batch.weights[tiles],
        weight,
    }
}

#[cfg(test)]
pub(crate) mod tests;
