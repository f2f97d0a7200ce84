use super::{CHUNK_TILES, ChunkGradients, Network, NetworkContext, SampleChunk};
use crate::encoding::{LightEncoding, MAX_LIGHT_INPUTS};
use crate::grid::HashGrid;
use crate::loss::{TILE, relative_l2};
use crate::mlp::{InferScratch, Mlp, MlpScratch, PackedMlp, tile_of, tile_of_mut};
use crate::params::ParamLayout;
use crate::scene_cache::AUX_PAPER;
use crate::simd::{AlignedVec, Isa, LANES};
use crate::{GridConfig, LightParams, MAX_PARAMS};

/// Tiles that run together, so that a weight's gradient is loaded and stored once for all of them.
const TILES: usize = 4;

/// The paper's network (section 4.3): grid, albedo, normal, depth and light into one plain ReLU network.
#[derive(Clone, Debug)]
pub(crate) struct ReferenceNetwork {
    layout: ParamLayout,
    grid: HashGrid,
    pub mlp: Mlp,
    pub light: LightEncoding,
}

/// Buffers of training.
pub(crate) struct ReferenceScratch {
    mlp: MlpScratch,
    /// Encoded pixels of one group.
    pixels: AlignedVec,
}

/// A light and its inputs.
pub(crate) struct LitReference {
    light: LightParams,
    pub inputs: [f32; MAX_LIGHT_INPUTS],
}

/// Buffers for one tile at a time.
pub(crate) struct ReferenceLightScratch {
    infer: InferScratch,
    train: MlpScratch,
}

impl ReferenceNetwork {
    /// A network of `layers` hidden layers of `width` for an image of `size` pixels.
    pub fn new(
        width: usize,
        layers: usize,
        grid: &GridConfig,
        size: [usize; 2],
        light: LightEncoding,
    ) -> Self {
        let mut layout = ParamLayout::default();
        let inputs = grid.levels * grid.features_per_level + AUX_PAPER + light.inputs();
        let mut sizes = vec![inputs];
        sizes.extend(std::iter::repeat_n(width, layers));
        sizes.push(3);
        let mlp = Mlp::new(&mut layout, "mlp", &sizes, 0.5);
        let grid = HashGrid::new(&mut layout, grid, size[0], size[1]);
        Self { layout, grid, mlp, light }
    }

    fn fill_light(&self, tile: &mut [f32], inputs: &[f32; MAX_LIGHT_INPUTS]) {
        let rows = tile[self.pixel_rows() * LANES..].chunks_exact_mut(LANES);
        for (row, input) in rows.zip(inputs) {
            row.fill(*input);
        }
    }
}

impl Network for ReferenceNetwork {
    type Packed = PackedMlp;
    type TrainScratch = ReferenceScratch;
    type Lit = LitReference;
    type LightScratch = ReferenceLightScratch;

    fn layout(&self) -> &ParamLayout {
        &self.layout
    }

    fn grid(&self) -> &HashGrid {
        &self.grid
    }

    fn light_encoding(&self) -> &LightEncoding {
        &self.light
    }

    fn multiply_adds(&self, _slots: usize) -> (usize, usize) {
        (self.mlp.multiply_adds(), self.mlp.multiply_adds())
    }

    fn pack(&self, params: &[f32]) -> PackedMlp {
        self.mlp.pack(&self.layout, params)
    }

    fn train_scratch(&self) -> ReferenceScratch {
        ReferenceScratch {
            mlp: self.mlp.scratch(TILES),
            pixels: AlignedVec::zeros(self.pixel_rows() * LANES),
        }
    }

