//! Strands and points against what is searched for densely in double precision.

use glam::{Affine3A, Quat, Vec3};
use relume_scene::{Curves, Geometry, Instance, Points, Scene, StrandShape};

use super::{tests::Random, *};
use crate::strand::Span;

/// Strands that start anywhere in a cube and wander.
fn tuft(shape: StrandShape, count: usize, seed: u64) -> Curves {
    let mut random = Random(seed);
    let mut curves = Curves { name: "tuft".into(), shape, first_keys: vec![0], ..Curves::default() };
    for _ in 0..count {
        let mut at = random.point(1.0);
        let mut step = random.direction() * 0.3;
        let keys = 2 + (random.next() * 5.0) as usize;
        for _ in 0..keys {
            curves.keys.push(at);
            curves.radii.push(0.02 + 0.03 * random.next());
            step = (step + random.point(0.15)).normalize() * 0.3;
            at += step;
        }
        curves.first_keys.push(curves.keys.len() as u32);
    }
    curves
}

fn placed(curves: Curves, world_from_object: Affine3A) -> Scene {
    Scene {
        instances: vec![Instance::new("hair", Geometry::Curves(0), world_from_object, vec![])],
        curves: vec![curves],
        ..Scene::default()
    }
}

/// Hit with AVX2, which the plain kernel has to find too.
fn intersect(bvh: &SceneBvh, ray: &Ray) -> Option<Hit> {
    let plain = SceneBvh { use_avx2: false, ..bvh.clone() };
    let (fast, slow) = (bvh.intersect(ray), plain.intersect(ray));
    assert_eq!(fast.map(|hit| hit.primitive), slow.map(|hit| hit.primitive), "{ray:?}");
    assert_eq!(fast.is_some(), bvh.is_blocked(ray));
    fast
}

/// A ray towards the cube from outside.
fn ray(random: &mut Random) -> Ray {
    let origin = random.direction() * 4.0;
    Ray::new(origin, (random.point(1.0) - origin).normalize())
}

/// Distance to the nearest place of any strand whose axis passes the ray within this share of the radius. A ribbon is met
/// where its axis passes nearest.
fn nearest_within(curves: &Curves, ray: &Ray, share: f32, is_flat: bool) -> f32 {
    let keys = (0..curves.curve_count()).flat_map(|curve| curves.keys_of(curve).skip(1).map(|key| key - 1));
    let mut nearest = f32::INFINITY;
    for key in keys {
        let span = Span::new(curves.span_at(key, 0.5), curves.shape);
        let passes = |step: i32| {
            let at = span.at(step as f32 / 100.0);
            let to_axis = at.truncate() - ray.origin;
            let along = to_axis.dot(ray.direction);
            (along, (to_axis - ray.direction * along).length(), at.w)
        };
        for step in 1..100 {
            let (along, apart, radius) = passes(step);
            let is_nearest = apart <= passes(step - 1).1 && apart <= passes(step + 1).1;
            if apart < share * radius && (is_nearest || !is_flat) {
                let raised = if is_flat { 0.0 } else { (radius * radius - apart * apart).sqrt() };
                nearest = nearest.min(along - raised);
            }
        }
    }
    nearest
}

/// Tapered, so that it does not matter whether the ends are open.
fn tapered(shape: StrandShape) -> Curves {
    let mut curves = tuft(shape, 40, 5);
    for curve in 0..curves.curve_count() {
        let keys = curves.keys_of(curve);
        (curves.radii[keys.start], curves.radii[keys.end - 1]) = (0.0, 0.0);
    }
    curves
}

