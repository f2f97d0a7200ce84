//! The solver on a relighter in closed form: unshadowed lights over a sloped floor and a wall, with exact derivatives.

use crate::objective::Objective;
use crate::solve::mappings;
use crate::variable::{PARAMS, tests::lights};
use crate::*;
use glam::Vec3;
use relume_image::Image;
use relume_scene::{LANES, Light, LightShape};
use std::ops::ControlFlow;

mod comparing;

pub(crate) const SIZE: (usize, usize) = (12, 8);

/// Irradiance of lights taken as small, each pixel a point of a floor or a wall.
pub(crate) struct Lambert {
    cell: usize,
    /// True if `linearise` gives derivatives; else only `pull_back` does.
    is_linear: bool,
}

impl Lambert {
    fn pixel(&self, number: usize, shape: &LightShape) -> [f32; 3] {
        let (x, y) = ((number % SIZE.0) as f32 / 6.0 - 1.0, (number / SIZE.0) as f32 / 4.0);
        let (point, normal) = match number % SIZE.0 {
            0..4 => (Vec3::new(-1.5, x * 3.0, 2.0 * y), Vec3::X),
            _ => (
                Vec3::new(2.0 * x, 3.0 * y - 1.5, 0.1 * x),
                Vec3::new(0.1 - 0.2 * x, 0.2 * y, 1.0).normalize(),
            ),
        };
        let smooth = |cos: f32| 0.5 * (cos + (cos * cos + 0.01).sqrt());
        let value = match *shape {
            LightShape::Sun { direction, .. } => shape.extent() * smooth(normal.dot(direction)),
            _ => {
                let to = shape.center().unwrap_or_default() - point;
                let (distance2, w) = (to.length_squared() + 0.05, to.normalize());
                let facing = match *shape {
                    LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
                        smooth(-w.dot(edge_u.cross(edge_v).normalize())) * (1.0 + 0.1 * edge_u.normalize().x)
                    }
                    LightShape::Spot { axis, half_angle, blend, .. } => {
                        (6.0 * (-w.dot(axis) - half_angle.cos()) / (0.3 + blend)).tanh() + 1.0
                    }
                    _ => 1.0,
                };
                // Larger lights look larger up close.
                shape.extent() * smooth(normal.dot(w)) * facing / (distance2 + shape.sizes()[0].powi(2))
            }
        };
        [value, 0.8 * value, 0.5 * value * (1.0 + 0.2 * x)]
    }

    pub(crate) fn of_cell(&self, shape: &LightShape, cell: u32) -> [f32; 3] {
        let wide = SIZE.0.div_ceil(self.cell);
        let (column, row) = (cell as usize % wide * self.cell, cell as usize / wide * self.cell);
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for y in row..(row + self.cell).min(SIZE.1) {
            for x in column..(column + self.cell).min(SIZE.0) {
                let pixel = self.pixel(y * SIZE.0 + x, shape);
                (0..3).for_each(|c| sum[c] += pixel[c]);
                count += 1.0;
            }
        }
        sum.map(|v| v / count)
    }

    fn slopes(&self, shape: &LightShape, cell: u32) -> [[f32; 3]; LANES] {
        std::array::from_fn(|lane| {
            let at = |delta: f32| {
                let mut step = [0.0; LANES];
                step[lane] = delta;
                self.of_cell(&shape.moved(&step), cell)
            };
            let (low, high) = (at(-4e-3), at(4e-3));
            std::array::from_fn(|c| (high[c] - low[c]) / 8e-3)
        })
    }
}

