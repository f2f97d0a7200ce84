//! Solves light parameters by gradients through a relighter (paper, section 5.3).
//!
//! ```text
//! let problem = Problem { relight: &proxy, target: &target, base: &static_and_world, bounds, locks: vec![Locks::default()] };
//! let starts = random_starts(&problem, 8, seed)?;         // or the lights of the scene
//! let solution = solve(&problem, &starts, &Settings::default(), &mut |step| ControlFlow::Continue(()))?;
//! let polished = polish(&problem, &gather, &solution.lights, 12, &mut |step| ControlFlow::Continue(()))?;
//! polished.lights                                         // centre, radius, radiance of each
//! ```
//!
//! Position and radius are the logistic function of an unconstrained value within their bounds, radiance is a
//! softplus, so that Adam may step freely. The loss is the mean squared error of Reinhard-tonemapped pixels on a
//! random subset drawn afresh for each step. [`polish`] then takes out the proxy's error with exact pictures.

mod adam;
mod error;
mod light;
mod objective;
mod polish;
mod random;
mod solve;

pub use error::OptimiseError;
pub use light::{Bounds, Locks, SphereLight};
pub use objective::{Compare, Problem, Relight, RelightError};
pub use polish::{PolishStep, Polished, UnitImages, polish};
pub use solve::{Settings, Solution, Step, TrajectoryPoint, random_starts, solve};
