use crate::MAX_PARAMS;
use crate::analytic::seen_params;
use crate::network::{FastNetwork, LitFast, LitReference, Network, ReferenceNetwork};
use crate::params::{ParamLayout, TensorId};
use crate::scene_cache::SURFACE;

/// Rows of a layer come in blocks of as many (`block.wgsl`).
const BLOCK: usize = 8;
/// Features of a pixel, in whole quads.
const FEATURE_ROWS: usize = 12;

/// The part of a network that runs for each pixel and light, packed for `network.wgsl`.
#[derive(Debug)]
pub(crate) struct DeviceNetwork {
    /// True if its first layer modulates a trunk and sees the analytic features.
    pub fast: bool,
    /// Values of a layer, those that fill up the last block included.
    pub width: usize,
    /// Values of a layer without those.
    pub true_width: usize,
    /// Matrices between two layers.
    pub hidden: usize,
    /// Rows of an encoded pixel.
    pub pixel_rows: usize,
    /// Weights for the way forward: matrices as `[input][row]`, then output weights and bias in quads of three values.
    /// For the way back: those between layers as `[row][input]`, then of the output, then of the features.
    pub weights: Vec<f32>,
}

impl DeviceNetwork {
    /// Inputs of the first matrix.
    pub fn first_inputs(&self) -> usize {
        if self.fast { FEATURE_ROWS } else { self.pixel_rows }
    }
}

/// A matrix of a parameter vector.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    values: &'a [f32],
    stride: usize,
    pub rows: usize,
    cols: usize,
}

impl<'a> Matrix<'a> {
    fn new(layout: &ParamLayout, params: &'a [f32], id: TensorId) -> Self {
        let tensor = &layout.tensors[id];
        let values = &params[tensor.range()];
        Self { values, stride: tensor.stride, rows: tensor.rows, cols: tensor.cols }
    }

    /// Zero outside.
    pub fn at(&self, row: usize, col: usize) -> f32 {
        if row < self.rows && col < self.cols { self.values[row * self.stride + col] } else { 0.0 }
    }

    /// Appends its first `cols` columns one by one, each filled up to `rows`.
    fn by_columns(&self, cols: usize, rows: usize, out: &mut Vec<f32>) {
        out.extend((0..cols).flat_map(|col| (0..rows).map(move |row| self.at(row, col))));
    }

    /// Appends `rows` rows, each filled up to `cols`.
    fn by_rows(&self, rows: usize, cols: usize, out: &mut Vec<f32>) {
        out.extend((0..rows).flat_map(|row| (0..cols).map(move |col| self.at(row, col))));
    }
}

/// The matrices of a [`DeviceNetwork`], which has the other fields as well.
pub(crate) struct Parts<'a> {
    pub fast: bool,
    pub pixel_rows: usize,
    pub first: Matrix<'a>,
    /// Columns of the first matrix that a device multiplies.
    pub first_inputs: usize,
    pub hidden: Vec<Matrix<'a>>,
    pub output: Matrix<'a>,
    pub output_bias: &'a [f32],
}

impl Parts<'_> {
    pub fn pack(&self) -> DeviceNetwork {
        let (fast, pixel_rows) = (self.fast, self.pixel_rows);
        let true_width = self.first.rows;
        let width = true_width.next_multiple_of(BLOCK);
        let mut weights = Vec::new();
        self.first.by_columns(self.first_inputs, width, &mut weights);
        self.hidden.iter().for_each(|matrix| matrix.by_columns(width, width, &mut weights));
        self.output.by_columns(width, 4, &mut weights);
        weights.extend_from_slice(self.output_bias);
        weights.push(0.0);
        self.hidden.iter().for_each(|matrix| matrix.by_rows(width, width, &mut weights));
        self.output.by_rows(4, width, &mut weights);
        if fast {
            self.first.by_rows(width, FEATURE_ROWS, &mut weights);
        }
        let hidden = self.hidden.len();
        DeviceNetwork { fast, width, true_width, hidden, pixel_rows, weights }
    }
}

