//! Lights of every type are found again from a picture of other paths.

use crate::room::{Bakes, light, picture, solve, target_request, traced};
use glam::Vec3;
use relume_session::Relighter;
use relume_session::image::metrics;
use relume_session::scene::{Light, LightShape};
use relume_session::trace::TraceSettings;
use serde_json::{Value, json};
use std::f32::consts::PI;

const POWER: [f32; 3] = [6.0, 4.5, 3.0];
const PLACE: [&str; 4] = ["position", "direction", "color", "strength"];
/// An area light under the ceiling, tilted.
const AT: Vec3 = Vec3::new(0.3, -0.1, 1.5);
const EDGE_U: Vec3 = Vec3::new(-0.5, 0.0, 0.2);
const EDGE_V: Vec3 = Vec3::new(0.0, 0.3, 0.0);
/// Place that the search starts from.
const FROM: Vec3 = Vec3::new(-0.2, 0.2, 1.2);

fn power(light: &Light) -> [f32; 3] {
    light.radiance.map(|radiance| radiance * light.shape.extent())
}

fn lit(shape: LightShape, power: [f32; 3]) -> Light {
    light("Key", shape, power.map(|power| power / shape.extent()))
}

/// Solves for a hidden light, some of whose values are free, from another one. The picture must match the target as
/// well as that of the hidden light, but for a decibel.
fn found(hidden: LightShape, start: LightShape, free: &[&str]) -> Light {
    found_in(&Bakes::open(), hidden, start, free, 2)
}

fn found_in(bakes: &Bakes, hidden: LightShape, start: LightShape, free: &[&str], starts: usize) -> Light {
    let start_power = if free.contains(&"strength") { [3.0; 3] } else { POWER };
    let target = picture(&bakes.other, &[lit(hidden, POWER)]);
    let request = json!({"lights": [lit(start, start_power)], "free": {"Key": free}, "starts": starts});
    let solved = solve(&[&bakes.own], &target_request(request), &[("target", &target)]).unwrap();
    let found = solved.lights.lights[0].clone();
    let psnr =
        |light: &Light| metrics::psnr_reinhard(&picture(&bakes.own, std::slice::from_ref(light)), &target);
    let [is, best] = [psnr(&found), psnr(&lit(hidden, POWER))];
    assert!(is > best - 1.0, "{is} of {best} dB: {found:?}");
    assert!(solved.report[0].report.met && solved.report[0].text.contains("reached"), "{:?}", solved.report);
    found
}

fn distance(found: &Light, hidden: LightShape) -> f32 {
    found.shape.center().unwrap().distance(hidden.center().unwrap())
}

/// The largest relative error of a channel.
fn power_error(found: &Light) -> f32 {
    let errors = power(found).into_iter().zip(POWER).map(|(is, was)| (is / was - 1.0).abs());
    errors.fold(0.0, f32::max)
}

fn degrees(a: Vec3, b: Vec3) -> f32 {
    a.angle_between(b).to_degrees()
}

fn normal(shape: &LightShape) -> Vec3 {
    match shape {
        LightShape::Quad { edge_u, edge_v, .. } | LightShape::Ellipse { edge_u, edge_v, .. } => {
            edge_u.cross(*edge_v)
        }
        _ => panic!("{shape:?} has no normal"),
    }
}

fn disk(center: Vec3, radius: f32) -> LightShape {
    LightShape::FacingDisk { center, radius }
}

/// A disk or rectangle.
fn flat(round: bool, edge_u: Vec3, edge_v: Vec3) -> LightShape {
    match round {
        true => LightShape::Ellipse { center: AT, edge_u, edge_v, spread: PI },
        false => LightShape::Quad { center: AT, edge_u, edge_v, spread: PI },
    }
}

fn spot(center: Vec3, axis: Vec3, half_angle: f32, blend: f32) -> LightShape {
    LightShape::Spot { center, radius: 0.3, axis: axis.normalize(), half_angle, blend, soft_falloff: true }
}

