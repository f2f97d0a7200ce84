use crate::OptimiseError;
use crate::goal::Aim;
use crate::objective::{Draw, Halves, Objective, ViewObjective};
use crate::problem::Problem;
use crate::random::Random;
use crate::solve::mappings;
use crate::starts::{random_shape, strengths};
use crate::variable::Mapping;
use relume_scene::Light;

/// Cells of each goal by which places are compared.
const COMPARED: usize = 1024;
/// Places tried, of all lights together.
const PLACES: usize = 128;
/// Of each place, in units of the light's power; a locked strength stays.
const STRENGTHS: [f32; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
/// Places whose pictures are made at a time: a relighter that is cancelled says so before the next ones.
const AT_ONCE: usize = 16;

/// The same lights with one of them somewhere else altogether, the best first and at most `most`: what is free of its shape goes a
/// random share of the way from where the artist has it to a random place in its bounds. Exact pictures are compared: smoothed lights
/// cast no shadow on a small stroke. None for a target, of which every cell says where light is missing.
///
/// # Errors
/// As [`crate::solve`].
pub fn relocations(
    problem: &Problem,
    lights: &[Light],
    most: usize,
    seed: u64,
) -> Result<Vec<Vec<Light>>, OptimiseError> {
    problem.validate()?;
    let mut goals = problem.views.iter().flat_map(|view| view.goals);
    let moves = |number: &usize| {
        let variable = &problem.variables[*number];
        !variable.locks.hold_shape(&variable.light.shape)
    };
    let movable: Vec<usize> = (0..lights.len()).filter(moves).collect();
    if movable.is_empty() || goals.any(|goal| matches!(goal.aim, Aim::Target { .. })) {
        return Ok(Vec::new());
    }
    let objective = Objective::new(problem, 0.0)?;
    let draw = objective.spread(COMPARED);
    let units = half_units(&objective, lights, &draw)?;
    let (mappings, random) = (mappings(problem, lights, 0.0)?, Random::new(seed));
    let mut relocate = Relocate { problem, lights, objective, mappings, draw, units, random };
    let mut all = Vec::new();
    for number in &movable {
        all.extend(relocate.places(*number, PLACES / movable.len())?);
    }
    all.sort_by(|a: &(f64, _), b| a.0.total_cmp(&b.0));
    Ok(all.into_iter().take(most).map(|(_, lights)| lights).collect())
}

struct Relocate<'a> {
    problem: &'a Problem<'a>,
    lights: &'a [Light],
    objective: Objective<'a>,
    mappings: Vec<Mapping>,
    draw: Draw,
    /// By view and light.
    units: Vec<Vec<Halves>>,
    random: Random,
}

impl Relocate<'_> {
    /// Arrangements with one light in each of so many places, with their losses.
    fn places(&mut self, number: usize, count: usize) -> Result<Vec<(f64, Vec<Light>)>, OptimiseError> {
        let places: Vec<Light> = (0..count).map(|_| self.place(number)).collect();
        let mut units = self.units.clone();
        let mut found = Vec::with_capacity(count);
        for some in places.chunks(AT_ONCE) {
            let by_view = self.objective.views.iter().zip(&self.draw).map(|(view, draw)| {
                view.half_values(number, &some.iter().collect::<Vec<_>>(), &view.cells_of(draw))
            });
            let by_view = by_view.collect::<Result<Vec<_>, _>>()?;
            for (i, place) in some.iter().enumerate() {
                for (units, of_places) in units.iter_mut().zip(&by_view) {
                    units[number] = of_places[i].clone();
                }
                found.push(self.best_strength(number, place, &units));
            }
        }
        Ok(found)
    }

    /// A light as powerful as it is in another place.
    fn place(&mut self, number: usize) -> Light {
        let (light, variable) = (&self.lights[number], &self.problem.variables[number]);
        let share = self.random.next_f32();
        let shape = random_shape(variable, share, &mut self.random);
        let radiance = light.radiance.map(|radiance| radiance * light.shape.extent() / shape.extent());
        variable.within(Light { shape, radiance, ..light.clone() })
    }

    fn best_strength(&self, number: usize, place: &Light, units: &[Vec<Halves>]) -> (f64, Vec<Light>) {
        let variable = &self.problem.variables[number];
        let mut best = (f64::INFINITY, self.lights.to_vec());
        for strength in strengths(variable, &STRENGTHS) {
            let mut lights = self.lights.to_vec();
            let radiance = place.radiance.map(|radiance| strength * radiance);
            lights[number] = variable.within(Light { radiance, ..place.clone() });
            let loss = self.objective.loss_of_halves(&lights, units, &self.draw)
                + self.objective.preference_loss(&self.mappings, &lights);
            if loss < best.0 {
                best = (loss, lights);
            }
        }
        best
    }
}