/// A network whose pixels a device can run.
pub(crate) trait OnDevice: Network {
    /// Weights of what runs per pixel.
    fn parts<'a>(&'a self, params: &'a [f32]) -> Parts<'a>;
    /// For each layer its scale, then its shift.
    fn modulation(&self, params: &[f32], lit: &Self::Lit) -> Vec<f32>;
    /// Sum that [`Network::light_backward`] makes, from the gradient by [`OnDevice::modulation`] and by the parameters
    /// as the features see them.
    fn gradient_sum(&self, params: &[f32], lit: &Self::Lit, d_modulation: &[f32], d_seen: &[f32])
    -> Vec<f32>;
}

impl OnDevice for FastNetwork {
    fn parts<'a>(&'a self, params: &'a [f32]) -> Parts<'a> {
        let matrix = |id| Matrix::new(self.layout(), params, id);
        debug_assert_eq!(self.pixel_rows(), self.head.width + SURFACE);
        Parts {
            fast: true,
            pixel_rows: self.pixel_rows(),
            first: matrix(self.head.features),
            first_inputs: FEATURE_ROWS,
            hidden: self.head.hidden.iter().map(|&id| matrix(id)).collect(),
            output: matrix(self.head.output),
            output_bias: self.layout().row(params, self.head.output_bias),
        }
    }

    fn modulation(&self, _params: &[f32], lit: &LitFast) -> Vec<f32> {
        let width = self.head.width;
        let is_scale = |index: usize| (index / width).is_multiple_of(2);
        let values = lit.modulation.iter().enumerate();
        values.map(|(index, value)| if is_scale(index) { 1.0 + value } else { *value }).collect()
    }

    fn gradient_sum(&self, _params: &[f32], lit: &LitFast, d_modulation: &[f32], d_seen: &[f32]) -> Vec<f32> {
        let mut by_parameter = [0.0; MAX_PARAMS];
        for (seen, d_seen) in seen_params(&lit.light, &self.light.normalisation).iter().zip(d_seen) {
            for (sum, d) in by_parameter.iter_mut().zip(seen.d) {
                *sum += d * d_seen;
            }
        }
        d_modulation.iter().copied().chain(by_parameter).collect()
    }
}

impl ReferenceNetwork {
    /// Weights of the light's inputs, which come after those of the pixel.
    fn light_weight(&self, params: &[f32], row: usize, input: usize) -> f32 {
        Matrix::new(self.layout(), params, self.mlp.weights[0]).at(row, self.pixel_rows() + input)
    }
}

impl OnDevice for ReferenceNetwork {
    fn parts<'a>(&'a self, params: &'a [f32]) -> Parts<'a> {
        let matrix = |id: &TensorId| Matrix::new(self.layout(), params, *id);
        let last = self.mlp.weights.len() - 1;
        Parts {
            fast: false,
            pixel_rows: self.pixel_rows(),
            first: matrix(&self.mlp.weights[0]),
            first_inputs: self.pixel_rows(),
            hidden: self.mlp.weights[1..last].iter().map(matrix).collect(),
            output: matrix(&self.mlp.weights[last]),
            output_bias: self.layout().row(params, self.mlp.biases[last]),
        }
    }

    /// Scales of one, the biases, and in that of the first layer what the light adds.
    fn modulation(&self, params: &[f32], lit: &LitReference) -> Vec<f32> {
        let layers = self.mlp.weights.len() - 1;
        let mut modulation = Vec::new();
        for (layer, &id) in self.mlp.biases[..layers].iter().enumerate() {
            let bias = self.layout().row(params, id);
            modulation.extend(bias.iter().map(|_| 1.0));
            modulation.extend(bias.iter().enumerate().map(|(row, bias)| {
                let inputs = if layer == 0 { &lit.inputs[..self.light.inputs()] } else { &[] };
                let values = inputs.iter().enumerate();
                bias + values.map(|(i, value)| self.light_weight(params, row, i) * value).sum::<f32>()
            }));
        }
        modulation
    }

    fn gradient_sum(
        &self,
        params: &[f32],
        _lit: &LitReference,
        d_modulation: &[f32],
        _d_seen: &[f32],
    ) -> Vec<f32> {
        let width = self.mlp.sizes[1];
        let d_shift = &d_modulation[width..2 * width];
        let by_input = |input| {
            d_shift.iter().enumerate().map(|(row, d)| d * self.light_weight(params, row, input)).sum()
        };
        (0..self.light.inputs()).map(by_input).collect()
    }
}
