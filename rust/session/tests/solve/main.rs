//! Solving lights on a small bake, through the smoothed gather and as a user asks for it.

mod bounds;
#[path = "../common/mod.rs"]
mod common;
mod goals;
mod lights;
mod live;
mod room;

use glam::Vec3;
use relume_session::image::{Image, Layer, LayeredImage, Precision, metrics, write_exr};
use relume_session::proxy::LightKind;
use relume_session::scene::{Camera, Light, LightShape, Scene};
use relume_session::trace::TraceSettings;
use relume_session::{
    Cancel, Listener, Monitor, Pictures, Progress, Relighter, SessionError, SoFar, SolveRequest, Solved,
    Stage, bake, solve_lights,
};
use room::{baked, inside, key, light, picture, room, solve, target_request, traced};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

#[test]
fn a_hidden_light_is_found_through_the_dump_alone() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let target = picture(&relighter, &[key()]);
    let solved =
        solve(&[&relighter], &target_request(json!({"add": {"count": 1}})), &[("target", &target)]).unwrap();
    assert!(miss(&solved) < 0.1 && solved.through == "gather", "{solved:?}");
    // Of each step until the start had nothing to gain.
    assert!(!solved.losses.is_empty() && solved.losses.len() <= 64, "{:?}", solved.losses);
    assert!(solved.losses.last().unwrap() < &(0.5 * solved.losses[0]), "{:?}", solved.losses);
    // Noise of single pixels is that of both gathers.
    let [found, target] =
        [&picture(&relighter, &solved.lights.lights), &target].map(|image| image.resized(12, 9));
    let psnr = metrics::psnr_reinhard(&found, &target);
    assert!(psnr > 35.0, "{psnr} dB");
    assert!(solved.report[0].report.met && solved.report[0].text.contains("reached"), "{:?}", solved.report);
}

#[test]
fn a_bake_of_a_single_sample_finds_the_strength() {
    let folder = tempfile::tempdir().unwrap();
    traced(folder.path(), 0.0, &TraceSettings { samples: 1, ..TraceSettings::default() });
    let relighter = Relighter::open(folder.path()).unwrap();
    let large = LightShape::Sphere { center: Vec3::new(0.3, -0.1, 1.3), radius: 0.5 };
    let hidden = Light { shape: large, ..key() };
    let target = picture(&relighter, std::slice::from_ref(&hidden));
    let darker = Light { radiance: hidden.radiance.map(|radiance| 0.3 * radiance), ..hidden.clone() };
    let request = json!({"lights": [darker], "free": {"Key": ["position", "strength"]}, "starts": 1});
    let solved = solve(&[&relighter], &target_request(request), &[("target", &target)]).unwrap();
    let factor = solved.lights.lights[0].radiance[0] / hidden.radiance[0];
    assert!((0.7..1.4).contains(&factor), "{factor} {:?}", solved.lights);
}

#[test]
fn two_views_share_their_lights_and_unneeded_ones_are_dropped() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    baked(folders[0].path(), -1.0);
    baked(folders[1].path(), 1.0);
    let relighters = folders.each_ref().map(|folder| Relighter::open(folder.path()).unwrap());
    let targets = relighters.each_ref().map(|relighter| picture(relighter, &[key()]));
    let goal = |view: usize| json!({"goal": "target", "image": format!("target {view}"), "view": view});
    let request = json!({
        "goals": [goal(0), goal(1)], "bounds": inside(), "add": {"count": 2}, "starts": 3, "steps": 64
    });
    let images = [("target 0", &targets[0]), ("target 1", &targets[1])];
    let solved = solve(&[&relighters[0], &relighters[1]], &request, &images).unwrap();
    assert_eq!(solved.report.len(), 2);
    assert!(solved.report.iter().all(|report| report.report.met), "{:?}", solved.report);
    assert_eq!(
        (solved.added.len(), solved.lights.lights.len(), solved.blender.len()),
        (1, 1, 1),
        "{solved:?}"
    );
    assert!(miss(&solved) < 0.05, "{:?}", solved.lights);
}

