use crate::goal::Criterion;
use crate::objective::{Draw, Objective, UnitPicture};
use crate::problem::Problem;
use crate::random::Random;
use crate::variable::{luminance, power};
use crate::{OptimiseError, Variable};
use glam::{Quat, Vec3};
use rayon::prelude::*;
use relume_scene::{LANES, Light, LightShape, lane};
use std::f32::consts::TAU;

/// Settings of the random starts of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RandomStarts {
    /// Number of starts.
    pub count: usize,
    /// Random places tried for each light of a start, of which the best is taken; 1 is the paper's.
    pub candidates: usize,
    /// Softness with which places are tried.
    pub softness: f32,
    /// Seed.
    pub seed: u64,
}

/// Cells of each goal by which places are compared.
const COMPARED: usize = 256;
/// Strengths tried in each place, in units of a candidate's; a locked one stays.
const STRENGTHS: [f32; 3] = [0.3, 1.0, 3.0];
const OWN_STRENGTH: [f32; 1] = [1.0];

/// Random starts: what is free of a light is drawn uniformly in its bounds (sizes by their logarithm, directions on the sphere or in
/// their cap). A target may be another picture altogether, so that lights for one are white where colour is free, together about as
/// bright as the picture lacks, and placed one after the other from darkness. What only asks for changes is near the picture as it
/// is: there shine all lights as they do, and of one after the other what is free of its shape is drawn.
///
/// # Errors
/// See [`crate::solve`].
pub fn random_starts(problem: &Problem, options: &RandomStarts) -> Result<Vec<Vec<Light>>, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, options.softness)?;
    let has_target = problem
        .views
        .iter()
        .flat_map(|view| view.goals)
        .any(|goal| matches!(goal.criterion, Criterion::Target { .. }));
    let draw = objective.spread(COMPARED);
    let search = StartSearch { problem, draw, objective, options, from_darkness: has_target };
    (0..options.count as u64).into_par_iter().map(|number| search.start(number)).collect()
}

struct StartSearch<'a> {
    problem: &'a Problem<'a>,
    objective: Objective<'a>,
    draw: Draw,
    options: &'a RandomStarts,
    from_darkness: bool,
}

/// Lights that were placed so far, those to come being black or as they are.
struct Placed {
    lights: Vec<Light>,
    /// Unit pictures by view and light.
    units: Vec<Vec<UnitPicture>>,
}

impl StartSearch<'_> {
    fn start(&self, number: u64) -> Result<Vec<Light>, OptimiseError> {
        let mut random = Random::new(self.options.seed.wrapping_mul(0x9e37_79b9) ^ number << 40 ^ 0x5eed);
        let variables = &self.problem.variables;
        let before = |variable: &Variable| match self.from_darkness {
            true => Light { radiance: [0.0; 3], ..variable.light.clone() },
            false => variable.within(variable.light.clone()),
        };
        let lights: Vec<Light> = variables.iter().map(before).collect();
        let units = match self.options.candidates {
            0 | 1 => Vec::new(),
            _ => self.objective.units(&lights, &self.draw)?,
        };
        let mut placed = Placed { lights, units };
        for (i, variable) in variables.iter().enumerate() {
            let stays = variable.locks.hold_shape(&variable.light.shape);
            if stays && self.shines(variable) {
                continue;
            }
            let candidates = if stays { 1 } else { self.options.candidates.max(1) };
            let candidates =
                (0..candidates).map(|_| self.candidate(i, &mut random)).collect::<Result<Vec<_>, _>>()?;
            self.place(&mut placed, i, candidates)?;
        }
        Ok(placed.lights)
    }

    /// True if a light is in the picture before it is placed.
    fn shines(&self, variable: &Variable) -> bool {
        !self.from_darkness && luminance(power(&variable.light)) > 0.0
    }

    /// A random light, as powerful as it is if it shines already, else with an equal share of what the picture lacks.
    fn candidate(&self, number: usize, random: &mut Random) -> Result<Light, OptimiseError> {
        let variable = &self.problem.variables[number];
        let light = Light { shape: random_shape(variable, 1.0, random), ..variable.light.clone() };
        if self.shines(variable) {
            let radiance = power(&variable.light).map(|power| power / light.shape.extent());
            return Ok(variable.within(Light { radiance, ..light }));
        }
        let share = self.problem.matching_radiance(number, &light, self.options.softness)?
            / self.problem.variables.len() as f32;
        let radiance = radiance(variable, &light.shape, share);
        Ok(variable.within(Light { radiance, ..light }))
    }

    /// Takes the candidate and strength with the least loss over the lights that are placed.
    fn place(&self, placed: &mut Placed, number: usize, candidates: Vec<Light>) -> Result<(), OptimiseError> {
        if self.options.candidates < 2 {
            placed.lights[number] = candidates[0].clone();
            return Ok(());
        }
        let mut best: Option<(f64, Light, Vec<UnitPicture>)> = None;
        for candidate in candidates {
            let own = self.objective.units_of(number, &candidate, &self.draw)?;
            for (units, own) in placed.units.iter_mut().zip(&own) {
                units[number] = own.clone();
            }
            let variable = &self.problem.variables[number];
            for strength in strengths(variable, &STRENGTHS) {
                let radiance = candidate.radiance.map(|r| strength * r);
                let light = variable.within(Light { radiance, ..candidate.clone() });
                placed.lights[number] = light.clone();
                let loss = self.objective.loss_of_goals(&placed.lights, &placed.units, &self.draw);
                if best.as_ref().is_none_or(|(least, ..)| loss < *least) {
                    best = Some((loss, light, own.clone()));
                }
            }
        }
        if let Some((_, light, own)) = best {
            placed.lights[number] = light;
            for (units, own) in placed.units.iter_mut().zip(own) {
                units[number] = own;
            }
        }
        Ok(())
    }
}

