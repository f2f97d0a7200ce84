use crate::analytic::FEATURES;
use crate::loss::TILE;
use crate::mlp::{add_weight_gradient, tile_of, tile_of_mut};
use crate::params::{ParamLayout, Role, TensorId, he_deviation};
use crate::simd::{
    AlignedVec, Finish, Isa, LANES, PackedMatrix, Start, dense, modulate, modulate_backward, padded, row_sums,
};

/// Outputs of the light encoder for one light: for each modulated layer its scale minus one, then its shift.
pub(crate) type Modulation = Vec<f32>;

/// The part that runs per pixel and light, modulated by the light (FiLM; Perez et al. 2018, "FiLM: Visual Reasoning
/// with a General Conditioning Layer"):
///
/// ```text
/// h_0 = relu(scale_0 * trunk + shift_0 + A features)
/// h_k = relu(scale_k * (W_k h_(k-1)) + shift_k)          k = 1..layers
/// y   = W h_layers + b
/// ```
#[derive(Clone, Debug)]
pub(crate) struct Head {
    pub width: usize,
    pub features: TensorId,
    pub hidden: Vec<TensorId>,
    pub output: TensorId,
    pub output_bias: TensorId,
}

#[derive(Debug)]
struct PackedPair {
    forward: PackedMatrix,
    backward: PackedMatrix,
}

/// Weights of a [`Head`] in the order of the kernels.
#[derive(Debug)]
pub(crate) struct PackedHead {
    features: PackedPair,
    hidden: Vec<PackedPair>,
    output: PackedPair,
    output_bias: Vec<f32>,
}

/// Activations and gradients of some tiles.
pub(crate) struct HeadScratch {
    features: AlignedVec,
    /// `h_0` to `h_layers`.
    activations: Vec<AlignedVec>,
    /// `W_k h_(k-1)`, before modulation.
    products: Vec<AlignedVec>,
    output: AlignedVec,
    d_output: AlignedVec,
    gradients: [AlignedVec; 2],
    d_features: AlignedVec,
    transposed: AlignedVec,
    scales: Vec<f32>,
}

impl Head {
    /// Adds the tensors of a head with `layers` hidden matrices.
    pub fn new(layout: &mut ParamLayout, width: usize, layers: usize) -> Self {
        let edge = Role::Edge;
        let features = layout.matrix("head.features.weight", width, FEATURES, edge, he_deviation(FEATURES));
        let deviation = he_deviation(width);
        let hidden = (0..layers)
            .map(|k| layout.matrix(&format!("head.{k}.weight"), width, width, Role::Hidden, deviation))
            .collect();
        let output = layout.matrix("head.output.weight", 3, width, edge, 0.5 * deviation);
        let output_bias = layout.bias("head.output.bias", 3);
        Self { width, features, hidden, output, output_bias }
    }

    /// Values of a [`Modulation`].
    pub fn modulation_len(&self) -> usize {
        2 * self.width * (self.hidden.len() + 1)
    }

    /// Multiply-adds of one sample.
    pub fn multiply_adds(&self) -> usize {
        self.width * (FEATURES + 1 + self.hidden.len() * (self.width + 1) + 3)
    }

    /// Packs the weights anew.
    pub fn pack(&self, layout: &ParamLayout, params: &[f32]) -> PackedHead {
        let pair = |id: TensorId| {
            let tensor = &layout.tensors[id];
            let values = layout.slice(params, id);
            let mut forward = PackedMatrix::new(tensor.rows, tensor.cols);
            forward.pack(values, tensor.stride);
            let mut backward = PackedMatrix::new(tensor.cols, tensor.rows);
            backward.pack_transposed(values, tensor.stride);
            PackedPair { forward, backward }
        };
        PackedHead {
            features: pair(self.features),
            hidden: self.hidden.iter().map(|&id| pair(id)).collect(),
            output: pair(self.output),
            output_bias: layout.row(params, self.output_bias).to_vec(),
        }
    }

    /// Room for up to `tiles` tiles.
    pub fn scratch(&self, tiles: usize) -> HeadScratch {
        let wide = || AlignedVec::zeros(tiles * self.width * LANES);
        let widest = padded(self.width.max(FEATURES));
        HeadScratch {
            features: AlignedVec::zeros(tiles * FEATURES * LANES),
            activations: (0..=self.hidden.len()).map(|_| wide()).collect(),
            products: (0..self.hidden.len()).map(|_| wide()).collect(),
            output: AlignedVec::zeros(tiles * TILE),
            d_output: AlignedVec::zeros(tiles * TILE),
            gradients: [wide(), wide()],
            d_features: AlignedVec::zeros(FEATURES * LANES),
            transposed: AlignedVec::zeros(tiles * LANES * widest),
            scales: vec![0.0; self.width],
        }
    }

