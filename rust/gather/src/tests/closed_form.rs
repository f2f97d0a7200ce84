//! A white Lambert plane at z = 0, seen by one pixel at the origin: the unit value is irradiance / pi, and
//! Blender's lights have closed forms there, which Cycles was measured to follow (P = 100, 2 m above, Cycles 4.2 to 5.2).

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;
use relume_dump::{Dump, End, Lobe, TileSamples};
use relume_scene::LightShape;

use super::{Random, dump, light, manifest, segment};
use crate::{Gather, SampleSplit};

const HEIGHT: f32 = 2.0;
const ABOVE: Vec3 = Vec3::new(0.0, 0.0, HEIGHT);

/// Strata along each axis of the disk under the hemisphere.
const STRATA: u32 = 512;

/// One pixel, stratified directions in proportion to the cosine; each leaves the scene, or ends at `ceiling`.
fn lambert_plane(ceiling: Option<f32>) -> Dump {
    let mut random = Random(1);
    dump(manifest(1, &[STRATA * STRATA]), |_, sample, samples: &mut TileSamples| {
        let jittered = |stratum: u32, jitter: f32| 2.0 * (stratum as f32 + jitter) / STRATA as f32 - 1.0;
        let x = jittered(sample % STRATA, random.next());
        let y = jittered(sample / STRATA, random.next());
        // Shirley and Chiu's map of the square to the disk, lifted to the hemisphere.
        let (radius, phi) = match x.abs() > y.abs() {
            true => (x, PI / 4.0 * y / x),
            false => (y, FRAC_PI_2 - PI / 4.0 * x / y),
        };
        let direction = Vec3::new(radius * phi.cos(), radius * phi.sin(), (1.0 - radius * radius).sqrt());
        let end = match ceiling {
            Some(height) if direction.z > 1e-3 => End::Vertex(direction * (height / direction.z)),
            _ => End::Escape(direction),
        };
        samples.push(segment(End::Vertex(Vec3::ZERO), Lobe::Camera));
        samples.push(segment(end, Lobe::Diffuse));
    })
}

fn value(dump: &Dump, shape: LightShape) -> f32 {
    let gather = Gather::new(dump.clone());
    let prepared = gather.prepare(&light(shape)).unwrap();
    gather.pixel(0, 0, &[prepared], SampleSplit::All)[0][0]
}

/// Compares unit values. With n strata inside the light's outline, about 3.5 sqrt(n) strata are cut by it, each with a
/// variance of 1/6: four standard deviations are 3 n^(1/4).
fn assert_close(found: f32, expected: f32) {
    let strata = expected * (STRATA * STRATA) as f32;
    let tolerance = 3.0 * strata.powf(-0.75) + 1e-5;
    assert!(
        (found / expected - 1.0).abs() < tolerance,
        "{found} instead of {expected}, tolerance {tolerance}"
    );
}

/// An area light of P = 100 W above the plane, facing it.
fn area(size: (f32, f32), spread: f32, is_ellipse: bool) -> (LightShape, f32) {
    let (center, edge_u, edge_v) = (ABOVE, Vec3::X * size.0, Vec3::NEG_Y * size.1);
    let fill = if is_ellipse { PI / 4.0 } else { 1.0 };
    let shape = match is_ellipse {
        true => LightShape::Ellipse { center, edge_u, edge_v, spread },
        false => LightShape::Quad { center, edge_u, edge_v, spread },
    };
    (shape, 100.0 / (PI * size.0 * size.1 * fill))
}

#[test]
fn area_lights_give_what_cycles_was_measured_to_give() {
    let dump = lambert_plane(None);
    for (size, is_ellipse, expected) in [
        ((1.0, 1.0), false, 2.33887),
        ((1.0, 2.0), false, 2.10666),
        ((1.0, 1.0), true, 2.38425),
        ((1.0, 2.0), true, 2.19815),
    ] {
        let (shape, radiance) = area(size, PI, is_ellipse);
        assert_close(value(&dump, shape), expected / radiance);
    }
}

#[test]
fn spread_gives_what_cycles_was_measured_to_give() {
    let dump = lambert_plane(None);
    for (degrees, expected) in [(120.0f32, 5.27379), (90.0, 8.85174), (40.0, 27.644), (10.0, 31.831)] {
        let (shape, radiance) = area((1.0, 1.0), degrees.to_radians(), false);
        assert_close(value(&dump, shape), expected / radiance);
    }
}

#[test]
fn spheres_of_any_radius_give_the_point_light_of_cycles() {
    let dump = lambert_plane(None);
    for radius in [0.1, 0.3, 1.0, 1.9] {
        let radiance = 100.0 / (4.0 * PI * PI * radius * radius);
        let sphere = LightShape::Sphere { center: ABOVE, radius };
        assert_close(value(&dump, sphere), 0.63326 / radiance);
    }
}

#[test]
fn a_facing_disk_is_a_disk_across_the_line_of_sight() {
    let dump = lambert_plane(None);
    for radius in [0.2f32, 1.0, 3.0] {
        let r2 = radius * radius;
        let disk = |center| LightShape::FacingDisk { center, radius };
        assert_close(value(&dump, disk(ABOVE)), r2 / (r2 + HEIGHT * HEIGHT));
    }
    // Off the normal: E = pi L sin^2(alpha) cos(theta) while the disk is above the horizon.
    let center = Vec3::new(1.5, 0.0, 2.0);
    let disk = LightShape::FacingDisk { center, radius: 0.5 };
    assert_close(value(&dump, disk), 0.25 / (0.25 + 6.25) * 0.8);
}

