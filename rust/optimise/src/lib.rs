//! Solves light parameters by gradients through a relighter (paper, section 5.3), for lights of every type, several views at
//! once, and goals from target pictures to strokes.
//!
//! ```text
//! let goals = [Goal { criterion: Criterion::Target { image, exposure_invariant: false }, pixels: None, weight: 1.0 }];
//! let view = View { relight: &proxy, base: &static_and_world, still: vec![None], goals: &goals };
//! let problem = Problem { views: vec![view], variables: vec![Variable { light, locks, bounds, prior_weight: 0.0 }] };
//! let starts = random_starts(&problem, &options)?;        // or the lights of the scene
//! let solution = solve(&problem, &starts, &Settings::default(), &|step| ControlFlow::Continue(()))?;
//! let polished = polish(&through_the_gather, &[&solution.lights[..]], 24, &mut |step| ControlFlow::Continue(()))?;
//! ```
//!
//! Free parameters of a light are mapped to unconstrained values (`variable`), of which some have active bounds
//! (`active_bound`); goals become residuals of cells (`goal`, `term`); their squares and what moves cost (`preference`)
//! are the loss (`objective`). [`solve`] steps by Adam on random subsets, from several starts of which the worse are
//! given up; [`polish`] by Levenberg-Marquardt on exact pictures. [`regroupings`] and [`relocations`] lead out of local
//! minima, [`idle_lights`] finds lights that are not needed, [`report()`] says what became of each goal.

mod active_bound;
mod adam;
mod cells;
mod error;
mod goal;
mod least_squares;
mod objective;
mod polish;
mod preference;
mod problem;
mod prune;
mod random;
mod region;
mod regroup;
mod relight;
mod relocate;
mod report;
mod solve;
mod starts;
mod term;
mod uncertain;
mod variable;

pub use active_bound::{ChromaticityBound, DirectionCone};
pub use error::OptimiseError;
pub use goal::{Criterion, Goal};
pub use polish::{PolishStep, Polished, polish};
pub use problem::{Problem, View};
pub use prune::idle_lights;
pub use region::{Region, Stroke};
pub use regroup::regroupings;
pub use relight::{Compare, Linear, LossGradient, PictureCells, Relight, RelightError};
pub use relocate::relocations;
pub use report::{Report, Worst, conflicts, report};
pub use solve::{RunnerUp, Settings, Solution, SolverStep, solve};
pub use starts::{RandomStarts, random_starts};
pub use term::TermTarget;
pub use uncertain::is_uncertain;
pub use variable::{Bounds, Locks, Variable};

#[cfg(test)]
mod tests;
