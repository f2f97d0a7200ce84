//! Solving lights on a small bake, through the smoothed gather and as a user asks for it.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod bounds;
mod cancelling;
#[path = "../common/mod.rs"]
mod common;
mod goals;
mod lights;
mod live;
mod room;
mod told;

use glam::Vec3;
use relume_session::image::metrics;
use relume_session::proxy::LightKind;
use relume_session::scene::{Camera, Light, LightShape, Scene};
use relume_session::trace::TraceSettings;
use relume_session::{Monitor, Relighter, Solved, bake};
use room::{baked, connected, inside, key, light, picture, room, solve, target_request, traced};
use serde_json::{Value, json};

#[test]
fn a_hidden_light_is_found_through_the_dump_alone() {
    let relighter = baked(0.0);
    let target = picture(&relighter, &[key()]);
    let solved =
        solve(&[&relighter], &target_request(json!({"add": {"count": 1}})), &[("target", &target)]).unwrap();
    assert!(miss(&solved) < 0.1 && solved.backend == "gather", "{solved:?}");
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
#[ignore = "takes a minute"]
fn two_views_share_their_lights_and_unneeded_ones_are_dropped() {
    let relighters = [baked(-1.0), baked(1.0)];
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

/// Distance of the first light from the place of the key, metres.
fn miss(solved: &Solved) -> f32 {
    let [found, hidden] = [solved.lights.lights[0].shape, key().shape].map(|shape| shape.center().unwrap());
    found.distance(hidden)
}

#[test]
fn strokes_change_what_they_ask_for_and_keep_the_rest() {
    let relighter = baked(0.0);
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
fn surplus_lights_are_dropped_without_a_polish_too() {
    let relighter = baked(0.0);
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
    assert_eq!(solved.backend, "proxy");
    assert!(solved.added.is_empty() && solved.lights.lights.len() == 1, "{:?}", solved.lights);
}

#[test]
#[ignore = "takes a minute"]
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
    let relighter = baked(0.0);
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
fn a_light_that_paths_hardly_meet_is_named_and_solved_on_with_paths_that_look_for_it() {
    let small = |x: f32| {
        light("Key", LightShape::Sphere { center: Vec3::new(x, -0.1, 1.3), radius: 0.006 }, [9000.0; 3])
    };
    let folder = tempfile::tempdir().unwrap();
    let towards = |name: &str, lights: &[Light], seed: u64| {
        let folder = folder.path().join(name);
        let settings =
            TraceSettings { samples: 128, guide_targets: lights.to_vec(), seed, ..TraceSettings::default() };
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
    assert_eq!(first.under_sampled, ["Key"]);
    let again = towards("again", &[small(-0.6), first.lights.lights[0].clone()], 2);
    let second = solved(&again, json!(first));
    assert!(second.under_sampled.is_empty());
    // What was said of it was noise, and is its picture now.
    let decibels = |solved: &Solved| solved.report[0].report.reached;
    assert!(decibels(&first) < 25.0 && decibels(&second) > 35.0, "{:?} {:?}", first.report, second.report);
    // Connected, it is met by every path.
    let third = solved(&connected(&folder.path().join("now")), json!({"lights": [small(0.3)]}));
    let miss = third.lights.lights[0].shape.center().unwrap().distance(small(0.5).shape.center().unwrap());
    assert!(third.under_sampled.is_empty() && miss < 0.02, "{miss} {:?}", third.report);
    assert!(decibels(&third) > 35.0, "{:?}", third.report);
    let sun = light("Key", LightShape::Sun { direction: Vec3::Z, half_angle: 0.1 }, [1.0; 3]);
    let other = solve(&[&now], &request(json!({"lights": [sun]})), &[("target", &target)]);
    assert!(other.unwrap_err().to_string().contains("light 'Key' is of another type"));
}
