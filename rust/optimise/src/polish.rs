use crate::OptimiseError;
use crate::objective::{Draw, Objective, ViewObjective};
use crate::problem::Problem;
use crate::solve::mappings;
use crate::term::Comparison;
use crate::variable::{Mapping, PARAMS};
use rayon::prelude::*;
use relume_scene::{LANES, Light};
use std::ops::ControlFlow;

/// How lights are polished.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polish {
    /// Most steps.
    pub steps: usize,
    /// Softness of the derivatives at the first step and the least; it is halved where they no longer lead on. Values are exact.
    pub softness: [f32; 2],
}

/// Where a polish stands; handed to the caller after every step.
#[derive(Clone, Copy, Debug)]
pub struct PolishStep<'a> {
    /// Which step.
    pub iteration: usize,
    /// Loss of all cells.
    pub loss: f64,
    /// The best lights so far.
    pub lights: &'a [Light],
}

/// Lights after [`polish`].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Polished {
    /// The lights; those that it was given if nothing was better.
    pub lights: Vec<Light>,
    /// Loss of all cells of exact pictures.
    pub loss: f64,
    /// That of the lights that it was given.
    pub start_loss: f64,
}

/// Cells of each goal that are looked at.
const MOST_CELLS: usize = 16384;
/// A further step that improves the loss by less than this share is the last at its softness.
const LEAST_GAIN: f64 = 1e-3;
/// Longest step of an unconstrained value.
const LONGEST: f64 = 0.7;

/// Moves solved lights to where exact pictures serve the goals best, by Levenberg-Marquardt steps (Marquardt 1963). What a
/// proxy or smoothing gets wrong is gone afterwards; the basin is still the one that it found.
///
/// # Errors
/// As [`crate::solve`]; also if the relighter of a view gives no derivatives with its values.
pub fn polish(
    problem: &Problem,
    lights: &[Light],
    settings: &Polish,
    on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
) -> Result<Polished, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, 0.0)?;
    let fit =
        Fit { draw: objective.spread(MOST_CELLS), mappings: mappings(problem, lights, 0.0)?, objective };
    let mut best = fit.state(lights)?;
    let start_loss = best.loss;
    let (mut softness, least) = (settings.softness[0], settings.softness[1]);
    let mut system = fit.normal_equations(&best, softness)?;
    let mut damping = 1e-3;
    for iteration in 0..settings.steps {
        let Some(delta) = system.solve(damping) else { break };
        let next = fit.state(&fit.moved(&best.lights, &delta))?;
        let gain = 1.0 - next.loss / best.loss;
        let improves = gain > 0.0;
        if improves {
            best = next;
        }
        damping *= if improves { 0.1 } else { 8.0 };
        if on_step(PolishStep { iteration, loss: best.loss, lights: &best.lights }).is_break() {
            break;
        }
        let is_done = (0.0..LEAST_GAIN).contains(&gain) || damping > 1e3;
        if is_done && softness <= least {
            break;
        }
        if is_done {
            (softness, damping) = ((0.5 * softness).max(least), 1e-3);
        }
        if improves || is_done {
            system = fit.normal_equations(&best, softness)?;
        }
    }
    Ok(Polished { lights: best.lights, loss: best.loss, start_loss })
}

/// Lights, and their pictures by view and light.
struct State {
    lights: Vec<Light>,
    units: Vec<Vec<Vec<[f32; 3]>>>,
    loss: f64,
}

struct Fit<'a> {
    objective: Objective<'a>,
    mappings: Vec<Mapping>,
    draw: Draw,
}