/// How far the first light is from where the key should be, metres.
fn miss(solved: &Solved) -> f32 {
    let [found, hidden] = [solved.lights.lights[0].shape, key().shape].map(|shape| shape.center().unwrap());
    found.distance(hidden)
}

#[test]
fn strokes_change_what_they_ask_for_and_keep_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let fill =
        Light { shape: LightShape::Sphere { center: Vec3::new(-0.6, 0.3, 0.7), radius: 0.2 }, ..key() };
    let lights = [key(), Light { name: "Fill".into(), ..fill }];
    let request = json!({
        "lights": lights, "free": {"Key": ["strength"], "Fill": ["color"]}, "steps": 64,
        "goals": [
            {"goal": "brighter", "stops": 0.5, "where": {"rectangle": [0.5, 0.0, 1.0, 1.0]}},
            {"goal": "cooler", "mireds": 30, "where": {"rectangle": [0.0, 0.4, 0.4, 1.0]}},
        ],
    });
    let solved = solve(&[&relighter], &request, &[]).unwrap();
    assert!(solved.report.iter().all(|report| report.report.met), "{:?}", solved.report);
    assert_eq!(solved.changed, ["Key", "Fill"]);
    let [a, b] = [&solved.lights.lights[0], &solved.lights.lights[1]];
    assert_eq!((a.shape, b.shape), (lights[0].shape, lights[1].shape));
    let tint = a.radiance[0] / a.radiance[2] / (lights[0].radiance[0] / lights[0].radiance[2]);
    assert!((tint - 1.0).abs() < 1e-3 && a.radiance[0] > 1.2 * lights[0].radiance[0], "{a:?}");
    let (was, is) = (lights[1].radiance, b.radiance);
    let luminance = |c: [f32; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
    assert!(
        (luminance(is) / luminance(was) - 1.0).abs() < 1e-3 && is[2] / is[0] > 1.1 * was[2] / was[0],
        "{b:?}"
    );
}

#[test]
fn contradictions_are_named_and_an_unreachable_target_says_where_and_how_much() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let left = json!({"rectangle": [0, 0, 0.5, 1]});
    let request = json!({
        "lights": [key()], "free": {"Key": ["strength"]}, "steps": 40,
        "goals": [{"goal": "brighter", "where": left}, {"goal": "darker", "where": left}],
    });
    let solved = solve(&[&relighter], &request, &[]).unwrap();
    assert_eq!(solved.warnings, ["Goals 1 and 2 contradict each other in the same place"]);
    let mut target = picture(&relighter, &[key()]);
    let width = target.width;
    for (i, pixel) in target.data.chunks_exact_mut(3).enumerate() {
        let factor = if i % width > width * 3 / 4 { 30.0 } else { 1.0 };
        pixel.iter_mut().for_each(|value| *value = factor * (*value + 0.01));
    }
    let request = target_request(json!({"lights": [key()], "free": {"Key": ["strength", "color"]}}));
    let solved = solve(&[&relighter], &request, &[("target", &target)]).unwrap();
    let report = &solved.report[0];
    assert!(!report.report.met && report.text.contains("too dark"), "{report:?}");
    assert!(report.report.worst.unwrap().x > 0.7, "{report:?}");
}

#[test]
fn a_stroke_that_a_target_does_not_show_contradicts_it() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let now = picture(&relighter, &[key()]);
    let warnings = |stops: f32, target: &Image| {
        let brighter = json!({"goal": "brighter", "stops": stops, "where": {"rectangle": [0, 0, 0.5, 1]}});
        let request = json!({
            "lights": [key()], "free": {"Key": ["strength"]}, "starts": 1, "steps": 4, "polish": 0,
            "goals": [brighter, {"goal": "target", "image": "target"}],
        });
        solve(&[&relighter], &request, &[("target", target)]).unwrap().warnings
    };
    assert_eq!(warnings(2.0, &now), ["Goals 1 and 2 contradict each other in the same place"]);
    let brighter = Image { data: now.data.iter().map(|value| 4.0 * value).collect(), ..now };
    assert!(warnings(2.0, &brighter).is_empty());
}

