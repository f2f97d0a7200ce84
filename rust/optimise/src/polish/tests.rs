use super::*;
use crate::objective::{add, mean};
use crate::random::Random;
use crate::relight::PictureCells;
use crate::tests::{FLOOR, SIZE, flat, lamps, picture, target, variable};
use crate::variable::luminance;
use crate::{Criterion, Goal, Locks, Relight, RelightError, View};
use glam::Vec3;
use relume_scene::{LANES, LightShape};

/// A floor with noise, from whose bright cells cleaning takes a part: the more of both the smaller the light.
struct Noisy {
    seed: u64,
    noise: f32,
    dimming: f32,
}

impl Noisy {
    fn half(&self, light: &Light, half: u64) -> Vec<[f32; 3]> {
        let cell = |cell: u32| {
            // Other segments meet a light of another size.
            let number = u64::from(light.shape.sizes()[0].to_bits()) << 32 | u64::from(cell) << 1 | half;
            let seed = self.seed << 50 ^ number;
            let noise = self.noise / light.shape.sizes()[0] * (2.0 * Random::new(seed).next_f32() - 1.0);
            FLOOR.of_cell(&light.shape, cell).map(|v| v * (1.0 + noise))
        };
        (0..(SIZE.0 * SIZE.1) as u32).map(cell).collect()
    }
}

impl Relight for Noisy {
    fn size(&self) -> (usize, usize) {
        SIZE
    }
    fn values(&self, light: &Light, _: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        FLOOR.values(light, 0.0, cells)
    }
    fn half_values(&self, lights: &[&Light], cells: &[u32]) -> Result<Vec<[Vec<[f32; 3]>; 2]>, RelightError> {
        let at = |whole: Vec<[f32; 3]>| cells.iter().map(|cell| whole[*cell as usize]).collect();
        Ok(lights.iter().map(|light| [0, 1].map(|half| at(self.half(light, half)))).collect())
    }
    fn picture(&self, lights: &[&Light]) -> Result<PictureCells, RelightError> {
        let light = lights[0];
        let lit = |v: [f32; 3]| std::array::from_fn(|c| v[c] * light.radiance[c]);
        let exact = [0, 1].map(|half| self.half(light, half).into_iter().map(lit).collect::<Vec<[f32; 3]>>());
        let dimmed =
            |v: &[f32; 3]| v.map(|v| v * (1.0 - self.dimming / light.shape.sizes()[0] * v / (v + 1.0)));
        Ok(PictureCells { clean: exact.each_ref().map(|half| half.iter().map(dimmed).collect()), exact })
    }
    fn pull_back(&self, _: &Light, _: f32, _: &[u32], _: &[[f32; 3]]) -> Result<[f32; LANES], RelightError> {
        Ok([0.0; LANES])
    }
}

fn lamp(radius: f32) -> Light {
    let shape = LightShape::Sphere { center: Vec3::new(0.3, 0.6, 0.9), radius };
    let radiance = [6.0, 3.0, 2.0].map(|power| power / shape.extent());
    Light { shape, radiance, ..lamps()[0].clone() }
}

/// Result for a light of radius 1 where one of `radius` is asked for, and by how much cleaned pictures are for or
/// against that.
fn sizes(relight: Noisy, radius: f32, rounds: usize) -> (f32, f64) {
    let base = flat(0.0);
    let goals = [target(picture(&FLOOR, &base, &[lamp(radius)]))];
    let view = View { relight: &relight, base: &base, still: vec![None], goals: &goals };
    let lights = [lamp(1.0)];
    let problem = Problem { views: vec![view], variables: vec![variable(&lights[0])] };
    let objective = Objective::new(&problem, 0.0).unwrap();
    let draw = objective.spread(MOST_CELLS);
    let fit = Fit::new(&objective, &draw, mappings(&problem, &lights, 0.0).unwrap());
    let [asked, larger] = [radius, 1.5 * radius].map(|radius| fit.state(&[lamp(radius)]).unwrap());
    let against = fit.loss(&asked, &Trust::default()) - fit.loss(&larger, &Trust::default());
    let mut found = fit.state(&lights).unwrap();
    for _ in 0..rounds {
        found = fit.with_best_sizes(found).unwrap();
    }
    (found.lights[0].shape.sizes()[0], against)
}

#[test]
fn sizes_are_those_of_exact_pictures_where_cleaned_ones_ask_for_larger_lights() {
    let (found, against) = sizes(Noisy { seed: 0, noise: 0.003, dimming: 0.1 }, 0.27, STAGES.len());
    assert!(against > 0.0, "the cleaned pictures are for the light that was asked for: {against}");
    assert!((found / 0.27).ln().abs() < 0.3, "{found}");
}

