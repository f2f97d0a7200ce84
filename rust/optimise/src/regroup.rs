use crate::OptimiseError;
use crate::objective::{Draw, Objective, UnitPicture};
use crate::problem::Problem;
use crate::variable::{luminance, power};
use glam::Vec3;
use rayon::prelude::*;
use relume_scene::{LANES, Light, LightShape, lane};

/// Cells of each goal by which groupings are compared.
const COMPARED: usize = 1024;
/// Mergers from which splits are tried.
const MERGERS: usize = 2;
/// Lights that take on the most when they are split, of many.
const SPLITS: usize = 6;
/// Distance of a split light's halves from where it was, by the diagonal of the bounds.
const APART: [f32; 2] = [0.03, 0.08];

/// Other arrangements of the same lights, the most promising first: one light's work is taken over by another that can do it best
/// (a merger), and it goes beside one that does the work of two (a split), on either side of where that was. No gradient leads
/// there; "SMEM algorithm for mixture models" (Ueda, Nakano, Ghahramani and Hinton 2000) does the same for mixtures. Lights
/// whose place or strength is locked stay as they are. `softness` is that of the comparison.
///
/// # Errors
/// See [`crate::solve`].
pub fn regroupings(
    problem: &Problem,
    lights: &[Light],
    softness: f32,
    most: usize,
) -> Result<Vec<Vec<Light>>, OptimiseError> {
    problem.validate()?;
    let objective = Objective::new(problem, softness)?;
    let draw = objective.spread(COMPARED);
    let units = objective.units(lights, &draw)?;
    let regroup = Regroup { problem, lights, objective, draw, units };
    let mut all = Vec::new();
    for (from, to) in regroup.best_mergers() {
        all.extend(regroup.splits(from, to)?);
    }
    all.sort_by(|a: &(f64, _), b| a.0.total_cmp(&b.0));
    Ok(all.into_iter().take(most).map(|(_, lights)| lights).collect())
}

struct Regroup<'a> {
    problem: &'a Problem<'a>,
    lights: &'a [Light],
    objective: Objective<'a>,
    draw: Draw,
    /// Unit pictures by view and light.
    units: Vec<Vec<UnitPicture>>,
}

