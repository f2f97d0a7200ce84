use super::fit::{Base, Fit, State};
use super::noise::{Gain, Trust};
use crate::OptimiseError;
use relume_scene::{Light, lane};
use std::ops::ControlFlow;

/// Shares of their range at which sizes are tried.
const SIZES: [f32; 7] = [0.07, 0.21, 0.36, 0.5, 0.64, 0.79, 0.93];
/// A size this near to an end of its range is where smoothing has left it to the noise: it says nothing.
const END: f32 = 0.1;
/// A size within this share of its range is where the artist had it.
const UNCHANGED: f32 = 1e-3;

/// What only exact pictures tell: denoising takes more from small lights than from large ones, and dims them.
impl Fit<'_> {
    /// With the sizes that suit best of some over their whole range.
    pub fn with_best_sizes(&self, state: State) -> Result<State, OptimiseError> {
        let trust = Trust::new(&self.exact_residuals(&state));
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
    /// derivatives are small, and denoising counts as much. So exact pictures are compared, and a size is only taken if they
    /// leave little doubt; one that was moved to the end of its range is also left if they do not ask for it.
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
        let gain = |(tried, after): (&Light, &[Vec<f32>; 2])| {
            let gain = Gain::new(&residuals[0], after);
            Gain { mean: gain.mean + self.strain(light, now) - self.strain(light, tried), ..gain }
        };
        let gains: Vec<Gain> = tried.iter().zip(&residuals).skip(1).map(gain).collect();
        let best = SIZES.into_iter().zip(&gains).max_by(|(_, a), (_, b)| a.least().total_cmp(&b.least()));
        let best = best.filter(|(_, gain)| gain.least() > 0.0).map(|(share, _)| share);
        let share = mapping.size_share(now, number);
        let was = mapping.size_share(&self.objective.problem.variables[light].light, number);
        let has_run_to_end = !(END..=1.0 - END).contains(&share) && (share - was).abs() > UNCHANGED;
        let middle = &gains[SIZES.len() / 2];
        let to_middle = has_run_to_end && middle.mean + middle.deviation > 0.0;
        Ok(best.or(to_middle.then_some(SIZES[SIZES.len() / 2])))
    }

    /// With the radiances that exact pictures ask for, if they leave little doubt.
    pub fn with_exact_radiances(&self, state: State) -> Result<State, OptimiseError> {
        let residuals = self.exact_residuals(&state);
        let (trust, exact) = (Trust::new(&residuals), State { residuals, ..state.clone() });
        let jacobian = self.jacobian(&exact, 0.0, &trust, &mut || ControlFlow::Continue(()))?;
        let delta = jacobian.and_then(|jacobian| {
            let system = self.normal_equations(&jacobian, &exact, &trust);
            system.solve(0.0, exact.expected_square(&trust))
        });
        let Some(delta) = delta else { return Ok(state) };
        let delta: Vec<f32> = delta.iter().map(|d| *d as f32).collect();
        let next = self.state(&self.moved(&state.lights, &delta))?;
        Ok(if self.exact_gain(&state, &next).least() > 0.0 { next } else { state })
    }

    /// By how much exact pictures prefer one state to another.
    pub fn exact_gain(&self, before: &State, after: &State) -> Gain {
        let gain = Gain::new(&self.exact_residuals(before), &self.exact_residuals(after));
        let strain = |state: &State| self.objective.preference_loss(&self.mappings, &state.lights);
        Gain { mean: gain.mean + strain(before) - strain(after), ..gain }
    }

    fn exact_residuals(&self, state: &State) -> [Vec<f32>; 2] {
        self.residuals(&state.pictures, |picture| &picture.exact)
    }

    /// What the move of a light costs.
    fn strain(&self, number: usize, light: &Light) -> f64 {
        let preferences = self.objective.preferences(number, &self.mappings[number], light);
        preferences.iter().map(|(value, _)| f64::from(value * value)).sum()
    }
}
