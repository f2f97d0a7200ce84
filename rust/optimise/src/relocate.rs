use crate::OptimiseError;
use crate::goal::Criterion;
use crate::objective::{Draw, Halves, Objective, ViewObjective};
use crate::problem::Problem;
use crate::random::Random;
use crate::solve::mappings;
use crate::starts::{random_shape, strengths};
use crate::variable::Mapping;
use rayon::prelude::*;
use relume_scene::Light;

/// Cells of each goal by which places are compared.
const COMPARED: usize = 1024;
/// Places tried, of all lights together.
const PLACES: usize = 512;
/// Rounds in which each light is scaled in turn, in units of its power; a locked strength stays.
const ROUNDS: usize = 2;
const STRENGTHS: [f32; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
/// Places whose pictures are made at a time: a relighter that is cancelled says so before the next ones.
const AT_ONCE: usize = 16;

/// Lights of which one is somewhere else altogether, the best first and at most `most`: the free part of its shape goes
/// a random share of the way from where the artist has it to a random place in its bounds. The others are where they
/// were found, or where the artist has them: they may have gone astray for want of this one. All strengths follow.
/// Exact pictures are compared: smoothed lights cast no shadow on a small stroke. None for a target, of which every
/// cell says where light is missing.
///
/// # Errors
/// See [`crate::solve`].
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
    if movable.is_empty() || goals.any(|goal| matches!(goal.criterion, Criterion::Target { .. })) {
        return Ok(Vec::new());
    }
    let objective = Objective::new(problem, 0.0)?;
    let draw = objective.spread(COMPARED);
    let first: Vec<Light> =
        problem.variables.iter().map(|variable| variable.within(variable.light.clone())).collect();
    let mut others = Vec::new();
    for lights in [lights.to_vec(), first] {
        let units = half_units(&objective, &lights, &draw)?;
        others.push(Others { mappings: mappings(problem, &lights, 0.0)?, lights, units });
    }
    let mut relocate = Relocate { problem, others, objective, draw, random: Random::new(seed) };
    let mut all = Vec::new();
    for number in &movable {
        all.extend(relocate.places(*number, PLACES / movable.len())?);
    }
    all.sort_by(|a: &(f64, _), b| a.0.total_cmp(&b.0));
    Ok(all.into_iter().take(most).map(|(_, lights)| lights).collect())
}

struct Relocate<'a> {
    problem: &'a Problem<'a>,
    /// Places of the other lights.
    others: Vec<Others>,
    objective: Objective<'a>,
    draw: Draw,
    random: Random,
}

/// Lights beside which one of them goes somewhere else.
struct Others {
    lights: Vec<Light>,
    mappings: Vec<Mapping>,
    /// Unit pictures by view and light.
    units: Vec<Vec<Halves>>,
}

impl Relocate<'_> {
    /// Arrangements with one light in each of so many places, with their losses.
    fn places(&mut self, number: usize, count: usize) -> Result<Vec<(f64, Vec<Light>)>, OptimiseError> {
        let places: Vec<Light> = (0..count).map(|_| self.place(number)).collect();
        let mut found = Vec::with_capacity(count);
        for some in places.chunks(AT_ONCE) {
            let by_view = self.objective.views.iter().zip(&self.draw).map(|(view, draw)| {
                view.half_values(number, &some.iter().collect::<Vec<_>>(), &view.cells_of(draw))
            });
            let by_view = by_view.collect::<Result<Vec<_>, _>>()?;
            let of_place = |(i, place): (usize, &Light)| {
                let own: Vec<&Halves> = by_view.iter().map(|of_places| &of_places[i]).collect();
                let arranged =
                    self.others.iter().map(|others| self.with_best_strengths(number, place, &own, others));
                arranged.min_by(|a, b| a.0.total_cmp(&b.0))
            };
            found.par_extend(some.par_iter().enumerate().filter_map(of_place));
        }
        Ok(found)
    }

    /// A light as powerful as it is in another place.
    fn place(&mut self, number: usize) -> Light {
        let (light, variable) = (&self.others[0].lights[number], &self.problem.variables[number]);
        let share = self.random.next_f32();
        let shape = random_shape(variable, share, &mut self.random);
        let radiance = light.radiance.map(|radiance| radiance * light.shape.extent() / shape.extent());
        variable.within(light.reshaped(shape, radiance))
    }

    /// Beside others, with its picture in each view.
    fn with_best_strengths(
        &self,
        number: usize,
        place: &Light,
        own: &[&Halves],
        others: &Others,
    ) -> (f64, Vec<Light>) {
        let mut units = others.units.clone();
        for (units, own) in units.iter_mut().zip(own) {
            units[number] = (*own).clone();
        }
        let loss = |lights: &[Light]| {
            self.objective.loss_of_halves(lights, &units, &self.draw)
                + self.objective.preference_loss(&others.mappings, lights)
        };
        let mut best = others.lights.clone();
        best[number] = place.clone();
        let mut least = loss(&best);
        let in_turn = std::iter::once(number).chain((0..best.len()).filter(|other| *other != number));
        for i in std::iter::repeat_n(in_turn, ROUNDS).flatten() {
            let (light, variable) = (best[i].clone(), &self.problem.variables[i]);
            for strength in strengths(variable, &STRENGTHS) {
                let mut lights = best.clone();
                let radiance = light.radiance.map(|radiance| strength * radiance);
                lights[i] = variable.within(Light { radiance, ..light.clone() });
                let loss = loss(&lights);
                if loss < least {
                    (least, best) = (loss, lights);
                }
            }
        }
        (least, best)
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
    use crate::{Criterion, Goal, Locks, View};
    use relume_scene::lane;

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
        [(Criterion::Brightness { stops: 3.0 }, true), (Criterion::Keep, false)]
            .map(|(criterion, is_in)| Goal { criterion, pixels: within(is_in), weight: 1.0 })
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
    fn the_others_may_be_where_the_artist_has_them_and_as_strong_as_that_needs() {
        let (goals, base, lights) = (lift(), flat(0.02), lamps()[..2].to_vec());
        let view = View { relight: &FLOOR, base: &base, still: vec![None; 2], goals: &goals };
        let problem = Problem { views: vec![view], variables: lights.iter().map(variable).collect() };
        // The first went astray, and is far too strong for where it is.
        let mut astray = lights.clone();
        let step = std::array::from_fn(|i| if lane::CENTER.contains(&i) { 0.5 } else { 0.0 });
        astray[0].shape = astray[0].shape.moved(&step);
        astray[0].radiance = astray[0].radiance.map(|radiance| 16.0 * radiance);
        let found = relocations(&problem, &astray, MOST, 1).unwrap();
        let is_back =
            |other: &Vec<Light>| other[0].shape == lights[0].shape && other[1].shape != lights[1].shape;
        assert!(found.iter().any(is_back), "{found:?}");
        let is_weaker = |other: &Vec<Light>| {
            other[0].radiance[1] * other[0].shape.extent() < astray[0].radiance[1] * astray[0].shape.extent()
        };
        assert!(found.iter().all(is_weaker), "{found:?}");
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
