use crate::OptimiseError;
use crate::least_squares::{Jacobian, NormalEquations};
use crate::objective::{Draw, Objective, add, mean};
use crate::problem::Problem;
use crate::relight::Picture;
use crate::solve::mappings;
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
/// Shares of their range at which sizes are tried.
const SIZES: [f32; 7] = [0.07, 0.21, 0.36, 0.5, 0.64, 0.79, 0.93];
/// A size this near to an end of its range is where smoothing has left it to the noise: it says nothing.
const END: f32 = 0.1;
/// By so many of its standard deviations a gain must be above 0 to be believed.
const SURE: f64 = 2.0;
/// Noise, in units of its median, at which a cell counts half.
const HALF_TRUST: f32 = 2.0;
/// Cells to either side by which noise is told.
const AROUND: usize = 4;

/// Moves solved lights to where clean pictures serve the goals best, by Levenberg-Marquardt steps (Marquardt 1963) with
/// derivatives from differences of exact pictures; between them sizes are chosen, and last of all radiances solved, by exact
/// pictures alone. What a proxy or smoothing gets wrong is gone afterwards; the basin is still
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
    let mut best = start.clone();
    let (mut iteration, mut left, mut flow) = (0, [0.0, 0.0], ControlFlow::Continue(()));
    for (number, width) in STAGES.into_iter().enumerate() {
        if number > 0 {
            best = fit.with_best_sizes(best)?;
        }
        let before = fit.loss(&best, &Trust::default());
        flow = fit.descend(&mut best, width, &mut iteration, steps, on_step)?;
        left = [left[1], fit.loss(&best, &Trust::default()) / before.max(f64::MIN_POSITIVE)];
        let gains_little = left[0] * left[1] > 1.0 - LEAST_STAGE_GAIN;
        if flow.is_break() || gains_little || iteration >= steps {
            break;
        }
    }
    if flow.is_continue() {
        best = fit.with_exact_radiances(best)?;
    }
    let loss = fit.loss(&best, &Trust::default());
    let [before, after] =
        [&start, &best].map(|state| fit.residuals(&state.pictures, |picture| &picture.exact));
    let is_worse = Gain::new(&before, &after).mean < 0.0 && loss > start_loss;
    let (best, loss) = if is_worse { (start, start_loss) } else { (best, loss) };
    // A sum of products may fall below 0 by chance.
    Ok(Polished { lights: best.lights, loss: loss.max(0.0), start_loss: start_loss.max(0.0) })
}

/// Lights, and how far they are from the goals.
#[derive(Clone)]
struct State {
    lights: Vec<Light>,
    /// Of all views.
    pictures: Vec<Picture>,
    /// Of the clean pictures, weighted.
    residuals: [Vec<f32>; 2],
}

/// The picture to which differences that a light makes are added.
#[derive(Clone, Copy)]
enum Base {
    /// The clean one, for both halves.
    Clean,
    /// Its exact halves.
    Exact,
}

/// Factors on residuals, less where they are noisy; 1 where there are none.
#[derive(Default)]
struct Trust(Vec<f32>);

impl Trust {
    /// From how much the two estimates differ at the cells around each, not at itself: products of its two residuals would else
    /// count less where their noise happens to be of opposite sign, and their sum be least for the lights with the least noise.
    fn new([a, b]: &[Vec<f32>; 2]) -> Self {
        let square = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>();
        let noise: Vec<f32> = a.as_chunks().0.iter().zip(b.as_chunks().0).map(square).collect();
        let around = |i: usize| {
            let near = &noise[i.saturating_sub(AROUND)..(i + AROUND + 1).min(noise.len())];
            (near.iter().sum::<f32>() - noise[i]) / (near.len() - 1).max(1) as f32
        };
        let noise: Vec<f32> = (0..noise.len()).map(around).collect();
        let mut sorted = noise.clone();
        sorted.sort_by(f32::total_cmp);
        let half = HALF_TRUST * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let trust = |noise: &f32| if half > 0.0 { (half / (half + noise.max(0.0))).sqrt() } else { 1.0 };
        Self(noise.iter().flat_map(|noise| [trust(noise); 3]).collect())
    }