impl Relight for Lambert {
    fn size(&self) -> (usize, usize) {
        SIZE
    }
    fn cell(&self) -> usize {
        self.cell
    }
    fn values(&self, light: &Light, _: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        Ok(cells.iter().map(|cell| self.of_cell(&light.shape, *cell)).collect())
    }
    fn pull_back(
        &self,
        light: &Light,
        _: f32,
        cells: &[u32],
        d: &[[f32; 3]],
    ) -> Result<[f32; LANES], RelightError> {
        let mut sum = [0.0; LANES];
        for (cell, d) in cells.iter().zip(d) {
            for (sum, slope) in sum.iter_mut().zip(self.slopes(&light.shape, *cell)) {
                *sum += (0..3).map(|c| d[c] * slope[c]).sum::<f32>();
            }
        }
        Ok(sum)
    }
    fn linearise(&self, light: &Light, _: f32, cells: &[u32]) -> Result<Option<Linear>, RelightError> {
        let linear = || Linear {
            values: self.values(light, 0.0, cells).unwrap_or_default(),
            slopes: cells.iter().map(|cell| self.slopes(&light.shape, *cell)).collect(),
        };
        Ok(self.is_linear.then(linear))
    }
}

pub(crate) const FLOOR: Lambert = Lambert { cell: 1, is_linear: false };
const IN_CELLS: Lambert = Lambert { cell: 3, is_linear: true };

fn bounds() -> Bounds {
    Bounds::new(Vec3::new(-1.0, -2.0, 0.5), Vec3::new(2.0, 5.0, 4.0), [0.05, 1.5])
}

pub(crate) fn variable(light: &Light) -> Variable {
    Variable { light: light.clone(), locks: Locks::default(), bounds: bounds(), prior_weight: 0.0 }
}

pub(crate) fn flat(value: f32) -> Image {
    Image { width: SIZE.0, height: SIZE.1, channels: 3, data: vec![value; SIZE.0 * SIZE.1 * 3] }
}

pub(crate) fn picture(relight: &Lambert, base: &Image, lights: &[Light]) -> Image {
    let mut image = base.clone();
    for (i, pixel) in image.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        for light in lights {
            let unit = relight.pixel(i, &light.shape);
            (0..3).for_each(|c| pixel[c] += light.radiance[c] * unit[c]);
        }
    }
    image
}

pub(crate) fn target(image: Image) -> Goal {
    Goal { criterion: Criterion::Target { image, exposure_invariant: false }, pixels: None, weight: 1.0 }
}

/// Lights of all types that light the floor about equally.
pub(crate) fn lamps() -> Vec<Light> {
    let shine =
        |light: Light| Light { radiance: [6.0, 3.0, 2.0].map(|power| power / light.shape.extent()), ..light };
    lights().into_iter().map(shine).collect()
}

/// A light somewhat elsewhere, turned, of another size, colour and strength.
pub(crate) fn disturbed(light: &Light) -> Light {
    let shape = light.shape.moved(&[0.3, -0.25, 0.2, 0.15, -0.1, 0.1, 0.3, -0.2, 0.1, 0.1]);
    let radiance = [4.0, 4.0, 4.0].map(|power| power / shape.extent());
    Light { shape, radiance, ..light.clone() }
}

#[test]
fn gradients_equal_differences_for_every_value_of_every_light_and_every_goal() {
    let (base, goal_picture) = (flat(0.02), picture(&FLOOR, &flat(0.1), &lamps()[1..3]));
    let left = Some((0..96).map(|i| if i % 12 < 6 { 1.0 } else { 0.1 }).collect::<Vec<f32>>());
    let goal = |criterion| Goal { criterion, pixels: left.clone(), weight: 0.7 };
    let goals = [
        target(goal_picture.clone()),
        goal(Criterion::Target { image: goal_picture, exposure_invariant: true }),
        goal(Criterion::Brightness { stops: 1.0 }),
        goal(Criterion::Color { color: [0.2, 0.5, 0.9] }),
        goal(Criterion::Temperature { mireds: -60.0 }),
        goal(Criterion::Keep),
    ];
    for light in lamps() {
        let other = disturbed(&lamps()[1]);
        let variables = vec![
            Variable { prior_weight: 0.05, ..variable(&light) },
            Variable { prior_weight: 0.05, ..variable(&other) },
        ];
        let view =
            |relight: &'static Lambert| View { relight, base: &base, still: vec![None, None], goals: &goals };
        let problem = Problem { views: vec![view(&FLOOR), view(&IN_CELLS)], variables };
        let objective = Objective::new(&problem, 0.0).unwrap();
        let lights = [disturbed(&light), lamps()[1].clone()];
        let maps = mappings(&problem, &lights, 0.0).unwrap();
        let draw = objective.spread(60);
        let (loss, gradient) = objective.gradient(&maps, &lights, &draw).unwrap();
        assert!((loss / objective.loss(&maps, &lights, &draw).unwrap() - 1.0).abs() < 1e-5);
        for (i, lane) in (0..2).flat_map(|i| (0..PARAMS).map(move |lane| (i, lane))) {
            let at = |delta: f32| {
                let mut step = [0.0; PARAMS];
                step[lane] = delta;
                let mut lights = lights.clone();
                lights[i] = maps[i].step(&lights[i], &step);
                objective.loss(&maps, &lights, &draw).unwrap()
            };
            let slope = (at(1e-2) - at(-1e-2)) / 2e-2;
            let error = (slope - f64::from(gradient[i][lane])).abs();
            // Differences of a loss in single precision are good to about 1e-5; a turn's own cost is first order.
            assert!(
                error < 2e-2 * slope.abs() + 4e-5 * loss + 2e-4,
                "{i} {lane} of {light:?}: {slope} for {}",
                gradient[i][lane]
            );
        }
    }
}

