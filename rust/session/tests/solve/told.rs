//! Messages about goals and lights that contradict each other.

use crate::common;
use crate::room::{baked, key, light, picture, solve, target_request};
use glam::Vec3;
use relume_session::image::{Image, Layer, LayeredImage, Precision, write_exr};
use relume_session::proxy::LightKind;
use relume_session::scene::{Light, LightShape};
use relume_session::{Monitor, Pictures, Relighter, SolveRequest, solve_lights};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::Path;

#[test]
fn contradictions_are_named_and_an_unreachable_target_says_where_and_how_much() {
    let relighter = baked(0.0);
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
    let relighter = baked(0.0);
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
    let relighter = baked(0.0);
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
    let relighter = baked(0.0);
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