impl Fit<'_> {
    fn state(&self, lights: &[Light]) -> Result<State, OptimiseError> {
        let units = self.objective.units(lights, &self.draw)?;
        let loss = self.objective.loss_of_goals(lights, &units, &self.draw)
            + self.objective.preference_loss(&self.mappings, lights);
        Ok(State {
            lights: lights.to_vec(),
            units,
            loss: if loss.is_finite() { loss } else { f64::INFINITY },
        })
    }

    fn moved(&self, lights: &[Light], delta: &[f64]) -> Vec<Light> {
        let of_light = |((light, mapping), delta): ((&Light, &Mapping), &[f64; PARAMS])| {
            mapping.step(light, &delta.map(|d| d.clamp(-LONGEST, LONGEST) as f32))
        };
        lights.iter().zip(&self.mappings).zip(delta.as_chunks::<PARAMS>().0).map(of_light).collect()
    }

    fn normal_equations(&self, state: &State, softness: f32) -> Result<NormalEquations, OptimiseError> {
        let mut system = NormalEquations::new(state.lights.len() * PARAMS);
        for ((view, draw), units) in self.objective.views.iter().zip(&self.draw).zip(&state.units) {
            let comparisons = view.compare(&state.lights, units, draw);
            let residuals: Vec<f32> = comparisons.iter().flat_map(Comparison::weighted_residuals).collect();
            let columns = self.columns(view, &state.lights, units, &comparisons, draw, softness)?;
            system.add(&columns, &residuals);
        }
        for (i, light) in state.lights.iter().enumerate() {
            for (value, row) in self.objective.preferences(i, &self.mappings[i], light) {
                system.add_row(i * PARAMS, &row, value);
            }
        }
        Ok(system)
    }

    /// Derivatives of the weighted residuals by each unconstrained value; empty where there are none.
    fn columns(
        &self,
        view: &ViewObjective,
        lights: &[Light],
        units: &[Vec<[f32; 3]>],
        comparisons: &[Comparison],
        draw: &[Vec<u32>],
        softness: f32,
    ) -> Result<Vec<Vec<f32>>, OptimiseError> {
        let cells = view.cells_of(draw);
        let of_light = |(i, light): (usize, &Light)| {
            let slopes = view.slopes(i, light, softness, &cells)?;
            let weights = lane_weights(&self.mappings[i], light);
            let column = |weights: &Weights| match weights.is_zero() {
                true => Vec::new(),
                false => {
                    let change = |k: usize| weights.change(light, &slopes, &units[i], k);
                    let of =
                        |comparison: &Comparison| comparison.push_forward(comparison.places().map(change));
                    comparisons.iter().flat_map(of).collect()
                }
            };
            Ok(weights.iter().map(column).collect())
        };
        let columns: Vec<Vec<Vec<f32>>> =
            lights.par_iter().enumerate().map(of_light).collect::<Result<_, OptimiseError>>()?;
        Ok(columns.into_iter().flatten().collect())
    }
}

/// What one unconstrained value does to a light: by the lanes of its shape, and by its radiance.
#[derive(Clone, Copy)]
struct Weights {
    shape: [f32; LANES],
    radiance: [f32; 3],
}

/// For each unconstrained value of a light.
fn lane_weights(mapping: &Mapping, light: &Light) -> [Weights; PARAMS] {
    let basis = |number: usize| {
        let (mut shape, mut radiance) = ([0.0; LANES], [0.0; 3]);
        match number.checked_sub(LANES) {
            Some(channel) => radiance[channel] = 1.0,
            None => shape[number] = 1.0,
        }
        mapping.pull_back(light, &shape, radiance)
    };
    let rows: [[f32; PARAMS]; PARAMS] = std::array::from_fn(basis);
    std::array::from_fn(|lane| Weights {
        shape: std::array::from_fn(|i| rows[i][lane]),
        radiance: std::array::from_fn(|c| rows[LANES + c][lane]),
    })
}

impl Weights {
    fn is_zero(&self) -> bool {
        self.shape.iter().chain(&self.radiance).all(|weight| *weight == 0.0)
    }

    /// Change of the picture at the `k`th cell.
    fn change(&self, light: &Light, slopes: &[[[f32; 3]; LANES]], unit: &[[f32; 3]], k: usize) -> [f32; 3] {
        let mut change: [f32; 3] = std::array::from_fn(|c| self.radiance[c] * unit[k][c]);
        for (weight, slope) in self.shape.iter().zip(slopes.get(k).into_iter().flatten()) {
            (0..3).for_each(|c| change[c] += weight * light.radiance[c] * slope[c]);
        }
        change
    }
}

/// `J^T J` and `-J^T r`.
struct NormalEquations {
    matrix: Vec<Vec<f64>>,
    right: Vec<f64>,
}

impl NormalEquations {
    fn new(size: usize) -> Self {
        Self { matrix: vec![vec![0.0; size]; size], right: vec![0.0; size] }
    }

    fn add(&mut self, columns: &[Vec<f32>], residuals: &[f32]) {
        let dot =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        self.matrix.par_iter_mut().zip(&mut self.right).zip(columns).for_each(|((row, right), a)| {
            row.iter_mut().zip(columns).for_each(|(sum, b)| *sum += dot(a, b));
            *right -= dot(a, residuals);
        });
    }

    fn add_row(&mut self, first: usize, row: &[f32; PARAMS], value: f32) {
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row.iter().enumerate() {
                self.matrix[first + i][first + j] += f64::from(a * b);
            }
            self.right[first + i] -= f64::from(a * value);
        }
    }

    /// The step with a damped diagonal, by Cholesky's decomposition; none where nothing has a slope. Values without one stay.
    fn solve(&self, damping: f64) -> Option<Vec<f64>> {
        let n = self.right.len();
        let largest = (0..n).map(|i| self.matrix[i][i]).fold(0.0, f64::max);
        let mut lower = vec![vec![0.0; n]; n];
        for row in 0..n {
            for column in 0..=row {
                let known: f64 = (0..column).map(|k| lower[row][k] * lower[column][k]).sum();
                let entry = self.matrix[row][column];
                lower[row][column] = match row == column {
                    true => (entry * (1.0 + damping) + 1e-12 * largest - known).sqrt(),
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
        (largest > 0.0 && step.iter().all(|value| value.is_finite())).then_some(step)
    }
}
