//! Bounds of strength, colour and direction.

use crate::room::{baked, inside, key, light, picture, room, solve, target_request};
use glam::Vec3;
use relume_session::image::Image;
use relume_session::scene::{Light, LightShape};
use relume_session::trace::TraceSettings;
use relume_session::{Monitor, Relighter, bake};
use serde_json::{Value, json};

fn stops(from: [f32; 3], to: [f32; 3]) -> f32 {
    let luminance = |c: [f32; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
    (luminance(to) / luminance(from)).log2()
}

fn brightened(light: &Light, stops: f32) -> Light {
    Light { radiance: light.radiance.map(|radiance| radiance * stops.exp2()), ..light.clone() }
}

/// Largest change in the ratio of two channels, stops.
fn stops_of_color(from: [f32; 3], to: [f32; 3]) -> f32 {
    let away = [0, 1, 2].map(|c| (to[c] / from[c]).log2());
    away.into_iter().fold(f32::MIN, f32::max) - away.into_iter().fold(f32::MAX, f32::min)
}

/// First light of the answer.
fn found(relighter: &Relighter, target: &Image, lights: &[Light], free: Value, more: Value) -> Light {
    let mut request = json!({"lights": lights, "free": free, "starts": 1});
    request.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    let solved = solve(&[relighter], &target_request(request), &[("target", target)]).unwrap();
    solved.lights.lights[0].clone()
}

#[test]
#[ignore = "takes a minute"]
fn a_light_is_as_bright_as_its_stops_allow_and_wide_bounds_change_nothing() {
    let relighter = baked(0.0);
    let target = picture(&relighter, &[brightened(&key(), 2.0)]);
    let with = |bounds: Value| {
        let mut all = inside();
        all.as_object_mut().unwrap().extend(bounds.as_object().unwrap().clone());
        let free = json!({"Key": ["position", "strength", "color"]});
        found(&relighter, &target, &[key()], free, json!({"bounds": all}))
    };
    let is = stops(key().radiance, with(json!({"stops": [-1.0, 0.5]})).radiance);
    assert!(is < 0.5 + 1e-5 && is > 0.49, "{is} stops");
    let free = with(json!({}));
    assert_eq!(with(json!({"stops": [-20.0, 20.0], "degrees": 5.0})), free);
    assert!(stops(key().radiance, free.radiance) > 1.8, "{free:?}");
}

#[test]
fn lights_and_the_world_are_as_coloured_as_their_tint_allows() {
    let folder = tempfile::tempdir().unwrap();
    let settings = TraceSettings { samples: 16, ..TraceSettings::default() };
    bake(&room(0.0, [0.4; 3]), &settings, folder.path(), false, &Monitor::default()).unwrap();
    let relighter = Relighter::open(folder.path()).unwrap();
    let goals = json!([{"goal": "color", "color": [0.1, 0.4, 1.0]}]);
    let colors = |of_light: [f32; 3], more: Value| {
        let mut request = json!({"lights": [key()], "goals": goals, "steps": 48, "polish": 8, "starts": 1});
        request.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let solved = solve(&[&relighter], &request, &[]).unwrap();
        let last = solved.lights.lights.last().unwrap().radiance;
        [stops_of_color(of_light, last), stops_of_color([1.0; 3], solved.world)]
    };
    let free = json!({"Key": ["color"], "world": ["color"]});
    let unbound = colors(key().radiance, json!({"free": free}));
    assert!(unbound.iter().all(|stops| *stops > 1.0), "{unbound:?}");
    let of_world = json!({"world": {"bounds": {"tint": 0.25}}});
    let held = colors(key().radiance, json!({"free": free, "bounds": {"tint": 0.5}, "each": of_world}));
    assert!(held[0] < 0.5 + 1e-4 && held[0] > 0.4 && held[1] < 0.25 + 1e-4 && held[1] > 0.2, "{held:?}");
    let [new, _] = colors([1.0; 3], json!({"add": {"count": 1}, "bounds": {"tint": 0.5}}));
    assert!((0.4..0.5 + 1e-4).contains(&new), "{new}");
}

#[test]
fn a_spot_turns_as_far_as_its_degrees_allow() {
    let relighter = baked(0.0);
    let axis = |degrees: f32| glam::Quat::from_rotation_z(degrees.to_radians()) * Vec3::new(0.2, 0.8, -0.6);
    let spot = |degrees: f32| {
        let shape = LightShape::Spot {
            center: Vec3::new(0.1, -0.6, 1.4),
            radius: 0.2,
            axis: axis(degrees).normalize(),
            half_angle: 0.5,
            blend: 0.2,
            soft_falloff: true,
        };
        light("Key", shape, [20.0; 3])
    };
    let target = picture(&relighter, &[spot(25.0)]);
    let angle = |bounds: Value| {
        let each = json!({"each": {"Key": {"bounds": bounds}}});
        let light = found(&relighter, &target, &[spot(0.0)], json!({"Key": ["direction"]}), each);
        light.shape.axis().unwrap().angle_between(spot(0.0).shape.axis().unwrap()).to_degrees()
    };
    let [free, held] = [angle(json!({})), angle(json!({"degrees": 8.0}))];
    let wanted = spot(25.0).shape.axis().unwrap().angle_between(spot(0.0).shape.axis().unwrap()).to_degrees();
    assert!((free - wanted).abs() < 2.0 && held < 8.02 && held > 7.9, "{held}, free {free} of {wanted}");
}

#[test]
fn a_light_that_may_not_be_dark_is_not_left_out() {
    let relighter = baked(0.0);
    let rest = Light { name: "Rest".into(), ..key() };
    let target = picture(&relighter, std::slice::from_ref(&rest));
    let dimmed = |bounds: Value| {
        let more = json!({"each": {"Key": {"bounds": bounds}}, "remove": true});
        found(&relighter, &target, &[key(), rest.clone()], json!({"Key": ["strength"]}), more)
    };
    assert_eq!(dimmed(json!({})).name, "Rest", "what does nothing goes");
    let is = stops(key().radiance, dimmed(json!({"stops": [-2, 0]})).radiance);
    assert!((is + 2.0).abs() < 1e-4, "{is} stops");
}

#[test]
fn the_world_is_as_bright_as_its_stops_allow_and_new_lights_as_bright_as_they_like() {
    let folder = tempfile::tempdir().unwrap();
    let settings = TraceSettings { samples: 16, ..TraceSettings::default() };
    bake(&room(0.0, [0.4; 3]), &settings, folder.path(), false, &Monitor::default()).unwrap();
    let relighter = Relighter::open(folder.path()).unwrap();
    let goals = json!([{"goal": "brighter", "stops": 2}]);
    let request = json!({"goals": goals, "free": {"world": ["strength"]}, "bounds": {"stops": [-1, 0.25]}});
    let solved = solve(&[&relighter], &request, &[]).unwrap();
    let is = stops([1.0; 3], solved.world);
    assert!(is < 0.25 + 1e-5 && is > 0.24, "{is} stops");
    let add =
        json!({"goals": goals, "add": {"count": 1}, "bounds": {"stops": [0, 0]}, "steps": 32, "polish": 8});
    let solved = solve(&[&relighter], &add, &[]).unwrap();
    assert!(solved.lights.lights[0].radiance[0] > 0.0, "{:?}", solved.lights);
}

#[test]
fn bounds_and_stay_of_one_light_hold_that_one_alone() {
    let relighter = baked(0.0);
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
    let relighter = baked(0.0);
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
