//! The two networks behind one trait.

mod fast;
mod reference;

pub(crate) use fast::{FastNetwork, LitFast};
pub(crate) use reference::{LitReference, ReferenceNetwork};

use crate::LightParams;
use crate::encoding::LightEncoding;
use crate::grid::HashGrid;
use crate::loss::TILE;
use crate::params::ParamLayout;
use crate::scene_cache::SceneCache;
use crate::simd::{Isa, LANES};

/// Tiles of a chunk, the unit of work of a training step.
pub(crate) const CHUNK_TILES: usize = 32;
/// Samples of a chunk.
pub(crate) const CHUNK: usize = CHUNK_TILES * LANES;

/// Context of calls that see pixels.
#[derive(Clone, Copy)]
pub(crate) struct NetworkContext<'a> {
    pub isa: Isa,
    pub scene: &'a SceneCache,
    pub params: &'a [f32],
}

/// The samples of a chunk. Tile `group * slots + slot` holds the 32 pixels of its group under one light.
pub(crate) struct SampleChunk<'a> {
    /// 32 pixels of each group.
    pub pixels: &'a [u32],
    /// Lights for which each group is seen.
    pub slots: usize,
    /// One light a tile.
    pub lights: &'a [LightParams],
    /// Targets in units of the network's output, tiles of three rows.
    pub targets: &'a [f32],
    /// Weight of each tile.
    pub weights: &'a [f32],
    /// Weight of every sample, to be multiplied with that of its tile.
    pub weight: f32,
}

/// Receiver of a chunk's gradients.
pub(crate) struct ChunkGradients<'a> {
    /// Gradient by all parameters but the grid, added to.
    pub params: &'a mut [f32],
    /// Gradient by the encoded pixels, a tile of [`HashGrid::outputs`] rows for each group.
    pub encoded: &'a mut [f32],
}

/// A network that maps a pixel and a light to three values.
pub(crate) trait Network: Sync {
    /// Weights in the order of the kernels.
    type Packed: Sync + Send;
    /// Buffers of [`Network::train_chunk`].
    type TrainScratch: Send + Sync;
    /// A light, ready for many pixels.
    type Lit: Sync;
    /// Buffers of inference and of gradients by the light.
    type LightScratch: Send;

    fn layout(&self) -> &ParamLayout;
    fn grid(&self) -> &HashGrid;
    /// Encoding of lights as inputs.
    fn light_encoding(&self) -> &LightEncoding;
    /// Multiply-adds of one sample in training (without what is shared) and in inference.
    fn multiply_adds(&self, slots: usize) -> (usize, usize);

    fn pack(&self, params: &[f32]) -> Self::Packed;
    fn train_scratch(&self) -> Self::TrainScratch;
    /// Forward and backward; returns the sum of the loss.
    fn train_chunk(
        &self,
        context: NetworkContext<'_>,
        packed: &Self::Packed,
        scratch: &mut Self::TrainScratch,
        chunk: &SampleChunk<'_>,
        gradients: &mut ChunkGradients<'_>,
    ) -> f64;

    /// Rows of [`Network::encode_pixels`].
    fn pixel_rows(&self) -> usize;
    /// Last rows of these, for which 16 bits are too few.
    fn exact_rows(&self) -> usize;
    /// Encodes 32 pixels without knowing the light, into a tile of [`Network::pixel_rows`] rows.
    fn encode_pixels(
        &self,
        context: NetworkContext<'_>,
        packed: &Self::Packed,
        pixels: &[u32],
        out: &mut [f32],
    );

    fn light_scratch(&self) -> Self::LightScratch;
    /// Computes what depends on the light alone.
    fn light(&self, isa: Isa, params: &[f32], packed: &Self::Packed, light: &LightParams) -> Self::Lit;
    /// Outputs of one encoded tile, three rows.
    fn infer(
        &self,
        isa: Isa,
        packed: &Self::Packed,
        lit: &Self::Lit,
        scratch: &mut Self::LightScratch,
        encoded: &[f32],
        y: &mut [f32; TILE],
    );

    /// Values of a light gradient in the making.
    fn light_gradient_len(&self) -> usize;
    /// Runs one tile forward into `y`, asks `d_of` for the gradient by it, and adds the gradient by the light to
    /// `gradient`.
    fn light_backward(
        &self,
        isa: Isa,
        packed: &Self::Packed,
        lit: &Self::Lit,
        scratch: &mut Self::LightScratch,
        encoded: &[f32],
        d_of: &mut dyn FnMut(&[f32], &mut [f32]),
        gradient: &mut [f32],
    );
    /// Turns the sum over all tiles into the gradient by the light's parameters.
    fn finish_light_gradient(
        &self,
        isa: Isa,
        packed: &Self::Packed,
        lit: &Self::Lit,
        gradient: &[f32],
    ) -> [f32; crate::MAX_PARAMS];
}