fn compare(shape: StrandShape, is_flat: bool) {
    let curves = tapered(shape);
    let bvh = SceneBvh::new(&placed(curves.clone(), Affine3A::IDENTITY)).unwrap();
    let (mut random, mut hits) = (Random(9), 0);
    for _ in 0..1500 {
        let ray = ray(&mut random);
        let sure = nearest_within(&curves, &ray, 0.9, is_flat);
        let Some(hit) = intersect(&bvh, &ray) else {
            assert!(sure.is_infinite(), "{shape:?}: missed at {sure}, {ray:?}");
            continue;
        };
        hits += 1;
        let axis = Span::new(curves.span_at(hit.primitive as usize, 0.5), shape).at(hit.barycentrics[0]);
        let (position, radius) = (ray.origin + ray.direction * hit.distance, axis.w);
        let apart = position.distance(axis.truncate());
        let share = if is_flat { hit.barycentrics[1].abs() } else { 1.0 };
        // The pieces of a ribbon are straight, which shows most where it points to the camera.
        let sag = if is_flat { 1e-3 } else { 1e-4 };
        assert!(
            (apart - share * radius).abs() < 0.05 * radius + sag,
            "{shape:?}: {apart} of {radius}, {ray:?}"
        );
        assert!(hit.distance < sure + 0.01, "{shape:?}: {} behind {sure}, {ray:?}", hit.distance);
    }
    assert!(hits > 300, "{hits}");
}

#[test]
fn round_strands_are_met_where_spheres_swept_along_them_are() {
    compare(StrandShape::Round, false);
}

#[test]
fn cones_are_met_where_spheres_swept_along_them_are() {
    compare(StrandShape::Linear, false);
}

#[test]
fn ribbons_are_met_where_they_face_the_ray() {
    compare(StrandShape::Ribbon { subdivisions: 4 }, true);
}

/// One straight strand along y of radius 0.1, from -1 to 1.
fn straight(shape: StrandShape) -> Curves {
    let keys = vec![Vec3::new(0.0, -1.0, 0.0), Vec3::ZERO, Vec3::new(0.0, 1.0, 0.0)];
    Curves { keys, radii: vec![0.1; 3], first_keys: vec![0, 3], shape, ..Curves::default() }
}

const SHAPES: [StrandShape; 3] =
    [StrandShape::Ribbon { subdivisions: 2 }, StrandShape::Round, StrandShape::Linear];

#[test]
fn a_straight_strand_has_the_outline_and_normals_of_a_cylinder() {
    for shape in SHAPES {
        let bvh = SceneBvh::new(&placed(straight(shape), Affine3A::IDENTITY)).unwrap();
        for step in 0..40 {
            let (x, y) = (-0.15 + 0.3 * step as f32 / 39.0, -0.95 + 1.9 * step as f32 / 39.0);
            let ray = Ray::new(Vec3::new(x, y, 3.0), Vec3::NEG_Z);
            let hit = intersect(&bvh, &ray);
            assert_eq!(hit.is_some(), x.abs() < 0.1, "{shape:?} {x}");
            let Some(hit) = hit else { continue };
            let height = (0.01 - x * x).sqrt();
            if let StrandShape::Ribbon { .. } = shape {
                assert!(
                    (hit.distance - 3.0).abs() < 1e-5
                        && (hit.barycentrics[1].abs() - x.abs() / 0.1).abs() < 1e-4
                );
            } else {
                assert!((hit.distance - 3.0 + height).abs() < 1e-4, "{shape:?} {x}");
                assert!(
                    hit.front.normalize().distance(Vec3::new(x, 0.0, height) / 0.1) < 2e-3,
                    "{shape:?} {x}"
                );
            }
        }
    }
}

#[test]
fn round_strands_are_open_at_their_ends_and_cones_are_not() {
    for (shape, is_closed) in [(StrandShape::Round, false), (StrandShape::Linear, true)] {
        let bvh = SceneBvh::new(&placed(straight(shape), Affine3A::IDENTITY)).unwrap();
        let hit = intersect(&bvh, &Ray::new(Vec3::new(0.02, 3.0, 0.03), Vec3::NEG_Y));
        assert_eq!(hit.is_some(), is_closed, "{shape:?}");
    }
}

