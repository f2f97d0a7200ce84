use crate::OptimiseError;
use crate::objective::Objective;
use crate::problem::Problem;
use crate::term::Comparison;
use relume_scene::Light;

/// Cells of each goal by which lights are judged.
const JUDGED: usize = 4096;

/// Whether some lights may do less than was asked for by amount: by exact or clean pictures, and noise taken for what it may hide, up to
/// the same quarter of what was asked for as while polishing.
///
/// # Errors
/// As [`crate::solve`].
pub fn may_lack(problem: &Problem, lights: &[Light]) -> Result<bool, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, 0.0)?;
    for (view, draw) in objective.views.iter().zip(&objective.spread(JUDGED)) {
        let picture = view.whole_picture(lights)?;
        let doubts = view.doubts(&picture, draw);
        if view.compare_picture(&picture, &doubts, draw).iter().any(Comparison::lacks) {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{FLOOR, flat, lamps, variable};
    use crate::{Aim, Goal, View};

    #[test]
    fn only_amounts_that_were_asked_for_can_lack() {
        let (base, lights) = (flat(0.0), &lamps()[..1]);
        let lacks = |aim: Aim, strength: f32| {
            let goals = [Goal { aim, pixels: None, weight: 3.0 }];
            let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
            let problem = Problem { views: vec![view], variables: lights.iter().map(variable).collect() };
            let mut lights = lights.to_vec();
            lights[0].radiance = lights[0].radiance.map(|radiance| strength * radiance);
            may_lack(&problem, &lights).unwrap()
        };
        assert!(lacks(Aim::Brightness { stops: 1.0 }, 1.9));
        assert!(!lacks(Aim::Brightness { stops: 1.0 }, 2.0));
        assert!(!lacks(Aim::Brightness { stops: 1.0 }, 8.0));
        assert!(lacks(Aim::Brightness { stops: -1.0 }, 0.55));
        assert!(!lacks(Aim::Brightness { stops: -1.0 }, 0.5));
        assert!(lacks(Aim::Temperature { mireds: 50.0 }, 1.0));
        assert!(!lacks(Aim::Keep, 2.0));
    }
}
