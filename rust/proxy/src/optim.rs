//! Adam (Kingma and Ba 2015) for edges, biases and the grid; Muon for hidden matrices.

use rayon::prelude::*;

use crate::params::{ParamLayout, Role, Tensor};
use crate::simd::{AlignedVec, Isa, LANES, outer};

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.99;
/// Small enough not to slow the tiny gradients of fine grid levels (Mueller et al. 2022, section 4).
const EPSILON: f32 = 1e-15;
/// Momentum of Muon.
const MOMENTUM: f32 = 0.95;
/// Parameters that one task updates.
const BLOCK: usize = 16_384;
/// Jordan's coefficients of the quintic Newton-Schulz iteration: of `x`, of `x xT x`, of `(x xT)^2 x`.
pub(crate) const NEWTON_SCHULZ: [f32; 3] = [3.4445, -4.7750, 2.0315];
/// Number of rounds.
pub(crate) const ROUNDS: usize = 5;

/// Factors of Adam's moments at a step, counted from 1, since they start at zero.
pub(crate) fn corrections(step: u64) -> [f32; 2] {
    let power = step.min(100_000) as i32;
    [1.0 / (1.0 - BETA1.powi(power)), 1.0 / (1.0 - BETA2.powi(power))]
}

/// Factor on the orthogonal matrix with the larger side `size`, so that the step's root mean square is half of `rate`.
pub(crate) fn muon_step_length(rate: f32, size: usize) -> f32 {
    0.5 * rate * (size as f32).sqrt()
}

/// Learning rates of one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepRates {
    pub adam: f32,
    pub muon: f32,
    pub grid: f32,
}

/// First and second moments of all parameters; Muon keeps its momentum in the first.
#[derive(Clone, Debug)]
pub(crate) struct Optimiser {
    pub first: Vec<f32>,
    pub second: Vec<f32>,
    muon: bool,
}

impl Optimiser {
    /// Optimiser with no memory.
    pub fn new(layout: &ParamLayout, muon: bool) -> Self {
        Self { first: vec![0.0; layout.len], second: vec![0.0; layout.len], muon }
    }

    /// One step; `step` counts from 1.
    pub fn update(
        &mut self,
        isa: Isa,
        layout: &ParamLayout,
        params: &mut [f32],
        grads: &[f32],
        rates: StepRates,
        step: u64,
    ) {
        let correction = corrections(step);
        let mut tasks = Vec::new();
        let (mut params, mut first, mut second) = (params, &mut self.first[..], &mut self.second[..]);
        let mut offset = 0;
        for tensor in &layout.tensors {
            let range = tensor.range();
            let next = |slice| cut(slice, range.start - offset, range.len());
            let state = [next(&mut params), next(&mut first), next(&mut second)];
            tasks.push((tensor, state, &grads[range.clone()]));
            offset = range.end;
        }
        let muon = self.muon;
        tasks.into_par_iter().for_each(|(tensor, [params, first, second], grads)| match tensor.role {
            Role::Hidden if muon => muon_step(isa, tensor, params, grads, first, rates.muon),
            Role::Grid => adam(params, grads, first, second, rates.grid, correction, true),
            Role::Hidden | Role::Edge | Role::Bias => {
                adam(params, grads, first, second, rates.adam, correction, false);
            }
        });
    }
}

/// Cuts `len` values off the front of a slice, after `skip`.
fn cut<'a>(slice: &mut &'a mut [f32], skip: usize, len: usize) -> &'a mut [f32] {
    let (own, rest) = std::mem::take(slice)[skip..].split_at_mut(len);
    *slice = rest;
    own
}

/// Adam in parallel blocks. With `sparse`, entries without a gradient stay as they are (Mueller et al. 2022).
fn adam(
    params: &mut [f32],
    grads: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    rate: f32,
    correction: [f32; 2],
    sparse: bool,
) {
    let state =
        params.par_chunks_mut(BLOCK).zip(first.par_chunks_mut(BLOCK)).zip(second.par_chunks_mut(BLOCK));
    state.zip(grads.par_chunks(BLOCK)).for_each(|(((params, first), second), grads)| {
        for (((p, m), v), g) in params.iter_mut().zip(first).zip(second).zip(grads) {
            if sparse && *g == 0.0 {
                continue;
            }
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
            *p -= rate * (*m * correction[0]) / ((*v * correction[1]).sqrt() + EPSILON);
        }
    });
}

