use super::*;
use crate::tests::{FLOOR, disturbed, flat, lamps, picture, target, variable};
use crate::*;
use std::ops::ControlFlow;

fn stops(light: &Light, home: &Light) -> f32 {
    (luminance(power(light)) / luminance(power(home))).log2()
}

fn brightened(light: &Light, factor: f32) -> Light {
    Light { radiance: light.radiance.map(|radiance| factor * radiance), ..light.clone() }
}

fn turned(light: &Light, turn: Vec3) -> Light {
    let mut step = [0.0; LANES];
    step[lane::TURN].copy_from_slice(&turn.to_array());
    Light { shape: light.shape.moved(&step), ..light.clone() }
}

fn bounded(home: &Light, locks: Locks, stops: Option<[f32; 2]>, angle: Option<f32>) -> Variable {
    let variable = variable(home);
    Variable { locks, bounds: variable.bounds.around(home, stops, angle), ..variable }
}

fn tinted(home: &Light, locks: Locks, stops: f32) -> Variable {
    let variable = variable(home);
    Variable { locks, bounds: variable.bounds.tinted(home, Some(stops)), ..variable }
}

/// Stops by which the ratio of two channels differs most from what it is at home.
fn stops_of_color(light: &Light, home: &Light) -> f32 {
    let away = [0, 1, 2].map(|c| (power(light)[c] / power(home)[c]).log2());
    away.into_iter().fold(f32::MIN, f32::max) - away.into_iter().fold(f32::MAX, f32::min)
}

/// Solution for one light, which starts as the variable has it, by steps and then by a polish, with what is left of the
/// loss.
fn found(wanted: &Light, variable: &Variable, iterations: usize) -> (Light, f64) {
    let base = flat(0.02);
    let goals = [target(picture(&FLOOR, &base, std::slice::from_ref(wanted)))];
    let still = picture(&FLOOR, &flat(0.0), &[Light { radiance: [1.0; 3], ..variable.light.clone() }]);
    let still = variable.locks.hold_shape(&variable.light.shape).then_some(&still);
    let view = View { relight: &FLOOR, base: &base, still: vec![still], goals: &goals };
    let problem = Problem { views: vec![view], variables: vec![variable.clone()] };
    let settings = Settings { iterations, pixel_fraction: 1.0, ..Settings::default() };
    let start = vec![variable.light.clone()];
    let solution = solve(&problem, &[start], &settings, &|_| ControlFlow::Continue(())).unwrap();
    let polished = polish(&problem, &[&solution.lights], 60, &mut |_| ControlFlow::Continue(())).unwrap();
    (polished.lights[0].clone(), polished.loss)
}

#[test]
fn strength_ends_at_its_bound_and_the_rest_is_as_good_as_it_can_be_there() {
    for (lamp, color) in lamps().into_iter().flat_map(|lamp| [(lamp.clone(), true), (lamp, false)]) {
        let direction = lamp.shape.center().is_some();
        let locks = Locks { color, direction, size: true, cone: true, ..Locks::default() };
        let home = Light { shape: disturbed(&lamp).shape, ..lamp.clone() };
        let home =
            Light { radiance: lamp.radiance.map(|r| r * lamp.shape.extent() / home.shape.extent()), ..home };
        for (wanted, range, end) in
            [(4.0, [-2.0, 1.0], 1.0), (0.3, [-0.5, 0.0], -0.5), (3.0, [-1.0, 0.0], 0.0)]
        {
            let wanted = brightened(&lamp, wanted);
            let (light, loss) = found(&wanted, &bounded(&home, locks, Some(range), None), 800);
            let is = stops(&light, &home);
            assert!((range[0] - 1e-5..range[1] + 1e-5).contains(&is), "{is} outside of {range:?}: {light:?}");
            assert!((is - end).abs() < 0.02, "{is} for {end}: {light:?}");
            let there =
                bounded(&brightened(&home, end.exp2()), Locks { strength: true, ..locks }, None, None);
            let (_, best) = found(&wanted, &there, 800);
            assert!(loss < 1.005 * best, "{loss} where {best} is possible: {light:?}");
        }
    }
}

#[test]
fn polishing_alone_goes_along_bounds() {
    for (lamp, is_turn) in lamps().into_iter().flat_map(|lamp| [(lamp.clone(), true), (lamp, false)]) {
        let locks = Locks { size: true, cone: true, ..Locks::default() };
        let home = Light { shape: disturbed(&lamp).shape, ..lamp.clone() };
        let (stops, angle) = if is_turn { (None, Some(0.05)) } else { (Some([-1.0, 0.0]), None) };
        let bounds = bounded(&home, locks, stops, angle);
        let [alone, best] = [0, 800].map(|steps| found(&brightened(&lamp, 2.0), &bounds, steps).1);
        assert!(alone < 1.05 * best, "{alone} where {best} is possible: {lamp:?}");
    }
}