impl Regroup<'_> {
    fn may_move(&self, number: usize) -> bool {
        let locks = &self.problem.variables[number].locks;
        !locks.position && !locks.strength && self.lights[number].shape.center().is_some()
    }

    fn movable(&self) -> impl Iterator<Item = usize> + Clone {
        (0..self.lights.len()).filter(|number| self.may_move(*number))
    }

    /// Pairs of lights of which the second can best do the work of the first.
    fn best_mergers(&self) -> Vec<(usize, usize)> {
        let to_best = |from: usize| {
            let others = self.movable().filter(|to| *to != from);
            let loss = |to: usize| (self.loss(&self.merged(from, to), &self.units), (from, to));
            others.map(loss).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut mergers: Vec<_> = self.movable().filter_map(to_best).collect();
        mergers.sort_by(|a, b| a.0.total_cmp(&b.0));
        mergers.into_iter().take(MERGERS).map(|(_, pair)| pair).collect()
    }

    /// The first light is black, the second has its power besides its own.
    fn merged(&self, from: usize, to: usize) -> Vec<Light> {
        let mut lights = self.lights.to_vec();
        let [a, b] = [from, to].map(|number| power(&lights[number]));
        lights[to] = self.lit(to, lights[to].shape, std::array::from_fn(|c| a[c] + b[c]));
        lights[from].radiance = [0.0; 3];
        lights
    }

    /// After a merger: arrangements in which the light that is free now has half of another's work, with their losses.
    fn splits(&self, from: usize, to: usize) -> Result<Vec<(f64, Vec<Light>)>, OptimiseError> {
        let merged = self.merged(from, to);
        let strength = |number: &usize| luminance(power(&merged[*number]));
        let mut strong: Vec<usize> = self.movable().filter(|number| *number != from).collect();
        strong.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
        let steps = [Vec3::X, Vec3::Y, Vec3::Z]
            .into_iter()
            .flat_map(|axis| APART.into_iter().flat_map(move |apart| [apart * axis, -apart * axis]));
        let candidates: Vec<(usize, Vec3)> =
            strong.iter().take(SPLITS).flat_map(|split| steps.clone().map(|step| (*split, step))).collect();
        let split = |(number, step): &(usize, Vec3)| self.split(&merged, from, *number, *step);
        candidates.par_iter().map(split).collect()
    }

    fn split(
        &self,
        merged: &[Light],
        free: usize,
        number: usize,
        step: Vec3,
    ) -> Result<(f64, Vec<Light>), OptimiseError> {
        let mut lights = merged.to_vec();
        let half = power(&lights[number]).map(|power| 0.5 * power);
        let center = lights[number].shape.center().unwrap_or_default();
        lights[number] = self.at(number, center - step * self.reach(number), half);
        lights[free] = self.at(free, center + step * self.reach(number), half);
        let mut units = self.units.clone();
        for moved in [number, free] {
            for (units, own) in
                units.iter_mut().zip(self.objective.units_of(moved, &lights[moved], &self.draw)?)
            {
                units[moved] = own;
            }
        }
        Ok((self.loss(&lights, &units), lights))
    }

    /// A light in another place within its bounds, and of another power.
    fn at(&self, number: usize, place: Vec3, power: [f32; 3]) -> Light {
        let (light, bounds) = (&self.lights[number], &self.problem.variables[number].bounds);
        let margin = 0.01 * (bounds.center_max - bounds.center_min);
        let place = place.clamp(bounds.center_min + margin, bounds.center_max - margin);
        let mut step = [0.0; LANES];
        let from = light.shape.center().unwrap_or_default();
        step[lane::CENTER].copy_from_slice(&(place - from).to_array());
        self.lit(number, light.shape.moved(&step), power)
    }

    /// A light of this shape and power, or one as bright where its colour is locked; as bright as may be.
    fn lit(&self, number: usize, shape: LightShape, wanted: [f32; 3]) -> Light {
        let (light, variable) = (&self.lights[number], &self.problem.variables[number]);
        let own = luminance(power(light));
        let radiance = match variable.locks.color && own > 0.0 {
            true => light.radiance.map(|radiance| radiance * luminance(wanted) / own),
            false => wanted.map(|power| power / shape.extent()),
        };
        variable.within(light.reshaped(shape, radiance))
    }

    /// The diagonal of a light's bounds.
    fn reach(&self, number: usize) -> f32 {
        let bounds = &self.problem.variables[number].bounds;
        (bounds.center_max - bounds.center_min).length()
    }

    fn loss(&self, lights: &[Light], units: &[Vec<UnitPicture>]) -> f64 {
        self.objective.loss_of_goals(lights, units, &self.draw)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{FLOOR, flat, lamps, picture, target, variable};
    use crate::{Locks, Variable, View};

    const PLACES: [Vec3; 3] = [Vec3::new(0.4, -0.9, 0.8), Vec3::new(0.4, 1.4, 0.8), Vec3::new(0.4, 2.8, 0.8)];

    fn lamp(center: Vec3, color: [f32; 3]) -> Light {
        let shape = LightShape::Sphere { center, radius: 0.2 };
        Light { shape, radiance: color.map(|power| power / shape.extent()), ..lamps()[0].clone() }
    }

    /// Two lights where one should be, and one where two should be.
    fn stuck(white: [f32; 3]) -> [Light; 3] {
        let [a, b, c] = PLACES;
        [
            lamp(a, white.map(|v| 0.5 * v)),
            lamp(b.lerp(c, 0.5), white.map(|v| 2.0 * v)),
            lamp(a + 0.1 * Vec3::X, white.map(|v| 0.5 * v)),
        ]
    }

    fn regrouped(lights: &[Light], locks: Locks) -> Vec<Vec<Light>> {
        let base = flat(0.02);
        let goals = [target(picture(&FLOOR, &base, &PLACES.map(|place| lamp(place, [3.0; 3]))))];
        let view = View { relight: &FLOOR, base: &base, still: vec![None; 3], goals: &goals };
        let mut variables: Vec<Variable> = lights.iter().map(variable).collect();
        variables[2].locks = locks;
        regroupings(&Problem { views: vec![view], variables }, lights, 0.0, 3).unwrap()
    }

    #[test]
    fn a_light_too_many_goes_where_there_is_one_too_few() {
        let best = &regrouped(&stuck([3.0; 3]), Locks::default())[0];
        for place in PLACES {
            let nearest = best.iter().filter_map(|light| light.shape.center());
            let nearest = nearest.map(|center| center.distance(place)).fold(f32::INFINITY, f32::min);
            assert!(nearest < 0.3, "{nearest} from {place}: {best:?}");
        }
        let powers = best.iter().map(|light| power(light)[0]).sum::<f32>();
        assert!((powers - 9.0).abs() < 1e-3, "power stays as it was: {powers}");
    }

    #[test]
    fn locked_places_strengths_and_colors_stay() {
        let lights = stuck([3.0, 2.0, 1.0]);
        for locks in
            [Locks { position: true, ..Locks::default() }, Locks { strength: true, ..Locks::default() }]
        {
            for other in regrouped(&lights, locks) {
                assert_eq!(other[2], lights[2]);
            }
        }
        let blue = lamp(PLACES[0], [0.5, 1.0, 2.0]);
        let lights = [lights[0].clone(), lights[1].clone(), blue.clone()];
        for other in regrouped(&lights, Locks { color: true, ..Locks::default() }) {
            let factor = other[2].radiance[0] / blue.radiance[0];
            let same =
                (0..3).all(|c| (other[2].radiance[c] / (factor * blue.radiance[c]) - 1.0).abs() < 1e-5);
            assert!(factor > 0.0 && same, "{:?}", other[2].radiance);
        }
    }
}
