use crate::OptimiseError;
use crate::objective::Objective;
use crate::problem::Problem;
use relume_scene::Light;

/// Cells of each goal by which lights are judged.
const JUDGED: usize = 4096;
/// A light that lowers the loss by less than this share of it does nothing: it may fit the noise of the goals by as much.
const LEAST_USE: f64 = 0.1;
/// Loss that nobody sees, a hundredth of that of half a step of an eight-bit picture.
const INVISIBLE: f64 = 0.01 / (510.0 * 510.0);

/// Those of some lights that may go because the goals do not need them, the least needed first. `softness` is that of the
/// comparison.
///
/// # Errors
/// See [`crate::solve`].
pub fn idle_lights(
    problem: &Problem,
    lights: &[Light],
    may_go: &[bool],
    softness: f32,
) -> Result<Vec<usize>, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, softness)?;
    let draw = objective.spread(JUDGED);
    let units = objective.units(lights, &draw)?;
    let mut left = lights.to_vec();
    let mut loss = objective.loss_of_goals(&left, &units, &draw);
    let mut idle = Vec::new();
    loop {
        let without = |i: usize| {
            let mut lights = left.clone();
            lights[i].radiance = [0.0; 3];
            (i, objective.loss_of_goals(&lights, &units, &draw))
        };
        let candidates = (0..lights.len()).filter(|i| may_go[*i] && !idle.contains(i)).map(without);
        let Some((number, next)) = candidates.min_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if next > loss * (1.0 + LEAST_USE) + INVISIBLE {
            break;
        }
        left[number].radiance = [0.0; 3];
        idle.push(number);
        loss = loss.min(next);
    }
    Ok(idle)
}