#[test]
fn a_target_of_another_hue_is_missed_in_words_of_colour() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let mut target = picture(&relighter, &[key()]);
    // Red and blue for the same luminance: a light of this colour cannot become so.
    for pixel in target.data.chunks_exact_mut(3) {
        let luminance = 0.2126 * pixel[0] + 0.7152 * pixel[1] + 0.0722 * pixel[2];
        pixel.copy_from_slice(&[0.4 * luminance, luminance, 2.7668 * luminance]);
    }
    let request = target_request(json!({"lights": [key()], "free": {"Key": ["strength"]}, "starts": 1}));
    let solved = solve(&[&relighter], &request, &[("target", &target)]).unwrap();
    let text = &solved.report[0].text;
    assert!(text.contains("mireds too warm") && !solved.report[0].report.met, "{text}");
}

#[test]
fn a_mask_with_values_that_are_no_numbers_is_named() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let error_of = |equals: Value, pictures: &Pictures| {
        let place = json!({"mask": "hand.exr", "equals": equals});
        let goals = json!([{"goal": "brighter"}, {"goal": "darker", "where": place}]);
        let request = json!({"lights": [key()], "free": {"Key": ["strength"]}, "goals": goals});
        let request = SolveRequest::parse(&request.to_string()).unwrap();
        solve_lights(&[&relighter], &request, pictures, &Monitor::default(), &|_| ()).unwrap_err().to_string()
    };
    for (value, equals) in [(f32::NAN, Value::Null), (f32::INFINITY, Value::Null), (f32::NAN, json!(3.0))] {
        let mut mask = picture(&relighter, &[key()]);
        mask.data[300] = value;
        let (width, height, layers) = (mask.width, mask.height, vec![Layer::color("Combined", mask.clone())]);
        let layers = LayeredImage { width, height, layers, ..LayeredImage::default() };
        write_exr(&folder.path().join("hand.exr"), &layers, Precision::Float).unwrap();
        let named = Pictures::named(HashMap::from([("hand.exr".to_string(), mask)]));
        for pictures in [named, Pictures::in_folder(folder.path())] {
            let error = error_of(equals.clone(), &pictures);
            let says = ["goal 2", "the mask 'hand.exr'", "infinite or no numbers"];
            assert!(says.iter().all(|words| error.contains(words)), "{error}");
        }
    }
}

#[test]
fn surplus_lights_are_dropped_without_a_polish_too() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let target = picture(&relighter, &[key()]);
    let request = json!({"lights": [key()], "add": {"count": 2}, "polish": 0, "starts": 1, "steps": 128});
    let solved = solve(&[&relighter], &target_request(request), &[("target", &target)]).unwrap();
    assert!(solved.added.is_empty() && solved.lights.lights.len() == 1, "{:?}", solved.lights);
}

#[test]
fn surplus_lights_are_dropped_where_there_are_proxies_alone() {
    let [bake, proxies] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    common::baked(bake.path());
    common::trained(bake.path(), proxies.path(), LightKind::Sphere);
    let relighter = Relighter::open(proxies.path()).unwrap();
    let target = relighter.relight(&[key()], &common::RAW, &Monitor::default()).unwrap().combined();
    let request = json!({"lights": [key()], "add": {"count": 2}, "starts": 1, "steps": 128});
    let solved = solve(&[&relighter], &target_request(request), &[("target", &target)]).unwrap();
    assert_eq!(solved.through, "proxy");
    assert!(solved.added.is_empty() && solved.lights.lights.len() == 1, "{:?}", solved.lights);
}

