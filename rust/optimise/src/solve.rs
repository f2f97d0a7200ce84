use crate::adam::Adam;
use crate::objective::{Draw, Objective};
use crate::problem::Problem;
use crate::random::{PixelSubset, Random};
use crate::variable::{Mapping, PARAMS};
use crate::{OptimiseError, Variable};
use rayon::prelude::*;
use relume_scene::Light;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Settings of the solver.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Most steps; 500 in the paper.
    pub iterations: usize,
    /// Adam's learning rate in unconstrained space; 0.05 in the paper.
    pub learning_rate: f32,
    /// Share of a goal's cells that each step looks at (paper, table 3).
    pub pixel_fraction: f32,
    /// Least number of them, however small the share.
    pub least_cells: usize,
    /// Softness of the lights at the first and the last steps ([`crate::Relight::values`]).
    pub softness: [f32; 2],
    /// Seed of starts and pixel subsets.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            iterations: 500,
            learning_rate: 0.05,
            pixel_fraction: 0.05,
            least_cells: 128,
            softness: [0.0; 2],
            seed: 0,
        }
    }
}

/// State of the solver; handed to the caller after every step.
#[derive(Clone, Copy, Debug)]
pub struct SolverStep<'a> {
    /// Number of the start.
    pub start: usize,
    /// Number of starts that are still followed.
    pub starts: usize,
    /// Number of the step within the start.
    pub iteration: usize,
    /// Loss on this step's cells.
    pub loss: f64,
    /// The lights before the step.
    pub lights: &'a [Light],
}

/// The best of all starts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Solution {
    /// The lights.
    pub lights: Vec<Light>,
    /// Loss over evenly spread cells.
    pub loss: f64,
    /// Loss of the start that it came from, over the same cells.
    pub start_loss: f64,
    /// Number of that start.
    pub start: usize,
    /// Loss of each of its steps, on that step's cells.
    pub losses: Vec<f64>,
    /// The start that came second, which may be the better one where losses are exact.
    pub runner_up: Option<RunnerUp>,
    /// True if the caller stopped it early; the lights are the best until then.
    pub cancelled: bool,
}

/// The second best of several starts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RunnerUp {
    /// The lights.
    pub lights: Vec<Light>,
    /// Loss of the start that they came from.
    pub start_loss: f64,
    /// Number of that start.
    pub start: usize,
    /// Loss of each of its steps, on that step's cells.
    pub losses: Vec<f64>,
}

/// Cells of each goal on which candidates are compared.
const CHECK_CELLS: usize = 1024;
/// Steps between comparisons. Losses of subsets are too noisy to tell the best step.
const CHECK_EVERY: usize = 25;
/// Parts of the way. Softness is constant within one; after each the worse half of the starts is given up.
const PARTS: usize = 8;
/// After so many parts only finalists are left.
const RACE: usize = 4;
const FINALISTS: usize = 2;
/// A start ends after so many comparisons of which none improves its loss by this share.
const PATIENCE: usize = 4;
const LEAST_GAIN: f64 = 1e-3;

/// Solves from each start and keeps the best: all starts side by side, the worse half given up again and again. `on_step` may
/// stop it; it is called from several threads.
///
/// # Errors
/// [`OptimiseError`] names the input that does not fit.
pub fn solve(
    problem: &Problem,
    starts: &[Vec<Light>],
    settings: &Settings,
    on_step: &(dyn Fn(SolverStep) -> ControlFlow<()> + Sync),
) -> Result<Solution, OptimiseError> {
    problem.validate()?;
    if !(settings.learning_rate > 0.0 && settings.pixel_fraction > 0.0) {
        return Err(OptimiseError::Settings("learning rate and pixel fraction must be above 0"));
    }
    let expected = problem.variables.len();
    if let Some(found) = starts.iter().map(Vec::len).find(|found| *found != expected) {
        return Err(OptimiseError::Lights { found, expected });
    }
    if starts.is_empty() {
        return Err(OptimiseError::Settings("at least one start is needed"));
    }
    let race = Race { problem, settings, on_step, cancelled: AtomicBool::new(false) };
    race.run(starts)
}

struct Race<'a> {
    problem: &'a Problem<'a>,
    settings: &'a Settings,
    on_step: &'a (dyn Fn(SolverStep) -> ControlFlow<()> + Sync),
    cancelled: AtomicBool,
}

/// State that the starts have in common in one part of the race.
struct RacePart<'a> {
    objective: &'a Objective<'a>,
    check: &'a StartCheck<'a>,
    iterations: std::ops::Range<usize>,
    starts: usize,
    may_end: bool,
}

/// Comparison of starts: the loss at the final softness over evenly spread cells.
struct StartCheck<'a> {
    objective: Objective<'a>,
    draw: Draw,
}

impl StartCheck<'_> {
    fn loss(&self, run: &StartRun) -> Result<f64, OptimiseError> {
        self.objective.loss(&run.mappings, &run.lights, &self.draw)
    }
}

