//! Every kind of goal is reached, as the picture of what was found says, not the solver.

use crate::room::{Bakes, GATHER, key, picture, room, solve, target_request};
use glam::Vec3;
use relume_session::image::Image;
use relume_session::scene::{Light, LightShape};
use relume_session::trace::TraceSettings;
use relume_session::{Monitor, Relighter, Solved, bake};
use serde_json::{Value, json};

/// Left, top, right and bottom of a part of the floor, and of one of the back wall.
const FLOOR: [f32; 4] = [0.4, 0.75, 0.7, 0.95];
const WALL: [f32; 4] = [0.35, 0.2, 0.65, 0.45];

/// Mean colour of a part of a picture.
fn mean(image: &Image, [left, top, right, bottom]: [f32; 4]) -> Vec3 {
    let (width, height) = (image.width as f32, image.height as f32);
    let is_in = |i: &usize| {
        let (x, y) = ((i % image.width) as f32 + 0.5, (i / image.width) as f32 + 0.5);
        (left * width..right * width).contains(&x) && (top * height..bottom * height).contains(&y)
    };
    let pixels: Vec<usize> = (0..image.pixel_count()).filter(is_in).collect();
    let sum: Vec3 = pixels.iter().map(|i| Vec3::from_slice(&image.data[3 * i..])).sum();
    sum / pixels.len() as f32
}

fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

fn fill() -> Light {
    let shape = LightShape::Sphere { center: Vec3::new(-0.5, -0.4, 0.5), radius: 0.2 };
    Light { name: "Fill".into(), shape, ..key() }
}

struct Reached {
    before: Image,
    after: Image,
    lights: Vec<Light>,
    /// Text about the goal.
    told: String,
}

/// Solves one goal by colours and strengths of two lights. The solver must be content with what it has reached.
fn reached(goal: Value, images: &[(&str, &Image)]) -> Reached {
    let bakes = Bakes::open();
    let (lights, free) = ([key(), fill()], ["color", "strength"]);
    let request = json!({"lights": lights, "free": {"Key": free, "Fill": free}, "goals": [goal], "starts": 2, "steps": 64});
    let solved = solve(&[&bakes.own], &request, images).unwrap();
    assert!(
        solved.report[0].report.met && !solved.report[0].text.contains("not reached"),
        "{:?}",
        solved.report
    );
    let [before, after] = [&lights[..], &solved.lights.lights].map(|lights| picture(&bakes.own, lights));
    Reached { before, after, lights: solved.lights.lights, told: solved.report[0].text.clone() }
}

/// Mireds by which one colour is warmer than another, by Wien's approximation at 460 and 610 nm. Each changes their
/// ratio of red to blue by c2 (1/lambda_B - 1/lambda_R) 1e-6.
fn warmer_by(before: Vec3, after: Vec3) -> f32 {
    let per_mired = 1.4388e-2 * (1.0 / 460e-9 - 1.0 / 610e-9) * 1e-6;
    ((after.x / after.z) / (before.x / before.z)).ln() / per_mired
}

#[test]
fn a_place_gets_this_colour() {
    let found =
        reached(json!({"goal": "color", "color": [0.2, 0.5, 0.8], "where": {"rectangle": WALL}}), &[]);
    let color = mean(&found.after, WALL);
    let [to_green, to_blue] = [color.x / color.y, color.z / color.y];
    assert!((to_green / 0.4 - 1.0).abs() < 0.1 && (to_blue / 1.6 - 1.0).abs() < 0.1, "{color}");
}

#[test]
fn warmer_and_cooler_are_as_many_mireds() {
    for (goal, sign) in [("warmer", 1.0), ("cooler", -1.0)] {
        let found = reached(json!({"goal": goal, "mireds": 40, "where": {"rectangle": WALL}}), &[]);
        let [before, after] = [&found.before, &found.after].map(|image| mean(image, WALL));
        let change = sign * warmer_by(before, after);
        assert!((36.0..44.0).contains(&change), "{goal}: {change} mireds, {before} to {after}");
        let stops = (luminance(after) / luminance(before)).log2();
        assert!(stops.abs() < 0.3, "{goal} is no other brightness: {stops} stops");
    }
}

#[test]
fn a_shadow_falls_where_it_is_asked_for() {
    let goal = json!({"goal": "shadow", "stops": 1.5, "where": {"rectangle": FLOOR}});
    let found = reached(goal, &[]);
    let stops = (luminance(mean(&found.after, FLOOR)) / luminance(mean(&found.before, FLOOR))).log2();
    assert!(
        (stops + 1.5).abs() < 0.15 && found.told.starts_with("Goal 1, shadow: "),
        "{stops} stops, {}",
        found.told
    );
}

#[test]
fn a_target_of_any_exposure_gives_colours_and_contrast() {
    let bakes = Bakes::open();
    let hidden =
        [Light { radiance: [4.0, 6.0, 9.0], ..key() }, Light { radiance: [6.0, 3.0, 1.5], ..fill() }];
    let mut target = picture(&bakes.other, &hidden);
    target.data.iter_mut().for_each(|value| *value *= 8.0);
    let goal = json!({"goal": "target", "image": "target", "exposure_invariant": true});
    let found = reached(goal, &[("target", &target)]);
    // All of both lights but one common factor.
    let factors = found
        .lights
        .iter()
        .zip(&hidden)
        .flat_map(|(is, was)| (0..3).map(|c| is.radiance[c] / was.radiance[c]));
    let factors: Vec<f32> = factors.collect();
    let mean = factors.iter().sum::<f32>() / 6.0;
    assert!(factors.iter().all(|factor| (factor / mean - 1.0).abs() < 0.06), "{factors:?}");
}