    fn train_chunk(
        &self,
        context: NetworkContext<'_>,
        packed: &PackedMlp,
        scratch: &mut ReferenceScratch,
        chunk: &SampleChunk<'_>,
        gradients: &mut ChunkGradients<'_>,
    ) -> f64 {
        let (isa, encoded_rows) = (context.isa, self.grid.outputs());
        let ReferenceScratch { mlp: scratch, pixels: encoded } = scratch;
        gradients.encoded.fill(0.0);
        let mut loss = 0.0;
        for first in (0..CHUNK_TILES).step_by(TILES) {
            for tile in 0..TILES {
                let (group, slot) = ((first + tile) / chunk.slots, (first + tile) % chunk.slots);
                if slot == 0 {
                    let pixels = &chunk.pixels[group * LANES..(group + 1) * LANES];
                    self.encode_pixels(context, packed, pixels, encoded);
                }
                let input = scratch.input_mut(&self.mlp, tile);
                input[..encoded.len()].copy_from_slice(encoded);
                self.fill_light(input, &self.light.encode(&chunk.lights[first + tile]));
            }
            self.mlp.forward(isa, packed, scratch, TILES);
            for tile in 0..TILES {
                let target = tile_of(chunk.targets, 3, first + tile);
                let mut gradient = [0.0; TILE];
                let weight = chunk.weight * chunk.weights[first + tile];
                loss += relative_l2(scratch.output(&self.mlp, tile), target, weight, &mut gradient);
                scratch.output_gradient(&self.mlp, tile).copy_from_slice(&gradient);
            }
            let grads = Some(&mut *gradients.params);
            self.mlp.backward(isa, &self.layout, packed, scratch, TILES, grads, true);
            for tile in 0..TILES {
                let group = (first + tile) / chunk.slots;
                let sums = tile_of_mut(gradients.encoded, encoded_rows, group);
                for (sum, d) in sums.iter_mut().zip(scratch.input_gradient(&self.mlp, tile)) {
                    *sum += d;
                }
            }
        }
        loss
    }

    fn pixel_rows(&self) -> usize {
        self.grid.outputs() + AUX_PAPER
    }

    fn exact_rows(&self) -> usize {
        0
    }

    fn encode_pixels(
        &self,
        context: NetworkContext<'_>,
        _packed: &PackedMlp,
        pixels: &[u32],
        out: &mut [f32],
    ) {
        self.grid.encode(&self.layout, context.params, pixels, out);
        context.scene.aux_tile(pixels, AUX_PAPER, &mut out[self.grid.outputs() * LANES..]);
    }

    fn light_scratch(&self) -> ReferenceLightScratch {
        ReferenceLightScratch { infer: InferScratch::new(&self.mlp), train: self.mlp.scratch(1) }
    }

    fn light(&self, _isa: Isa, _params: &[f32], _packed: &PackedMlp, light: &LightParams) -> LitReference {
        LitReference { light: *light, inputs: self.light.encode(light) }
    }

    fn infer(
        &self,
        isa: Isa,
        packed: &PackedMlp,
        lit: &LitReference,
        scratch: &mut ReferenceLightScratch,
        encoded: &[f32],
        y: &mut [f32; TILE],
    ) {
        let input = &mut scratch.infer.ping[..self.mlp.inputs() * LANES];
        input[..encoded.len()].copy_from_slice(encoded);
        self.fill_light(input, &lit.inputs);
        packed.infer(isa, &mut scratch.infer, y);
    }

    fn light_gradient_len(&self) -> usize {
        self.light.inputs()
    }

    fn light_backward(
        &self,
        isa: Isa,
        packed: &PackedMlp,
        lit: &LitReference,
        scratch: &mut ReferenceLightScratch,
        encoded: &[f32],
        d_of: &mut dyn FnMut(&[f32], &mut [f32]),
        gradient: &mut [f32],
    ) {
        let train = &mut scratch.train;
        let input = train.input_mut(&self.mlp, 0);
        input[..encoded.len()].copy_from_slice(encoded);
        self.fill_light(input, &lit.inputs);
        self.mlp.forward(isa, packed, train, 1);
        let mut d = [0.0; TILE];
        d_of(train.output(&self.mlp, 0), &mut d);
        train.output_gradient(&self.mlp, 0).copy_from_slice(&d);
        self.mlp.backward(isa, &self.layout, packed, train, 1, None, true);
        let rows = train.input_gradient(&self.mlp, 0)[self.pixel_rows() * LANES..].chunks_exact(LANES);
        for (sum, row) in gradient.iter_mut().zip(rows) {
            *sum += row.iter().sum::<f32>();
        }
    }

    fn finish_light_gradient(
        &self,
        _isa: Isa,
        _packed: &PackedMlp,
        lit: &LitReference,
        gradient: &[f32],
    ) -> [f32; MAX_PARAMS] {
        self.light.backward(&lit.light, gradient)
    }
}