/// Angle at which a cone has half of its light; a spot of the tests' radius has a softer edge than any blend makes.
fn half_light(half_angle: f32, blend: f32) -> f32 {
    (1.0 - (1.0 - half_angle.cos()) * (1.0 - 0.5 * blend)).acos()
}

const HANGS: Vec3 = Vec3::new(0.1, -0.6, 1.4);
const AIM: Vec3 = Vec3::new(0.2, 0.8, -0.6);

#[test]
fn a_point_light_is_found_to_three_centimetres() {
    let hidden = disk(Vec3::new(0.3, -0.2, 1.2), 0.25);
    let found = found(hidden, disk(Vec3::new(-0.3, 0.2, 0.9), 0.25), &PLACE);
    assert!(distance(&found, hidden) < 0.03 && power_error(&found) < 0.02, "{found:?}");
}

#[test]
fn the_size_of_a_large_point_light_is_found() {
    // One of a tenth of a metre has penumbrae of a pixel here: its size is left to chance.
    let center = Vec3::new(0.3, -0.2, 1.2);
    let found = found(disk(center, 0.4), disk(center, 0.1), &["size"]);
    assert!((found.shape.sizes()[0] / 0.4 - 1.0).abs() < 0.05, "{found:?}");
    assert!(power_error(&found) < 1e-3 && distance(&found, disk(center, 0.4)) == 0.0, "{found:?}");
}

#[test]
fn place_and_tilt_of_a_rectangle_are_found() {
    let hidden = LightShape::Quad { center: AT, edge_u: EDGE_U, edge_v: EDGE_V, spread: PI };
    let start =
        LightShape::Quad { center: FROM, edge_u: -EDGE_U.length() * Vec3::X, edge_v: EDGE_V, spread: PI };
    let found = found(hidden, start, &PLACE);
    // From here a turn in its own plane shows in little but the shape of penumbrae.
    let tilt = degrees(normal(&found.shape), normal(&hidden));
    assert!(distance(&found, hidden) < 0.06 && power_error(&found) < 0.03 && tilt < 4.0, "{tilt}: {found:?}");
}

#[test]
fn the_roll_of_a_long_rectangle_at_a_wall_is_found() {
    let rolled = |center: Vec3, degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (edge_u, edge_v) = (Vec3::new(sin, 0.0, cos), 0.15 * Vec3::new(cos, 0.0, -sin));
        LightShape::Quad { center, edge_u, edge_v, spread: PI }
    };
    let hidden = rolled(Vec3::new(0.2, 0.7, 1.1), 65.0);
    let found = found(hidden, rolled(Vec3::new(0.0, 0.6, 1.0), 25.0), &PLACE);
    let along = |shape: &LightShape| match shape {
        LightShape::Quad { edge_u, .. } => *edge_u,
        _ => panic!("{shape:?} has no edges"),
    };
    let roll = degrees(along(&found.shape), along(&hidden));
    let roll = roll.min(180.0 - roll);
    let tilt = degrees(normal(&found.shape), normal(&hidden));
    assert!(roll < 2.0 && tilt < 2.0, "{roll} {tilt}: {found:?}");
    assert!(distance(&found, hidden) < 0.02 && power_error(&found) < 0.02, "{found:?}");
}

#[test]
#[ignore = "takes half a minute"]
fn place_and_tilt_of_an_area_disk_are_found() {
    let edge_v = EDGE_U.length() * Vec3::Y;
    let hidden = LightShape::Ellipse { center: AT, edge_u: EDGE_U, edge_v, spread: PI };
    let start = LightShape::Ellipse { center: FROM, edge_u: -EDGE_U.length() * Vec3::X, edge_v, spread: PI };
    let found = found(hidden, start, &PLACE);
    let tilt = degrees(normal(&found.shape), normal(&hidden));
    assert!(distance(&found, hidden) < 0.08 && power_error(&found) < 0.03 && tilt < 4.0, "{tilt}: {found:?}");
}

