use crate::light::PARAMS;
use crate::objective::{Problem, RelightError, reinhard};
use crate::{Bounds, OptimiseError, SphereLight};
use glam::Vec3;
use relume_image::{Image, metrics};
use std::ops::ControlFlow;

/// Something that makes whole unit images of sphere lights, exact but without gradients, such as a gather.
pub trait UnitImages {
    /// Unit images (radiance 1, linear RGB) of spheres given by centre and radius, of the target's size.
    ///
    /// # Errors
    /// Whatever keeps it from making them.
    fn unit_images(&self, spheres: &[(Vec3, f32)]) -> Result<Vec<Image>, RelightError>;
}

/// Where a polish stands; handed to the caller after every step.
#[derive(Clone, Copy, Debug)]
pub struct PolishStep {
    /// Which step.
    pub iteration: usize,
    /// Mean squared tonemapped difference of block means.
    pub loss: f64,
}

/// Lights after [`polish`].
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Polished {
    /// The lights; those that it was given if nothing was better.
    pub lights: Vec<SphereLight>,
    /// Mean squared tonemapped difference of block means.
    pub loss: f64,
    /// That of the lights that it was given.
    pub start_loss: f64,
}

/// Pixels along the edge of the blocks whose means are compared: the noise of gathered pictures is an eighth there, and
/// a tonemapped mean is less biased by it than the mean of tonemapped pixels.
const BLOCK: usize = 8;
/// Steps of the central differences: of the centre in radii, of the radius as its logarithm. Large, because a gathered
/// picture changes by single segments.
const CENTER_STEP: f32 = 0.25;
const RADIUS_STEP: f32 = 0.15;
/// A further step that improves the loss by less than this share is the last.
const LEAST_GAIN: f64 = 1e-3;

/// Moves solved lights to where exact pictures fit the target best, by Levenberg-Marquardt steps (Marquardt 1963) with
/// derivatives from differences of pictures. A proxy's error is gone afterwards; the basin is still the one it found.
///
/// # Errors
/// As [`crate::solve`].
pub fn polish(
    problem: &Problem,
    exact: &dyn UnitImages,
    lights: &[SphereLight],
    steps: usize,
    on_step: &mut dyn FnMut(PolishStep) -> ControlFlow<()>,
) -> Result<Polished, OptimiseError> {
    problem.validate()?;
    if lights.len() != problem.locks.len() {
        return Err(OptimiseError::Starts { found: lights.len(), expected: problem.locks.len() });
    }
    let fit = Fit::new(problem, exact);
    let mut best = fit.at(lights)?;
    let start_loss = best.loss;
    let mut system = fit.normal_equations(&best)?;
    let mut damping = 1e-3;
    for iteration in 0..steps {
        let Some(delta) = system.solve(damping) else { break };
        let next = fit.at(&fit.moved(&best.lights, &delta))?;
        let gain = 1.0 - next.loss / best.loss;
        if gain > 0.0 {
            best = next;
            damping *= 0.1;
        } else {
            damping *= 8.0;
        }
        let stop = on_step(PolishStep { iteration, loss: best.loss }).is_break();
        if stop || (0.0..LEAST_GAIN).contains(&gain) || damping > 1e6 {
            break;
        }
        if gain > 0.0 {
            system = fit.normal_equations(&best)?;
        }
    }
    Ok(Polished { lights: best.lights, loss: best.loss, start_loss })
}

/// Lights, their pictures as block means, and what is wrong with the sum.
struct State {
    lights: Vec<SphereLight>,
    units: Vec<Vec<f32>>,
    /// Tonemapped difference and slope of the tonemapping for each value.
    residuals: Vec<(f32, f32)>,
    loss: f64,
}

struct Fit<'a> {
    exact: &'a dyn UnitImages,
    bounds: Bounds,
    /// Parameters that may move, as (light, lane): centre, logarithm of the radius, radiance.
    lanes: Vec<(usize, usize)>,
    base: Vec<f32>,
    /// Tonemapped.
    target: Vec<f32>,
    exposure: f32,
}

impl<'a> Fit<'a> {
    fn new(problem: &'a Problem, exact: &'a dyn UnitImages) -> Self {
        let exposure = metrics::exposure(problem.target);
        let target = block_means(problem.target).into_iter().map(|v| reinhard(exposure * v).0).collect();
        let base = block_means(problem.base);
        let lanes = (0..problem.locks.len()).flat_map(|light| (0..PARAMS).map(move |lane| (light, lane)));
        let lanes = lanes.filter(|(light, lane)| problem.locks[*light].free(*lane)).collect();
        Self { exact, bounds: problem.bounds, lanes, base, target, exposure }
    }

    fn at(&self, lights: &[SphereLight]) -> Result<State, OptimiseError> {
        let spheres: Vec<_> = lights.iter().map(|light| (light.center, light.radius)).collect();
        let units: Vec<_> = self.exact.unit_images(&spheres)?.iter().map(block_means).collect();
        let residual = |i: usize| {
            let sum: f32 =
                lights.iter().zip(&units).map(|(light, unit)| light.radiance[i % 3] * unit[i]).sum();
            let (tone, slope) = reinhard(self.exposure * (self.base[i] + sum));
            (tone - self.target[i], self.exposure * slope)
        };
        let residuals: Vec<_> = (0..self.target.len()).map(residual).collect();
        let loss = residuals.iter().map(|(r, _)| f64::from(r * r)).sum::<f64>() / residuals.len() as f64;
        Ok(State { lights: lights.to_vec(), units, residuals, loss })
    }

