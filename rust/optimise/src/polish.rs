use crate::OptimiseError;
use crate::objective::{Draw, Objective};
use crate::problem::Problem;
use crate::relight::Linear;
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
    /// Softness of the derivatives in the first and the last stage; what they lead to is compared by clean pictures.
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
    /// Loss of all cells of clean pictures.
    pub loss: f64,
    /// That of the lights that it was given.
    pub start_loss: f64,
}

/// Cells of each goal that are looked at.
const MOST_CELLS: usize = 4096;
/// Stages, each softer than the next.
const STAGES: usize = 4;
/// A further step that improves the loss by less than this share is the last of its stage; so is one that is damped more.
const LEAST_GAIN: f64 = 1e-3;
const MOST_DAMPING: f64 = 1e4;
/// Longest step of an unconstrained value.
const LONGEST: f64 = 0.7;

/// Moves solved lights to where clean pictures serve the goals best, by Levenberg-Marquardt steps (Marquardt 1963) with
/// derivatives of less and less softened ones. What a proxy or smoothing gets wrong is gone afterwards; the basin is still the
/// one that it found.
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
    let (start_loss, mut iteration) = (best.loss, 0);
    for stage in 0..STAGES {
        let [from, to] = settings.softness;
        let softness = from * (to / from).powf(stage as f32 / (STAGES - 1) as f32);
        let most = settings.steps * (stage + 1) / STAGES;
        if fit.descend(&mut best, softness, &mut iteration, most, on_step)?.is_break() {
            break;
        }
    }
    Ok(Polished { lights: best.lights, loss: best.loss, start_loss })
}

/// Lights, and the pictures of all views.
struct State {
    lights: Vec<Light>,
    pictures: Vec<Vec<[f32; 3]>>,
    loss: f64,
}

struct Fit<'a> {
    objective: Objective<'a>,
    mappings: Vec<Mapping>,
    draw: Draw,
}

impl Fit<'_> {
    /// Steps until nothing is gained any more; whether the caller wants to stop altogether.
    fn descend(
        &self,
        best: &mut State,
        softness: f32,
        iteration: &mut usize,
        most: usize,
        on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, OptimiseError> {
        let mut system = self.normal_equations(best, softness)?;
        let (mut damping, mut flow) = (1e-3, ControlFlow::Continue(()));
        while *iteration < most && damping < MOST_DAMPING && flow.is_continue() {
            let Some(delta) = system.solve(damping) else { break };
            let next = self.state(&self.moved(&best.lights, &delta))?;
            let gain = 1.0 - next.loss / best.loss;
            damping *= if gain > 0.0 { 0.1 } else { 10.0 };
            if gain > 0.0 {
                *best = next;
                system = self.normal_equations(best, softness)?;
            }
            flow = on_step(PolishStep { iteration: *iteration, loss: best.loss, lights: &best.lights });
            *iteration += 1;
            if (0.0..LEAST_GAIN).contains(&gain) {
                break;
            }
        }
        Ok(flow)
    }

    fn state(&self, lights: &[Light]) -> Result<State, OptimiseError> {
        let views = &self.objective.views;
        let pictures = views.iter().map(|view| view.clean_picture(lights)).collect::<Result<Vec<_>, _>>()?;
        let mut loss = self.objective.preference_loss(&self.mappings, lights);
        for ((view, draw), picture) in views.iter().zip(&self.draw).zip(&pictures) {
            loss += view.compare_picture(picture, draw).iter().map(Comparison::loss).sum::<f64>();
        }
        let loss = if loss.is_finite() { loss } else { f64::INFINITY };
        Ok(State { lights: lights.to_vec(), pictures, loss })
    }

    fn moved(&self, lights: &[Light], delta: &[f64]) -> Vec<Light> {
        let of_light = |((light, mapping), delta): ((&Light, &Mapping), &[f64; PARAMS])| {
            mapping.step(light, &delta.map(|d| d.clamp(-LONGEST, LONGEST) as f32))
        };
        lights.iter().zip(&self.mappings).zip(delta.as_chunks::<PARAMS>().0).map(of_light).collect()
    }

    fn normal_equations(&self, state: &State, softness: f32) -> Result<NormalEquations, OptimiseError> {
        let mut system = NormalEquations::new(state.lights.len() * PARAMS);
        let units = self.objective.linear_units(&state.lights, softness, &self.draw)?;
        let views = self.objective.views.iter().zip(&self.draw).zip(state.pictures.iter().zip(&units));
        for ((view, draw), (picture, units)) in views {
            let comparisons = view.compare_picture(picture, draw);
            let residuals: Vec<f32> = comparisons.iter().flat_map(Comparison::weighted_residuals).collect();
            system.add(&self.columns(&state.lights, units, &comparisons), &residuals);
        }
        for (i, light) in state.lights.iter().enumerate() {
            for (value, row) in self.objective.preferences(i, &self.mappings[i], light) {
                system.add_row(i * PARAMS, &row, value);
            }
        }
        Ok(system)
    }

    /// Derivatives of the weighted residuals by each unconstrained value; empty where there are none.
    fn columns(&self, lights: &[Light], units: &[Linear], comparisons: &[Comparison]) -> Vec<Vec<f32>> {
        let of_light = |(i, light): (usize, &Light)| {
            let column = |weights: &Weights| match weights.is_zero() {
                true => Vec::new(),
                false => {
                    let change = |k: usize| weights.change(light, &units[i], k);
                    let of =
                        |comparison: &Comparison| comparison.push_forward(comparison.places().map(change));
                    comparisons.iter().flat_map(of).collect()
                }
            };
            lane_weights(&self.mappings[i], light).iter().map(column).collect::<Vec<_>>()
        };
        lights.par_iter().enumerate().flat_map(of_light).collect()
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
    fn change(&self, light: &Light, unit: &Linear, k: usize) -> [f32; 3] {
        let mut change: [f32; 3] = std::array::from_fn(|c| self.radiance[c] * unit.values[k][c]);
        for (weight, slope) in self.shape.iter().zip(unit.slopes.get(k).into_iter().flatten()) {
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