impl Race<'_> {
    fn run(&self, starts: &[Vec<Light>]) -> Result<Solution, OptimiseError> {
        let [from, to] = self.settings.softness;
        let last = Objective::new(self.problem, to)?;
        let check = StartCheck { draw: last.spread(CHECK_CELLS), objective: last };
        let new = |(number, start): (usize, &Vec<Light>)| StartRun::new(self, number, start, &check);
        let mut runs = starts.par_iter().enumerate().map(new).collect::<Result<Vec<_>, _>>()?;
        for part in 0..PARTS {
            let softness =
                if to > 0.0 { from * (to / from).powf(part as f32 / (PARTS - 1) as f32) } else { 0.0 };
            let new = if softness == to { None } else { Some(Objective::new(self.problem, softness)?) };
            let at = |part: usize| part * self.settings.iterations / PARTS;
            let part = RacePart {
                objective: new.as_ref().unwrap_or(&check.objective),
                check: &check,
                iterations: at(part)..at(part + 1),
                starts: runs.len(),
                may_end: softness == to,
            };
            runs.par_iter_mut().try_for_each(|run| run.follow(self, &part))?;
            runs.retain(|run| run.best_loss.is_finite());
            runs.sort_by(|a, b| a.best_loss.total_cmp(&b.best_loss));
            let half = if part.iterations.end >= at(RACE) { 0 } else { runs.len().div_ceil(2) };
            runs.truncate(half.max(FINALISTS));
        }
        let mut runs = runs.into_iter();
        let best = runs.next().ok_or(OptimiseError::Diverged)?;
        let runner_up = |run: StartRun| RunnerUp {
            lights: run.best,
            start_loss: run.start_loss,
            start: run.number,
            losses: run.losses,
        };
        Ok(Solution {
            lights: best.best,
            loss: best.best_loss,
            start_loss: best.start_loss,
            start: best.number,
            losses: best.losses,
            runner_up: runs.next().map(runner_up),
            cancelled: self.cancelled.load(Ordering::Relaxed),
        })
    }
}

/// Descent from one start.
struct StartRun {
    number: usize,
    mappings: Vec<Mapping>,
    lights: Vec<Light>,
    adam: Adam,
    random: Random,
    /// For each term of each view.
    subsets: Vec<Vec<PixelSubset>>,
    losses: Vec<f64>,
    best: Vec<Light>,
    best_loss: f64,
    start_loss: f64,
    /// Comparisons since the last gain.
    stale: usize,
    has_ended: bool,
}

impl StartRun {
    fn new(race: &Race, number: usize, start: &[Light], check: &StartCheck) -> Result<Self, OptimiseError> {
        let subsets = check.objective.views.iter().map(|view| {
            let subset = |term: &crate::term::Term| {
                let share = race.settings.pixel_fraction.min(1.0) * term.len() as f32;
                PixelSubset::new(term.len(), (share as usize).max(race.settings.least_cells))
            };
            view.terms.iter().map(subset).collect()
        });
        let start = race.problem.within(start);
        let mut new = Self {
            number,
            mappings: mappings(race.problem, &start, race.settings.softness[1])?,
            lights: start.clone(),
            adam: Adam::new(race.problem.variables.len() * PARAMS, race.settings.learning_rate),
            random: Random::new(race.settings.seed ^ (number as u64) << 32),
            subsets: subsets.collect(),
            losses: Vec::new(),
            best: start,
            best_loss: 0.0,
            start_loss: 0.0,
            stale: 0,
            has_ended: false,
        };
        new.start_loss = check.loss(&new)?;
        new.best_loss = new.start_loss;
        Ok(new)
    }

    fn follow(&mut self, race: &Race, part: &RacePart) -> Result<(), OptimiseError> {
        for iteration in part.iterations.clone() {
            if self.has_ended || race.cancelled.load(Ordering::Relaxed) {
                return Ok(());
            }
            let random = &mut self.random;
            let draw = self.subsets.iter_mut();
            let draw = draw
                .map(|view| view.iter_mut().map(|subset| subset.draw(random).to_vec()).collect())
                .collect();
            let (loss, gradient) = part.objective.gradient(&self.mappings, &self.lights, &draw)?;
            let step =
                SolverStep { start: self.number, starts: part.starts, iteration, loss, lights: &self.lights };
            if (race.on_step)(step).is_break() {
                race.cancelled.store(true, Ordering::Relaxed);
            }
            self.losses.push(loss);
            if !(loss.is_finite() && gradient.as_flattened().iter().all(|g| g.is_finite())) {
                self.has_ended = true;
                return Ok(());
            }
            let step = self.adam.step(gradient.as_flattened());
            for ((light, mapping), delta) in
                self.lights.iter_mut().zip(&self.mappings).zip(step.as_chunks::<PARAMS>().0)
            {
                *light = mapping.step(light, delta);
            }
            if (iteration + 1) % CHECK_EVERY == 0 || iteration + 1 == part.iterations.end {
                self.compare(part)?;
            }
        }
        Ok(())
    }

    fn compare(&mut self, part: &RacePart) -> Result<(), OptimiseError> {
        let loss = part.check.loss(self)?;
        self.stale = if loss < (1.0 - LEAST_GAIN) * self.best_loss { 0 } else { self.stale + 1 };
        self.has_ended = part.may_end && self.stale > PATIENCE;
        if loss < self.best_loss {
            (self.best_loss, self.best) = (loss, self.lights.clone());
        }
        Ok(())
    }
}

/// The maps of all lights, with their units from where they are.
pub(crate) fn mappings(
    problem: &Problem,
    lights: &[Light],
    softness: f32,
) -> Result<Vec<Mapping>, OptimiseError> {
    let mapping = |(i, (light, variable)): (usize, (&Light, &Variable))| {
        let radiance = problem.matching_radiance(i, light, softness)? / lights.len() as f32;
        // Adam's steps are of one size: a light that is far stronger than its share would hardly move.
        let own = crate::variable::power(light).into_iter().fold(0.0, f32::max);
        let power_unit = own.max(radiance * light.shape.extent());
        Ok(Mapping { bounds: variable.bounds, locks: variable.locks, power_unit })
    };
    lights.iter().zip(&problem.variables).enumerate().map(mapping).collect()
}
