use crate::OptimiseError;
use crate::least_squares::{Jacobian, NormalEquations};
use crate::objective::{Draw, Objective, add, mean};
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
/// segments: wide differences have little noise, narrow ones little curvature. They are taken anew while that gains.
const STAGES: [f32; 8] = [0.5, 0.25, 0.25, 0.12, 0.5, 0.25, 0.25, 0.12];
/// Radians for each unit of these widths: an eighth of a box is half a unit, an eighth of a radian as far.
const TURN: f32 = 0.25;
/// Of differences by radiance, which add no noise.
const BRIGHTEN: f32 = 0.05;
/// A further step that improves the loss by less than this share is the last of its stage.
const LEAST_GAIN: f64 = 1e-3;
/// So is the last of so many that improve nothing.
const PATIENCE: usize = 3;
/// Two stages that together improve it by less than this share are the last ones.
const LEAST_STAGE_GAIN: f64 = 0.05;
/// Longest step of an unconstrained value; also what is expected of one, against which its derivatives are weighed: what they say
/// less about than the residuals' scatter stays.
const LONGEST: f64 = 0.7;
/// A size in this share at the ends of its range is brought inside first, where the logistic function has a slope: smoothing
/// leaves it to the noise, which drives it there.
const MARGIN: f32 = 0.1;
/// Noise, in units of its median, at which a cell counts half.
const HALF_TRUST: f32 = 2.0;

/// Moves solved lights to where clean pictures serve the goals best, by Levenberg-Marquardt steps (Marquardt 1963) with
/// derivatives from differences of exact pictures. What a proxy or smoothing gets wrong is gone afterwards; the basin is still
/// the one that it found. At most `steps` steps are made.
///
/// The loss is the sum of products of residuals by two halves of the paths, and its derivative that of slopes by one half and
/// residuals by the other: noise that both share would pull the lights to where there is least of it. So pictures of
/// derivatives need not be denoised, only those that are compared with the goals.
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
    let (mut iteration, mut losses) = (0, vec![fit.loss(&best, &Trust::default())]);
    for width in STAGES {
        let flow = fit.descend(&mut best, width, &mut iteration, steps, on_step)?;
        losses.push(fit.loss(&best, &Trust::default()));
        let gains_little = matches!(losses[..], [.., a, _, b] if b > (1.0 - LEAST_STAGE_GAIN) * a);
        if flow.is_break() || gains_little || iteration >= steps {
            break;
        }
    }
    let loss = losses[losses.len() - 1];
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
            let [a, b] = &before;
            let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(0.5 * (a + b)).powi(2)).sum();
            let noise = squares / a.len() as f64;
            let system = self.normal_equations(&jacobian, best, &trust);
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

    fn normal_equations(&self, jacobian: &Jacobian, state: &State, trust: &Trust) -> NormalEquations {
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
    fn jacobian(
        &self,
        state: &State,
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
                    moved.push(mapping.step(light, &delta));
                }
            }
            let mut residuals = self.residuals_instead(state, i, &moved, trust)?.into_iter().skip(1);
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

    /// Residuals with some lights instead of one, the first of which is that one itself: of the clean picture with the difference
    /// that each half of the paths makes.
    fn residuals_instead(
        &self,
        state: &State,
        number: usize,
        lights: &[Light],
        trust: &Trust,
    ) -> Result<Vec<[Vec<f32>; 2]>, OptimiseError> {
        let mut residuals: Vec<[Vec<f32>; 2]> = vec![Default::default(); lights.len()];
        for ((view, draw), picture) in self.objective.views.iter().zip(&self.draw).zip(&state.pictures) {
            let is_other = |light: &&Light| light.shape != lights[0].shape;
            let shapes: Vec<&Light> = lights[..1].iter().chain(lights.iter().filter(is_other)).collect();
            let units = view.half_values(number, &shapes)?;
            let unit =
                |light: &Light| shapes.iter().position(|other| other.shape == light.shape).unwrap_or(0);
            let by_light = lights.par_iter().map(|light| {
                [0, 1].map(|half| {
                    let mut picture = picture.clone();
                    add(&mut picture, &units[unit(light)][half], light.radiance);
                    add(&mut picture, &units[0][half], lights[0].radiance.map(|r| -r));
                    let comparisons = view.compare_picture(&picture, draw);
                    comparisons.iter().flat_map(Comparison::weighted_residuals).collect::<Vec<_>>()
                })
            });
            let by_light: Vec<_> = by_light.collect();
            for (residuals, new) in residuals.iter_mut().zip(by_light) {
                residuals.iter_mut().zip(new).for_each(|(residuals, new)| residuals.extend(new));
            }
        }
        for residuals in residuals.as_flattened_mut() {
            residuals.iter_mut().enumerate().for_each(|(i, residual)| *residual *= trust.of(i));
        }
        Ok(residuals)
    }
}

/// Half widths of the differences for each free value.
fn widths(mapping: &Mapping, light: &Light, width: f32) -> impl Iterator<Item = (usize, f32)> {
    let of_value = move |number: usize| match number {
        LANES.. => (number, BRIGHTEN),
        _ if lane::TURN.contains(&number) => (number, TURN * width),
        _ => (number, width),
    };
    (0..PARAMS).filter(|number| mapping.is_free(&light.shape, *number)).map(of_value)
}

impl State {
    /// Residuals times their trust.
    fn trusted(&self, trust: &Trust) -> [Vec<f32>; 2] {
        let of_half = |half: &Vec<f32>| half.iter().enumerate().map(|(i, r)| trust.of(i) * r).collect();
        self.residuals.each_ref().map(of_half)
    }
}
