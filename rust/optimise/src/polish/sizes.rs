use super::fit::{Base, Fit, FitState};
use super::noise::{Gain, Trust};
use crate::OptimiseError;
use crate::variable::Mapping;
use relume_scene::{Light, lane};
use std::ops::ControlFlow;

/// Shares of their range at which sizes are tried.
const SIZES: [f32; 7] = [0.07, 0.21, 0.36, 0.5, 0.64, 0.79, 0.93];
/// A light's sizes are chosen anew at most so often: how large one side of an area light should be depends on the other.
const ROUNDS: usize = 4;
/// A size this near to an end of its range is where smoothing has left it to the noise: it says nothing.
const END: f32 = 0.1;
/// Largest factor of the loss of clean pictures by which an end of the range is left for the middle. A compromise:
/// denoising dims small lights, so that clean pictures dislike them a little even where they are right.
const MOST_DISLIKED: f64 = 2.0;
/// A size within this share of its range is where the artist had it.
const UNCHANGED: f32 = 1e-3;

/// Tests of sizes that need exact pictures: denoising takes more from small lights than from large ones, and dims them.
impl Fit<'_> {
    /// State with the sizes that suit best of some over their whole range.
    pub fn with_best_sizes(&self, state: FitState) -> Result<FitState, OptimiseError> {
        let trust = Trust::new(&self.exact_residuals(&state), &self.rows);
        let mut lights = state.lights.clone();
        for (number, light) in lights.iter_mut().enumerate() {
            for _ in 0..ROUNDS {
                let Some(better) = self.better_sized(&state, number, light, &trust)? else { break };
                *light = better;
            }
        }
        if lights == state.lights { Ok(state) } else { self.state(&lights) }
    }

    /// The light that is `now` in place of one of the state's, with better sizes; none if there are none. A size shows in little but
    /// how soft shadows are: its derivatives are small, and denoising counts as much. So exact pictures are compared, and
    /// others are only taken if they leave little uncertainty; one that was moved to the end of its range is also left if they
    /// like the middle better, and clean ones not much less.
    fn better_sized(
        &self,
        state: &FitState,
        number: usize,
        now: &Light,
        trust: &Trust,
    ) -> Result<Option<Light>, OptimiseError> {
        let groups = size_groups(&self.mappings[number], now);
        let sized = |group: &[usize], share: f32| {
            group
                .iter()
                .fold(now.clone(), |light, size| self.mappings[number].with_size(&light, *size, share))
        };
        let tried: Vec<Light> =
            groups.iter().flat_map(|group| SIZES.map(|share| sized(group, share))).collect();
        let gains = self.gains_instead(state, number, now, &tried, trust)?;
        let best = tried.iter().zip(&gains).max_by(|(_, a), (_, b)| a.least().total_cmp(&b.least()));
        if let Some((better, _)) = best.filter(|(_, gain)| gain.least() > 0.0) {
            return Ok(Some(better.clone()));
        }
        let middles = (SIZES.len() / 2..).step_by(SIZES.len());
        for (group, middle) in groups.iter().zip(middles) {
            let has_run = group.iter().all(|size| self.has_run_to_end(number, now, *size));
            let is_liked = has_run && gains[middle].mean > 0.0;
            if is_liked && self.is_hardly_disliked(&tried[middle], state, number, now)? {
                return Ok(Some(tried[middle].clone()));
            }
        }
        Ok(None)
    }

    /// True if clean pictures like a light not much less than the one that is `now` in place of one of the state's.
    fn is_hardly_disliked(
        &self,
        other: &Light,
        state: &FitState,
        number: usize,
        now: &Light,
    ) -> Result<bool, OptimiseError> {
        let [other, now] = [other, now].map(|light| self.clean_loss_with(state, number, light));
        Ok(other? <= MOST_DISLIKED * now?)
    }

    /// Loss of clean pictures with a light in place of one of the state's.
    fn clean_loss_with(&self, state: &FitState, number: usize, light: &Light) -> Result<f64, OptimiseError> {
        let mut lights = state.lights.clone();
        lights[number] = light.clone();
        Ok(self.loss(&self.state(&lights)?, &Trust::default()))
    }

    /// Gain of exact pictures, and of preferences with them, by others of a light that is `now` in place of one of the
    /// state's.
    fn gains_instead(
        &self,
        state: &FitState,
        number: usize,
        now: &Light,
        others: &[Light],
        trust: &Trust,
    ) -> Result<Vec<Gain>, OptimiseError> {
        let lights = [&[state.lights[number].clone(), now.clone()], others].concat();
        let residuals = self.residuals_instead(state, number, &lights, trust, Base::Exact)?;
        let gain = |(other, after): (&Light, &[Vec<f32>; 2])| {
            Gain::new(&residuals[1], after).plus(self.strain(number, now) - self.strain(number, other))
        };
        Ok(others.iter().zip(&residuals[2..]).map(gain).collect())
    }

    /// True if a size is at an end of its range to which the solver has moved it.
    fn has_run_to_end(&self, number: usize, light: &Light, size: usize) -> bool {
        let [share, was] = [light, &self.objective.problem.variables[number].light]
            .map(|light| self.mappings[number].size_share(light, size));
        !(END..=1.0 - END).contains(&share) && (share - was).abs() > UNCHANGED
    }

    /// State with the radiances that exact pictures ask for, if they leave little uncertainty.
    pub fn with_exact_radiances(&self, state: FitState) -> Result<FitState, OptimiseError> {
        let residuals = self.exact_residuals(&state);
        let (trust, exact) = (Trust::new(&residuals, &self.rows), FitState { residuals, ..state.clone() });
        let jacobian = self.jacobian(&exact, 0.0, &trust, &mut || ControlFlow::Continue(()))?;
        let delta = jacobian.and_then(|jacobian| {
            let system = self.normal_equations(&jacobian, &exact, &trust);
            self.step_of(system, &exact, 0.0, &trust)
        });
        let Some(delta) = delta else { return Ok(state) };
        let delta: Vec<f32> = delta.iter().map(|d| *d as f32).collect();
        let next = self.state(&self.moved(&state.lights, &delta))?;
        Ok(if self.exact_gain(&state, &next).least() > 0.0 { next } else { state })
    }

    /// Gain of one state over another by exact pictures.
    pub fn exact_gain(&self, before: &FitState, after: &FitState) -> Gain {
        let strain = |state: &FitState| self.objective.preference_loss(&self.mappings, &state.lights);
        let gain = Gain::new(&self.exact_residuals(before), &self.exact_residuals(after));
        gain.plus(strain(before) - strain(after))
    }

    fn exact_residuals(&self, state: &FitState) -> [Vec<f32>; 2] {
        self.residuals(&state.pictures, Base::Exact)
    }

    /// Cost of the move of a light.
    fn strain(&self, number: usize, light: &Light) -> f64 {
        let preferences = self.objective.preferences(number, &self.mappings[number], light);
        preferences.iter().map(|(value, _)| f64::from(value * value)).sum()
    }
}

/// The sizes of a light that are tried together: each that is free by itself, and both sides of an area light as one, since a light
/// that is too small on both is no better for being longer.
fn size_groups(mapping: &Mapping, light: &Light) -> Vec<Vec<usize>> {
    let free: Vec<usize> = lane::SIZE.filter(|size| mapping.is_free(&light.shape, *size)).collect();
    let each = free.iter().map(|size| vec![*size]);
    let all = (free.len() > 1).then(|| free.clone());
    each.chain(all).collect()
}
