use super::PolishStep;
use super::noise::{Rows, Trust};
use crate::OptimiseError;
use crate::active_bound::ActiveBound;
use crate::least_squares::{Jacobian, NormalEquations};
use crate::objective::{Draw, Objective, ViewObjective, mean};
use crate::relight::PictureCells;
use crate::term::Uncertainty;
use crate::variable::{Mapping, PARAMS};
use rayon::prelude::*;
use relume_scene::{LANES, Light, lane};
use std::ops::ControlFlow;

/// Radians for each unit of a difference's width: an eighth of a box is half a unit, an eighth of a radian as far.
const TURN: f32 = 0.25;
/// Half width of differences by radiance, which add no noise.
const BRIGHTEN: f32 = 0.05;
/// A further step that improves the loss by less than this share is the last of its stage.
const LEAST_GAIN: f64 = 1e-3;
/// Number of steps in a row without improvement after which a stage ends.
const PATIENCE: usize = 5;
/// Longest step of an unconstrained value; also what is expected of one, against which its derivatives are weighed: what they say
/// less about than the residuals' scatter stays.
const LONGEST: f64 = 0.7;

/// Lights, and how far they are from the goals.
#[derive(Clone)]
pub(super) struct FitState {
    pub lights: Vec<Light>,
    /// Pictures of all views.
    pub pictures: Vec<PictureCells>,
    /// Weighted residuals of the clean pictures.
    pub residuals: [Vec<f32>; 2],
}

impl FitState {
    /// Residuals times their trust.
    fn trusted(&self, trust: &Trust) -> [Vec<f32>; 2] {
        let of_half = |half: &Vec<f32>| half.iter().enumerate().map(|(i, r)| trust.of(i) * r).collect();
        self.residuals.each_ref().map(of_half)
    }

    /// The square of a residual that a value leaves which is [`LONGEST`] from where it should be.
    pub fn expected_square(&self, trust: &Trust) -> f64 {
        squares_of_means(&self.trusted(trust)) / self.residuals[0].len() as f64 / (LONGEST * LONGEST)
    }
}

/// The picture to which differences that a light makes are added.
#[derive(Clone, Copy)]
pub(super) enum Base {
    /// The clean one, for both halves.
    Clean,
    /// Exact halves of the pictures.
    Exact,
}

/// Pictures of lights against the goals.
pub(super) struct Fit<'a> {
    pub objective: &'a Objective<'a>,
    pub draw: &'a Draw,
    pub mappings: Vec<Mapping>,
    /// Goals and cells that residuals belong to.
    pub rows: Rows,
    /// Uncertainty of the means of each view's terms, as last updated.
    pub uncertainties: Vec<Vec<Uncertainty>>,
}

impl<'a> Fit<'a> {
    pub fn new(objective: &'a Objective<'a>, draw: &'a Draw, mappings: Vec<Mapping>) -> Self {
        let goals = objective.views.iter().zip(draw).flat_map(|(view, draw)| view.terms.iter().zip(draw));
        let rows = Rows::new(goals.map(|(term, draw)| (draw.len(), term.has_mean())));
        let none = |view: &ViewObjective| vec![Uncertainty::NONE; view.terms.len()];
        Self { objective, draw, mappings, rows, uncertainties: objective.views.iter().map(none).collect() }
    }

    /// Updates the uncertainty of means at these lights. It is taken for the same at those nearby: noise itself would lead
    /// small steps astray.
    pub fn update_uncertainties(&mut self, state: &mut FitState) {
        let views = self.objective.views.iter().zip(self.draw).zip(&state.pictures);
        self.uncertainties = views.map(|((view, draw), picture)| view.uncertainties(picture, draw)).collect();
        state.residuals = self.residuals(&state.pictures, Base::Clean);
    }

