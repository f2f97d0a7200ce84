use glam::{Affine3A, Quat, Vec3, Vec4};
use relume_scene::{Curves, Geometry, Instance, Mesh, Points, Pose, STILL, Scene, StrandShape};

use super::{tests::Random, *};

const SHAPES: [StrandShape; 3] =
    [StrandShape::Round, StrandShape::Linear, StrandShape::Ribbon { subdivisions: 2 }];

/// Places of values at five keys, the given ones in the middle.
fn wandering<T: Copy>(middle: &[T], mut step: impl FnMut(T, f32) -> T) -> Vec<T> {
    (0..5)
        .flat_map(|key| middle.iter().map(|value| step(*value, key as f32 - 2.0)).collect::<Vec<_>>())
        .collect()
}

fn spinning(random: &mut Random, keys: usize) -> Vec<Pose> {
    let axis = random.direction();
    let way = random.point(0.5);
    let transforms: Vec<Affine3A> = (0..keys)
        .map(|key| {
            let along = key as f32 / (keys - 1) as f32 - 0.5;
            let scale = Vec3::new(1.0 + 0.4 * along, 1.0, 0.8 - 0.6 * along);
            Affine3A::from_scale_rotation_translation(
                scale,
                Quat::from_axis_angle(axis, 2.4 * along),
                way * along,
            )
        })
        .collect();
    Pose::keys(&transforms)
}

/// Triangles, strands and spheres; of each one turns, one changes its shape, one does both.
fn scene(shape: StrandShape) -> Scene {
    let mut random = Random(5);
    let mut mesh = Mesh { name: "soup".into(), ..Mesh::default() };
    for index in 0..40 {
        let center = random.point(0.7);
        mesh.positions.extend([(); 3].map(|()| center + random.point(0.3)));
        mesh.triangles.push([3 * index, 3 * index + 1, 3 * index + 2]);
    }
    let bent = |point: Vec3, by: f32| point + 0.15 * by * Vec3::new(point.y, -point.z, point.x);
    let moving_mesh = Mesh { motion: wandering(&mesh.positions, bent), ..mesh.clone() };
    let keys: Vec<Vec4> = (0..60).map(|_| random.point(0.8).extend(0.02 + 0.03 * random.next())).collect();
    let swayed = |key: Vec4, by: f32| bent(key.truncate(), by).extend(key.w * (1.0 + 0.2 * by));
    let curves = Curves {
        shape,
        keys: keys.iter().map(|key| key.truncate()).collect(),
        radii: keys.iter().map(|key| key.w).collect(),
        first_keys: (0..=20).map(|curve| 3 * curve).collect(),
        ..Curves::default()
    };
    let moving_curves = Curves { motion: wandering(&keys, swayed), ..curves.clone() };
    let points = Points { positions: curves.keys.clone(), radii: curves.radii.clone(), ..Points::default() };
    let moving_points = Points { motion: wandering(&keys, swayed), ..points.clone() };
    let mut scene = Scene {
        meshes: vec![mesh, moving_mesh],
        curves: vec![curves, moving_curves],
        points: vec![points, moving_points],
        ..Scene::default()
    };
    for geometry in [Geometry::Mesh, Geometry::Curves, Geometry::Points] {
        for (number, keys) in [(0, 3), (1, 0), (1, 9)] {
            let motion = if keys == 0 { Vec::new() } else { spinning(&mut random, keys) };
            let still = Affine3A::from_translation(random.point(0.5));
            let world_from_object = if keys == 0 { still } else { Pose::at(&motion, STILL) };
            let placed = Instance::new("a", geometry(number), world_from_object, vec![]);
            scene.instances.push(Instance { motion, ..placed });
        }
    }
    scene
}