/// Those that are tried of a light; its own where that is locked.
pub(crate) fn strengths(variable: &Variable, all: &'static [f32]) -> impl Iterator<Item = f32> + use<> {
    if variable.locks.strength { &OWN_STRENGTH } else { all }.iter().copied()
}

/// Shape whose free part goes a share of the way to one drawn anew.
pub(crate) fn random_shape(variable: &Variable, share: f32, random: &mut Random) -> LightShape {
    let (locks, bounds, shape) = (&variable.locks, &variable.bounds, &variable.light.shape);
    let mut step = [0.0; LANES];
    if let (Some(center), false) = (shape.center(), locks.position) {
        let at = Vec3::from_array(std::array::from_fn(|_| random.next_f32()));
        let to = bounds.center_min + at * (bounds.center_max - bounds.center_min);
        step[lane::CENTER].copy_from_slice(&(to - center).to_array());
    }
    if !locks.direction {
        step[lane::TURN].copy_from_slice(&random_turn(random).to_array());
    }
    if !locks.size {
        let [low, high] = if matches!(shape, LightShape::Sun { .. }) { bounds.sun } else { bounds.size };
        for (i, size) in lane::SIZE.zip(shape.sizes()) {
            step[i] = (low * (high / low).powf(random.next_f32()) / size).ln();
        }
        lane::SIZE.for_each(|i| step[i] = step[locks.lead(i)]);
    }
    let shape = shape.moved(&step.map(|step| share * step));
    bounds.direction.filter(|_| !locks.direction).map_or(shape, |cone| cone.warped(&shape))
}

/// A uniform rotation as its vector (Shoemake 1992, "Uniform random rotations").
fn random_turn(random: &mut Random) -> Vec3 {
    let [a, b, c] = std::array::from_fn(|_| random.next_f32());
    let (low, high) = ((1.0 - a).sqrt(), a.sqrt());
    let ((sin_b, cos_b), (sin_c, cos_c)) = ((TAU * b).sin_cos(), (TAU * c).sin_cos());
    Quat::from_xyzw(low * sin_b, low * cos_b, high * sin_c, high * cos_c).normalize().to_scaled_axis()
}

/// White radiance where it is free; else the light's own colour or strength at its new extent.
fn radiance(variable: &Variable, shape: &LightShape, share: f32) -> [f32; 3] {
    let power = power(&variable.light);
    let own = luminance(power);
    match (variable.locks.color, variable.locks.strength) {
        (_, true) => power.map(|power| power / shape.extent()),
        (true, false) if own > 0.0 => power.map(|power| share * power / own),
        _ => [share; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{FLOOR, flat, lamps, picture, target, variable};
    use crate::{Goal, Locks, View};

    #[test]
    fn what_is_locked_is_as_it_was_in_every_start() {
        let base = flat(0.02);
        let goals = [target(picture(&FLOOR, &base, &lamps()))];
        let view = View { relight: &FLOOR, base: &base, still: vec![None, None], goals: &goals };
        let locked = Locks { strength: true, size: true, ..Locks::default() };
        for lamp in lamps() {
            let variables = vec![Variable { locks: locked, ..variable(&lamp) }, variable(&lamps()[0])];
            let problem = Problem { views: vec![view.clone()], variables };
            for candidates in [1, 16] {
                let options = RandomStarts { count: 4, candidates, softness: 0.0, seed: 1 };
                for start in random_starts(&problem, &options).unwrap() {
                    let [now, was] = [&start[0], &lamp].map(|light| luminance(power(light)));
                    assert!((now / was - 1.0).abs() < 1e-4, "{candidates} candidates: {now} for {was}");
                    let sizes = start[0].shape.sizes().into_iter().zip(lamp.shape.sizes());
                    assert!(sizes.into_iter().all(|(now, was)| (now - was).abs() < 1e-5), "{start:?}");
                }
            }
        }
    }

    #[test]
    fn for_a_change_of_the_picture_other_lights_shine_as_they_do() {
        let base = flat(0.02);
        let left = Some((0..96).map(|i| f32::from(i % 12 < 6)).collect::<Vec<f32>>());
        let goals = [Goal { criterion: Criterion::Brightness { stops: 1.0 }, pixels: left, weight: 1.0 }];
        let [stays, moves] = [0, 1].map(|number| variable(&lamps()[number]));
        let stays = Variable { locks: Locks { strength: false, ..Locks::ALL }, ..stays };
        let still = picture(&FLOOR, &flat(0.0), &[Light { radiance: [1.0; 3], ..stays.light.clone() }]);
        let view = View { relight: &FLOOR, base: &base, still: vec![Some(&still), None], goals: &goals };
        let problem = Problem { views: vec![view], variables: vec![stays.clone(), moves.clone()] };
        let options = RandomStarts { count: 3, candidates: 16, softness: 0.0, seed: 1 };
        let starts = random_starts(&problem, &options).unwrap();
        for start in &starts {
            assert_eq!(start[0], stays.light);
            let factor = luminance(power(&start[1])) / luminance(power(&moves.light));
            assert!(STRENGTHS.iter().any(|strength| (factor / strength - 1.0).abs() < 1e-3), "{factor}");
            assert_ne!(start[1].shape, moves.light.shape);
        }
        assert_ne!(starts[0], starts[1]);
    }
}
