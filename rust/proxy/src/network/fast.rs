use super::{CHUNK_TILES, ChunkGradients, Network, NetworkContext, SampleChunk};
use crate::analytic::FEATURES;
use crate::encoding::LightEncoding;
use crate::features::{feature_tile, features_backward};
use crate::grid::HashGrid;
use crate::head::{FoldedHead, Head, HeadScratch, Modulation, PackedHead};
use crate::loss::{TILE, relative_l2};
use crate::mlp::{Mlp, MlpScratch, PackedMlp, tile_of};
use crate::params::ParamLayout;
use crate::scene_cache::{AUX, FACTOR, SURFACE};
use crate::simd::{AlignedVec, Isa, LANES, padded, transpose};
use crate::{GridConfig, LightParams, MAX_PARAMS};

/// Most tiles of a group that run together, so that a weight's gradient is loaded and stored once for all of them.
const TILES: usize = 4;

/// Octaves of the light's position that the encoder sees beside the position. They cost nothing per pixel; without them
/// the encoder is too smooth for the edges of shadows.
const FREQUENCIES: usize = 3;

/// The factorised network: a trunk per pixel (computed once), an encoder per light (once a frame) whose outputs
/// modulate a small head per pixel and light, which also sees the analytic features. The head answers for a white surface;
/// its output is multiplied with the albedo, so that textures and colours need not be learned.
#[derive(Clone, Debug)]
pub(crate) struct FastNetwork {
    layout: ParamLayout,
    grid: HashGrid,
    trunk: Mlp,
    encoder: Mlp,
    pub head: Head,
    pub light: LightEncoding,
}

/// Packed weights of the three parts.
pub(crate) struct PackedFast {
    trunk: PackedMlp,
    encoder: PackedMlp,
    head: PackedHead,
}

/// Buffers of training.
pub(crate) struct FastScratch {
    trunk: MlpScratch,
    encoder: MlpScratch,
    head: HeadScratch,
    surfaces: AlignedVec,
    /// Modulations and their gradients, one row per light.
    modulations: AlignedVec,
    d_modulations: AlignedVec,
}

/// A light, its modulation and the head with that modulation folded in.
pub(crate) struct LitFast {
    pub light: LightParams,
    pub modulation: Modulation,
    head: FoldedHead,
}

/// Buffers for one tile at a time.
pub(crate) struct FastLightScratch {
    head: HeadScratch,
    infer: [AlignedVec; 2],
    features: AlignedVec,
}

/// Multiplies outputs, or gradients by them, with the factors of their surfaces.
fn apply_factors(surfaces: &[f32], tile: &mut [f32; TILE]) {
    for (value, factor) in tile.iter_mut().zip(&surfaces[FACTOR * LANES..]) {
        *value *= factor;
    }
}

impl FastNetwork {
    /// Trunk and encoder of two hidden layers of `width`, a head with `layers` hidden matrices.
    pub fn new(
        width: usize,
        layers: usize,
        grid: &GridConfig,
        size: [usize; 2],
        light: LightEncoding,
    ) -> Self {
        let mut layout = ParamLayout::default();
        let light = light.with_frequencies(FREQUENCIES);
        let pixel_inputs = grid.levels * grid.features_per_level + AUX;
        let trunk = Mlp::new(&mut layout, "trunk", &[pixel_inputs, width, width, width], 1.0);
        let head = Head::new(&mut layout, width, layers);
        let encoder =
            Mlp::new(&mut layout, "encoder", &[light.inputs(), width, width, head.modulation_len()], 0.3);
        let grid = HashGrid::new(&mut layout, grid, size[0], size[1]);
        Self { layout, grid, trunk, encoder, head, light }
    }

    fn trunk_input(&self, context: NetworkContext<'_>, pixels: &[u32], out: &mut [f32]) {
        self.grid.encode(&self.layout, context.params, pixels, out);
        context.scene.aux_tile(pixels, AUX, &mut out[self.grid.outputs() * LANES..]);
    }

    /// Runs the encoder on all lights of a chunk.
    fn encode_lights(
        &self,
        isa: Isa,
        packed: &PackedFast,
        scratch: &mut FastScratch,
        lights: &[LightParams],
    ) {
        let input = scratch.encoder.input_mut(&self.encoder, 0);
        for (lane, light) in lights.iter().enumerate() {
            for (row, value) in self.light.encode(light)[..self.light.inputs()].iter().enumerate() {
                input[row * LANES + lane] = *value;
            }
        }
        self.encoder.forward(isa, &packed.encoder, &mut scratch.encoder, 1);
        let stride = padded(self.head.modulation_len());
        transpose(isa, scratch.encoder.output(&self.encoder, 0), stride, &mut scratch.modulations);
    }

