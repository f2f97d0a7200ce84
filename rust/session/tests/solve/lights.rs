//! Lights of every type are found again from a picture of other paths.

use crate::room::{Bakes, light, picture, solve, target_request};
use glam::Vec3;
use relume_session::image::metrics;
use relume_session::scene::{Light, LightShape};
use serde_json::json;
use std::f32::consts::PI;

const POWER: [f32; 3] = [6.0, 4.5, 3.0];
const PLACE: [&str; 4] = ["position", "direction", "color", "strength"];
/// An area light under the ceiling, tilted.
const AT: Vec3 = Vec3::new(0.3, -0.1, 1.5);
const EDGE_U: Vec3 = Vec3::new(-0.5, 0.0, 0.2);
const EDGE_V: Vec3 = Vec3::new(0.0, 0.3, 0.0);
/// Where one is looked for first.
const FROM: Vec3 = Vec3::new(-0.2, 0.2, 1.2);

fn power(light: &Light) -> [f32; 3] {
    light.radiance.map(|radiance| radiance * light.shape.extent())
}

fn lit(shape: LightShape, power: [f32; 3]) -> Light {
    light("Key", shape, power.map(|power| power / shape.extent()))
}

/// What is found of a hidden light, some of whose values are free, from another one. Its picture must be as near to the target
/// as that of the hidden light itself, but for a decibel.
fn found(hidden: LightShape, start: LightShape, free: &[&str]) -> Light {
    let bakes = Bakes::open();
    let start_power = if free.contains(&"strength") { [3.0; 3] } else { POWER };
    let target = picture(&bakes.other, &[lit(hidden, POWER)]);
    let request = json!({"lights": [lit(start, start_power)], "free": {"Key": free}, "starts": 2});
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
    // A turn in its own plane shows in little but the shape of penumbrae.
    let tilt = degrees(normal(&found.shape), normal(&hidden));
    assert!(distance(&found, hidden) < 0.06 && power_error(&found) < 0.03 && tilt < 4.0, "{tilt}: {found:?}");
}

#[test]
fn place_tilt_and_sides_of_a_rectangle_are_found() {
    let hidden = LightShape::Quad { center: AT, edge_u: EDGE_U, edge_v: EDGE_V, spread: PI };
    let start = LightShape::Quad { center: FROM, edge_u: -0.2 * Vec3::X, edge_v: 0.2 * Vec3::Y, spread: PI };
    let found = found(hidden, start, &["position", "direction", "size", "color", "strength"]);
    let tilt = degrees(normal(&found.shape), normal(&hidden));
    assert!(distance(&found, hidden) < 0.06 && power_error(&found) < 0.03 && tilt < 4.0, "{tilt}: {found:?}");
    // Sides show in little but the softness of shadows.
    let LightShape::Quad { edge_u, edge_v, .. } = found.shape else { panic!("{found:?}") };
    let [long, short] = if edge_u.length() > edge_v.length() { [edge_u, edge_v] } else { [edge_v, edge_u] };
    let factors = [long.length() / EDGE_U.length(), short.length() / EDGE_V.length()];
    assert!(factors.iter().all(|factor| (0.5..2.0).contains(factor)), "{factors:?}: {found:?}");
    let across = degrees(long, EDGE_U);
    assert!(across.min(180.0 - across) < 20.0, "{across}: {found:?}");
}

#[test]
fn place_and_tilt_of_an_area_disk_are_found() {
    let edge_v = EDGE_U.length() * Vec3::Y;
    let hidden = LightShape::Ellipse { center: AT, edge_u: EDGE_U, edge_v, spread: PI };
    let start = LightShape::Ellipse { center: FROM, edge_u: -EDGE_U.length() * Vec3::X, edge_v, spread: PI };
    let found = found(hidden, start, &PLACE);
    let tilt = degrees(normal(&found.shape), normal(&hidden));
    assert!(distance(&found, hidden) < 0.08 && power_error(&found) < 0.03 && tilt < 4.0, "{tilt}: {found:?}");
}

#[test]
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

#[test]
fn place_aim_and_cone_of_a_spot_are_found() {
    let start = spot(Vec3::new(-0.2, -0.4, 1.2), Vec3::new(0.0, 0.5, -0.8), 0.7, 0.1);
    let hidden = spot(HANGS, AIM, 0.5, 0.3);
    let found = found(hidden, start, &["position", "direction", "cone", "color", "strength"]);
    // Nearer and wider is nearly the same picture: certain are middle and width of its light on the back wall.
    let on_wall = |light: &LightShape| {
        let LightShape::Spot { center, axis, half_angle, blend, .. } = *light else { panic!("{light:?}") };
        let way = (1.0 - center.y) / axis.y;
        (center + way * axis, way * half_light(half_angle, blend).tan())
    };
    let [(middle, width), (hidden_middle, hidden_width)] = [&found.shape, &hidden].map(on_wall);
    assert!(middle.distance(hidden_middle) < 0.05 && distance(&found, hidden) < 0.4, "{middle}: {found:?}");
    assert!((width / hidden_width - 1.0).abs() < 0.1, "{width} for {hidden_width}: {found:?}");
}

#[test]
fn place_and_aim_of_a_spot_are_found() {
    let hidden = spot(HANGS, AIM, 0.5, 0.3);
    let found = found(hidden, spot(Vec3::new(-0.2, -0.4, 1.2), Vec3::new(0.0, 0.5, -0.8), 0.5, 0.3), &PLACE);
    let LightShape::Spot { center, axis, .. } = found.shape else { panic!("{found:?}") };
    // To move while turning so that the middle of its light on the back wall stays changes the picture least.
    let on_wall = |from: Vec3, axis: Vec3| from + axis * ((1.0 - from.y) / axis.y);
    let miss = on_wall(center, axis).distance(on_wall(HANGS, AIM));
    assert!(
        miss < 0.08 && distance(&found, hidden) < 0.25 && power_error(&found) < 0.08,
        "{miss}: {found:?}"
    );
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
