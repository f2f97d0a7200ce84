use crate::adam::Adam;
use crate::objective::Objective;
use crate::random::{PixelSubset, Random};
use crate::{OptimiseError, Problem, SphereLight};
use std::ops::ControlFlow;

/// How the solver steps.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Steps of each start; 500 in the paper.
    pub iterations: usize,
    /// Adam's learning rate in unconstrained space; 0.05 in the paper.
    pub learning_rate: f32,
    /// Share of pixels that each step looks at (paper, table 3); at least 256 pixels.
    pub pixel_fraction: f32,
    /// Seed of the pixel subsets.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { iterations: 500, learning_rate: 0.05, pixel_fraction: 0.05, seed: 0 }
    }
}

/// Where the solver stands; handed to the caller before every step.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// Which start.
    pub start: usize,
    /// Which step of it.
    pub iteration: usize,
    /// Loss on this step's pixels.
    pub loss: f64,
    /// The lights before the step.
    pub lights: &'a [SphereLight],
}

/// The state of one step.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TrajectoryPoint {
    /// Step number.
    pub iteration: usize,
    /// Loss on that step's pixels.
    pub loss: f64,
    /// The lights.
    pub lights: Vec<SphereLight>,
}

/// The best of all starts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Solution {
    /// The lights.
    pub lights: Vec<SphereLight>,
    /// Loss over evenly spread pixels.
    pub loss: f64,
    /// Loss of the start that it came from, over the same pixels.
    pub start_loss: f64,
    /// Number of that start.
    pub start: usize,
    /// Its steps, one by one.
    pub trajectory: Vec<TrajectoryPoint>,
    /// Whether the caller stopped it early; the lights are the best until then.
    pub cancelled: bool,
}

/// Pixels on which candidates are compared.
const CHECK_PIXELS: usize = 4096;
/// Steps between comparisons. Subset losses are too noisy to tell the best step.
const CHECK_EVERY: usize = 25;

/// Solves from each start and keeps the best. `on_step` may stop it.
///
/// # Errors
/// [`OptimiseError`] names the input that does not fit.
pub fn solve(
    problem: &Problem,
    starts: &[Vec<SphereLight>],
    settings: &Settings,
    on_step: &mut dyn FnMut(Step) -> ControlFlow<()>,
) -> Result<Solution, OptimiseError> {
    problem.validate()?;
    if !(settings.learning_rate > 0.0 && settings.pixel_fraction > 0.0) {
        return Err(OptimiseError::Settings("learning rate and pixel fraction must be above 0"));
    }
    let expected = problem.locks.len();
    let wrong = starts.iter().map(Vec::len).find(|found| *found != expected || expected == 0);
    if starts.is_empty() || wrong.is_some() {
        return Err(OptimiseError::Starts { found: wrong.unwrap_or(0), expected });
    }
    let mut best: Option<Solution> = None;
    for (number, start) in starts.iter().enumerate() {
        let solution = run(problem, number, start, settings, on_step)?;
        let stop = solution.cancelled;
        if solution.loss.is_finite() && best.as_ref().is_none_or(|best| solution.loss < best.loss) {
            best = Some(solution);
        }
        if stop {
            best.iter_mut().for_each(|best| best.cancelled = true);
            break;
        }
    }
    best.ok_or(OptimiseError::Diverged)
}

fn run(
    problem: &Problem,
    number: usize,
    start: &[SphereLight],
    settings: &Settings,
    on_step: &mut dyn FnMut(Step) -> ControlFlow<()>,
) -> Result<Solution, OptimiseError> {
    let objective = Objective::new(problem, start)?;
    let check = problem.spread_pixels(CHECK_PIXELS);
    let mut u = objective.unconstrained(start);
    let start_loss = objective.loss(&u, &check)?;
    let (mut best, mut cancelled) = ((start_loss, u.clone()), false);
    let mut trajectory = Vec::with_capacity(settings.iterations);

    let share = settings.pixel_fraction.min(1.0) as f64 * problem.pixel_count() as f64;
    let mut subset = PixelSubset::new(problem.pixel_count(), (share as usize).max(256));
    let mut random = Random::new(settings.seed ^ (number as u64) << 32);
    let mut adam = Adam::new(u.len(), settings.learning_rate);
    for iteration in 0..settings.iterations {
        let (loss, gradient) = objective.gradient(&u, subset.draw(&mut random))?;
        let lights = objective.lights(&u);
        cancelled = on_step(Step { start: number, iteration, loss, lights: &lights }).is_break();
        trajectory.push(TrajectoryPoint { iteration, loss, lights });
        if cancelled || !(loss.is_finite() && gradient.iter().all(|g| g.is_finite())) {
            break;
        }
        adam.update(&mut u, &gradient);
        if (iteration + 1) % CHECK_EVERY == 0 || iteration + 1 == settings.iterations {
            keep_better(&mut best, &u, objective.loss(&u, &check)?);
        }
    }
    let (loss, u) = best;
    Ok(Solution { lights: objective.lights(&u), loss, start_loss, start: number, trajectory, cancelled })
}

fn keep_better(best: &mut (f64, Vec<f32>), u: &[f32], loss: f64) {
    if loss < best.0 {
        *best = (loss, u.to_vec());
    }
}

/// Random starts: centres uniform in the bounds, radii log-uniform, white, together as bright as the target.
///
/// # Errors
/// As [`solve`].
pub fn random_starts(
    problem: &Problem,
    count: usize,
    seed: u64,
) -> Result<Vec<Vec<SphereLight>>, OptimiseError> {
    problem.validate()?;
    let mut random = Random::new(seed);
    let bounds = &problem.bounds;
    let lights = problem.locks.len();
    let mut draw = || {
        let at = glam::Vec3::from_array(std::array::from_fn(|_| random.next_f32()));
        let mut light = SphereLight {
            center: bounds.center_min + at * (bounds.center_max - bounds.center_min),
            radius: bounds.radius_min * (bounds.radius_max / bounds.radius_min).powf(random.next_f32()),
            radiance: [1.0; 3],
        };
        light.radiance = [problem.matching_radiance(&light)? / lights as f32; 3];
        Ok(light)
    };
    (0..count).map(|_| (0..lights).map(|_| draw()).collect()).collect()
}
