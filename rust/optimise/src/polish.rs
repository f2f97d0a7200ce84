use crate::OptimiseError;
use crate::objective::{Draw, Objective, Unit, mean};
use crate::problem::Problem;
use crate::solve::mappings;
use crate::term::Comparison;
use crate::variable::{Mapping, PARAMS};
use rayon::prelude::*;
use relume_scene::{LANES, Light, lane};
use std::ops::ControlFlow;

/// Where a polish stands; handed to the caller after every picture of derivatives and every step.
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
/// Half widths of the differences that stand for derivatives, of unconstrained values. A dump's picture changes by single
/// segments: wide differences have little noise, narrow ones little curvature.
const STAGES: [f32; 2] = [0.5, 0.25];
/// Radians for each unit of these widths: an eighth of a box is half a unit, an eighth of a radian as far.
const TURN: f32 = 0.25;
/// A further step that improves the loss by less than this share is the last of its stage.
const LEAST_GAIN: f64 = 1e-3;
/// So is the last of so many that improve nothing.
const PATIENCE: usize = 3;
/// Longest step of an unconstrained value; also what is expected of one, against which its derivatives are weighed: what they say
/// less about than the residuals' scatter stays.
const LONGEST: f64 = 0.7;
/// Steps shorter than this tell nothing about derivatives.
const SHORTEST: f32 = 1e-3;
/// A size in this share at the ends of its range is brought inside first, where the logistic function has a slope: smoothing
/// leaves it to the noise, which drives it there.
const MARGIN: f32 = 0.1;
/// Noise, in units of its median, at which a cell counts half.
const HALF_TRUST: f32 = 2.0;

/// Moves solved lights to where clean pictures serve the goals best, by Levenberg-Marquardt steps (Marquardt 1963) with
/// derivatives from differences of clean pictures. What a proxy or smoothing gets wrong is gone afterwards; the basin is still
/// the one that it found. At most `steps` steps are made.
///
/// # Errors
/// As [`crate::solve`].
pub fn polish(
    problem: &Problem,
    lights: &[Light],
    steps: usize,
    on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
) -> Result<Polished, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, 0.0)?;
    let fit =
        Fit { draw: objective.spread(MOST_CELLS), mappings: mappings(problem, lights, 0.0)?, objective };
    let start = fit.state(lights)?;
    let start_loss = fit.loss(&start, &Trust::default());
    let inside = |(mapping, light): (&Mapping, &Light)| mapping.inside(light, MARGIN);
    let mut best = fit.state(&fit.mappings.iter().zip(lights).map(inside).collect::<Vec<_>>())?;
    let mut iteration = 0;
    for (stage, width) in STAGES.into_iter().enumerate() {
        let most = steps * (stage + 1) / STAGES.len();
        if fit.descend(&mut best, width, &mut iteration, most, on_step)?.is_break() {
            break;
        }
    }
    let loss = fit.loss(&best, &Trust::default());
    let (best, loss) = if loss <= start_loss { (best, loss) } else { (start, start_loss) };
    // A sum of products may fall below 0 by chance.
    Ok(Polished { lights: best.lights, loss: loss.max(0.0), start_loss: start_loss.max(0.0) })
}

/// Lights, and how far they are from the goals.
struct State {
    lights: Vec<Light>,
    /// Of all views: means of two estimates.
    pictures: Vec<Vec<[f32; 3]>>,
    /// Of all views, weighted: by two estimates with independent noise.
    residuals: [Vec<f32>; 2],
}

/// Factors on residuals, less where they are noisy; 1 where there are none.
#[derive(Default)]
struct Trust(Vec<f32>);

impl Trust {
    /// From how much the two estimates differ.
    fn new(state: &State) -> Self {
        let [a, b] = &state.residuals;
        let square = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>();
        let noise: Vec<f32> = a.as_chunks().0.iter().zip(b.as_chunks().0).map(square).collect();
        let mut sorted = noise.clone();
        sorted.sort_by(f32::total_cmp);
        let half = HALF_TRUST * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let trust = |noise: &f32| if half > 0.0 { (half / (half + noise)).sqrt() } else { 1.0 };
        Self(noise.iter().flat_map(|noise| [trust(noise); 3]).collect())
    }