/// Blender's area light of this shape, facing down.
fn area(shape: &str, at: Vec3, size: f32) -> Value {
    let world_from_object =
        [[1.0, 0.0, 0.0, at.x], [0.0, 1.0, 0.0, at.y], [0.0, 0.0, 1.0, at.z], [0.0, 0.0, 0.0, 1.0]];
    let kind = json!({"type": "AREA", "shape": shape, "size": size, "size_y": size});
    json!({"name": "Key", "kind": kind, "energy": 10.0, "world_from_object": world_from_object})
}

#[test]
#[ignore = "takes a minute"]
fn whatever_the_size_of_an_area_light_is_taken_for_its_place_and_tilt_are_found() {
    // Sides show in little but the softness of shadows, and are left to noise here.
    let (bakes, square) = (Bakes::open(), EDGE_U.length() * Vec3::Y);
    for (shape, edge_v, round) in
        [("RECTANGLE", EDGE_V, false), ("SQUARE", square, false), ("DISK", square, true)]
    {
        // A disk of the wrong size lets a little more of its power pass for noise.
        let [miss, weak] = if round { [0.08, 0.05] } else { [0.06, 0.03] };
        let hidden = flat(round, EDGE_U, edge_v);
        let target = picture(&bakes.other, &[lit(hidden, POWER)]);
        let free = ["position", "direction", "size", "color", "strength"];
        let request = json!({"lights": [area(shape, FROM, 0.2)], "free": {"Key": free}, "starts": 2});
        let solved = solve(&[&bakes.own], &target_request(request), &[("target", &target)]).unwrap();
        let found = &solved.lights.lights[0];
        let tilt = degrees(normal(&found.shape), normal(&hidden));
        assert!(
            distance(found, hidden) < miss && power_error(found) < weak && tilt < 4.0,
            "{tilt}: {found:?}"
        );
        assert!(solved.report[0].report.met, "{:?}", solved.report);
        assert_eq!(solved.blender[0]["shape"], shape, "{:?}", solved.blender);
    }
}

#[test]
#[ignore = "takes minutes"]
fn paths_that_look_for_a_disk_tell_its_size() {
    let edge_v = 0.42 * Vec3::Y;
    let hidden = LightShape::Ellipse { center: AT, edge_u: 0.42 * EDGE_U.normalize(), edge_v, spread: PI };
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [own, other] = [0, 1].map(|seed| {
        let towards = vec![lit(hidden, POWER)];
        let settings =
            TraceSettings { samples: 384, seed, guide_targets: towards, ..TraceSettings::default() };
        traced(folders[seed as usize].path(), 0.0, &settings);
        Relighter::open(folders[seed as usize].path()).unwrap()
    });
    let target = picture(&other, &[lit(hidden, POWER)]);
    let free = ["position", "direction", "size", "color", "strength"];
    let request = json!({"lights": [area("DISK", FROM, 0.2)], "free": {"Key": free}, "starts": 2});
    let solved = solve(&[&own], &target_request(request), &[("target", &target)]).unwrap();
    let found = &solved.lights.lights[0];
    let factor = found.shape.sizes()[0] / 0.42;
    assert!((0.7..1.4).contains(&factor) && distance(found, hidden) < 0.03, "{factor}: {found:?}");
}

#[test]
#[ignore = "takes minutes"]
fn the_sides_of_a_large_area_light_in_its_place_are_found() {
    let bakes = Bakes::open();
    for round in [false, true] {
        let sized = |u: f32, v: f32| flat(round, u * EDGE_U.normalize(), v * Vec3::Y);
        let target = picture(&bakes.other, &[lit(sized(1.0, 0.5), POWER)]);
        let most = if round { 1.3 } else { 1.1 };
        for start in [0.3, 0.9] {
            let lights = [lit(sized(start, start), POWER)];
            let mut request = target_request(json!({"lights": lights, "free": {"Key": ["size"]}}));
            request["bounds"]["size"] = json!([0.1, 1.2]);
            let solved = solve(&[&bakes.own], &request, &[("target", &target)]).unwrap();
            let found = &solved.lights.lights[0];
            let [u, v] = [found.shape.sizes()[0], found.shape.sizes()[1] / 0.5];
            assert!([u, v].iter().all(|factor| (1.0 / most..most).contains(factor)), "{u}, {v}: {found:?}");
        }
    }
}