/// Each light's pictures for radiance 1 by either half of the paths, by view and light.
fn half_units(
    objective: &Objective,
    lights: &[Light],
    draw: &Draw,
) -> Result<Vec<Vec<Halves>>, OptimiseError> {
    let of_view = |(view, draw): (&ViewObjective, &Vec<Vec<u32>>)| {
        let cells = view.cells_of(draw);
        let of_light = |(number, light): (usize, &Light)| view.half_values(number, &[light], &cells);
        let units = lights.iter().enumerate().map(of_light).collect::<Result<Vec<_>, _>>()?;
        Ok(units.concat())
    };
    objective.views.iter().zip(draw).map(of_view).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{FLOOR, SIZE, flat, lamps, target, variable};
    use crate::{Aim, Goal, Locks, View};

    const MOST: usize = 4;

    fn relocated(goals: &[Goal], locks: Locks) -> Vec<Vec<Light>> {
        let (base, lights) = (flat(0.02), lamps()[..2].to_vec());
        let mut variables: Vec<_> = lights.iter().map(variable).collect();
        variables.iter_mut().for_each(|variable| variable.locks = locks);
        let view = View { relight: &FLOOR, base: &base, still: vec![None; 2], goals };
        relocations(&Problem { views: vec![view], variables }, &lights, MOST, 1).unwrap()
    }

    /// To lift what is darkest and leave the rest.
    fn lift() -> [Goal; 2] {
        let within = |is_in: bool| {
            Some((0..SIZE.0 * SIZE.1).map(|i| f32::from((i % SIZE.0 >= SIZE.0 - 2) == is_in)).collect())
        };
        [(Aim::Brightness { stops: 3.0 }, true), (Aim::Keep, false)].map(|(aim, is_in)| Goal {
            aim,
            pixels: within(is_in),
            weight: 1.0,
        })
    }

    #[test]
    fn one_light_goes_to_where_it_does_most_of_what_is_asked() {
        let (goals, base, lights) = (lift(), flat(0.02), &lamps()[..2]);
        let found = relocated(&goals, Locks::default());
        assert_eq!(found.len(), MOST);
        let view = View { relight: &FLOOR, base: &base, still: vec![None; 2], goals: &goals };
        let problem = Problem { views: vec![view], variables: lights.iter().map(variable).collect() };
        let loss = |lights: &[Light]| {
            let objective = Objective::new(&problem, 0.0).unwrap();
            let draw = objective.spread(COMPARED);
            objective.loss_of_goals(lights, &objective.units(lights, &draw).unwrap(), &draw)
        };
        let losses: Vec<f64> = found.iter().map(|lights| loss(lights)).collect();
        assert!(losses[0] < 0.7 * loss(lights) && losses.is_sorted(), "{losses:?} after {}", loss(lights));
        for other in &found {
            assert_eq!(other.iter().zip(lights).filter(|(now, was)| now.shape != was.shape).count(), 1);
        }
    }

    #[test]
    fn a_locked_strength_stays_and_a_target_needs_none() {
        let powers =
            |lights: &[Light]| lights.iter().map(|light| crate::variable::power(light)[0]).sum::<f32>();
        let found = relocated(&lift(), Locks { strength: true, ..Locks::default() });
        assert_eq!(found.len(), MOST);
        for other in found {
            assert!((powers(&other) / powers(&lamps()[..2]) - 1.0).abs() < 1e-3, "{other:?}");
        }
        assert!(relocated(&[target(flat(1.0))], Locks::default()).is_empty());
    }
}