#[test]
fn every_type_of_light_is_found_again() {
    let base = flat(0.02);
    for light in lamps() {
        let goals = [target(picture(&FLOOR, &base, std::slice::from_ref(&light)))];
        let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
        let problem = Problem { views: vec![view.clone()], variables: vec![variable(&light)] };
        let settings = Settings { iterations: 400, pixel_fraction: 1.0, ..Settings::default() };
        let solution =
            solve(&problem, &[vec![disturbed(&light)]], &settings, &|_| ControlFlow::Continue(())).unwrap();
        assert!(
            solution.loss < 2e-2 * solution.start_loss,
            "{light:?}: {} of {}",
            solution.loss,
            solution.start_loss
        );
        let problem = Problem { views: vec![View { relight: &IN_CELLS, ..view }], ..problem };
        let polished =
            polish(&problem, &[&solution.lights[..]], 60, &mut |_| ControlFlow::Continue(())).unwrap();
        assert!(polished.loss < 1e-6, "{light:?}: {} after {}", polished.loss, polished.start_loss);
        let found = &polished.lights[0];
        if let (Some(a), Some(b)) = (found.shape.center(), light.shape.center()) {
            assert!(a.distance(b) < 0.02, "{a} for {b}");
        }
        let (a, b) = (crate::variable::power(found), crate::variable::power(&light));
        (0..3).for_each(|c| assert!((a[c] / b[c] - 1.0).abs() < 0.03, "{light:?}: {a:?} for {b:?}"));
    }
}

