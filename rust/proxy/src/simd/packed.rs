use super::{AlignedVec, ROWS};

/// A matrix in the order in which the kernels read it: blocks of [`ROWS`] outputs, in each `[input][ROWS]`, the last
/// block zero-padded.
#[derive(Clone, Debug, Default)]
pub(crate) struct PackedMatrix {
    outputs: usize,
    inputs: usize,
    data: AlignedVec,
}

impl PackedMatrix {
    /// A matrix of zeros.
    pub fn new(outputs: usize, inputs: usize) -> Self {
        Self { outputs, inputs, data: AlignedVec::zeros(outputs.div_ceil(ROWS) * inputs * ROWS) }
    }

    /// Fills from row-major weights `[outputs][stride]`, each row times `scale(row)`.
    pub fn pack_scaled(&mut self, weights: &[f32], stride: usize, scale: impl Fn(usize) -> f32) {
        let inputs = self.inputs;
        for output in 0..self.outputs {
            let factor = scale(output);
            let row = &weights[output * stride..output * stride + inputs];
            let start = output / ROWS * inputs * ROWS + output % ROWS;
            for (slot, w) in self.data[start..].iter_mut().step_by(ROWS).zip(row) {
                *slot = w * factor;
            }
        }
    }

    /// Fills from row-major weights `[outputs][stride]`.
    pub fn pack(&mut self, weights: &[f32], stride: usize) {
        self.pack_scaled(weights, stride, |_| 1.0);
    }

    /// Fills with the transpose of row-major weights `[inputs][stride]`.
    pub fn pack_transposed(&mut self, weights: &[f32], stride: usize) {
        let (inputs, outputs) = (self.inputs, self.outputs);
        for (input, row) in weights.chunks(stride).take(inputs).enumerate() {
            for (block, values) in row[..outputs].chunks(ROWS).enumerate() {
                let start = (block * inputs + input) * ROWS;
                self.data[start..start + values.len()].copy_from_slice(values);
            }
        }
    }

    /// Rows.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Columns.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// The packed values.
    pub fn data(&self) -> &[f32] {
        &self.data
    }
}