#[test]
fn bounds_and_stay_of_one_light_hold_that_one_alone() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let target = picture(&relighter, &[key()]);
    let center = |x: f32| Vec3::new(x, 0.1, 1.1);
    let at = |x: f32| Light { shape: LightShape::Sphere { center: center(x), radius: 0.2 }, ..key() };
    let found = |each: serde_json::Value| {
        let free = json!({"Key": ["position", "strength"]});
        let request = json!({"lights": [at(-0.3)], "free": free, "each": each, "starts": 1});
        solve(&[&relighter], &target_request(request), &[("target", &target)])
            .map(|solved| solved.lights.lights[0].shape.center().unwrap())
    };
    let held = found(json!({"Key": {"bounds": {"max": [-0.2, 0.9, 1.9]}}})).unwrap();
    assert!(held.x <= -0.2 && held.x > -0.9, "{held}");
    let [near, free] = [1.0, 0.0].map(|stay| found(json!({"Key": {"stay": stay}})).unwrap());
    let moved = [near, free].map(|place| place.distance(center(-0.3)));
    assert!(free.distance(key().shape.center().unwrap()) < 0.1 && moved[0] < 0.5 * moved[1], "{moved:?}");
    let error = found(json!({"Key": {"bounds": {"min": [2, -0.9, 0.2]}}})).unwrap_err().to_string();
    assert!(error.contains("light 'Key'") && error.contains("\"min\" below its \"max\""), "{error}");
}

#[test]
fn a_spot_keeps_its_cone_in_the_range_that_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let spot = |half_angle: f32| LightShape::Spot {
        center: Vec3::new(0.1, -0.6, 1.4),
        radius: 0.2,
        axis: Vec3::new(0.2, 0.8, -0.6).normalize(),
        half_angle,
        blend: 0.1,
        soft_falloff: true,
    };
    let lit = |half_angle: f32| light("Key", spot(half_angle), [20.0; 3]);
    let target = picture(&relighter, &[lit(0.4)]);
    let angle = |bounds: Value| {
        let request = json!({
            "lights": [lit(0.8)], "free": {"Key": ["cone"]}, "starts": 1, "each": {"Key": {"bounds": bounds}}
        });
        let solved = solve(&[&relighter], &target_request(request), &[("target", &target)]).unwrap();
        let LightShape::Spot { half_angle, .. } = solved.lights.lights[0].shape else { panic!("{solved:?}") };
        half_angle
    };
    let [free, held] = [angle(json!({})), angle(json!({"cone": [0.6, 1.0]}))];
    assert!(free < 0.55 && (0.6..0.75).contains(&held), "{free} {held}");
}

#[test]
fn in_a_large_picture_strengths_and_places_are_found_and_told_of_the_part_that_counts() {
    let folder = tempfile::tempdir().unwrap();
    // Looked at in squares of 2 x 2, of which those at the right and the bottom are cut.
    let scene = Scene {
        camera: Camera { width: 331, height: 251, ..room(0.0, [0.0; 3]).camera },
        ..room(0.0, [0.0; 3])
    };
    let settings = TraceSettings { samples: 24, ..TraceSettings::default() };
    bake(&scene, &settings, folder.path(), false, &Monitor::default()).unwrap();
    let relighter = Relighter::open(folder.path()).unwrap();
    let fill = LightShape::Sphere { center: Vec3::new(-0.6, 0.3, 0.7), radius: 0.2 };
    let lights = [key(), light("Fill", fill, [4.0, 6.0, 8.0])];
    let mut target = picture(&relighter, &lights);
    for pixel in target.data.chunks_exact_mut(3 * 331).flat_map(|row| row[..3 * 100].chunks_exact_mut(3)) {
        pixel.copy_from_slice(&[7.0, 0.0, 7.0]);
    }
    let moved = LightShape::Sphere { center: Vec3::new(-0.2, 0.1, 0.9), radius: 0.2 };
    let now = [Light { radiance: [3.0; 3], ..key() }, light("Fill", moved, [5.0; 3])];
    let request = json!({
        "lights": now, "free": {"Key": ["color", "strength"], "Fill": ["position", "color", "strength"]}, "starts": 1,
        "goals": [{"goal": "target", "image": "target", "where": {"rectangle": [0.31, 0, 1, 1]}}],
    });
    let solved = solve(&[&relighter], &request, &[("target", &target)]).unwrap();
    let [found_key, found_fill] = [0, 1].map(|i| &solved.lights.lights[i]);
    let off = |found: &Light, was: &Light| {
        (0..3).map(|c| (found.radiance[c] / was.radiance[c] - 1.0).abs()).fold(0.0, f32::max)
    };
    assert!(off(found_key, &lights[0]) < 0.02 && off(found_fill, &lights[1]) < 0.1, "{:?}", solved.lights);
    let miss = found_fill.shape.center().unwrap().distance(fill.center().unwrap());
    assert!(miss < 0.05 && solved.report[0].report.reached > 35.0, "{miss}: {:?}", solved.report);
}