    fn of(&self, number: usize) -> f32 {
        self.0.get(number).copied().unwrap_or(1.0)
    }
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
        width: f32,
        iteration: &mut usize,
        most: usize,
        on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, OptimiseError> {
        let trust = Trust::new(best);
        let mut loss = self.loss(best, &trust);
        let mut report =
            |iteration: usize, loss: f64, lights: &[Light]| on_step(PolishStep { iteration, loss, lights });
        let Some(mut jacobian) =
            self.jacobian(best, width, &trust, &mut || report(*iteration, loss, &best.lights))?
        else {
            return Ok(ControlFlow::Break(()));
        };
        let (mut damping, mut rejected, mut flow) = (1e-2, 0, ControlFlow::Continue(()));
        while *iteration < most && rejected < PATIENCE && flow.is_continue() {
            let before = best.trusted(&trust);
            let squares: f64 = before.iter().map(|r| f64::from(r * r)).sum();
            let noise = squares / before.len() as f64;
            let system = self.normal_equations(&jacobian, &before, &best.lights);
            let Some(delta) = system.solve(damping, noise / (LONGEST * LONGEST)) else { break };
            let longest = delta.iter().fold(LONGEST, |most, d| most.max(d.abs()));
            let delta: Vec<f32> = delta.iter().map(|d| (d * LONGEST / longest) as f32).collect();
            let next = self.state(&self.moved(&best.lights, &delta))?;
            let (next_loss, after) = (self.loss(&next, &trust), next.trusted(&trust));
            jacobian.learn(&delta, &before, &after);
            let gain = (loss - next_loss) / squares.max(f64::MIN_POSITIVE);
            if gain > 0.0 {
                (*best, loss, rejected, damping) = (next, next_loss, 0, 0.1 * damping);
            } else {
                (rejected, damping) = (rejected + 1, 10.0 * damping);
            }
            flow = report(*iteration, loss, &best.lights);
            *iteration += 1;
            if (0.0..LEAST_GAIN).contains(&gain) {
                break;
            }
        }
        Ok(flow)
    }

    fn state(&self, lights: &[Light]) -> Result<State, OptimiseError> {
        let (mut pictures, mut residuals) = (Vec::new(), [Vec::new(), Vec::new()]);
        for (view, draw) in self.objective.views.iter().zip(&self.draw) {
            let estimates = view.clean_pictures(lights)?;
            for (residuals, picture) in residuals.iter_mut().zip(&estimates) {
                let comparisons = view.compare_picture(picture, draw);
                residuals.extend(comparisons.iter().flat_map(Comparison::weighted_residuals));
            }
            pictures.push(mean(estimates));
        }
        Ok(State { lights: lights.to_vec(), pictures, residuals })
    }

    /// Sum of the products of two estimates: that of squares without what noise adds.
    fn loss(&self, state: &State, trust: &Trust) -> f64 {
        let [a, b] = &state.residuals;
        let product = |(i, (a, b)): (usize, (&f32, &f32))| f64::from(a * b) * f64::from(trust.of(i)).powi(2);
        let goals: f64 = a.iter().zip(b).enumerate().map(product).sum();
        let loss = goals + self.objective.preference_loss(&self.mappings, &state.lights);
        if loss.is_finite() { loss } else { f64::INFINITY }
    }

    fn moved(&self, lights: &[Light], delta: &[f32]) -> Vec<Light> {
        let of_light =
            |((light, mapping), delta): ((&Light, &Mapping), &[f32; PARAMS])| mapping.step(light, delta);
        lights.iter().zip(&self.mappings).zip(delta.as_chunks::<PARAMS>().0).map(of_light).collect()
    }

    fn normal_equations(&self, jacobian: &Jacobian, residuals: &[f32], lights: &[Light]) -> NormalEquations {
        let mut system = NormalEquations::new(lights.len() * PARAMS);
        system.add(&jacobian.columns, residuals);
        for (i, light) in lights.iter().enumerate() {
            for (value, row) in self.objective.preferences(i, &self.mappings[i], light) {
                system.add_row(i * PARAMS, &row, value);
            }
        }
        system
    }