#[test]
fn locked_values_come_back_bit_by_bit_and_still_lights_by_their_picture() {
    let (base, lamps) = (flat(0.02), lamps());
    let still = picture(&FLOOR, &flat(0.0), &[Light { radiance: [1.0; 3], ..lamps[3].clone() }]);
    let wanted =
        [lamps[0].clone(), Light { radiance: lamps[3].radiance.map(|r| 2.5 * r), ..lamps[3].clone() }];
    let goals = [target(picture(&FLOOR, &base, &wanted))];
    let view = View { relight: &FLOOR, base: &base, still: vec![None, Some(&still)], goals: &goals };
    let moves = Locks { position: false, ..Locks::ALL };
    let dims = Locks { strength: false, ..Locks::ALL };
    let mut start = lamps[0].clone();
    start.shape = start.shape.moved(&[0.3, 0.3, -0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let variables =
        vec![Variable { locks: moves, ..variable(&start) }, Variable { locks: dims, ..variable(&lamps[3]) }];
    let problem = Problem { views: vec![view], variables };
    let settings = Settings { iterations: 300, pixel_fraction: 1.0, ..Settings::default() };
    let solution =
        solve(&problem, &[vec![start, lamps[3].clone()]], &settings, &|_| ControlFlow::Continue(())).unwrap();
    let [a, b] = [&solution.lights[0], &solution.lights[1]];
    assert_eq!((a.radiance, a.shape.sizes()), (lamps[0].radiance, lamps[0].shape.sizes()));
    assert!(a.shape.center().unwrap().distance(lamps[0].shape.center().unwrap()) < 0.1, "{a:?}");
    assert_eq!(b.shape, lamps[3].shape);
    assert!((b.radiance[0] / lamps[3].radiance[0] - 2.5).abs() < 0.1, "{b:?}");
}

#[test]
fn more_starts_are_never_worse_and_the_best_is_kept() {
    let base = flat(0.02);
    let hidden = [lamps()[0].clone(), disturbed(&lamps()[1])];
    let goals = [target(picture(&FLOOR, &base, &hidden))];
    let view = View { relight: &FLOOR, base: &base, still: vec![None, None], goals: &goals };
    let variables = hidden.iter().map(variable).collect();
    let problem = Problem { views: vec![view], variables };
    let options = RandomStarts { count: 6, candidates: 1, softness: 0.0, seed: 3 };
    let starts = random_starts(&problem, &options).unwrap();
    assert_eq!(starts, random_starts(&problem, &options).unwrap(), "a seed says it all");
    let settings = Settings { iterations: 120, pixel_fraction: 1.0, ..Settings::default() };
    let go =
        |starts: &[Vec<Light>]| solve(&problem, starts, &settings, &|_| ControlFlow::Continue(())).unwrap();
    let (one, six) = (go(&starts[..1]), go(&starts));
    assert!(six.loss < one.loss, "{} for {}", six.loss, one.loss);
    assert_eq!(one.runner_up, None);
    assert!(six.runner_up.is_some_and(|second| second.start != six.start && second.lights != six.lights));
    let chosen = random_starts(&problem, &RandomStarts { candidates: 16, ..options }).unwrap();
    let loss = |starts: &[Vec<Light>]| {
        let none = Settings { iterations: 0, ..settings };
        starts
            .iter()
            .map(|start| {
                solve(&problem, std::slice::from_ref(start), &none, &|_| ControlFlow::Continue(()))
                    .unwrap()
                    .loss
            })
            .sum::<f64>()
    };
    let (chosen, drawn) = (loss(&chosen), loss(&starts));
    assert!(chosen < 0.8 * drawn, "choosing among places helps: {chosen} for {drawn}");
}

#[test]
fn cancelling_at_any_step_gives_the_best_until_then() {
    let base = flat(0.02);
    let light = &lamps()[0];
    let goals = [target(picture(&FLOOR, &base, std::slice::from_ref(light)))];
    let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
    let problem = Problem { views: vec![view], variables: vec![variable(light)] };
    for last in [0, 1, 30] {
        let stop = |step: SolverStep| match step.iteration >= last {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let start = [vec![disturbed(light)]];
        let solution = solve(&problem, &start, &Settings::default(), &stop).unwrap();
        assert!(solution.cancelled && solution.loss <= solution.start_loss);
        assert_eq!(solution.losses.len(), last + 1);
    }
}

#[test]
fn lights_that_do_nothing_are_named() {
    let (base, lamps) = (flat(0.02), lamps());
    let goals = [target(picture(&FLOOR, &base, &lamps[..2]))];
    let view = View { relight: &FLOOR, base: &base, still: vec![None; 4], goals: &goals };
    let mut lights = lamps[..4].to_vec();
    lights[2].radiance = [1e-6; 3];
    lights[3].radiance = [0.0; 3];
    let problem = Problem { views: vec![view], variables: lights.iter().map(variable).collect() };
    let mut idle = idle_lights(&problem, &lights, &[true; 4], 0.0).unwrap();
    idle.sort();
    assert_eq!(idle, [2, 3]);
    assert_eq!(idle_lights(&problem, &lights, &[true, true, false, true], 0.0).unwrap(), [3]);
}

#[test]
fn bad_input_is_named() {
    let base = flat(0.02);
    let light = lamps()[0].clone();
    let attempt = |goals: &[Goal], variable: Variable| {
        let view = View { relight: &FLOOR, base: &base, still: vec![None], goals };
        let problem = Problem { views: vec![view], variables: vec![variable] };
        let error =
            solve(&problem, &[vec![light.clone()]], &Settings::default(), &|_| ControlFlow::Continue(()));
        error.unwrap_err().to_string()
    };
    let good = variable(&light);
    assert!(attempt(&[], good.clone()).contains("nothing is asked for"));
    assert!(attempt(&[target(flat(0.0))], good.clone()).contains("black everywhere"));
    assert!(attempt(&[target(flat(f32::NAN))], good.clone()).contains("finite"));
    assert!(attempt(&[target(Image::new(4, 4, 3))], good.clone()).contains("4 x 4 pixels, the bake 12 x 8"));
    let nowhere = Goal { pixels: Some(vec![0.0; 96]), ..target(flat(1.0)) };
    assert!(attempt(&[nowhere], good.clone()).contains("goal 1 concerns no pixel"));
    let all_locked = Variable { locks: Locks::ALL, ..good.clone() };
    assert!(attempt(&[target(flat(1.0))], all_locked).contains("unlock"));
    let inverted = Variable { bounds: Bounds { size: [1.0, 0.5], ..bounds() }, ..good.clone() };
    assert!(attempt(&[target(flat(1.0))], inverted).contains("'Lamp': bounds of the size"));
    let cap = |angle: f32| Some(DirectionCone { axis: Vec3::Z, angle });
    for (bounds, what) in [
        (Bounds { strength: Some([2.0, 1.0]), ..bounds() }, "the strength"),
        (Bounds { strength: Some([f32::NAN, 1.0]), ..bounds() }, "the strength"),
        (Bounds { direction: cap(-0.1), ..bounds() }, "the direction"),
        (Bounds { direction: cap(f32::NAN), ..bounds() }, "the direction"),
    ] {
        let error = attempt(&[target(flat(1.0))], Variable { bounds, ..good.clone() });
        assert!(error.contains(&format!("'Lamp': bounds of {what}")), "{error}");
    }
}

#[test]
fn a_black_picture_gives_strokes_nothing_to_go_by_but_a_target_does() {
    let (base, dark) = (flat(0.0), Light { radiance: [0.0; 3], ..lamps()[0].clone() });
    let of = |criterion: Criterion| Goal { criterion, pixels: None, weight: 1.0 };
    let attempt = |goals: &[Goal]| {
        let view = View { relight: &FLOOR, base: &base, still: vec![None], goals };
        let problem = Problem { views: vec![view], variables: vec![variable(&dark)] };
        let found =
            solve(&problem, &[lamps()[..1].to_vec()], &Settings::default(), &|_| ControlFlow::Continue(()));
        found.map(|found| found.lights[0].radiance)
    };
    for criterion in [Criterion::Brightness { stops: 1.0 }, Criterion::Color { color: [1.0, 0.5, 0.2] }] {
        assert!(matches!(attempt(&[of(criterion)]), Err(OptimiseError::BlackBefore)));
    }
    let wanted = picture(&FLOOR, &base, &lamps()[..1]);
    let found = attempt(&[target(wanted), Goal { weight: 0.1, ..of(Criterion::Keep) }]).unwrap();
    assert!(found.iter().all(|channel| channel.is_finite() && *channel > 0.0), "{found:?}");
}

#[test]
fn a_colour_is_found_for_light_that_is_all_there_is() {
    let (base, lamp) = (flat(0.0), lamps()[0].clone());
    let goals = [Goal { criterion: Criterion::Color { color: [1.0, 0.5, 0.25] }, pixels: None, weight: 1.0 }];
    let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
    let problem = Problem { views: vec![view], variables: vec![variable(&lamp)] };
    let settings = Settings { iterations: 300, pixel_fraction: 1.0, ..Settings::default() };
    let found = solve(&problem, &[vec![lamp.clone()]], &settings, &|_| ControlFlow::Continue(())).unwrap();
    let [before, after] = [&[lamp][..], &found.lights].map(|lights| picture(&FLOOR, &base, lights));
    let report = report(&goals[0], &before, &after);
    assert!(report.met && report.reached < 0.2 * report.before, "{report:?}");
}

struct Broken;

impl Relight for Broken {
    fn size(&self) -> (usize, usize) {
        SIZE
    }
    fn values(&self, _: &Light, _: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        Ok(vec![[f32::NAN; 3]; cells.len()])
    }
    fn pull_back(&self, _: &Light, _: f32, _: &[u32], _: &[[f32; 3]]) -> Result<[f32; LANES], RelightError> {
        Ok([f32::NAN; LANES])
    }
}

#[test]
fn a_broken_relighter_is_an_error_not_a_result() {
    let (base, light, goals) = (flat(0.02), lamps()[0].clone(), [target(flat(1.0))]);
    let view = View { relight: &Broken, base: &base, still: vec![None], goals: &goals };
    let problem = Problem { views: vec![view], variables: vec![variable(&light)] };
    let result = solve(&problem, &[vec![light]], &Settings::default(), &|_| ControlFlow::Continue(()));
    assert!(matches!(result, Err(OptimiseError::Diverged)));
}

#[test]
fn brighter_does_not_tint_and_warmer_does_not_dim() {
    // Without a base, whose colour would be a part of the picture's.
    let (base, light) = (flat(0.0), lamps()[0].clone());
    let still = picture(&FLOOR, &flat(0.0), &[Light { radiance: [1.0; 3], ..light.clone() }]);
    let locks = Locks { color: false, strength: false, ..Locks::ALL };
    let found = |criterion: Criterion| {
        let goals = [Goal { criterion, pixels: None, weight: 1.0 }];
        let view = View { relight: &FLOOR, base: &base, still: vec![Some(&still)], goals: &goals };
        let problem = Problem { views: vec![view], variables: vec![Variable { locks, ..variable(&light) }] };
        let settings = Settings { iterations: 300, pixel_fraction: 1.0, ..Settings::default() };
        solve(&problem, &[vec![light.clone()]], &settings, &|_| ControlFlow::Continue(())).unwrap().lights[0]
            .radiance
    };
    let luminance = |c: [f32; 3]| crate::variable::luminance(c) / crate::variable::luminance(light.radiance);
    let ratio = |c: [f32; 3], i: usize| c[i] / c[1] / (light.radiance[i] / light.radiance[1]);
    let brighter = found(Criterion::Brightness { stops: 1.0 });
    assert!(luminance(brighter) > 1.8, "{brighter:?}");
    assert!(
        (ratio(brighter, 0) - 1.0).abs() < 0.05 && (ratio(brighter, 2) - 1.0).abs() < 0.05,
        "{brighter:?}"
    );
    let warmer = found(Criterion::Temperature { mireds: 60.0 });
    assert!(ratio(warmer, 0) / ratio(warmer, 2) > 1.4, "{warmer:?}");
    assert!((luminance(warmer) - 1.0).abs() < 0.05, "{warmer:?}");
}

#[test]
fn a_region_gets_as_many_stops_as_asked_for_on_average() {
    let (base, light) = (flat(0.02), lamps()[0].clone());
    // Its near side gains more than its far side as the light moves.
    let region: Vec<f32> = (0..SIZE.0 * SIZE.1).map(|i| if i % SIZE.0 < 7 { 1.0 } else { 0.0 }).collect();
    let goals =
        [Goal { criterion: Criterion::Brightness { stops: 1.0 }, pixels: Some(region.clone()), weight: 1.0 }];
    let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
    let locks = Locks { position: false, strength: false, ..Locks::ALL };
    let problem = Problem { views: vec![view], variables: vec![Variable { locks, ..variable(&light) }] };
    let settings = Settings { iterations: 300, pixel_fraction: 1.0, ..Settings::default() };
    let found = solve(&problem, &[vec![light.clone()]], &settings, &|_| ControlFlow::Continue(())).unwrap();
    let polished = polish(&problem, &[&found.lights[..]], 60, &mut |_| ControlFlow::Continue(())).unwrap();
    let [before, after] = [&[light][..], &polished.lights].map(|lights| picture(&FLOOR, &base, lights));
    let reached = report(&goals[0], &before, &after).reached;
    assert!((1.0..1.04).contains(&reached), "{reached}");
}