#[test]
fn new_lights_are_of_the_type_that_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let target = picture(&relighter, &[key()]);
    for (kind, blender) in [("point", "POINT"), ("area", "AREA"), ("spot", "SPOT"), ("sun", "SUN")] {
        // From so many starts each type finds a place where it helps; a light that does nothing is not added.
        let request = json!({"add": {"count": 1, "type": kind}, "starts": 4, "steps": 64, "polish": 0});
        let solved = solve(&[&relighter], &target_request(request), &[("target", &target)]).unwrap();
        assert_eq!(solved.added.len(), 1, "{kind}");
        assert_eq!(solved.blender[0]["type"], blender);
        assert!(solved.blender[0]["energy"].as_f64().unwrap() > 0.0, "{:?}", solved.blender[0]);
    }
}

#[test]
fn lights_that_no_proxy_knows_are_named_with_what_helps() {
    let [bake, proxies] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    common::baked(bake.path());
    common::trained(bake.path(), bake.path(), LightKind::Sphere);
    common::trained(bake.path(), proxies.path(), LightKind::Sphere);
    let error_of = |folder: &Path, shapes: &[LightShape]| {
        let lights: Vec<Light> =
            shapes.iter().zip(["Lamp", "Rim"]).map(|(shape, name)| light(name, *shape, [2.0; 3])).collect();
        let free = json!(["position", "direction"]);
        let free: HashMap<&str, &Value> = lights.iter().map(|light| (&light.name[..], &free)).collect();
        let request = json!({
            "lights": lights, "free": free, "through": "proxy", "starts": 1, "steps": 4, "polish": 0,
            "goals": [{"goal": "brighter", "where": {"rectangle": [0.3, 0.2, 0.7, 0.5]}}],
        });
        let relighter = Relighter::open(folder).unwrap();
        solve(&[&relighter], &request, &[]).err().map(|error| error.to_string())
    };
    let sphere = |x: f32, radius: f32| LightShape::Sphere { center: Vec3::new(x, 0.1, 1.3), radius };
    let sun = LightShape::Sun { direction: Vec3::Z, half_angle: 0.1 };
    let (known, [far, large]) = (sphere(0.2, 0.2), [sphere(50.0, 0.2), sphere(0.2, 0.9)]);
    assert_eq!(error_of(bake.path(), &[known]), None);
    for (folder, shapes, says) in [
        (&bake, [far, known], ["lights 'Lamp':", "outside of where one was", "through the bake, or train"]),
        (&bake, [known, large], ["lights 'Rim':", "size", "through the bake, or train"]),
        (&bake, [far, sun], ["lights 'Lamp', 'Rim':", "type", "through the bake, or lock"]),
        (&proxies, [far, known], ["lights 'Lamp':", "outside", "in the folder of the bake, or train"]),
    ] {
        let error = error_of(folder.path(), &shapes).unwrap();
        assert!(says.iter().all(|words| error.contains(words)), "{error}");
    }
}