#[test]
fn radii_scale_with_the_object() {
    let place = Affine3A::from_scale_rotation_translation(
        Vec3::new(3.0, 1.0, 2.0),
        Quat::from_rotation_z(0.4),
        Vec3::new(5.0, -2.0, 1.0),
    );
    for shape in SHAPES {
        let bvh = SceneBvh::new(&placed(straight(shape), place)).unwrap();
        let side = place.transform_vector3(Vec3::X);
        for share in [0.0, 0.9, 1.1] {
            let target = place.translation + glam::Vec3A::from(side * (0.1 * share));
            let hit = intersect(&bvh, &Ray::new(Vec3::from(target) + Vec3::Z * 4.0, Vec3::NEG_Z));
            assert_eq!(hit.is_some(), share < 1.0, "{shape:?} {share}");
        }
    }
}

#[test]
fn rays_that_leave_a_strand_do_not_meet_it_again() {
    for shape in SHAPES {
        let bvh =
            SceneBvh::new(&placed(tuft(shape, 40, 5), Affine3A::from_scale(Vec3::splat(0.01)))).unwrap();
        let mut random = Random(3);
        for _ in 0..2000 {
            let mut ray = ray(&mut random);
            ray.origin *= 0.01;
            let Some(hit) = intersect(&bvh, &ray) else { continue };
            let (normal, out) = (hit.front.normalize(), random.direction());
            let direction = if out.dot(normal) < 0.0 { -out } else { out };
            let from = Some((hit.instance, hit.primitive));
            let position = ray.origin + ray.direction * hit.distance;
            let next = intersect(&bvh, &Ray { from, ..Ray::new(position, direction) });
            // The radius is 0.0002 to 0.0005.
            assert!(
                next.is_none_or(|next| next.distance > 1e-4 || next.primitive != hit.primitive),
                "{shape:?}"
            );
        }
    }
}

#[test]
fn points_are_spheres_that_are_seen_from_outside() {
    let mut random = Random(11);
    let positions: Vec<Vec3> = (0..500).map(|_| random.point(1.0)).collect();
    let radii: Vec<f32> = (0..500).map(|_| 0.05 * random.next()).collect();
    let points = Points { positions, radii, ..Points::default() };
    let scene = Scene {
        instances: vec![Instance::new("dust", Geometry::Points(0), Affine3A::IDENTITY, vec![])],
        points: vec![points.clone()],
        ..Scene::default()
    };
    let bvh = SceneBvh::new(&scene).unwrap();
    for number in 0..3000 {
        let mut ray = ray(&mut random);
        if number % 3 == 0 {
            ray.origin = random.point(1.0);
        }
        let enter = |(center, radius): (&Vec3, &f32)| {
            let to_center = center.as_dvec3() - ray.origin.as_dvec3();
            let along = to_center.dot(ray.direction.as_dvec3());
            let inside = f64::from(radius * radius) - (to_center.length_squared() - along * along);
            (inside > 0.0).then(|| along - inside.sqrt()).filter(|t| *t > 0.0)
        };
        let nearest =
            points.positions.iter().zip(&points.radii).filter_map(enter).fold(f64::INFINITY, f64::min);
        match intersect(&bvh, &ray) {
            Some(hit) => {
                assert!((f64::from(hit.distance) - nearest).abs() < 1e-3, "{ray:?} {nearest}");
                let center = points.positions[hit.primitive as usize];
                let out = (ray.origin + ray.direction * hit.distance - center).normalize();
                assert!(hit.front.normalize().distance(out) < 1e-3);
                let again =
                    Ray { from: Some((0, hit.primitive)), ..Ray::new(center + out * 0.049, ray.direction) };
                assert!(intersect(&bvh, &again).is_none_or(|next| next.primitive != hit.primitive));
            }
            None => assert!(nearest.is_infinite(), "{ray:?} {nearest}"),
        }
    }
}