    fn normal_equations(&self, state: &State) -> Result<NormalEquations, OptimiseError> {
        let mut columns = Vec::with_capacity(self.lanes.len());
        for (i, lane) in &self.lanes {
            let (light, unit) = (&state.lights[*i], &state.units[*i]);
            let slopes = state.residuals.iter().map(|(_, slope)| slope);
            columns.push(match lane {
                0..=3 => {
                    let d_unit = self.difference(light, *lane)?;
                    slopes.enumerate().map(|(k, slope)| slope * light.radiance[k % 3] * d_unit[k]).collect()
                }
                _ => slopes
                    .enumerate()
                    .map(|(k, slope)| if k % 3 == lane - 4 { slope * unit[k] } else { 0.0 })
                    .collect::<Vec<f32>>(),
            });
        }
        Ok(NormalEquations::new(&columns, &state.residuals))
    }

    /// Derivative of a light's block means by one lane of its shape.
    fn difference(&self, light: &SphereLight, lane: usize) -> Result<Vec<f32>, OptimiseError> {
        let step = if lane < 3 { CENTER_STEP * light.radius } else { RADIUS_STEP };
        let images = self.exact.unit_images(&[-step, step].map(|step| {
            let mut delta = [0.0; 4];
            delta[lane] = step;
            (light.center + Vec3::from_slice(&delta), light.radius * delta[3].exp())
        }))?;
        let (low, high) = (block_means(&images[0]), block_means(&images[1]));
        Ok(low.iter().zip(&high).map(|(low, high)| (high - low) / (2.0 * step)).collect())
    }

    /// Lights after a step, within bounds; a radius changes by no more than half, a centre by two radii.
    fn moved(&self, lights: &[SphereLight], delta: &[f64]) -> Vec<SphereLight> {
        let mut moved = lights.to_vec();
        for (&(i, lane), delta) in self.lanes.iter().zip(delta) {
            let (light, delta) = (&mut moved[i], *delta as f32);
            match lane {
                0..3 => {
                    let reach = 2.0 * lights[i].radius;
                    light.center[lane] = (light.center[lane] + delta.clamp(-reach, reach))
                        .clamp(self.bounds.center_min[lane], self.bounds.center_max[lane]);
                }
                3 => {
                    light.radius = (light.radius * delta.clamp(-0.5, 0.5).exp())
                        .clamp(self.bounds.radius_min, self.bounds.radius_max);
                }
                _ => light.radiance[lane - 4] = (light.radiance[lane - 4] + delta).max(0.0),
            }
        }
        moved
    }
}

/// `J^T J` and `-J^T r`.
struct NormalEquations {
    matrix: Vec<Vec<f64>>,
    right: Vec<f64>,
}

impl NormalEquations {
    fn new(columns: &[Vec<f32>], residuals: &[(f32, f32)]) -> Self {
        let dot =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let matrix = columns.iter().map(|a| columns.iter().map(|b| dot(a, b)).collect()).collect();
        let against = |column: &Vec<f32>| {
            column.iter().zip(residuals).map(|(a, (r, _))| -f64::from(*a) * f64::from(*r)).sum()
        };
        Self { matrix, right: columns.iter().map(against).collect() }
    }

    /// The step with a damped diagonal, by Cholesky's decomposition; none where no lane has a slope.
    fn solve(&self, damping: f64) -> Option<Vec<f64>> {
        let n = self.right.len();
        let mut lower = vec![vec![0.0; n]; n];
        for row in 0..n {
            for column in 0..=row {
                let damped = if row == column { 1.0 + damping } else { 1.0 };
                let known: f64 = (0..column).map(|k| lower[row][k] * lower[column][k]).sum();
                let rest = self.matrix[row][column] * damped - known;
                lower[row][column] = if row == column { rest.sqrt() } else { rest / lower[column][column] };
            }
        }
        let mut step = self.right.clone();
        for row in 0..n {
            let known: f64 = (0..row).map(|k| lower[row][k] * step[k]).sum();
            step[row] = (step[row] - known) / lower[row][row];
        }
        for row in (0..n).rev() {
            let known: f64 = (row + 1..n).map(|k| lower[k][row] * step[k]).sum();
            step[row] = (step[row] - known) / lower[row][row];
        }
        (n > 0 && step.iter().all(|value| value.is_finite())).then_some(step)
    }
}

/// Means over blocks, row by row, RGB.
fn block_means(image: &Image) -> Vec<f32> {
    let (wide, high) = (image.width.div_ceil(BLOCK), image.height.div_ceil(BLOCK));
    let (mut sums, mut counts) = (vec![0.0; wide * high * 3], vec![0.0; wide * high]);
    for (i, value) in image.data.chunks_exact(3).enumerate() {
        let block = i / image.width / BLOCK * wide + i % image.width / BLOCK;
        (0..3).for_each(|c| sums[block * 3 + c] += value[c]);
        counts[block] += 1.0;
    }
    sums.iter().enumerate().map(|(i, sum)| sum / counts[i / 3]).collect()
}