    /// Propagates the gradients by the modulations to the encoder's weights.
    fn encoder_backward(&self, isa: Isa, packed: &PackedFast, scratch: &mut FastScratch, grads: &mut [f32]) {
        let stride = padded(self.head.modulation_len());
        let d = scratch.encoder.output_gradient(&self.encoder, 0);
        for (lane, row) in scratch.d_modulations.chunks_exact(stride).enumerate() {
            for (index, value) in row[..self.head.modulation_len()].iter().enumerate() {
                d[index * LANES + lane] = *value;
            }
        }
        self.encoder.backward(
            isa,
            &self.layout,
            &packed.encoder,
            &mut scratch.encoder,
            1,
            Some(grads),
            false,
        );
    }
}

impl Network for FastNetwork {
    type Packed = PackedFast;
    type TrainScratch = FastScratch;
    type Lit = LitFast;
    type LightScratch = FastLightScratch;

    fn layout(&self) -> &ParamLayout {
        &self.layout
    }

    fn grid(&self) -> &HashGrid {
        &self.grid
    }

    fn light_encoding(&self) -> &LightEncoding {
        &self.light
    }

    fn multiply_adds(&self, slots: usize) -> (usize, usize) {
        let head = self.head.multiply_adds();
        let shared = self.trunk.multiply_adds() / slots + self.encoder.multiply_adds() / LANES;
        (head + shared, head)
    }

    fn pack(&self, params: &[f32]) -> PackedFast {
        PackedFast {
            trunk: self.trunk.pack(&self.layout, params),
            encoder: self.encoder.pack(&self.layout, params),
            head: self.head.pack(&self.layout, params),
        }
    }

    fn train_scratch(&self) -> FastScratch {
        let modulations = LANES * padded(self.head.modulation_len());
        FastScratch {
            trunk: self.trunk.scratch(CHUNK_TILES),
            encoder: self.encoder.scratch(1),
            head: self.head.scratch(TILES),
            surfaces: AlignedVec::zeros(SURFACE * LANES),
            modulations: AlignedVec::zeros(modulations),
            d_modulations: AlignedVec::zeros(modulations),
        }
    }

    fn train_chunk(
        &self,
        context: NetworkContext<'_>,
        packed: &PackedFast,
        scratch: &mut FastScratch,
        chunk: &SampleChunk<'_>,
        gradients: &mut ChunkGradients<'_>,
    ) -> f64 {
        let isa = context.isa;
        let groups = chunk.pixels.len() / LANES;
        let stride = padded(self.head.modulation_len());
        self.encode_lights(isa, packed, scratch, chunk.lights);
        scratch.d_modulations.fill(0.0);
        for (group, pixels) in chunk.pixels.chunks_exact(LANES).enumerate() {
            self.trunk_input(context, pixels, scratch.trunk.input_mut(&self.trunk, group));
        }
        self.trunk.forward(isa, &packed.trunk, &mut scratch.trunk, groups);

        let mut loss = 0.0;
        for (group, pixels) in chunk.pixels.chunks_exact(LANES).enumerate() {
            let FastScratch { trunk, head, surfaces, modulations, d_modulations, .. } = scratch;
            context.scene.surface_tile(pixels, surfaces);
            let (t, d_trunk) = trunk.output_and_gradient(&self.trunk, group);
            d_trunk.fill(0.0);
            for first in (0..chunk.slots).step_by(TILES) {
                let count = TILES.min(chunk.slots - first);
                let tiles = group * chunk.slots + first..group * chunk.slots + first + count;
                let rows = tiles.start * stride..tiles.end * stride;
                for (slot, light) in chunk.lights[tiles.clone()].iter().enumerate() {
                    feature_tile(isa, &self.light, light, surfaces, head.features_mut(slot));
                }
                self.head.forward(isa, &packed.head, head, t, &modulations[rows.clone()], count);
                for (slot, tile) in tiles.enumerate() {
                    let (mut y, mut d) = ([0.0; TILE], [0.0; TILE]);
                    y.copy_from_slice(head.output(slot));
                    apply_factors(surfaces, &mut y);
                    let weight = chunk.weight * chunk.weights[tile];
                    loss += relative_l2(&y, tile_of(chunk.targets, 3, tile), weight, &mut d);
                    apply_factors(surfaces, &mut d);
                    head.output_gradient(slot).copy_from_slice(&d);
                }
                self.head.backward(
                    isa,
                    Some((&self.layout, &mut *gradients.params)),
                    &packed.head,
                    head,
                    t,
                    &modulations[rows.clone()],
                    &mut d_modulations[rows],
                    count,
                    Some(&mut *d_trunk),
                );
            }
        }
        self.trunk.backward(
            isa,
            &self.layout,
            &packed.trunk,
            &mut scratch.trunk,
            groups,
            Some(&mut *gradients.params),
            true,
        );
        let rows = self.grid.outputs() * LANES;
        for (group, out) in gradients.encoded.chunks_exact_mut(rows).enumerate() {
            out.copy_from_slice(&scratch.trunk.input_gradient(&self.trunk, group)[..rows]);
        }
        self.encoder_backward(isa, packed, scratch, gradients.params);
        loss
    }

    fn pixel_rows(&self) -> usize {
        self.trunk.outputs() + SURFACE
    }