/// Muon (Jordan et al. 2024, "Muon: An optimizer for hidden layers in neural networks"): Nesterov momentum, its singular
/// values brought near 1.
fn muon_step(isa: Isa, tensor: &Tensor, params: &mut [f32], grads: &[f32], momentum: &mut [f32], rate: f32) {
    for (m, g) in momentum.iter_mut().zip(grads) {
        *m = MOMENTUM * *m + g;
    }
    let size = tensor.rows.max(tensor.cols).next_multiple_of(LANES);
    let mut x = AlignedVec::zeros(size * size);
    let rows = momentum.chunks(tensor.stride).zip(grads.chunks(tensor.stride));
    for (to, (m, g)) in x.chunks_mut(size).zip(rows) {
        for ((to, m), g) in to.iter_mut().zip(&m[..tensor.cols]).zip(g) {
            *to = g + MOMENTUM * m;
        }
    }
    orthogonalise(isa, &mut x, size);
    let step = muon_step_length(rate, tensor.rows.max(tensor.cols));
    for (row, x) in params.chunks_mut(tensor.stride).zip(x.chunks(size)) {
        for (p, x) in row[..tensor.cols].iter_mut().zip(x) {
            *p -= step * x;
        }
    }
}

/// The Newton-Schulz iteration, which brings all singular values between about 0.7 and 1.2.
fn orthogonalise(isa: Isa, x: &mut AlignedVec, size: usize) {
    let [a, b, c] = NEWTON_SCHULZ;
    let norm = x.iter().map(|x| x * x).sum::<f32>().sqrt();
    if norm.is_nan() || norm < 1e-30 {
        x.fill(0.0);
        return;
    }
    for x in x.iter_mut() {
        *x /= norm;
    }
    let mut transposed = AlignedVec::zeros(size * size);
    for _ in 0..ROUNDS {
        for row in 0..size {
            for column in 0..size {
                transposed[column * size + row] = x[row * size + column];
            }
        }
        let gram = product(isa, x, &transposed, size);
        let mut polynomial = product(isa, &gram, &gram, size);
        for (p, g) in polynomial.iter_mut().zip(gram.iter()) {
            *p = c * *p + b * g;
        }
        let mut next = product(isa, &polynomial, x, size);
        for (n, x) in next.iter_mut().zip(x.iter()) {
            *n += a * x;
        }
        *x = next;
    }
}

/// Product of two square row-major matrices whose size is a multiple of a tile.
fn product(isa: Isa, a: &AlignedVec, b: &AlignedVec, size: usize) -> AlignedVec {
    let mut tiles = AlignedVec::zeros(size * size);
    for (row, values) in a.chunks(size).enumerate() {
        for (tile, values) in values.chunks(LANES).enumerate() {
            let start = (tile * size + row) * LANES;
            tiles[start..start + LANES].copy_from_slice(values);
        }
    }
    let mut out = AlignedVec::zeros(size * size);
    outer(isa, &tiles, b, size, size, &mut out);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    #[test]
    fn orthogonalised_matrices_have_singular_values_near_one() {
        let size = 64;
        let mut rng = Rng::stream(4, 4, 4);
        let mut x = AlignedVec::zeros(size * size);
        x.iter_mut().for_each(|x| *x = rng.next_normal());
        orthogonalise(Isa::detect(), &mut x, size);
        for _ in 0..10 {
            let v: Vec<f32> = (0..size).map(|_| rng.next_normal()).collect();
            let image: f32 =
                x.chunks(size).map(|row| row.iter().zip(&v).map(|(a, b)| a * b).sum::<f32>().powi(2)).sum();
            let ratio = (image / v.iter().map(|v| v * v).sum::<f32>()).sqrt();
            assert!((0.7..1.25).contains(&ratio), "a random vector is stretched by {ratio}");
        }
    }

    #[test]
    fn adam_moves_every_weight_by_the_rate_at_its_first_step() {
        let mut params = vec![1.0, 1.0, 1.0];
        let (mut first, mut second) = (vec![0.0; 3], vec![0.0; 3]);
        let correction = [1.0 / (1.0 - BETA1), 1.0 / (1.0 - BETA2)];
        adam(&mut params, &[1e-6, -3.0, 0.0], &mut first, &mut second, 0.1, correction, true);
        assert!((params[0] - 0.9).abs() < 1e-4 && (params[1] - 1.1).abs() < 1e-4, "{params:?}");
        assert_eq!((params[2], first[2]), (1.0, 0.0), "no gradient, no change");
    }
}
