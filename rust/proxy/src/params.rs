use std::ops::Range;

use crate::Rng;
use crate::simd::{PAD, padded};

/// Role of a tensor, which decides its optimiser and its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// Matrix between two hidden layers: Muon.
    Hidden,
    /// Matrix at the edge of a network: Adam.
    Edge,
    /// Bias: Adam.
    Bias,
    /// Hash grid entries: Adam with its own rate, untouched where no sample fell.
    Grid,
}

/// One named block of a flat parameter vector: `rows` rows of `cols` values, `stride` apart, zero in between.
#[derive(Clone, Debug)]
pub(crate) struct Tensor {
    pub name: String,
    pub rows: usize,
    pub cols: usize,
    pub stride: usize,
    pub start: usize,
    pub role: Role,
    /// Standard deviation of the start values; for grids half the width of a uniform range.
    pub deviation: f32,
}

impl Tensor {
    /// Range of the tensor in the parameter vector.
    pub fn range(&self) -> Range<usize> {
        self.start..self.start + self.rows * self.stride
    }
}

/// Index of a tensor in its layout.
pub(crate) type TensorId = usize;

/// The tensors of a network in one flat vector.
#[derive(Clone, Debug, Default)]
pub(crate) struct ParamLayout {
    pub tensors: Vec<Tensor>,
    pub len: usize,
}

impl ParamLayout {
    /// Adds a matrix, its rows padded for the kernels.
    pub fn matrix(&mut self, name: &str, rows: usize, cols: usize, role: Role, deviation: f32) -> TensorId {
        self.add(name, rows, cols, padded(cols), role, deviation)
    }

    /// Adds a bias, zero at the start.
    pub fn bias(&mut self, name: &str, len: usize) -> TensorId {
        self.add(name, 1, len, padded(len), Role::Bias, 0.0)
    }

    /// Adds a level of a hash grid.
    pub fn grid(&mut self, name: &str, entries: usize, features: usize) -> TensorId {
        self.add(name, entries, features, features, Role::Grid, 1e-2)
    }

    fn add(
        &mut self,
        name: &str,
        rows: usize,
        cols: usize,
        stride: usize,
        role: Role,
        deviation: f32,
    ) -> TensorId {
        let start = self.len;
        self.len = (start + rows * stride).next_multiple_of(PAD);
        self.tensors.push(Tensor { name: name.to_owned(), rows, cols, stride, start, role, deviation });
        self.tensors.len() - 1
    }

    /// Values of a tensor.
    pub fn slice<'a>(&self, params: &'a [f32], id: TensorId) -> &'a [f32] {
        &params[self.tensors[id].range()]
    }

    /// Values of a vector or of a matrix of one row, without padding.
    pub fn row<'a>(&self, params: &'a [f32], id: TensorId) -> &'a [f32] {
        let tensor = &self.tensors[id];
        &params[tensor.start..tensor.start + tensor.cols]
    }

    /// Draws the start values: normal for matrices, uniform for grids, zero for biases.
    pub fn start_values(&self, seed: u64) -> Vec<f32> {
        let mut params = vec![0.0; self.len];
        for (id, tensor) in self.tensors.iter().enumerate() {
            let mut rng = Rng::stream(seed, START_STREAM, id as u64);
            for row in params[tensor.range()].chunks_mut(tensor.stride) {
                for value in &mut row[..tensor.cols] {
                    *value = match tensor.role {
                        Role::Grid => tensor.deviation * (2.0 * rng.next_f32() - 1.0),
                        _ => tensor.deviation * rng.next_normal(),
                    };
                }
            }
        }
        params
    }
}

/// First counter of the random streams of start values.
const START_STREAM: u64 = 0x5354_4152_5400_0000;

/// Deviation of He et al. 2015 ("Delving Deep into Rectifiers"), which keeps the variance through a ReLU.
pub(crate) fn he_deviation(inputs: usize) -> f32 {
    (2.0 / inputs as f32).sqrt()
}
