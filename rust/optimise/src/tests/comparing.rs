//! A relighter that compares its pictures itself, as those on a GPU do.

use super::*;
use crate::objective::add;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The floor, which compares its pictures itself, and counts how often.
struct Comparing(AtomicUsize);

/// Pictures of the floor over others.
struct OnFloor<'a> {
    base: Vec<[f32; 3]>,
    still: Vec<Vec<[f32; 3]>>,
    count: &'a AtomicUsize,
}

impl Relight for Comparing {
    fn size(&self) -> (usize, usize) {
        FLOOR.size()
    }
    fn values(&self, light: &Light, softness: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError> {
        FLOOR.values(light, softness, cells)
    }
    fn pull_back(
        &self,
        light: &Light,
        softness: f32,
        cells: &[u32],
        d: &[[f32; 3]],
    ) -> Result<[f32; LANES], RelightError> {
        FLOOR.pull_back(light, softness, cells, d)
    }
    fn comparison<'a>(
        &'a self,
        base: &[[f32; 3]],
        still: &[&[[f32; 3]]],
    ) -> Result<Option<Box<dyn Compare + 'a>>, RelightError> {
        let still = still.iter().map(|picture| picture.to_vec()).collect();
        Ok(Some(Box::new(OnFloor { base: base.to_vec(), still, count: &self.0 })))
    }
}

impl Compare for OnFloor<'_> {
    fn gradient(
        &self,
        lights: &[&Light],
        still: &[[f32; 3]],
        softness: f32,
        wanted: &[TermTarget],
    ) -> Result<Option<LossGradient>, RelightError> {
        self.count.fetch_add(1, Ordering::Relaxed);
        let mut compared = LossGradient {
            loss: 0.0,
            lights: vec![Default::default(); lights.len()],
            still: vec![[0.0; 3]; still.len()],
        };
        for wanted in wanted {
            let cells = wanted.cells.clone();
            let at = |picture: &Vec<[f32; 3]>| cells.iter().map(|cell| picture[*cell as usize]).collect();
            let units = lights.iter().map(|light| FLOOR.values(light, softness, &cells));
            let units: Vec<Vec<[f32; 3]>> = units.collect::<Result<_, _>>()?;
            let held: Vec<Vec<[f32; 3]>> = self.still.iter().map(at).collect();
            let mut picture: Vec<[f32; 3]> = at(&self.base);
            for (light, unit) in lights.iter().zip(&units) {
                add(&mut picture, unit, light.radiance);
            }
            for (radiance, unit) in still.iter().zip(&held) {
                add(&mut picture, unit, *radiance);
            }
            let (loss, d_picture) = wanted.clone().compare(picture);
            compared.loss += loss;
            let pull = |d_radiance: &mut [f32; 3], unit: &[[f32; 3]]| {
                for (d, unit) in d_picture.iter().zip(unit) {
                    (0..3).for_each(|c| d_radiance[c] += d[c] * unit[c]);
                }
            };
            compared.still.iter_mut().zip(&held).for_each(|(d, unit)| pull(d, unit));
            for ((light, unit), (d_shape, d_radiance)) in lights.iter().zip(&units).zip(&mut compared.lights)
            {
                pull(d_radiance, unit);
                let scaled = |d: &[f32; 3]| std::array::from_fn(|c| d[c] * light.radiance[c]);
                let d_unit: Vec<[f32; 3]> = d_picture.iter().map(scaled).collect();
                let pulled = FLOOR.pull_back(light, softness, &cells, &d_unit)?;
                d_shape.iter_mut().zip(pulled).for_each(|(sum, d)| *sum += d);
            }
        }
        Ok(Some(compared))
    }
}

#[test]
fn goals_are_compared_where_the_pictures_are_made() {
    let (base, lights) = (flat(0.02), [lamps()[1].clone(), lamps()[0].clone(), lamps()[2].clone()]);
    let image = picture(&FLOOR, &flat(0.1), &lamps()[1..3]);
    let left: Vec<f32> = (0..96).map(|i| if i % 12 < 6 { 1.0 } else { 0.1 * (i % 3) as f32 }).collect();
    let goals = [
        Goal {
            criterion: Criterion::Target { image: image.clone(), exposure_invariant: false },
            pixels: None,
            weight: 0.7,
        },
        Goal {
            criterion: Criterion::Target { image, exposure_invariant: true },
            pixels: Some(left.clone()),
            weight: 0.7,
        },
        Goal { criterion: Criterion::Brightness { stops: 1.0 }, pixels: Some(left), weight: 0.4 },
    ];
    let held = picture(&FLOOR, &flat(0.0), &[Light { radiance: [1.0; 3], ..lights[1].clone() }]);
    let locked = Locks { color: false, strength: false, ..Locks::ALL };
    for goals in [&goals[..1], &goals] {
        let own = Comparing(AtomicUsize::new(0));
        let gradient = |relight: &dyn Relight| {
            let still = vec![None, Some(&held), None];
            let view = View { relight, base: &base, still, goals };
            let mut variables: Vec<Variable> = lights.iter().map(variable).collect();
            variables[1].locks = locked;
            let problem = Problem { views: vec![view], variables };
            let objective = Objective::new(&problem, 0.0).unwrap();
            let lights = [disturbed(&lights[0]), lights[1].clone(), disturbed(&lights[2])];
            let (maps, draw) = (mappings(&problem, &lights, 0.0).unwrap(), objective.spread(60));
            let loss = objective.loss(&maps, &lights, &draw).unwrap();
            (loss, objective.gradient(&maps, &lights, &draw).unwrap())
        };
        let ((alone, (loss, expected)), (own_alone, (own_loss, found))) = (gradient(&FLOOR), gradient(&own));
        assert_eq!(own.0.load(Ordering::Relaxed), 2);
        let are_near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-5;
        assert!(are_near(own_loss, loss) && are_near(own_alone, alone), "{own_loss} for {loss}");
        for (found, expected) in found.iter().zip(&expected) {
            let largest = expected.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
            for (a, b) in found.iter().zip(expected) {
                assert!((a - b).abs() < 1e-5 * largest, "{found:?} for {expected:?}");
            }
        }
    }
}