/// Stops a solver at its n-th report.
struct StopAt(Mutex<usize>, Cancel);

impl Listener for StopAt {
    fn progress(&self, progress: &Progress) {
        let mut left = self.0.lock().unwrap();
        if matches!(progress.stage, Stage::Optimise | Stage::Polish) && progress.done > 0 {
            *left = left.saturating_sub(1);
            if *left == 0 {
                self.1.request();
            }
        }
    }
    fn warning(&self, _: &str) {}
}

#[test]
fn a_light_that_paths_hardly_meet_is_named_and_solved_on_with_paths_that_look_for_it() {
    let small = |x: f32| {
        light("Key", LightShape::Sphere { center: Vec3::new(x, -0.1, 1.3), radius: 0.006 }, [9000.0; 3])
    };
    let folder = tempfile::tempdir().unwrap();
    let towards = |name: &str, lights: &[Light], seed: u64| {
        let folder = folder.path().join(name);
        let settings =
            TraceSettings { samples: 128, towards: lights.to_vec(), seed, ..TraceSettings::default() };
        traced(&folder, 0.0, &settings);
        Relighter::open(&folder).unwrap()
    };
    let now = towards("now", &[small(-0.6)], 0);
    let target = picture(&towards("there", &[small(0.5)], 1), &[small(0.5)]);
    let request = |answer: Value| {
        let lights = [small(-0.6)];
        let free = json!({"Key": ["position"]});
        target_request(json!({"lights": lights, "free": free, "from": answer, "steps": 0, "starts": 1}))
    };
    let solved = |relighter: &Relighter, answer: Value| {
        solve(&[relighter], &request(answer), &[("target", &target)]).unwrap()
    };
    let first = solved(&now, json!({"lights": [small(0.46)]}));
    assert_eq!(first.rarely_met, ["Key"]);
    let again = towards("again", &[small(-0.6), first.lights.lights[0].clone()], 2);
    let second = solved(&again, json!(first));
    assert!(second.rarely_met.is_empty());
    // What was said of it was noise, and is its picture now.
    let decibels = |solved: &Solved| solved.report[0].report.reached;
    assert!(decibels(&first) < 25.0 && decibels(&second) > 35.0, "{:?} {:?}", first.report, second.report);
    let sun = light("Key", LightShape::Sun { direction: Vec3::Z, half_angle: 0.1 }, [1.0; 3]);
    let other = solve(&[&now], &request(json!({"lights": [sun]})), &[("target", &target)]);
    assert!(other.unwrap_err().to_string().contains("light 'Key' is of another type"));
}

/// Counts a solver's steps.
#[derive(Default)]
struct Steps(Mutex<u64>);

impl Listener for Steps {
    fn progress(&self, progress: &Progress) {
        if matches!(progress.stage, Stage::Optimise | Stage::Polish) {
            *self.0.lock().unwrap() += progress.done;
        }
    }
    fn warning(&self, _: &str) {}
}

#[test]
fn cancelling_works_before_the_first_step() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let request = target_request(json!({"add": {"count": 2}}));
    let request = SolveRequest::parse(&request.to_string()).unwrap();
    let target = picture(&relighter, &[key()]);
    let pictures = Pictures::named(HashMap::from([("target".to_string(), target)]));
    let (steps, cancel) = (Arc::new(Steps::default()), Cancel::default());
    cancel.request();
    let monitor = Monitor::new(steps.clone(), cancel);
    let result = solve_lights(&[&relighter], &request, &pictures, &monitor, &|_| ());
    assert!(matches!(result, Err(SessionError::Cancelled)), "{result:?}");
    assert_eq!(*steps.0.lock().unwrap(), 0, "random starts were looked for all the same");
}

