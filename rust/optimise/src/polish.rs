mod fit;
mod noise;
mod sizes;

use crate::OptimiseError;
use crate::objective::Objective;
use crate::problem::Problem;
use crate::solve::mappings;
use fit::{Fit, FitState};
use noise::Trust;
use relume_scene::Light;
use std::ops::ControlFlow;

/// State of a polish; handed to the caller after every picture of derivatives and every step.
#[derive(Clone, Copy, Debug)]
pub struct PolishStep<'a> {
    /// Number of the step.
    pub iteration: usize,
    /// Loss of all cells.
    pub loss: f64,
    /// The best lights so far, of the candidate that is polished.
    pub lights: &'a [Light],
}

/// Lights after [`polish`].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Polished {
    /// The lights; those that it was given if nothing was better.
    pub lights: Vec<Light>,
    /// Number of the candidate that they were.
    pub candidate: usize,
    /// Loss of all cells of clean pictures.
    pub loss: f64,
    /// Loss of the candidate.
    pub start_loss: f64,
}

/// Cells of each goal that are looked at.
const MOST_CELLS: usize = 4096;
/// Half widths of the differences that stand for derivatives, of unconstrained values. A dump's picture changes by single
/// segments: wide differences have little noise, narrow ones little curvature. They are taken anew while that gains.
const STAGES: [f32; 8] = [0.5, 0.25, 0.25, 0.12, 0.5, 0.25, 0.25, 0.12];
/// Sizes are chosen before the second stage, and again after so many.
const SIZES_EVERY: usize = 2;
/// Two stages that together improve the loss by less than this share are the last ones, unless narrower differences are left.
const LEAST_STAGE_GAIN: f64 = 0.05;

/// Moves solved lights to where clean pictures serve the goals best, by Levenberg-Marquardt steps (Marquardt 1963) with
/// derivatives from differences of exact pictures; between them sizes are chosen, and last of all radiances solved, by exact
/// pictures alone. What a proxy or smoothing gets wrong is gone afterwards; the basin is still
/// the one that it found. At most `steps` steps are made.
///
/// Each of several candidates gets the first stage, which tells best which is best, and that one the others.
///
/// The loss is the sum of products of residuals by two halves of the paths, and its derivative that of slopes by one half and
/// residuals by the other: noise that both share would pull the lights to where there is least of it. So pictures of
/// derivatives need not be denoised, only those that are compared with the goals.
///
/// # Errors
/// Those of [`crate::solve`]; no candidate.
pub fn polish(
    problem: &Problem,
    candidates: &[&[Light]],
    steps: usize,
    on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
) -> Result<Polished, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, 0.0)?;
    let draw = objective.spread(MOST_CELLS);
    let (mut iteration, mut leader) = (0, None::<Polish>);
    for (number, lights) in candidates.iter().enumerate() {
        let lights = problem.within(lights);
        let fit = Fit::new(&objective, &draw, mappings(problem, &lights, 0.0)?);
        let mut candidate = Polish::new(number, &lights, fit)?;
        candidate.stage(&mut iteration, steps, on_step)?;
        if leader.as_ref().is_none_or(|leader| candidate.loss() < leader.loss()) {
            leader = Some(candidate);
        }
    }
    let mut polish = leader.ok_or(OptimiseError::Settings("at least one candidate is needed"))?;
    while polish.goes_on && iteration < steps {
        polish.stage(&mut iteration, steps, on_step)?;
    }
    polish.finish()
}

/// One candidate.
struct Polish<'a> {
    number: usize,
    fit: Fit<'a>,
    start: FitState,
    start_loss: f64,
    best: FitState,
    /// Stages that are done.
    stages: usize,
    /// Losses after the last two stages.
    left: [f64; 2],
    goes_on: bool,
    is_stopped: bool,
}

impl<'a> Polish<'a> {
    fn new(number: usize, lights: &[Light], mut fit: Fit<'a>) -> Result<Self, OptimiseError> {
        let mut start = fit.state(lights)?;
        fit.update_uncertainties(&mut start);
        let (start_loss, best) = (fit.loss(&start, &Trust::default()), start.clone());
        let (stages, left) = (0, [0.0; 2]);
        Ok(Self { number, fit, start, start_loss, best, stages, left, goes_on: true, is_stopped: false })
    }

    fn loss(&self) -> f64 {
        self.fit.loss(&self.best, &Trust::default())
    }

    fn stage(
        &mut self,
        iteration: &mut usize,
        steps: usize,
        on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
    ) -> Result<(), OptimiseError> {
        if self.stages % SIZES_EVERY == 1 {
            self.best = self.fit.with_best_sizes(self.best.clone())?;
        }
        let (before, width) = (self.loss(), STAGES[self.stages]);
        let (last, uncertainties) = (self.best.clone(), self.fit.uncertainties.clone());
        let flow = self.fit.descend(&mut self.best, width, iteration, steps, on_step)?;
        let after = self.loss();
        self.fit.update_uncertainties(&mut self.best);
        if self.loss() > before.max(after) {
            // Its whole gain is uncertain.
            (self.best, self.fit.uncertainties) = (last, uncertainties);
        }
        self.stages += 1;
        self.left = [self.left[1], self.loss() / before.max(f64::MIN_POSITIVE)];
        self.is_stopped = flow.is_break();
        let gains_enough = self.left[0] * self.left[1] <= 1.0 - LEAST_STAGE_GAIN;
        let may_gain = STAGES[self.stages..].iter().any(|next| gains_enough || *next < width);
        self.goes_on = !self.is_stopped && may_gain;
        Ok(())
    }

    fn finish(self) -> Result<Polished, OptimiseError> {
        let Self { number, fit, start, start_loss, mut best, is_stopped, .. } = self;
        if !is_stopped {
            best = fit.with_exact_radiances(best)?;
        }
        let loss = fit.loss(&best, &Trust::default());
        let is_worse = loss > start_loss && fit.exact_gain(&start, &best).mean < 0.0;
        let (best, loss) = if is_worse { (start, start_loss) } else { (best, loss) };
        // A sum of products may fall below 0 by chance.
        let [loss, start_loss] = [loss, start_loss].map(|loss| loss.max(0.0));
        Ok(Polished { lights: best.lights, candidate: number, loss, start_loss })
    }
}

#[cfg(test)]
mod tests;