    /// Runs `tiles` tiles of one group of pixels, whose trunk is `trunk`, each under its row of `modulations`.
    pub fn forward(
        &self,
        isa: Isa,
        packed: &PackedHead,
        scratch: &mut HeadScratch,
        trunk: &[f32],
        modulations: &[f32],
        tiles: usize,
    ) {
        let width = self.width;
        let stride = modulations.len() / tiles;
        for tile in 0..tiles {
            let modulation = &modulations[tile * stride..];
            let h = tile_of_mut(&mut scratch.activations[0], width, tile);
            let shift = scratch.scales.load(modulation, width, 0);
            modulate(isa, trunk, &scratch.scales, shift, false, h);
            let features = tile_of(&scratch.features, FEATURES, tile);
            dense(isa, &packed.features.forward, Start::Output, features, h, Finish::Relu);
            for (k, weights) in packed.hidden.iter().enumerate() {
                let (before, after) = scratch.activations.split_at_mut(k + 1);
                let z = tile_of_mut(&mut scratch.products[k], width, tile);
                dense(
                    isa,
                    &weights.forward,
                    Start::Zero,
                    tile_of(&before[k], width, tile),
                    z,
                    Finish::Linear,
                );
                let shift = scratch.scales.load(modulation, width, k + 1);
                modulate(isa, z, &scratch.scales, shift, true, tile_of_mut(&mut after[0], width, tile));
            }
            let h = tile_of(&scratch.activations[self.hidden.len()], width, tile);
            let y = tile_of_mut(&mut scratch.output, 3, tile);
            dense(isa, &packed.output.forward, Start::Bias(&packed.output_bias), h, y, Finish::Linear);
        }
    }

    /// Adds, from [`HeadScratch::output_gradient`], the gradients by the weights (if `grads` is given), by the
    /// modulations, and by the trunk (if `d_trunk` is given). With one tile and no `grads`, leaves the gradient by the
    /// features in [`HeadScratch::feature_gradient`].
    pub fn backward(
        &self,
        isa: Isa,
        mut grads: Option<(&ParamLayout, &mut [f32])>,
        packed: &PackedHead,
        scratch: &mut HeadScratch,
        trunk: &[f32],
        modulations: &[f32],
        d_modulations: &mut [f32],
        tiles: usize,
        mut d_trunk: Option<&mut [f32]>,
    ) {
        let width = self.width;
        let (size, stride) = (width * LANES, modulations.len() / tiles);
        let HeadScratch { activations, products, gradients, transposed, scales, .. } = scratch;
        let d_output = &scratch.d_output[..tiles * TILE];
        let last = &activations[self.hidden.len()][..tiles * size];
        if let Some((layout, grads)) = &mut grads {
            let range = layout.tensors[self.output].range();
            add_weight_gradient(isa, d_output, last, 3, width, transposed, &mut grads[range]);
            let bias = layout.tensors[self.output_bias].start;
            for tile in d_output.chunks_exact(TILE) {
                row_sums(isa, tile, &mut grads[bias..bias + 3]);
            }
        }
        for tile in 0..tiles {
            let (d, mask) = (tile_of_mut(&mut gradients[0], width, tile), tile_of(last, width, tile));
            let d_output = tile_of(d_output, 3, tile);
            dense(isa, &packed.output.backward, Start::Zero, d_output, d, Finish::Mask(mask));
        }
        for k in (0..self.hidden.len()).rev() {
            let h = &activations[k][..tiles * size];
            let [d, d_next] = &mut *gradients;
            for tile in 0..tiles {
                scales.load(&modulations[tile * stride..], width, k + 1);
                let (d_scale, d_shift) = layer_of(&mut d_modulations[tile * stride..], width, k + 1);
                let z = tile_of(&products[k], width, tile);
                modulate_backward(isa, z, scales, tile_of_mut(d, width, tile), d_scale, d_shift);
            }
            if let Some((layout, grads)) = &mut grads {
                let range = layout.tensors[self.hidden[k]].range();
                let d = &d[..tiles * size];
                add_weight_gradient(isa, d, h, width, width, transposed, &mut grads[range]);
            }
            for tile in 0..tiles {
                let (d, d_next) = (tile_of(d, width, tile), tile_of_mut(d_next, width, tile));
                let mask = Finish::Mask(tile_of(h, width, tile));
                dense(isa, &packed.hidden[k].backward, Start::Zero, d, d_next, mask);
            }
            gradients.swap(0, 1);
        }
        match &mut grads {
            Some((layout, grads)) => {
                let range = layout.tensors[self.features].range();
                let features = &scratch.features[..tiles * FEATURES * LANES];
                let d = &gradients[0][..tiles * size];
                add_weight_gradient(isa, d, features, width, FEATURES, transposed, &mut grads[range]);
            }
            None => {
                let d = tile_of(&gradients[0], width, 0);
                let d_features = &mut scratch.d_features;
                dense(isa, &packed.features.backward, Start::Zero, d, d_features, Finish::Linear);
            }
        }
        let d = &mut gradients[0][..tiles * size];
        for (tile, d) in d.chunks_exact_mut(size).enumerate() {
            scales.load(&modulations[tile * stride..], width, 0);
            let (d_scale, d_shift) = layer_of(&mut d_modulations[tile * stride..], width, 0);
            modulate_backward(isa, trunk, scales, d, d_scale, d_shift);
            if let Some(d_trunk) = d_trunk.as_deref_mut() {
                d_trunk.iter_mut().zip(d).for_each(|(sum, d)| *sum += *d);
            }
        }
    }