#[test]
fn cancelling_works_at_any_step_and_previews_hold_all_lights() {
    let folder = tempfile::tempdir().unwrap();
    baked(folder.path(), 0.0);
    let relighter = Relighter::open(folder.path()).unwrap();
    let target = picture(&relighter, &[key()]);
    let request =
        target_request(json!({"lights": [key()], "free": {"Key": ["strength"]}, "add": {"count": 1}}));
    let request = SolveRequest::parse(&request.to_string()).unwrap();
    let pictures = Pictures::named(HashMap::from([("target".to_string(), target)]));
    for step in [1, 30, 65] {
        let cancel = Cancel::default();
        let monitor = Monitor::new(Arc::new(StopAt(Mutex::new(step), cancel.clone())), cancel);
        let seen = Mutex::new(0);
        let preview = |found: &SoFar| {
            assert!(found.lights.lights.len() == 2 && found.lights.lights[0].name == "Key");
            *seen.lock().unwrap() += 1;
        };
        let result = solve_lights(&[&relighter], &request, &pictures, &monitor, &preview);
        assert!(matches!(result, Err(SessionError::Cancelled)), "{step}: {result:?}");
        assert!(*seen.lock().unwrap() > 0);
    }
}

/// Remembers reports, and cancels at one of them.
struct CancelAt {
    number: usize,
    reports: Mutex<Vec<Progress>>,
    cancel: Cancel,
}

impl Listener for CancelAt {
    fn progress(&self, progress: &Progress) {
        let mut reports = self.reports.lock().unwrap();
        if reports.len() == self.number {
            self.cancel.request();
        }
        reports.push(progress.clone());
    }
    fn warning(&self, _: &str) {}
}

#[test]
fn cancelling_works_at_every_report_but_the_last() {
    let folder = tempfile::tempdir().unwrap();
    common::baked(folder.path());
    let relighter = Relighter::open(folder.path()).unwrap();
    let far = LightShape::Sphere { center: Vec3::new(-0.6, 0.3, 0.5), radius: 0.2 };
    let target = picture(&relighter, &[key(), light("Fill", far, [4.0, 6.0, 8.0])]);
    // Behind a wall, so that it is dropped.
    let outside = light("Outside", LightShape::Sphere { center: Vec3::Z * 9.0, radius: 0.2 }, [1.0; 3]);
    let request = target_request(json!({
        "lights": [outside], "free": {"Outside": ["strength"]}, "remove": true, "add": {"count": 2},
        "starts": 2, "steps": 8, "polish": 2, "candidates": 2,
    }));
    let request = SolveRequest::parse(&request.to_string()).unwrap();
    let pictures = Pictures::named(HashMap::from([("target".to_string(), target)]));
    let solve_until = |number: usize| {
        let cancel = Cancel::default();
        let listener = Arc::new(CancelAt { number, reports: Mutex::default(), cancel: cancel.clone() });
        let monitor = Monitor::new(listener.clone(), cancel);
        let result = solve_lights(&[&relighter], &request, &pictures, &monitor, &|_| ());
        (result, std::mem::take(&mut *listener.reports.lock().unwrap()))
    };
    let (whole, reports) = solve_until(usize::MAX);
    assert_eq!(whole.unwrap().removed, ["Outside"]);
    let begins = |stage: Stage| reports.iter().filter(|r| r.stage == stage && r.done == 0).count();
    // Explored, polished, regrouped once at least, which is explored and polished, and polished without what is dropped.
    assert!(begins(Stage::Optimise) >= 2 && begins(Stage::Polish) >= 3, "{reports:?}");
    // After the last one there is nothing left to stop.
    for (number, report) in reports[..reports.len() - 1].iter().enumerate() {
        let (result, until) = solve_until(number);
        assert!(matches!(result, Err(SessionError::Cancelled)), "{number}, {report:?}: {result:?}");
        assert!(until.len() <= number + 3, "{number}, {report:?}: it went on: {:?}", &until[number..]);
    }
}