    fn exact_rows(&self) -> usize {
        SURFACE
    }

    fn encode_pixels(
        &self,
        context: NetworkContext<'_>,
        packed: &PackedFast,
        pixels: &[u32],
        out: &mut [f32],
    ) {
        let mut scratch = self.trunk.scratch(1);
        self.trunk_input(context, pixels, scratch.input_mut(&self.trunk, 0));
        self.trunk.forward(context.isa, &packed.trunk, &mut scratch, 1);
        let (trunk, surfaces) = out.split_at_mut(self.trunk.outputs() * LANES);
        trunk.copy_from_slice(scratch.output(&self.trunk, 0));
        context.scene.surface_tile(pixels, surfaces);
    }

    fn light_scratch(&self) -> FastLightScratch {
        let tile = || AlignedVec::zeros(self.trunk.outputs() * LANES);
        FastLightScratch {
            head: self.head.scratch(1),
            infer: [tile(), tile()],
            features: AlignedVec::zeros(FEATURES * LANES),
        }
    }

    fn light(&self, isa: Isa, params: &[f32], packed: &PackedFast, light: &LightParams) -> LitFast {
        let mut scratch = self.encoder.scratch(1);
        let input = scratch.input_mut(&self.encoder, 0);
        for (row, value) in input.chunks_exact_mut(LANES).zip(self.light.encode(light)) {
            row.fill(value);
        }
        self.encoder.forward(isa, &packed.encoder, &mut scratch, 1);
        let output = scratch.output(&self.encoder, 0).chunks_exact(LANES).map(|row| row[0]);
        let modulation: Modulation = output.collect();
        let head = self.head.fold(&self.layout, params, &modulation);
        LitFast { light: *light, modulation, head }
    }

    fn infer(
        &self,
        isa: Isa,
        _packed: &PackedFast,
        lit: &LitFast,
        scratch: &mut FastLightScratch,
        encoded: &[f32],
        y: &mut [f32; TILE],
    ) {
        let (trunk, surfaces) = encoded.split_at(self.trunk.outputs() * LANES);
        feature_tile(isa, &self.light, &lit.light, surfaces, &mut scratch.features);
        lit.head.infer(isa, trunk, &scratch.features, &mut scratch.infer, y);
        apply_factors(surfaces, y);
    }

    /// The modulation's gradient, then the gradient by the parameters through the analytic features.
    fn light_gradient_len(&self) -> usize {
        self.head.modulation_len() + MAX_PARAMS
    }

    fn light_backward(
        &self,
        isa: Isa,
        packed: &PackedFast,
        lit: &LitFast,
        scratch: &mut FastLightScratch,
        encoded: &[f32],
        d_of: &mut dyn FnMut(&[f32], &mut [f32]),
        gradient: &mut [f32],
    ) {
        let (trunk, surfaces) = encoded.split_at(self.trunk.outputs() * LANES);
        let (d_modulation, d_light) = gradient.split_at_mut(self.head.modulation_len());
        let head = &mut scratch.head;
        feature_tile(isa, &self.light, &lit.light, surfaces, head.features_mut(0));
        self.head.forward(isa, &packed.head, head, trunk, &lit.modulation, 1);
        let (mut y, mut d) = ([0.0; TILE], [0.0; TILE]);
        y.copy_from_slice(head.output(0));
        apply_factors(surfaces, &mut y);
        d_of(&y, &mut d);
        apply_factors(surfaces, &mut d);
        head.output_gradient(0).copy_from_slice(&d);
        self.head.backward(isa, None, &packed.head, head, trunk, &lit.modulation, d_modulation, 1, None);
        features_backward(&self.light, &lit.light, surfaces, head.feature_gradient(), d_light);
    }

    fn finish_light_gradient(
        &self,
        isa: Isa,
        packed: &PackedFast,
        lit: &LitFast,
        gradient: &[f32],
    ) -> [f32; MAX_PARAMS] {
        let (d_modulation, through_features) = gradient.split_at(self.head.modulation_len());
        let mut scratch = self.encoder.scratch(1);
        let input = scratch.input_mut(&self.encoder, 0);
        for (row, value) in input.chunks_exact_mut(LANES).zip(self.light.encode(&lit.light)) {
            row[0] = value;
        }
        self.encoder.forward(isa, &packed.encoder, &mut scratch, 1);
        let d = scratch.output_gradient(&self.encoder, 0);
        for (row, value) in d.chunks_exact_mut(LANES).zip(d_modulation) {
            row.fill(0.0);
            row[0] = *value;
        }
        self.encoder.backward(isa, &self.layout, &packed.encoder, &mut scratch, 1, None, true);
        let d_inputs: Vec<f32> =
            scratch.input_gradient(&self.encoder, 0).chunks_exact(LANES).map(|row| row[0]).collect();
        let through_encoder = self.light.backward(&lit.light, &d_inputs);
        std::array::from_fn(|i| through_encoder[i] + through_features[i])
    }
}