#[test]
fn polishing_alone_takes_a_strength_to_its_bound() {
    for (home, color) in lamps().into_iter().flat_map(|lamp| [(lamp.clone(), true), (lamp, false)]) {
        let locks = Locks { strength: false, color, ..Locks::ALL };
        let bounds = bounded(&home, locks, Some([-1.0, 1.0]), None);
        let (light, _) = found(&brightened(&home, 4.0), &bounds, 0);
        assert!((stops(&light, &home) - 1.0).abs() < 1e-5, "{light:?}");
    }
}

#[test]
fn directions_end_at_their_bound_where_that_is_best() {
    let turn = Vec3::new(0.3, -0.5, 0.2);
    for lamp in lamps().into_iter().filter(|lamp| lamp.shape.axis().is_some()) {
        let locks = Locks { direction: false, ..Locks::ALL };
        let home = turned(&lamp, turn);
        let variable = bounded(&home, locks, None, Some(0.2));
        let (light, loss) = found(&lamp, &variable, 200);
        let cap = variable.bounds.direction.unwrap();
        let angle = cap.angle_to(light.shape.axis().unwrap());
        assert!(angle > 0.199 && angle < 0.2 + 1e-5, "{angle} rad: {light:?}");
        // All directions at the edge.
        let base = flat(0.02);
        let goals = [target(picture(&FLOOR, &base, std::slice::from_ref(&lamp)))];
        let view = View { relight: &FLOOR, base: &base, still: vec![None], goals: &goals };
        let problem = Problem { views: vec![view], variables: vec![variable.clone()] };
        let loss_of = |light: Light| {
            let none = Settings { iterations: 0, ..Settings::default() };
            solve(&problem, &[vec![light]], &none, &|_| ControlFlow::Continue(())).unwrap().loss
        };
        let across = cap.axis.any_orthonormal_vector();
        let edge = (0..90).map(|i| {
            let around = glam::Quat::from_axis_angle(cap.axis, i as f32 / 90.0 * std::f32::consts::TAU);
            loss_of(turned(&home, around * across * 0.2))
        });
        let best = edge.fold(f64::INFINITY, f64::min);
        assert!(loss < 1.01 * best, "{loss} where {best} is possible: {light:?}");
    }
}

#[test]
fn colors_end_at_their_bound_and_the_rest_is_as_good_as_it_can_be_there() {
    for (lamp, strength) in lamps().into_iter().flat_map(|lamp| [(lamp.clone(), false), (lamp, true)]) {
        let locks = Locks { color: false, strength, ..Locks::ALL };
        let home = Light { radiance: [lamp.radiance[1]; 3], ..lamp.clone() };
        for wanted in [[4.0, 1.0, 0.5], [0.1, 1.0, 1.0], [1.0, 3.0, 1.0]] {
            let shine = std::array::from_fn(|c| wanted[c] * home.radiance[c]);
            let wanted = Light { radiance: shine, ..home.clone() };
            let variable = tinted(&home, locks, 0.5);
            let [loss, alone] = [800, 0].map(|steps| {
                let (light, loss) = found(&wanted, &variable, steps);
                let is = stops_of_color(&light, &home);
                assert!(is < 0.5 + 1e-4, "{is}: {light:?}");
                loss
            });
            // All colours at the edge, a hexagon of ratios.
            let edge = (0..6).flat_map(|side| (0..20).map(move |i| (side, i as f32 / 20.0)));
            let loss_of = |(side, along): (usize, f32)| {
                let corner =
                    |side: usize| [0, 1, 2].map(|c| [1.0, 1.0, 0.0, 0.0, 0.0, 1.0][(side + 2 * c) % 6]);
                let (a, b) = (corner(side), corner((side + 1) % 6));
                let color: [f32; 3] =
                    std::array::from_fn(|c| (0.5 * (a[c] + along * (b[c] - a[c]))).exp2() * home.radiance[c]);
                let bright = luminance(home.radiance) / luminance(color);
                let light = Light { radiance: color.map(|c| c * bright), ..home.clone() };
                let brightens = Locks { strength: false, ..Locks::ALL };
                found(&wanted, &bounded(&light, brightens, strength.then_some([0.0, 0.0]), None), 0).1
            };
            let best = edge.map(loss_of).fold(f64::INFINITY, f64::min);
            assert!(loss < 1.01 * best && alone < 1.01 * best, "{loss} and {alone} where {best} is possible");
        }
    }
}