#[test]
#[ignore = "takes half a minute"]
fn the_radius_of_a_spot_is_found() {
    let shape = |radius: f32| match spot(HANGS, AIM, 0.5, 0.3) {
        LightShape::Spot { center, axis, half_angle, blend, soft_falloff, .. } => {
            LightShape::Spot { center, radius, axis, half_angle, blend, soft_falloff }
        }
        other => other,
    };
    let found = found(shape(0.4), shape(0.1), &["size"]);
    assert!((found.shape.sizes()[0] / 0.4 - 1.0).abs() < 0.05 && power_error(&found) < 1e-3, "{found:?}");
}

/// A spot of this cone elsewhere than the one that hangs there: more than a metre away.
fn elsewhere(half_angle: f32, blend: f32) -> LightShape {
    spot(Vec3::new(-0.5, 0.1, 0.9), Vec3::new(0.0, 0.5, -0.8), half_angle, blend)
}

/// Middle and radius of a spot's light on the back wall.
fn on_wall(light: &LightShape) -> (Vec3, f32) {
    let LightShape::Spot { center, axis, half_angle, blend, .. } = *light else { panic!("{light:?}") };
    let way = (1.0 - center.y) / axis.y;
    (center + way * axis, way * half_light(half_angle, blend).tan())
}

#[test]
#[ignore = "takes minutes"]
fn place_aim_and_cone_of_a_spot_are_found() {
    let hidden = spot(HANGS, AIM, 0.5, 0.3);
    let free = ["position", "direction", "cone", "color", "strength"];
    let found = found_in(&Bakes::large(), hidden, elsewhere(0.7, 0.1), &free, 4);
    // Nearer, wider and weaker is nearly the same picture: most certain is its light on the back wall.
    let [(middle, width), (hidden_middle, hidden_width)] = [&found.shape, &hidden].map(on_wall);
    assert!(middle.distance(hidden_middle) < 0.05, "{middle} for {hidden_middle}: {found:?}");
    assert!((width / hidden_width - 1.0).abs() < 0.1, "{width} for {hidden_width}: {found:?}");
    let LightShape::Spot { half_angle, blend, .. } = found.shape else { panic!("{found:?}") };
    let cone = half_light(half_angle, blend) / half_light(0.5, 0.3);
    assert!((cone - 1.0).abs() < 0.12, "{cone}: {found:?}");
    assert!(distance(&found, hidden) < 0.2 && power_error(&found) < 0.2, "{found:?}");
}

#[test]
fn aim_and_cone_of_a_spot_are_found() {
    let start = spot(HANGS, Vec3::new(0.0, 0.5, -0.8), 0.7, 0.1);
    let found = found(spot(HANGS, AIM, 0.5, 0.3), start, &["direction", "cone", "color", "strength"]);
    let LightShape::Spot { axis, half_angle, blend, .. } = found.shape else { panic!("{found:?}") };
    let [is, was] = [half_light(half_angle, blend), half_light(0.5, 0.3)];
    assert!((is / was - 1.0).abs() < 0.04 && degrees(axis, AIM) < 2.0, "{is} for {was}: {found:?}");
    assert!(power_error(&found) < 0.1, "{found:?}");
}

#[test]
fn direction_angle_and_strength_of_a_sun_are_found() {
    let sun =
        |direction: Vec3, half_angle: f32| LightShape::Sun { direction: direction.normalize(), half_angle };
    let to = Vec3::new(0.4, -0.7, 0.5);
    let start = sun(Vec3::new(-0.1, -0.8, 0.3), 0.1);
    let found = found(sun(to, 0.3), start, &["direction", "size", "color", "strength"]);
    let LightShape::Sun { direction, half_angle } = found.shape else { panic!("{found:?}") };
    assert!(degrees(direction, to) < 2.0 && power_error(&found) < 0.05, "{found:?}");
    assert!((half_angle / 0.3 - 1.0).abs() < 0.15, "{found:?}");
}