/// The scene as it is at a time, without motion.
fn frozen(scene: &Scene, time: f32) -> Scene {
    let mut still = scene.clone();
    for (mesh, moving) in still.meshes.iter_mut().zip(&scene.meshes) {
        for (number, triangle) in moving.triangles.iter().enumerate() {
            for (vertex, place) in triangle.iter().zip(moving.corners_at(number, time)) {
                mesh.positions[*vertex as usize] = place;
            }
        }
        mesh.motion.clear();
    }
    for (curves, moving) in still.curves.iter_mut().zip(&scene.curves) {
        let keys: Vec<Vec4> = (0..moving.keys.len()).map(|key| moving.key_at(key, time)).collect();
        curves.keys = keys.iter().map(|key| key.truncate()).collect();
        (curves.radii, curves.motion) = (keys.iter().map(|key| key.w).collect(), Vec::new());
    }
    for (points, moving) in still.points.iter_mut().zip(&scene.points) {
        let keys: Vec<Vec4> = (0..moving.radii.len()).map(|point| moving.sphere_at(point, time)).collect();
        points.positions = keys.iter().map(|key| key.truncate()).collect();
        (points.radii, points.motion) = (keys.iter().map(|key| key.w).collect(), Vec::new());
    }
    for instance in &mut still.instances {
        instance.world_from_object = instance.world_from_object_at(time);
        instance.motion.clear();
    }
    still
}

#[test]
fn rays_meet_at_each_time_what_a_scene_that_stands_still_there_has() {
    for shape in SHAPES {
        let moving = scene(shape);
        let bvh = SceneBvh::new(&moving).unwrap();
        let slow = SceneBvh { use_avx2: false, ..bvh.clone() };
        let mut random = Random(9);
        let mut met = [0; 9];
        for time in [0.0, 0.13, 0.25, 0.5, 0.61, 0.875, 1.0] {
            let still = SceneBvh::new(&frozen(&moving, time)).unwrap();
            for _ in 0..1500 {
                let origin = random.direction() * 4.0;
                let ray = Ray::new(origin, (random.point(0.9) - origin).normalize()).at(time);
                let (found, expected) = (bvh.intersect(&ray), still.intersect(&ray));
                let hit_of = |hit: Option<Hit>| hit.map(|hit| (hit.instance, hit.primitive));
                let distances = [found, expected].map(|hit| hit.map_or(f32::INFINITY, |hit| hit.distance));
                // Where objects coincide, and at edges, roundings decide.
                let is_tie = (distances[0] - distances[1]).abs() < 1e-5;
                let is_same = hit_of(found) == hit_of(expected) && (distances[0] - distances[1]).abs() < 1e-3;
                let mut is_edge = || {
                    (0..20).any(|_| {
                        let direction = (ray.direction + random.point(5e-4)).normalize();
                        hit_of(still.intersect(&Ray { direction, ..ray })) != hit_of(expected)
                    })
                };
                assert!(
                    is_same || is_tie || distances == [f32::INFINITY; 2] || is_edge(),
                    "{time} {found:?} {expected:?}"
                );
                assert_eq!(found.is_some(), bvh.is_blocked(&ray));
                assert_eq!(hit_of(found), hit_of(slow.intersect(&ray)));
                if let (Some(hit), Some(other)) = (found, expected)
                    && is_same
                {
                    met[hit.instance as usize] += 1;
                    let [a, b] = [hit.front, other.front].map(Vec3::normalize);
                    assert!(a.dot(b) > 0.99, "{time} {hit:?} {other:?}");
                }
            }
        }
        assert!(met.iter().all(|count| *count > 50), "{met:?}");
    }
}

#[test]
fn bodies_that_move_are_met_from_within() {
    let mut moving = scene(StrandShape::Round);
    moving.instances.truncate(3);
    let bvh = SceneBvh::new(&moving).unwrap();
    let mut random = Random(3);
    for time in [0.0, 0.3, 0.99, 1.0] {
        let still = frozen(&moving, time);
        for instance in 0..3 {
            let alone = Scene { instances: vec![still.instances[instance].clone()], ..still.clone() };
            let alone = SceneBvh::new(&alone).unwrap();
            for _ in 0..300 {
                let ray = Ray::new(random.point(1.0), random.direction()).at(time);
                let found = bvh.intersect_within(&ray, instance as u32).map(|hit| hit.primitive);
                assert_eq!(found, alone.intersect(&ray).map(|hit| hit.primitive), "{time} {instance}");
            }
        }
    }
}