#[test]
fn colors_without_a_channel_have_bounds_too() {
    let lamp = &lamps()[0];
    let [red, black] = [[5.0, 0.0, 0.0], [0.0; 3]].map(|radiance| Light { radiance, ..lamp.clone() });
    let of_red = tinted(&red, Locks::default(), 1.0);
    assert_eq!(of_red.within(red.clone()), red);
    let held = of_red.within(Light { radiance: [1.0; 3], ..lamp.clone() });
    assert!((held.radiance[1] / held.radiance[0] / (2.0 * LEAST_CHANNEL) - 1.0).abs() < 1e-3, "{held:?}");
    let of_black = tinted(&black, Locks::default(), 1.0);
    assert_eq!(of_black.within(black.clone()), black);
    let held = of_black.within(red.clone()).radiance;
    assert!((held[0] / held[1] - 2.0).abs() < 1e-3 && held[1] == held[2], "around white: {held:?}");
}

#[test]
fn bounds_that_are_not_met_change_nothing() {
    for lamp in lamps() {
        let home = disturbed(&lamp);
        let free = variable(&home);
        let mut wide = bounded(&home, free.locks, Some([-8.0, 8.0]), Some(1.5));
        wide.bounds = wide.bounds.tinted(&home, Some(8.0));
        assert_eq!(found(&lamp, &wide, 200), found(&lamp, &free, 200));
    }
}

#[test]
fn no_step_leads_out_of_bounds_and_what_is_locked_stays() {
    let delta: [f32; PARAMS] = std::array::from_fn(|i| if i % 2 == 0 { 3.0 } else { -2.0 });
    for lamp in lamps() {
        for locks in [Locks::default(), Locks { color: true, ..Locks::default() }, Locks::ALL] {
            let Variable { bounds, .. } = bounded(&lamp, locks, Some([-0.2, 0.3]), Some(0.1));
            let bounds = bounds.tinted(&lamp, Some(0.25));
            let mapping = Mapping { bounds, locks, power_unit: 3.0 };
            for sign in [1.0, -1.0] {
                let light = mapping.step(&lamp, &delta.map(|d| sign * d));
                let strength = stops(&light, &lamp);
                assert!((-0.2 - 1e-5..0.3 + 1e-5).contains(&strength), "{strength}");
                assert!(stops_of_color(&light, &lamp) < 0.25 + 1e-4, "{light:?}");
                let angle = lamp
                    .shape
                    .axis()
                    .map(|_| bounds.direction.unwrap().angle_to(light.shape.axis().unwrap()));
                assert!(angle.is_none_or(|angle| angle < 0.1 + 1e-5), "{angle:?}");
                assert!(locks != Locks::ALL || light == lamp, "{light:?}");
            }
        }
        let other = bounded(&lamp, Locks::ALL, Some([1.0, 2.0]), None);
        assert_eq!(other.within(lamp.clone()), lamp, "a bound of what is locked is none");
        let brighter = bounded(&lamp, Locks::default(), Some([1.0, 2.0]), None).within(lamp.clone());
        assert!((stops(&brighter, &lamp) - 1.0).abs() < 1e-5);
    }
}

#[test]
fn random_starts_and_regroupings_are_within_bounds() {
    let base = flat(0.02);
    let lights = lamps()[..4].to_vec();
    let goals = [target(picture(&FLOOR, &base, &lights.iter().map(disturbed).collect::<Vec<_>>()))];
    let view = View { relight: &FLOOR, base: &base, still: vec![None; 4], goals: &goals };
    let variables: Vec<_> =
        lights.iter().map(|light| bounded(light, Locks::default(), Some([-0.1, 0.2]), Some(0.3))).collect();
    let problem = Problem { views: vec![view], variables };
    let options = RandomStarts { count: 64, candidates: 1, softness: 0.0, seed: 1 };
    let mut all = random_starts(&problem, &options).unwrap();
    // Uniform on a cap: cosines are uniform between 1 and that of its edge.
    let cosines = |number: usize| {
        let axis = lights[number].shape.axis().unwrap();
        all.iter().map(|start| start[number].shape.axis().unwrap().dot(axis)).sum::<f32>() / all.len() as f32
    };
    let mean = 0.5 * (1.0 + 0.3_f32.cos());
    assert!((2..4).all(|number| (cosines(number) - mean).abs() < 0.004), "{} {}", cosines(2), cosines(3));
    all.extend(random_starts(&problem, &RandomStarts { count: 4, candidates: 8, ..options }).unwrap());
    let others = regroupings(&problem, &lights, 0.0, 8).unwrap();
    assert!(!others.is_empty());
    for start in all.iter().chain(&others) {
        for (light, home) in start.iter().zip(&lights) {
            let strength = stops(light, home);
            assert!((-0.1 - 1e-5..0.2 + 1e-5).contains(&strength), "{strength}");
            let axes = light.shape.axis().zip(home.shape.axis());
            assert!(axes.is_none_or(|(a, b)| a.dot(b) > 0.3_f32.cos() - 1e-5), "{light:?}");
        }
    }
}