#[test]
fn a_spot_is_cut_by_its_cone() {
    let dump = lambert_plane(None);
    let spot = |half_angle, blend, soft_falloff| LightShape::Spot {
        center: ABOVE,
        radius: 1.0,
        axis: Vec3::NEG_Z,
        half_angle,
        blend,
        soft_falloff,
    };
    // A cone wider than what is seen of the light changes nothing.
    assert_close(value(&dump, spot(1.2, 0.0, false)), 0.25);
    assert_close(value(&dump, spot(1.2, 0.0, true)), 0.2);
    // A narrower one leaves the directions within it: sin^2 of its half angle.
    assert_close(value(&dump, spot(0.3, 0.0, false)), 0.3f32.sin().powi(2));
    // Blend: the integral of 2 sin cos smoothstep over the cone, by the midpoint rule.
    let (half, blend, steps) = (0.4f64, 0.7, 10_000);
    let blended: f64 = (0..steps)
        .map(|i| {
            let theta = half * (f64::from(i) + 0.5) / f64::from(steps);
            let x = ((theta.cos() - half.cos()) / ((1.0 - half.cos()) * blend)).min(1.0);
            2.0 * theta.sin() * theta.cos() * x * x * (3.0 - 2.0 * x) * half / f64::from(steps)
        })
        .sum();
    assert_close(value(&dump, spot(0.4, 0.7, false)), blended as f32);
    // Turned away, it is dark.
    let away = LightShape::Spot {
        center: ABOVE,
        radius: 1.0,
        axis: Vec3::Z,
        half_angle: 0.5,
        blend: 0.1,
        soft_falloff: false,
    };
    assert_eq!(value(&dump, away), 0.0);
}

#[test]
fn the_sun_shines_from_its_disk_on_escaped_segments_only() {
    let direction = Vec3::new(0.6, 0.0, 0.8);
    for half_angle in [0.05f32, 0.2, 0.6] {
        let sun = LightShape::Sun { direction, half_angle };
        assert_close(value(&lambert_plane(None), sun), half_angle.sin().powi(2) * 0.8);
    }
    let everywhere = LightShape::Sun { direction, half_angle: PI };
    assert!(value(&lambert_plane(Some(3.0)), everywhere) < 1e-5);
}

#[test]
fn lights_above_the_ceiling_are_hidden_and_lights_cut_by_it_are_cut() {
    let sphere = |z| LightShape::Sphere { center: Vec3::new(0.0, 0.0, z), radius: 0.5 };
    let dump = lambert_plane(Some(2.0));
    assert_eq!(value(&dump, sphere(2.6)), 0.0);
    assert_close(value(&dump, sphere(1.0)), 0.25);
    let quad = |z, up| LightShape::Quad {
        center: Vec3::new(0.0, 0.0, z),
        edge_u: Vec3::X,
        edge_v: Vec3::Y * up,
        spread: PI,
    };
    assert_eq!(value(&dump, quad(2.1, -1.0)), 0.0);
    assert_eq!(value(&dump, quad(1.9, 1.0)), 0.0, "it shines upwards");
    assert!(value(&dump, quad(1.9, -1.0)) > 0.05);
    // Half of the sphere is above the ceiling: what is left is seen as the part of the lower cap.
    let cut = value(&dump, sphere(2.2));
    assert!(cut > 0.0 && cut < value(&lambert_plane(None), sphere(2.2)));
}

#[test]
fn a_light_below_the_radius_floor_keeps_its_power() {
    let gather = Gather::new(lambert_plane(None)).with_radius_floor(0.1);
    let edge = |axis: Vec3| axis * 1e-3;
    for (shape, share_of_floor, value_at_floor) in [
        (LightShape::Sphere { center: ABOVE, radius: 1e-3 }, 1e-4, 0.01 / 4.0),
        (LightShape::FacingDisk { center: ABOVE, radius: 1e-3 }, 1e-4, 0.01 / 4.01),
        // Edges of twice the floor; the form factor of a small square.
        (
            LightShape::Quad { center: ABOVE, edge_u: edge(Vec3::X), edge_v: edge(Vec3::NEG_Y), spread: PI },
            2.5e-5,
            0.04 / (4.0 * PI) / 1.005,
        ),
    ] {
        let prepared = gather.prepare(&light(shape)).unwrap();
        let found = gather.pixel(0, 0, &[prepared], SampleSplit::All)[0][0];
        assert_close(found / share_of_floor, value_at_floor);
        assert_eq!(gather.enlarged(&shape), Some(0.1));
    }
    assert_eq!(gather.enlarged(&LightShape::Sphere { center: ABOVE, radius: 0.2 }), None);
}

#[test]
fn a_segment_from_inside_a_sphere_sees_it_once_where_it_leaves() {
    let around = LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 };
    assert_close(value(&lambert_plane(None), around), 1.0);
    // It ends inside: Cycles counts no hit.
    assert_eq!(
        value(&lambert_plane(Some(1e-3)), LightShape::Sphere { center: Vec3::ZERO, radius: 100.0 }),
        0.0
    );
    // A spot from inside: only towards its centre, and without its cone.
    let spot = LightShape::Spot {
        center: Vec3::new(0.0, 0.0, 0.5),
        radius: 1.0,
        axis: Vec3::Z,
        half_angle: FRAC_PI_2 * 0.5,
        blend: 0.0,
        soft_falloff: false,
    };
    assert_close(value(&lambert_plane(None), spot), 1.0);
    // With soft falloff the cone counts within the radius, too: turned away, it is dark.
    let LightShape::Spot { center, radius, axis, half_angle, blend, .. } = spot else { unreachable!() };
    let soft = LightShape::Spot { center, radius, axis, half_angle, blend, soft_falloff: true };
    assert_eq!(value(&lambert_plane(None), soft), 0.0);
}