    fn of(&self, number: usize) -> f32 {
        self.0.get(number).copied().unwrap_or(1.0)
    }
}

/// By how much a loss is less than before, and the standard deviation of that. Both are estimated from the cells.
struct Gain {
    mean: f64,
    deviation: f64,
}

impl Gain {
    fn new(before: &[Vec<f32>; 2], after: &[Vec<f32>; 2]) -> Self {
        let products = |[a, b]: &[Vec<f32>; 2]| -> Vec<f64> {
            let of_cell = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] * b[c])).sum();
            a.as_chunks().0.iter().zip(b.as_chunks().0).map(of_cell).collect()
        };
        let gains: Vec<f64> =
            products(before).iter().zip(products(after)).map(|(before, after)| before - after).collect();
        let mean = gains.iter().sum::<f64>();
        let each = mean / gains.len().max(1) as f64;
        Self { mean, deviation: gains.iter().map(|gain| (gain - each).powi(2)).sum::<f64>().sqrt() }
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
        let trust = Trust::new(&best.residuals);
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
            let squares = squares_of_means(&before);
            let noise = squares / before[0].len() as f64;
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

    /// With the sizes that suit best of some over their whole range.
    fn with_best_sizes(&self, state: State) -> Result<State, OptimiseError> {
        let trust = Trust::new(&self.residuals(&state.pictures, |picture| &picture.exact));
        let mut lights = state.lights.clone();
        for (i, mapping) in self.mappings.iter().enumerate() {
            for number in lane::SIZE.filter(|number| mapping.is_free(&state.lights[i].shape, *number)) {
                if let Some(share) = self.best_size(&state, i, number, &trust)? {
                    lights[i] = mapping.with_size(&lights[i], number, share);
                }
            }
        }
        if lights == state.lights { Ok(state) } else { self.state(&lights) }
    }

    /// The share of its range that a size should have, if another than it has. A size shows in little but how soft shadows are: its
    /// derivatives are small, and denoising, which takes more from small lights than from large ones, counts as much. So exact
    /// pictures are compared, and a size is only taken if they leave little doubt; one at the end of its range is also left if
    /// they do not ask for it.
    fn best_size(
        &self,
        state: &State,
        light: usize,
        number: usize,
        trust: &Trust,
    ) -> Result<Option<f32>, OptimiseError> {
        let (mapping, now) = (&self.mappings[light], &state.lights[light]);
        let others = SIZES.map(|share| mapping.with_size(now, number, share));
        let tried: Vec<Light> = std::iter::once(now.clone()).chain(others).collect();
        let residuals = self.residuals_instead(state, light, &tried, trust, Base::Exact)?;
        let strain = |tried: &Light| {
            let preferences = self.objective.preferences(light, mapping, tried);
            preferences.iter().map(|(value, _)| f64::from(value * value)).sum::<f64>()
        };
        let gain = |(tried, after): (&Light, &[Vec<f32>; 2])| {
            let gain = Gain::new(&residuals[0], after);
            Gain { mean: gain.mean + strain(now) - strain(tried), ..gain }
        };
        let gains: Vec<Gain> = tried.iter().zip(&residuals).skip(1).map(gain).collect();
        let least = |gain: &Gain| gain.mean - SURE * gain.deviation;
        let best = SIZES.into_iter().zip(&gains).max_by(|(_, a), (_, b)| least(a).total_cmp(&least(b)));
        let best = best.filter(|(_, gain)| least(gain) > 0.0).map(|(share, _)| share);
        let is_at_end = !(END..=1.0 - END).contains(&mapping.size_share(now, number));
        let middle = &gains[SIZES.len() / 2];
        let to_middle = is_at_end && middle.mean + middle.deviation > 0.0;
        Ok(best.or(to_middle.then_some(SIZES[SIZES.len() / 2])))
    }

    /// With the radiances that exact pictures ask for, if they leave little doubt: denoising dims small lights.
    fn with_exact_radiances(&self, state: State) -> Result<State, OptimiseError> {
        let residuals = self.residuals(&state.pictures, |picture| &picture.exact);
        let (trust, exact) = (Trust::new(&residuals), State { residuals, ..state.clone() });
        let jacobian = self.jacobian(&exact, 0.0, &trust, &mut || ControlFlow::Continue(()))?;
        let system = jacobian.map(|jacobian| self.normal_equations(&jacobian, &exact, &trust));
        let trusted = exact.trusted(&trust);
        let noise = squares_of_means(&trusted) / trusted[0].len() as f64;
        let Some(delta) = system.and_then(|system| system.solve(0.0, noise / (LONGEST * LONGEST))) else {
            return Ok(state);
        };
        let delta: Vec<f32> = delta.iter().map(|d| *d as f32).collect();
        let next = self.state(&self.moved(&state.lights, &delta))?;
        let gain = Gain::new(&exact.residuals, &self.residuals(&next.pictures, |picture| &picture.exact));
        Ok(if gain.mean > SURE * gain.deviation { next } else { state })
    }

    fn state(&self, lights: &[Light]) -> Result<State, OptimiseError> {
        let pictures = self.objective.views.iter().map(|view| view.whole_picture(lights));
        let pictures = pictures.collect::<Result<Vec<_>, _>>()?;
        let residuals = self.residuals(&pictures, |picture| &picture.clean);
        Ok(State { lights: lights.to_vec(), pictures, residuals })
    }

    /// Weighted residuals of either half of the pictures of all views.
    fn residuals(&self, pictures: &[Picture], halves: fn(&Picture) -> &[Vec<[f32; 3]>; 2]) -> [Vec<f32>; 2] {
        let mut residuals = [Vec::new(), Vec::new()];
        for ((view, draw), picture) in self.objective.views.iter().zip(&self.draw).zip(pictures) {
            let comparisons = view.compare_picture(&mean(&picture.clean), draw);
            for (residuals, half) in residuals.iter_mut().zip(halves(picture)) {
                residuals.extend(view.residuals_beside(&comparisons, half, draw));
            }
        }
        residuals
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
    fn residuals_instead(
        &self,
        state: &State,
        number: usize,
        lights: &[Light],
        trust: &Trust,
        base: Base,
    ) -> Result<Vec<[Vec<f32>; 2]>, OptimiseError> {
        let mut residuals: Vec<[Vec<f32>; 2]> = vec![Default::default(); lights.len()];
        for ((view, draw), picture) in self.objective.views.iter().zip(&self.draw).zip(&state.pictures) {
            let is_other = |light: &&Light| light.shape != lights[0].shape;
            let shapes: Vec<&Light> = lights[..1].iter().chain(lights.iter().filter(is_other)).collect();
            let units = view.half_values(number, &shapes)?;
            let unit =
                |light: &Light| shapes.iter().position(|other| other.shape == light.shape).unwrap_or(0);
            let clean = mean(&picture.clean);
            let comparisons = view.compare_picture(&clean, draw);
            let by_light = lights.par_iter().map(|light| {
                [0, 1].map(|half| {
                    let mut picture = match base {
                        Base::Clean => clean.clone(),
                        Base::Exact => picture.exact[half].clone(),
                    };
                    add(&mut picture, &units[unit(light)][half], light.radiance);
                    add(&mut picture, &units[0][half], lights[0].radiance.map(|r| -r));
                    view.residuals_beside(&comparisons, &picture, draw)
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

impl State {
    /// Residuals times their trust.
    fn trusted(&self, trust: &Trust) -> [Vec<f32>; 2] {
        let of_half = |half: &Vec<f32>| half.iter().enumerate().map(|(i, r)| trust.of(i) * r).collect();
        self.residuals.each_ref().map(of_half)
    }
}

#[cfg(test)]
#[path = "polish_tests.rs"]
mod tests;