#[test]
fn a_target_counts_where_its_mask_is_white() {
    let bakes = Bakes::open();
    let hidden =
        [Light { radiance: [4.0, 6.0, 9.0], ..key() }, Light { radiance: [6.0, 3.0, 1.5], ..fill() }];
    let mut target = picture(&bakes.other, &hidden);
    let mut mask = Image::new(target.width, target.height, 1);
    for (i, pixel) in target.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let is_right = i % mask.width >= mask.width / 3;
        mask.data[i] = f32::from(is_right);
        if !is_right {
            *pixel = [20.0, 0.0, 0.0];
        }
    }
    let goal = json!({"goal": "target", "image": "target", "where": {"mask": "right"}});
    let found = reached(goal, &[("target", &target), ("right", &mask)]);
    for (is, was) in found.lights.iter().zip(&hidden) {
        let errors = (0..3).map(|c| (is.radiance[c] / was.radiance[c] - 1.0).abs());
        assert!(errors.fold(0.0, f32::max) < 0.06, "{is:?} for {was:?}");
    }
}

#[test]
fn an_index_mask_of_another_size_has_no_indices_between_its_own() {
    let bakes = Bakes::open();
    // Left index 2, right index 4, twice as fine, and one fine column off the coarse border: nothing is index 3.
    let (width, height) = (192, 144);
    let index = |i: usize| if i % width < width / 2 + 1 { 2.0 } else { 4.0 };
    let data = (0..width * height).flat_map(|i| [index(i); 3]).collect();
    let mask = Image { width, height, channels: 3, data };
    let request = |index: u32| {
        let place = json!({"mask": "mask", "equals": index});
        let goal = json!({"goal": "brighter", "stops": 0.5, "where": place});
        json!({"lights": [key()], "free": {"Key": ["strength"]}, "goals": [goal], "starts": 1, "steps": 16})
    };
    assert!(solve(&[&bakes.own], &request(2), &[("mask", &mask)]).is_ok());
    let error = solve(&[&bakes.own], &request(3), &[("mask", &mask)]).unwrap_err().to_string();
    assert!(error.contains("no pixel"), "{error}");
}

#[test]
fn the_worlds_light_and_a_lamps_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let settings = TraceSettings { samples: 96, ..TraceSettings::default() };
    bake(&room(0.0, [0.4, 0.5, 0.6]), &settings, folder.path(), false, &Monitor::default()).unwrap();
    let relighter = Relighter::open(folder.path()).unwrap();
    let relit = relighter.relight(&[key()], &GATHER, &Monitor::default()).unwrap();
    let (world, strength) = ([2.0, 1.5, 0.5], 0.4);
    let mut target = relit.static_light.clone();
    target.add_scaled(&relit.world, &world);
    target.add_scaled(&relit.lights[0].image, &[strength; 3]);
    let found = |free: Value| {
        let request = json!({"lights": [key()], "free": free, "starts": 1});
        let solved = solve(&[&relighter], &target_request(request), &[("target", &target)]).unwrap();
        (solved.world, solved.lights.lights[0].radiance[0] / key().radiance[0], solved)
    };
    let (is, lamp, solved) = found(json!({"world": ["color", "strength"], "Key": ["strength"]}));
    assert!(is.iter().zip(world).all(|(is, was)| (is / was - 1.0).abs() < 0.05), "{is:?}");
    assert!(
        (lamp / strength - 1.0).abs() < 0.05 && solved.report[0].report.met,
        "{lamp}: {:?}",
        solved.report
    );
    // Of its strength alone: it keeps its colour, the lamp all that it is.
    let (is, lamp, _) = found(json!({"world": ["strength"]}));
    assert!(is[0] != 1.0 && is[0] == is[1] && is[1] == is[2] && lamp == 1.0, "{is:?} {lamp}");
    let (is, lamp, _) = found(json!({"Key": ["strength"]}));
    assert!(is == [1.0; 3] && lamp != 1.0, "{is:?} {lamp}");
}

#[test]
fn a_lamp_that_the_target_lacks_goes_if_it_may() {
    let bakes = Bakes::open();
    let target = picture(&bakes.other, &[key()]);
    let lights = [Light { radiance: key().radiance.map(|value| 0.5 * value), ..key() }, fill()];
    let found = |free: Value, remove: bool| {
        let request = json!({"lights": lights, "free": free, "remove": remove, "starts": 1});
        solve(&[&bakes.own], &target_request(request), &[("target", &target)]).unwrap()
    };
    let names =
        |solved: &Solved| solved.lights.lights.iter().map(|light| light.name.clone()).collect::<Vec<_>>();
    let both = json!({"Key": ["strength"], "Fill": ["strength"]});
    let without = found(both.clone(), true);
    assert_eq!((&without.removed[..], &names(&without)[..]), (&["Fill".into()][..], &["Key".into()][..]));
    assert_eq!(without.blender.len(), 1, "{:?}", without.blender);
    assert!(
        (without.lights.lights[0].radiance[0] / key().radiance[0] - 1.0).abs() < 0.03
            && without.report[0].report.met
    );
    // It stays, but dark, where it may not go; and as it is where its strength is locked.
    let with = found(both, false);
    assert!(
        with.removed.is_empty() && with.lights.lights[1].radiance[0] < 0.05 * fill().radiance[0],
        "{with:?}"
    );
    let locked = found(json!({"Key": ["strength"], "Fill": ["color"]}), true);
    assert!(locked.removed.is_empty() && names(&locked) == ["Key", "Fill"], "{locked:?}");
}
