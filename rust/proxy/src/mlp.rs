use crate::params::{ParamLayout, Role, TensorId, he_deviation};
use crate::simd::{
    AlignedVec, Finish, Isa, LANES, PackedMatrix, Start, dense, outer, padded, row_sums, transpose,
};

/// A plain network: dense layers with ReLU between them, linear at the end.
#[derive(Clone, Debug)]
pub(crate) struct Mlp {
    /// Values before, between and after the layers.
    pub sizes: Vec<usize>,
    pub weights: Vec<TensorId>,
    pub biases: Vec<TensorId>,
}

/// Weights of an [`Mlp`] in the order of the kernels, forwards and transposed.
#[derive(Clone, Debug)]
pub(crate) struct PackedMlp {
    layers: Vec<PackedLayer>,
}

#[derive(Clone, Debug)]
struct PackedLayer {
    forward: PackedMatrix,
    backward: PackedMatrix,
    bias: Vec<f32>,
}

/// Activations and gradients of some tiles: `[tile][feature][LANES]` for each layer.
pub(crate) struct MlpScratch {
    activations: Vec<AlignedVec>,
    gradients: [AlignedVec; 2],
    transposed: AlignedVec,
}

impl Mlp {
    /// Adds the tensors of a network of these sizes. `last_scale` shrinks the start values of the last layer.
    pub fn new(layout: &mut ParamLayout, name: &str, sizes: &[usize], last_scale: f32) -> Self {
        let count = sizes.len() - 1;
        let mut mlp = Self { sizes: sizes.to_vec(), weights: Vec::new(), biases: Vec::new() };
        for layer in 0..count {
            let (inputs, outputs) = (sizes[layer], sizes[layer + 1]);
            let edge = layer == 0 || layer + 1 == count;
            let scale = if layer + 1 == count { last_scale } else { 1.0 };
            let role = if edge { Role::Edge } else { Role::Hidden };
            let deviation = scale * he_deviation(inputs);
            mlp.weights.push(layout.matrix(
                &format!("{name}.{layer}.weight"),
                outputs,
                inputs,
                role,
                deviation,
            ));
            mlp.biases.push(layout.bias(&format!("{name}.{layer}.bias"), outputs));
        }
        mlp
    }

    /// Values of an input.
    pub fn inputs(&self) -> usize {
        self.sizes[0]
    }

    /// Values of an output.
    pub fn outputs(&self) -> usize {
        self.sizes[self.sizes.len() - 1]
    }

    /// Multiply-adds of one sample.
    pub fn multiply_adds(&self) -> usize {
        self.sizes.windows(2).map(|pair| pair[0] * pair[1]).sum()
    }

    /// Values of the widest layer.
    fn widest(&self) -> usize {
        self.sizes.iter().copied().max().unwrap_or(0)
    }

    /// Packs the weights anew.
    pub fn pack(&self, layout: &ParamLayout, params: &[f32]) -> PackedMlp {
        let layers = self.weights.iter().zip(&self.biases).map(|(&weight, &bias)| {
            let tensor = &layout.tensors[weight];
            let values = layout.slice(params, weight);
            let mut forward = PackedMatrix::new(tensor.rows, tensor.cols);
            forward.pack(values, tensor.stride);
            let mut backward = PackedMatrix::new(tensor.cols, tensor.rows);
            backward.pack_transposed(values, tensor.stride);
            PackedLayer { forward, backward, bias: layout.row(params, bias).to_vec() }
        });
        PackedMlp { layers: layers.collect() }
    }

    /// Room for up to `tiles` tiles.
    pub fn scratch(&self, tiles: usize) -> MlpScratch {
        let size = tiles * LANES * self.widest();
        MlpScratch {
            activations: self.sizes.iter().map(|size| AlignedVec::zeros(tiles * size * LANES)).collect(),
            gradients: [AlignedVec::zeros(size), AlignedVec::zeros(size)],
            transposed: AlignedVec::zeros(tiles * LANES * padded(self.widest())),
        }
    }

    /// Runs tiles through, keeping all activations for [`Mlp::backward`].
    pub fn forward(&self, isa: Isa, packed: &PackedMlp, scratch: &mut MlpScratch, tiles: usize) {
        let last = packed.layers.len() - 1;
        for tile in 0..tiles {
            for (index, layer) in packed.layers.iter().enumerate() {
                let (before, after) = scratch.activations.split_at_mut(index + 1);
                let x = tile_of(&before[index], self.sizes[index], tile);
                let y = tile_of_mut(&mut after[0], self.sizes[index + 1], tile);
                let finish = if index == last { Finish::Linear } else { Finish::Relu };
                dense(isa, &layer.forward, Start::Bias(&layer.bias), x, y, finish);
            }
        }
    }

