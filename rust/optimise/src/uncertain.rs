use crate::OptimiseError;
use crate::objective::Objective;
use crate::problem::Problem;
use crate::term::GoalComparison;
use relume_scene::Light;

/// Cells of each goal by which lights are judged.
const JUDGED: usize = 4096;

/// True if some lights may do less than was asked for by amount, by exact or clean pictures and within the noise
/// assumed while polishing, or if they do far more, or change much of what is to be kept.
///
/// # Errors
/// See [`crate::solve`].
pub fn is_uncertain(problem: &Problem, lights: &[Light]) -> Result<bool, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, 0.0)?;
    for (view, draw) in objective.views.iter().zip(&objective.spread(JUDGED)) {
        let picture = view.whole_picture(lights)?;
        let uncertainties = view.uncertainties(&picture, draw);
        if view.compare_picture(&picture, &uncertainties, draw).iter().any(GoalComparison::is_off) {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{FLOOR, flat, lamps, variable};
    use crate::{Criterion, Goal, View};

    #[test]
    fn what_is_short_or_far_too_much_is_uncertain() {
        let (base, lights) = (flat(0.0), &lamps()[..1]);
        let uncertain = |criterion: Criterion, strength: f32| {
            let goals = [Goal { criterion, pixels: None, weight: 3.0 }];
            let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
            let problem = Problem { views: vec![view], variables: lights.iter().map(variable).collect() };
            let mut lights = lights.to_vec();
            lights[0].radiance = lights[0].radiance.map(|radiance| strength * radiance);
            is_uncertain(&problem, &lights).unwrap()
        };
        assert!(uncertain(Criterion::Brightness { stops: 1.0 }, 1.9));
        assert!(!uncertain(Criterion::Brightness { stops: 1.0 }, 2.0));
        assert!(!uncertain(Criterion::Brightness { stops: 1.0 }, 2.4));
        assert!(uncertain(Criterion::Brightness { stops: 1.0 }, 2.6));
        assert!(uncertain(Criterion::Brightness { stops: -1.0 }, 0.55));
        assert!(!uncertain(Criterion::Brightness { stops: -1.0 }, 0.5));
        assert!(uncertain(Criterion::Brightness { stops: -1.0 }, 0.2));
        assert!(uncertain(Criterion::Temperature { mireds: 50.0 }, 1.0));
        assert!(uncertain(Criterion::Keep, 1.012));
        assert!(!uncertain(Criterion::Keep, 1.008));
    }
}