    /// Steps until nothing is gained any more, or there were `most`; whether the caller wants to stop altogether.
    pub fn descend(
        &self,
        best: &mut FitState,
        width: f32,
        iteration: &mut usize,
        most: usize,
        on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, OptimiseError> {
        let trust = Trust::new(&best.residuals, &self.rows);
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
            let system = self.normal_equations(&jacobian, best, &trust);
            let Some(delta) = self.step_of(system, best, damping, &trust) else { break };
            let longest = delta.iter().fold(LONGEST, |most, d| most.max(d.abs()));
            let delta: Vec<f32> = delta.iter().map(|d| (d * LONGEST / longest) as f32).collect();
            let next = self.state(&self.moved(&best.lights, &delta))?;
            let (next_loss, after) = (self.loss(&next, &trust), next.trusted(&trust));
            jacobian.learn(&delta, &before, &after);
            let gain = (loss - next_loss) / squares_of_means(&before).max(f64::MIN_POSITIVE);
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

    pub fn state(&self, lights: &[Light]) -> Result<FitState, OptimiseError> {
        let pictures = self.objective.views.iter().map(|view| view.whole_picture(lights));
        let pictures = pictures.collect::<Result<Vec<_>, _>>()?;
        let residuals = self.residuals(&pictures, Base::Clean);
        Ok(FitState { lights: lights.to_vec(), pictures, residuals })
    }

    /// Weighted residuals of either half of the pictures of all views, clean or exact.
    pub fn residuals(&self, pictures: &[PictureCells], of: Base) -> [Vec<f32>; 2] {
        let mut residuals = [Vec::new(), Vec::new()];
        for (((view, draw), uncertainties), picture) in self.views().zip(pictures) {
            let comparisons = view.compare_picture(picture, uncertainties, draw);
            let halves = match of {
                Base::Clean => &picture.clean,
                Base::Exact => &picture.exact,
            };
            for (residuals, half) in residuals.iter_mut().zip(halves) {
                residuals.extend(view.residuals_beside(&comparisons, half, draw));
            }
        }
        self.rows.join_means(&mut residuals);
        residuals
    }

    /// Views with the drawn cells of their terms, and the uncertainties.
    fn views(&self) -> impl Iterator<Item = ((&ViewObjective<'a>, &Vec<Vec<u32>>), &Vec<Uncertainty>)> {
        self.objective.views.iter().zip(self.draw).zip(&self.uncertainties)
    }

    /// Sum of the products of two estimates: that of squares without what noise adds.
    pub fn loss(&self, state: &FitState, trust: &Trust) -> f64 {
        let [a, b] = &state.residuals;
        let product = |(i, (a, b)): (usize, (&f32, &f32))| f64::from(a * b) * f64::from(trust.of(i)).powi(2);
        let goals: f64 = a.iter().zip(b).enumerate().map(product).sum();
        let loss = goals + self.objective.preference_loss(&self.mappings, &state.lights);
        if loss.is_finite() { loss } else { f64::INFINITY }
    }

    pub fn moved(&self, lights: &[Light], delta: &[f32]) -> Vec<Light> {
        let of_light =
            |((light, mapping), delta): ((&Light, &Mapping), &[f32; PARAMS])| mapping.step(light, delta);
        lights.iter().zip(&self.mappings).zip(delta.as_chunks::<PARAMS>().0).map(of_light).collect()
    }

    /// The step that solves a state's equations, to bounds and along them where it would lead through. Of each light's bounds that are
    /// passed only the one that is passed furthest is taken at a time: along it the others may not be met.
    pub fn step_of(
        &self,
        mut system: NormalEquations,
        state: &FitState,
        damping: f64,
        trust: &Trust,
    ) -> Option<Vec<f64>> {
        let lights = state.lights.iter().zip(&self.mappings);
        let mut bounds: Vec<Vec<_>> =
            lights.map(|(light, mapping)| mapping.active_bounds(light).collect()).collect();
        loop {
            let step = system.solve(damping, state.expected_square(trust))?;
            let mut is_within = true;
            for (i, bounds) in bounds.iter_mut().enumerate() {
                let first = i * PARAMS;
                let beyond = |bound: &ActiveBound| bound.overshoot(&step[first..first + PARAMS]);
                let by_depth = |(_, a): &(usize, f64), (_, b): &(usize, f64)| a.total_cmp(b);
                let deepest = bounds.iter().map(beyond).enumerate().max_by(by_depth);
                if let Some((number, _)) = deepest.filter(|(_, beyond)| *beyond > 0.0) {
                    let bound = bounds.swap_remove(number);
                    system.hold(first, &bound.normal, bound.distance);
                    is_within = false;
                }
            }
            if is_within {
                return Some(step);
            }
        }
    }

    pub fn normal_equations(&self, jacobian: &Jacobian, state: &FitState, trust: &Trust) -> NormalEquations {
        let lights = &state.lights;
        let mut system = NormalEquations::new(lights.len() * PARAMS);
        system.add(jacobian, &state.trusted(trust));
        for (i, light) in lights.iter().enumerate() {
            for (value, row) in self.objective.preferences(i, &self.mappings[i], light) {
                system.add_row(i * PARAMS, &row, value);
            }
        }
        system
    }

    /// Differences of pictures at both sides of each free value. None if the caller wants to stop.
    pub fn jacobian(
        &self,
        state: &FitState,
        width: f32,
        trust: &Trust,
        on_light: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<Option<Jacobian>, OptimiseError> {
        let mut columns = Vec::with_capacity(state.lights.len() * PARAMS);
        for (i, (light, mapping)) in state.lights.iter().zip(&self.mappings).enumerate() {
            let mut moved = vec![light.clone()];
            for (number, width) in widths(mapping, light, width) {
                for step in [width, -width] {
                    let mut delta = [0.0; PARAMS];
                    delta[number] = step;
                    moved.push(mapping.free_step(light, &delta));
                }
            }
            let mut residuals =
                self.residuals_instead(state, i, &moved, trust, Base::Clean)?.into_iter().skip(1);
            let mut of_light: [[Vec<f32>; 2]; PARAMS] = std::array::from_fn(|_| Default::default());
            for (number, width) in widths(mapping, light, width) {
                let Some((above, below)) = residuals.next().zip(residuals.next()) else { break };
                let slope = |(above, below): (&f32, &f32)| (above - below) / (2.0 * width);
                of_light[number] =
                    [0, 1].map(|half| above[half].iter().zip(&below[half]).map(slope).collect());
            }
            columns.extend(of_light);
            if on_light().is_break() {
                return Ok(None);
            }
        }
        Ok(Some(Jacobian { columns }))
    }

    /// Residuals with some lights instead of one, the first of which is that one itself, by the differences that either half of the
    /// paths makes.
    pub fn residuals_instead(
        &self,
        state: &FitState,
        number: usize,
        lights: &[Light],
        trust: &Trust,
        base: Base,
    ) -> Result<Vec<[Vec<f32>; 2]>, OptimiseError> {
        let mut residuals: Vec<[Vec<f32>; 2]> = vec![Default::default(); lights.len()];
        for (((view, draw), uncertainties), picture) in self.views().zip(&state.pictures) {
            let is_other = |light: &&Light| light.shape != lights[0].shape;
            let shapes: Vec<&Light> = lights[..1].iter().chain(lights.iter().filter(is_other)).collect();
            let cells = all_of(view.cells_of(draw));
            let units = view.half_values(number, &shapes, &cells)?;
            let unit =
                |light: &Light| shapes.iter().position(|other| other.shape == light.shape).unwrap_or(0);
            let clean = mean(&picture.clean);
            let comparisons = view.compare_picture(picture, uncertainties, draw);
            let by_light = lights.par_iter().map(|light| {
                [0, 1].map(|half| {
                    let mut picture = match base {
                        Base::Clean => clean.clone(),
                        Base::Exact => picture.exact[half].clone(),
                    };
                    add_at(&mut picture, &cells, &units[unit(light)][half], light.radiance);
                    add_at(&mut picture, &cells, &units[0][half], lights[0].radiance.map(|r| -r));
                    view.residuals_beside(&comparisons, &picture, draw)
                })
            });
            let by_light: Vec<_> = by_light.collect();
            for (residuals, new) in residuals.iter_mut().zip(by_light) {
                residuals.iter_mut().zip(new).for_each(|(residuals, new)| residuals.extend(new));
            }
        }
        residuals.iter_mut().for_each(|residuals| self.rows.join_means(residuals));
        for residuals in residuals.as_flattened_mut() {
            residuals.iter_mut().enumerate().for_each(|(i, residual)| *residual *= trust.of(i));
        }
        Ok(residuals)
    }
}

/// Each number once, rising.
fn all_of(mut cells: Vec<u32>) -> Vec<u32> {
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// Adds values of some cells times a radiance to a picture.
fn add_at(picture: &mut [[f32; 3]], cells: &[u32], values: &[[f32; 3]], radiance: [f32; 3]) {
    for (cell, value) in cells.iter().zip(values) {
        (0..3).for_each(|c| picture[*cell as usize][c] += radiance[c] * value[c]);
    }
}

/// Sum of the squares of the means of two estimates.
fn squares_of_means([a, b]: &[Vec<f32>; 2]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(0.5 * (a + b)).powi(2)).sum()
}

/// Half widths of the differences for each free value; with width 0 for those of the radiance alone.
fn widths(mapping: &Mapping, light: &Light, width: f32) -> impl Iterator<Item = (usize, f32)> {
    let of_value = move |number: usize| match number {
        LANES.. => (number, BRIGHTEN),
        _ if lane::TURN.contains(&number) => (number, TURN * width),
        _ => (number, width),
    };
    let first = if width > 0.0 { 0 } else { LANES };
    (first..PARAMS).filter(|number| mapping.is_free(&light.shape, *number)).map(of_value)
}