    /// Adds, from the gradient by the output in [`MlpScratch::output_gradient`], the gradient by all parameters to
    /// `grads` (if given) and leaves the gradient by the input in [`MlpScratch::input_gradient`] (if asked).
    pub fn backward(
        &self,
        isa: Isa,
        layout: &ParamLayout,
        packed: &PackedMlp,
        scratch: &mut MlpScratch,
        tiles: usize,
        mut grads: Option<&mut [f32]>,
        want_input: bool,
    ) {
        let MlpScratch { activations, gradients, transposed } = scratch;
        for (index, layer) in packed.layers.iter().enumerate().rev() {
            let (inputs, outputs) = (self.sizes[index], self.sizes[index + 1]);
            let x = &activations[index][..tiles * inputs * LANES];
            let [d, d_input] = gradients;
            let d = &d[..tiles * outputs * LANES];
            if let Some(grads) = grads.as_deref_mut() {
                let weight = &mut grads[layout.tensors[self.weights[index]].range()];
                add_weight_gradient(isa, d, x, outputs, inputs, transposed, weight);
                let bias = layout.tensors[self.biases[index]].start;
                for tile in d.chunks_exact(outputs * LANES) {
                    row_sums(isa, tile, &mut grads[bias..bias + outputs]);
                }
            }
            if index > 0 || want_input {
                for tile in 0..tiles {
                    let finish =
                        if index > 0 { Finish::Mask(tile_of(x, inputs, tile)) } else { Finish::Linear };
                    let d = tile_of(d, outputs, tile);
                    dense(isa, &layer.backward, Start::Zero, d, tile_of_mut(d_input, inputs, tile), finish);
                }
                gradients.swap(0, 1);
            }
        }
    }
}

/// `grad[o][i] += sum over samples d[o] x[i]` for tiles `d` and `x`.
pub(crate) fn add_weight_gradient(
    isa: Isa,
    d: &[f32],
    x: &[f32],
    outputs: usize,
    inputs: usize,
    transposed: &mut [f32],
    grad: &mut [f32],
) {
    let stride = padded(inputs);
    let tiles = x.len() / (inputs * LANES);
    let transposed = &mut transposed[..tiles * LANES * stride];
    for (x, out) in x.chunks_exact(inputs * LANES).zip(transposed.chunks_exact_mut(LANES * stride)) {
        transpose(isa, x, stride, out);
    }
    outer(isa, d, transposed, outputs, stride, grad);
}

impl MlpScratch {
    /// The input of a tile, to be filled before [`Mlp::forward`].
    pub fn input_mut(&mut self, mlp: &Mlp, tile: usize) -> &mut [f32] {
        tile_of_mut(&mut self.activations[0], mlp.inputs(), tile)
    }

    /// The output of a tile.
    pub fn output(&self, mlp: &Mlp, tile: usize) -> &[f32] {
        tile_of(&self.activations[self.activations.len() - 1], mlp.outputs(), tile)
    }

    /// The gradient by the output of a tile, to be filled before [`Mlp::backward`].
    pub fn output_gradient(&mut self, mlp: &Mlp, tile: usize) -> &mut [f32] {
        tile_of_mut(&mut self.gradients[0], mlp.outputs(), tile)
    }

    /// The output of a tile and the gradient by it.
    pub fn output_and_gradient(&mut self, mlp: &Mlp, tile: usize) -> (&[f32], &mut [f32]) {
        let output = tile_of(&self.activations[self.activations.len() - 1], mlp.outputs(), tile);
        (output, tile_of_mut(&mut self.gradients[0], mlp.outputs(), tile))
    }

    /// The gradient by the input of a tile, after [`Mlp::backward`].
    pub fn input_gradient(&self, mlp: &Mlp, tile: usize) -> &[f32] {
        tile_of(&self.gradients[0], mlp.inputs(), tile)
    }
}

/// Buffers for [`PackedMlp::infer`], small enough for the innermost cache.
pub(crate) struct InferScratch {
    pub ping: AlignedVec,
    pub pong: AlignedVec,
}

impl InferScratch {
    /// Room for one tile of `mlp`.
    pub fn new(mlp: &Mlp) -> Self {
        let size = mlp.widest() * LANES;
        Self { ping: AlignedVec::zeros(size), pong: AlignedVec::zeros(size) }
    }
}

impl PackedMlp {
    /// Runs one tile, whose input lies in `scratch.ping`, into `y`.
    pub fn infer(&self, isa: Isa, scratch: &mut InferScratch, y: &mut [f32]) {
        let (last, hidden) = self.layers.split_last().expect("an Mlp has at least one layer");
        let (mut from, mut to) = (&mut scratch.ping, &mut scratch.pong);
        for layer in hidden {
            let (inputs, outputs) = (layer.forward.inputs() * LANES, layer.forward.outputs() * LANES);
            let start = Start::Bias(&layer.bias);
            dense(isa, &layer.forward, start, &from[..inputs], &mut to[..outputs], Finish::Relu);
            std::mem::swap(&mut from, &mut to);
        }
        let x = &from[..last.forward.inputs() * LANES];
        dense(isa, &last.forward, Start::Bias(&last.bias), x, y, Finish::Linear);
    }
}

/// The values of one tile out of `[tile][features][LANES]`.
pub(crate) fn tile_of(tiles: &[f32], features: usize, tile: usize) -> &[f32] {
    &tiles[tile * features * LANES..(tile + 1) * features * LANES]
}

/// The values of one tile out of `[tile][features][LANES]`, to be written.
pub(crate) fn tile_of_mut(tiles: &mut [f32], features: usize, tile: usize) -> &mut [f32] {
    &mut tiles[tile * features * LANES..(tile + 1) * features * LANES]
}