    /// None if the caller wants to stop.
    fn jacobian(
        &self,
        state: &State,
        width: f32,
        trust: &Trust,
        on_column: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<Option<Jacobian>, OptimiseError> {
        let units = self.objective.units(&state.lights, &self.draw)?;
        let mut columns = Vec::with_capacity(state.lights.len() * PARAMS);
        for (i, (light, mapping)) in state.lights.iter().zip(&self.mappings).enumerate() {
            for number in 0..LANES {
                if !mapping.is_free(&light.shape, number) {
                    columns.push(Vec::new());
                    continue;
                }
                let width = if lane::TURN.contains(&number) { TURN * width } else { width };
                columns.push(self.difference(&state.lights, i * PARAMS + number, width, trust)?);
                if on_column().is_break() {
                    return Ok(None);
                }
            }
            let by_radiance = mapping.radiance_slopes(light);
            columns.extend(by_radiance.map(|slope| self.by_radiance(state, i, slope, &units, trust)));
        }
        Ok(Some(Jacobian { columns }))
    }

    /// Derivatives of the residuals by an unconstrained value, from pictures at both sides.
    fn difference(
        &self,
        lights: &[Light],
        number: usize,
        width: f32,
        trust: &Trust,
    ) -> Result<Vec<f32>, OptimiseError> {
        let at = |step: f32| {
            let mut delta = vec![0.0; lights.len() * PARAMS];
            delta[number] = step;
            self.state(&self.moved(lights, &delta)).map(|state| state.trusted(trust))
        };
        let (above, below) = (at(width)?, at(-width)?);
        Ok(above.iter().zip(&below).map(|(above, below)| (above - below) / (2.0 * width)).collect())
    }

    /// Derivatives of the residuals by a value that changes a light's radiance so much; empty if it does not.
    fn by_radiance(
        &self,
        state: &State,
        number: usize,
        slope: [f32; 3],
        units: &[Vec<Unit>],
        trust: &Trust,
    ) -> Vec<f32> {
        if slope == [0.0; 3] {
            return Vec::new();
        }
        let mut column = Vec::new();
        let views = self.objective.views.iter().zip(&self.draw).zip(state.pictures.iter().zip(units));
        for ((view, draw), (picture, units)) in views {
            let change = |k: usize| std::array::from_fn(|c| slope[c] * units[number][k][c]);
            for comparison in view.compare_picture(picture, draw) {
                column.extend(comparison.push_forward(comparison.places().map(change)));
            }
        }
        column.iter_mut().enumerate().for_each(|(i, value)| *value *= trust.of(i));
        column
    }
}

impl State {
    /// Means of the two estimates, times their trust.
    fn trusted(&self, trust: &Trust) -> Vec<f32> {
        let [a, b] = &self.residuals;
        a.iter().zip(b).enumerate().map(|(i, (a, b))| trust.of(i) * 0.5 * (a + b)).collect()
    }
}

/// Derivatives of the weighted residuals by each unconstrained value; empty where there are none.
struct Jacobian {
    columns: Vec<Vec<f32>>,
}

impl Jacobian {
    /// Broyden's update (1965): the least change that makes it true for a step that was tried.
    fn learn(&mut self, delta: &[f32], before: &[f32], after: &[f32]) {
        let length2 = delta.iter().map(|d| d * d).sum::<f32>();
        let mut missing: Vec<f32> = before.iter().zip(after).map(|(before, after)| after - before).collect();
        for (column, delta) in self.columns.iter().zip(delta) {
            missing.iter_mut().zip(column).for_each(|(missing, slope)| *missing -= slope * delta);
        }
        if !(length2 > SHORTEST * SHORTEST && missing.iter().all(|missing| missing.is_finite())) {
            return;
        }
        self.columns.par_iter_mut().zip(delta).for_each(|(column, delta)| {
            let share = delta / length2;
            column.iter_mut().zip(&missing).for_each(|(slope, missing)| *slope += share * missing);
        });
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

    /// The step with a damped and raised diagonal, by Cholesky's decomposition; none where nothing has a slope. Values without
    /// one stay.
    fn solve(&self, damping: f64, raise: f64) -> Option<Vec<f64>> {
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
        (largest > 0.0 && step.iter().all(|value| value.is_finite())).then_some(step)
    }
}
