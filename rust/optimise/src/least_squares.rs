//! Linear least squares of residuals that are estimated twice with independent noise.

use crate::variable::PARAMS;
use rayon::prelude::*;

/// Steps shorter than this tell nothing about derivatives.
const SHORTEST: f32 = 1e-3;
/// Derivatives of the weighted residuals by each unconstrained value, by either half of the paths; empty where there are none.
pub(crate) struct Jacobian {
    pub(crate) columns: Vec<[Vec<f32>; 2]>,
}

impl Jacobian {
    /// Broyden's update (1965): the least change that makes it true for a step that was tried.
    pub(crate) fn learn(&mut self, delta: &[f32], before: &[Vec<f32>; 2], after: &[Vec<f32>; 2]) {
        let length2 = delta.iter().map(|d| d * d).sum::<f32>();
        for half in 0..2 {
            let change = after[half].iter().zip(&before[half]);
            let mut missing: Vec<f32> = change.map(|(after, before)| after - before).collect();
            for (column, delta) in self.columns.iter().zip(delta) {
                missing.iter_mut().zip(&column[half]).for_each(|(missing, slope)| *missing -= slope * delta);
            }
            if !(length2 > SHORTEST * SHORTEST && missing.iter().all(|missing| missing.is_finite())) {
                return;
            }
            self.columns.par_iter_mut().zip(delta).for_each(|(column, delta)| {
                let share = delta / length2;
                column[half].iter_mut().zip(&missing).for_each(|(slope, missing)| *slope += share * missing);
            });
        }
    }
}

/// `J^T J`, of which the part above the diagonal is not kept, and `-J^T r`.
pub(crate) struct NormalEquations {
    matrix: Vec<Vec<f64>>,
    right: Vec<f64>,
    /// Directions of unit length, and how far steps go along them.
    held: Vec<(Vec<f64>, f64)>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl NormalEquations {
    pub(crate) fn new(size: usize) -> Self {
        Self { matrix: vec![vec![0.0; size]; size], right: vec![0.0; size], held: Vec::new() }
    }

    /// The right side takes slopes from one half and residuals from the other: it is the derivative of the loss, without what
    /// noise that both share would add. The matrix is that of the means, which always has a root.
    pub(crate) fn add(&mut self, jacobian: &Jacobian, [r_a, r_b]: &[Vec<f32>; 2]) {
        let dot =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let mean = |[a, b]: &[Vec<f32>; 2]| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect();
        let means: Vec<Vec<f32>> = jacobian.columns.par_iter().map(mean).collect();
        let rows = self.matrix.par_iter_mut().zip(&mut self.right).zip(&jacobian.columns);
        rows.enumerate().for_each(|(i, ((row, right), [a, b]))| {
            row.iter_mut().zip(&means[..=i]).for_each(|(sum, other)| *sum += dot(&means[i], other));
            *right -= 0.5 * (dot(a, r_b) + dot(b, r_a));
        });
    }

    pub(crate) fn add_row(&mut self, first: usize, row: &[f32; PARAMS], value: f32) {
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row[..=i].iter().enumerate() {
                self.matrix[first + i][first + j] += f64::from(a * b);
            }
            self.right[first + i] -= f64::from(a * value);
        }
    }

    /// Lets steps go so far along a direction of the values that begin at `first`, no further and no less: what is solved is the rest.
    pub(crate) fn hold(&mut self, first: usize, direction: &[f32; PARAMS], distance: f32) {
        let n = self.right.len();
        let Some((unit, reach)) = self.beside_held(first, direction, distance) else { return };
        let entry = |i: usize, j: usize| self.matrix[i.max(j)][i.min(j)];
        let along: Vec<f64> = (0..n).map(|i| (0..n).map(|j| entry(i, j) * unit[j]).sum()).collect();
        self.right.iter_mut().zip(&along).for_each(|(right, along)| *right -= reach * along);
        let (both, pull) = (dot(&along, &unit), dot(&self.right, &unit));
        for i in 0..n {
            for j in 0..=i {
                self.matrix[i][j] += both * unit[i] * unit[j] - unit[i] * along[j] - along[i] * unit[j];
            }
            self.right[i] -= pull * unit[i];
        }
        self.held.push((unit, reach));
    }

    /// The part of a direction, of unit length, that is across all that are held, and how far steps go along it; none if it is one
    /// of theirs.
    fn beside_held(&self, first: usize, direction: &[f32; PARAMS], distance: f32) -> Option<(Vec<f64>, f64)> {
        let length = |direction: &[f64]| dot(direction, direction).sqrt();
        let (mut across, mut reach) = (vec![0.0; self.right.len()], f64::from(distance));
        across[first..first + PARAMS].iter_mut().zip(direction).for_each(|(a, d)| *a = f64::from(*d));
        let whole = length(&across);
        for (unit, held) in &self.held {
            let along = dot(&across, unit);
            across.iter_mut().zip(unit).for_each(|(a, u)| *a -= along * u);
            reach -= along * held;
        }
        let rest = length(&across);
        (rest > 1e-6 * whole).then(|| (across.iter().map(|a| a / rest).collect(), reach / rest))
    }

    /// The step with a damped and raised diagonal, by Cholesky's decomposition; none where nothing has a slope. Values without
    /// one stay.
    pub(crate) fn solve(&self, damping: f64, raise: f64) -> Option<Vec<f64>> {
        let n = self.right.len();
        let largest = (0..n).map(|i| self.matrix[i][i]).fold(0.0, f64::max);
        let mut lower = vec![vec![0.0; n]; n];
        for row in 0..n {
            for column in 0..=row {
                let known: f64 = (0..column).map(|k| lower[row][k] * lower[column][k]).sum();
                let entry = self.matrix[row][column];
                lower[row][column] = match row == column {
                    true => (entry * (1.0 + damping) + raise + 1e-12 * largest - known).sqrt(),
                    false => (entry - known) / lower[column][column],
                };
            }
        }
        let mut step = self.right.clone();
        for row in 0..n {
            let known: f64 = (0..row).map(|k| lower[row][k] * step[k]).sum();
            step[row] = (step[row] - known) / lower[row][row];
        }
        for row in (0..n).rev() {
            let known: f64 = (row + 1..n).map(|k| lower[k][row] * step[k]).sum();
            step[row] = (step[row] - known) / lower[row][row];
        }
        for (unit, reach) in &self.held {
            let missing = reach - dot(&step, unit);
            step.iter_mut().zip(unit).for_each(|(step, unit)| *step += missing * unit);
        }
        let has_any = largest > 0.0 || !self.held.is_empty();
        (has_any && step.iter().all(|value| value.is_finite())).then_some(step)
    }
}