#[test]
fn what_was_asked_for_is_there_where_cleaned_pictures_only_seem_to_have_it() {
    // Cleaning adds to bright cells: a light that comes nearer seems to do more than it does.
    let relight = Noisy { seed: 0, noise: 0.003, dimming: -1.5 };
    let (base, before) = (flat(0.02), lamp(0.8));
    let place: Vec<f32> = (0..SIZE.0 * SIZE.1).map(|i| f32::from(i % SIZE.0 < 3)).collect();
    let goals =
        [Goal { criterion: Criterion::Brightness { stops: 0.5 }, pixels: Some(place.clone()), weight: 1.0 }];
    let view = View { relight: &relight, base: &base, still: vec![None], goals: &goals };
    let mut moves = variable(&before);
    moves.locks = Locks { position: false, ..Locks::ALL };
    let problem = Problem { views: vec![view], variables: vec![moves] };
    let found = polish(&problem, &[std::slice::from_ref(&before)], 64, &mut |_| ControlFlow::Continue(()));
    let mean = |pictures: &[Vec<[f32; 3]>; 2]| {
        let of_half = |half: &Vec<[f32; 3]>| {
            half.iter().zip(&place).map(|(pixel, weight)| weight * luminance(*pixel)).sum::<f32>()
        };
        0.02 + pictures.iter().map(of_half).sum::<f32>() / (2.0 * place.iter().sum::<f32>())
    };
    let [before, after] =
        [&before, &found.unwrap().lights[0]].map(|light| relight.picture(&[light]).unwrap());
    let exact = (mean(&after.exact) / mean(&before.exact)).log2();
    let clean = (mean(&after.clean) / mean(&before.clean)).log2();
    assert!((0.5..0.56).contains(&exact) && clean > exact + 0.05, "{exact} {clean}");
}

#[test]
fn noise_alone_seldom_changes_a_size() {
    let is_changed = |seed: &u64| sizes(Noisy { seed: *seed, noise: 2.0, dimming: 0.0 }, 1.1, 1).0 != 1.0;
    let changed = (0..40).filter(is_changed).count();
    assert!(changed <= 6, "{changed} of 40");
    let found = sizes(Noisy { seed: 0, noise: 0.0, dimming: 0.0 }, 0.27, 1).0;
    assert!(found < 0.5, "without noise it would be changed: {found}");
}

#[test]
fn residuals_beside_a_picture_are_its_own_to_first_order() {
    let (base, noisy) = (flat(0.02), Noisy { seed: 1, noise: 0.002, dimming: 0.0 });
    let light = lamp(0.4);
    let criteria = [
        Criterion::Target { image: picture(&FLOOR, &base, &[lamp(0.6)]), exposure_invariant: false },
        Criterion::Target { image: picture(&FLOOR, &flat(0.3), &[lamp(0.6)]), exposure_invariant: true },
        Criterion::Brightness { stops: 1.0 },
        Criterion::Temperature { mireds: 40.0 },
        Criterion::Keep,
    ];
    for criterion in criteria {
        let goals = [Goal { criterion, pixels: None, weight: 2.0 }];
        let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
        let problem = Problem { views: vec![view], variables: vec![variable(&light)] };
        let objective = Objective::new(&problem, 0.0).unwrap();
        let (draw, view) = (&objective.spread(MOST_CELLS)[0], &objective.views[0]);
        let clean = mean(&view.whole_picture(std::slice::from_ref(&light)).unwrap().clean);
        let mut other = clean.clone();
        add(&mut other, &noisy.half(&light, 0), light.radiance);
        add(
            &mut other,
            &FLOOR.values(&light, 0.0, &(0..96).collect::<Vec<_>>()).unwrap(),
            light.radiance.map(|r| -r),
        );
        let of = |at: &[[f32; 3]], picture: &[[f32; 3]]| {
            let twice = || [at.to_vec(), at.to_vec()];
            let at = PictureCells { exact: twice(), clean: twice() };
            let uncertainties = view.uncertainties(&at, draw);
            view.residuals_beside(&view.compare_picture(&at, &uncertainties, draw), picture, draw)
        };
        let distance =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
        let (before, own, beside) = (of(&clean, &clean), of(&other, &other), of(&clean, &other));
        let (all, missed) = (distance(&own, &before), distance(&own, &beside));
        assert!(all > 0.0 && missed < 0.03 * all, "{:?}: {missed} of {all}", goals[0].criterion);
    }
}