    /// The head for one light: scales multiplied into the weights, so that a pixel costs a plain network.
    pub fn fold(&self, layout: &ParamLayout, params: &[f32], modulation: &Modulation) -> FoldedHead {
        let width = self.width;
        let scale = |layer: usize, row: usize| 1.0 + modulation[2 * width * layer + row];
        let shift = |layer: usize| modulation[2 * width * layer + width..2 * width * (layer + 1)].to_vec();
        let pack = |id: TensorId, scale: &dyn Fn(usize) -> f32| {
            let tensor = &layout.tensors[id];
            let mut packed = PackedMatrix::new(tensor.rows, tensor.cols);
            packed.pack_scaled(layout.slice(params, id), tensor.stride, scale);
            packed
        };
        FoldedHead {
            trunk_scale: (0..width).map(|row| scale(0, row)).collect(),
            trunk_shift: shift(0),
            features: pack(self.features, &|_| 1.0),
            hidden: self
                .hidden
                .iter()
                .enumerate()
                .map(|(k, &id)| (pack(id, &|row| scale(k + 1, row)), shift(k + 1)))
                .collect(),
            output: pack(self.output, &|_| 1.0),
            output_bias: layout.row(params, self.output_bias).to_vec(),
        }
    }
}

/// Reads one layer of a modulation.
trait LoadScales {
    /// Writes one plus the scales of `layer` into this buffer and returns its shifts.
    fn load<'a>(&mut self, modulation: &'a [f32], width: usize, layer: usize) -> &'a [f32];
}

impl LoadScales for Vec<f32> {
    fn load<'a>(&mut self, modulation: &'a [f32], width: usize, layer: usize) -> &'a [f32] {
        let (scale, shift) = modulation[2 * width * layer..2 * width * (layer + 1)].split_at(width);
        for (to, from) in self.iter_mut().zip(scale) {
            *to = 1.0 + from;
        }
        shift
    }
}

/// Scales and shifts of one layer.
fn layer_of(modulation: &mut [f32], width: usize, layer: usize) -> (&mut [f32], &mut [f32]) {
    modulation[2 * width * layer..2 * width * (layer + 1)].split_at_mut(width)
}

impl HeadScratch {
    /// The features of a tile, to be filled before [`Head::forward`].
    pub fn features_mut(&mut self, tile: usize) -> &mut [f32] {
        tile_of_mut(&mut self.features, FEATURES, tile)
    }

    /// The output of a tile.
    pub fn output(&self, tile: usize) -> &[f32] {
        tile_of(&self.output, 3, tile)
    }

    /// The gradient by the output of a tile, to be filled before [`Head::backward`].
    pub fn output_gradient(&mut self, tile: usize) -> &mut [f32] {
        tile_of_mut(&mut self.d_output, 3, tile)
    }

    /// The gradient by the features of the only tile.
    pub fn feature_gradient(&self) -> &[f32] {
        &self.d_features
    }
}

/// A head for one light.
#[derive(Debug)]
pub(crate) struct FoldedHead {
    trunk_scale: Vec<f32>,
    trunk_shift: Vec<f32>,
    features: PackedMatrix,
    hidden: Vec<(PackedMatrix, Vec<f32>)>,
    output: PackedMatrix,
    output_bias: Vec<f32>,
}

impl FoldedHead {
    /// Runs one tile into `y`.
    pub fn infer(
        &self,
        isa: Isa,
        trunk: &[f32],
        features: &[f32],
        buffers: &mut [AlignedVec; 2],
        y: &mut [f32],
    ) {
        let [from, to] = buffers;
        let (mut from, mut to) = (from, to);
        modulate(isa, trunk, &self.trunk_scale, &self.trunk_shift, false, from);
        dense(isa, &self.features, Start::Output, features, from, Finish::Relu);
        for (weights, shift) in &self.hidden {
            dense(isa, weights, Start::Bias(shift), from, to, Finish::Relu);
            std::mem::swap(&mut from, &mut to);
        }
        dense(isa, &self.output, Start::Bias(&self.output_bias), from, y, Finish::Linear);
    }
}
