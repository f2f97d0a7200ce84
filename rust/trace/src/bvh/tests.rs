use glam::{Affine3A, Quat, Vec3};
use relume_scene::{Instance, Mesh, Scene};

use super::*;

/// A small generator (PCG), so that tests need no crate for it.
pub(super) struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let mixed = ((self.0 >> 18) ^ self.0) >> 27;
        (mixed as u32).rotate_right((self.0 >> 59) as u32) as f32 / u32::MAX as f32
    }

    pub fn point(&mut self, scale: f32) -> Vec3 {
        Vec3::new(self.next() - 0.5, self.next() - 0.5, self.next() - 0.5) * 2.0 * scale
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let point = self.point(1.0);
            if (0.01..=1.0).contains(&point.length_squared()) {
                return point.normalize();
            }
        }
    }
}

fn soup(count: usize, size: f32, extent: f32, seed: u64) -> Mesh {
    let mut random = Random(seed);
    let mut mesh = Mesh { name: "soup".into(), ..Mesh::default() };
    for index in 0..count as u32 {
        let center = random.point(extent);
        mesh.positions.extend([(); 3].map(|()| center + random.point(size)));
        mesh.triangles.push([3 * index, 3 * index + 1, 3 * index + 2]);
    }
    mesh
}

fn scene_of(parts: Vec<(Mesh, Vec<Affine3A>)>) -> Scene {
    let mut scene = Scene::default();
    for (mesh, places) in parts {
        for place in places {
            scene.instances.push(Instance::new(mesh.name.clone(), scene.meshes.len(), place, vec![]));
        }
        scene.meshes.push(mesh);
    }
    scene
}

/// Nearest hit in double precision, with all triangles grown by `slack` of their size.
fn brute_force(scene: &Scene, ray: &Ray, slack: f64) -> f64 {
    let mut nearest = f64::from(ray.t_max);
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    for (index, instance) in scene.instances.iter().enumerate() {
        let Some(mesh) = scene.mesh(instance.geometry) else { continue };
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            if ray.from == Some((index as u32, number as u32)) {
                continue;
            }
            let [a, b, c] = triangle
                .map(|v| instance.world_from_object.transform_point3(mesh.positions[v as usize]).as_dvec3());
            let (edge_1, edge_2) = (b - a, c - a);
            let p = direction.cross(edge_2);
            let determinant = edge_1.dot(p);
            if determinant == 0.0 {
                continue;
            }
            let q = (origin - a).cross(edge_1);
            let u = (origin - a).dot(p) / determinant;
            let v = direction.dot(q) / determinant;
            let t = edge_2.dot(q) / determinant;
            if u >= -slack && v >= -slack && u + v <= 1.0 + slack && t > f64::from(ray.t_min) {
                nearest = nearest.min(t);
            }
        }
    }
    nearest
}

/// Both kernels agree with brute force for random rays, except where a ray passes within rounding of an edge.
fn check(scene: &Scene, rays: usize, extent: f32, tolerance: f64) {
    let fast = SceneBvh::new(scene).unwrap();
    let portable = SceneBvh { use_avx2: false, ..fast.clone() };
    let mut random = Random(99);
    let mut hits = 0;
    for number in 0..rays {
        let mut ray = Ray::new(random.point(extent), random.direction());
        if number % 7 == 0 {
            // Axis-aligned rays divide by zero.
            ray.direction = [Vec3::X, Vec3::NEG_Y, Vec3::Z][number % 3];
        }
        let (inner, outer) = (brute_force(scene, &ray, -1e-4), brute_force(scene, &ray, 1e-4));
        for (name, bvh) in [("avx2", &fast), ("scalar", &portable)] {
            let t = bvh.intersect(&ray).map_or(f64::INFINITY, |hit| f64::from(hit.distance));
            let slack = tolerance * (1.0 + outer.min(1e30));
            assert!(
                t >= outer - slack && (t <= inner + slack || t == inner),
                "{name}: ray {number} {ray:?} hits at {t}, brute force says {outer}..{inner}"
            );
            assert_eq!(bvh.is_blocked(&ray), t.is_finite());
            hits += usize::from(t.is_finite());
        }
    }
    assert!(hits > rays / 40, "the test scene is hardly ever hit: {hits}");
}

#[test]
fn soups_of_any_size_match_brute_force() {
    for (count, size) in [(1, 1.0), (2, 1.0), (7, 1.0), (9, 0.8), (60, 0.5), (1000, 0.15)] {
        check(
            &scene_of(vec![(soup(count, size, 1.0, count as u64), vec![Affine3A::IDENTITY])]),
            2000,
            1.5,
            1e-5,
        );
    }
}

#[test]
fn long_thin_triangles_match_brute_force() {
    let mut mesh = soup(300, 1.0, 1.0, 5);
    for positions in mesh.positions.chunks_mut(3) {
        positions[2] = positions[1] + (positions[2] - positions[1]) * 0.01;
    }
    check(&scene_of(vec![(mesh, vec![Affine3A::IDENTITY])]), 1500, 1.5, 1e-4);
}

#[test]
fn huge_coordinates_match_brute_force() {
    let mut mesh = soup(200, 3e5, 1e6, 5);
    mesh.positions.iter_mut().for_each(|position| *position += Vec3::new(3e6, -2e6, 1e6));
    let scene = scene_of(vec![(mesh, vec![Affine3A::IDENTITY])]);
    let bvh = SceneBvh::new(&scene).unwrap();
    let mut random = Random(3);
    for _ in 0..500 {
        let ray = Ray::new(Vec3::new(3e6, -2e6, 1e6) + random.point(1e6), random.direction());
        let (inner, outer) = (brute_force(&scene, &ray, -1e-4), brute_force(&scene, &ray, 1e-4));
        let t = bvh.intersect(&ray).map_or(f64::INFINITY, |hit| f64::from(hit.distance));
        assert!(t >= outer - 10.0 && t <= inner + 10.0, "{t} not in {outer}..{inner}");
    }
}

#[test]
fn instances_match_brute_force_also_mirrored_and_nested_in_each_other() {
    let places = [
        Affine3A::IDENTITY,
        Affine3A::from_scale_rotation_translation(
            Vec3::new(-0.5, 2.0, 1.0),
            Quat::from_rotation_y(0.7),
            Vec3::new(1.0, 0.2, 0.3),
        ),
        Affine3A::from_scale_rotation_translation(
            Vec3::splat(1e-2),
            Quat::from_rotation_x(2.0),
            Vec3::new(-1.0, 0.5, 0.0),
        ),
    ];
    let shared = soup(build::SHARED_MESH_TRIANGLES * 2, 0.4, 1.0, 8);
    let scene = scene_of(vec![(shared, places.to_vec()), (soup(50, 0.4, 1.0, 9), vec![places[1]])]);
    assert_eq!(SceneBvh::new(&scene).unwrap().tree.placements.len(), 3);
    check(&scene, 2000, 2.0, 1e-4);
}

#[test]
fn instances_beside_split_triangles_match_brute_force() {
    let mut mesh = soup(60, 0.2, 1.5, 3);
    // Long, thin and diagonal: its box is split.
    mesh.positions.extend([Vec3::splat(-2.0), Vec3::splat(2.0), Vec3::new(2.0, 2.0, 1.9)]);
    mesh.triangles.push([180, 181, 182]);
    let place = |x: i32| Affine3A::from_translation(Vec3::new(x as f32 - 2.0, 0.5, -0.3 * x as f32));
    let shared = soup(2 * build::SHARED_MESH_TRIANGLES, 0.2, 0.5, 4);
    let scene = scene_of(vec![(mesh, vec![Affine3A::IDENTITY]), (shared, (0..5).map(place).collect())]);
    check(&scene, 3000, 2.5, 1e-4);
}

#[test]
fn instancing_finds_the_same_triangles_as_copies() {
    let mesh = soup(200, 0.4, 1.0, 8);
    let places = [Affine3A::from_translation(Vec3::X), Affine3A::from_scale(Vec3::new(1.0, -1.0, 2.0))];
    let shared_scene = scene_of(vec![(mesh.clone(), places.to_vec())]);
    let shared = SceneBvh::new(&shared_scene).unwrap();
    let copies =
        SceneBvh::new(&scene_of(vec![(mesh.clone(), vec![places[0]]), (mesh, vec![places[1]])])).unwrap();
    assert_eq!((shared.tree.placements.len(), copies.tree.placements.len()), (2, 0));
    let mut random = Random(4);
    let mut differing = 0;
    for _ in 0..5000 {
        let ray = Ray::new(random.point(2.0), random.direction());
        let [a, b] =
            [&shared, &copies].map(|bvh| bvh.intersect(&ray).map(|hit| (hit.instance, hit.primitive)));
        differing += usize::from(a != b);
        if let (Some(a), true) = (shared.intersect(&ray), a == b) {
            // Fronts follow the object also where it is mirrored, however it is stored.
            let listed = Hit::on(&shared_scene, [a.instance, a.primitive], a.barycentrics, a.distance);
            let b = copies.intersect(&ray).unwrap();
            for front in [a.front, b.front] {
                assert!(front.normalize().dot(listed.front.normalize()) > 0.999, "{front} {}", listed.front);
            }
        }
        if let Some(from) = a {
            // Leaving a placed triangle never meets it again.
            let again = shared.intersect(&Ray { from: Some(from), ..ray });
            assert_ne!(again.map(|hit| (hit.instance, hit.primitive)), Some(from));
        }
    }
    assert!(differing <= 3, "{differing} of 5000 rays differ by more than rounding at edges explains");
}

/// A sphere of `4^levels * 8` triangles around the origin.
fn sphere(levels: usize) -> Mesh {
    let mut triangles: Vec<[Vec3; 3]> = Vec::new();
    for x in [Vec3::X, Vec3::NEG_X] {
        for y in [Vec3::Y, Vec3::NEG_Y] {
            for z in [Vec3::Z, Vec3::NEG_Z] {
                triangles.push([x, y, z]);
            }
        }
    }
    for _ in 0..levels {
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [a + b, b + c, c + a].map(Vec3::normalize);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let positions = triangles.iter().flatten().copied().collect();
    let triangles = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Mesh { name: "sphere".into(), positions, triangles, ..Mesh::default() }
}

#[test]
fn closed_meshes_do_not_leak_not_even_at_vertices_and_edges() {
    let mesh = sphere(5);
    let place = Affine3A::from_scale_rotation_translation(
        Vec3::splat(3.7),
        Quat::from_rotation_z(0.3) * Quat::from_rotation_x(1.1),
        Vec3::new(1.3, -20.0, 5.0),
    );
    let scene = scene_of(vec![(mesh.clone(), vec![place])]);
    let mut random = Random(7);
    let fast = SceneBvh::new(&scene).unwrap();
    let portable = SceneBvh { use_avx2: false, ..fast.clone() };
    for bvh in [fast, portable] {
        for corners in mesh.positions.chunks(3) {
            let origin = place.transform_point3(random.point(0.5));
            for target in [corners[0], (corners[0] + corners[1]) * 0.5, corners[1] * 0.3 + corners[2] * 0.7] {
                let direction = (place.transform_point3(target) - origin).normalize();
                assert!(bvh.intersect(&Ray::new(origin, direction)).is_some(), "a ray to {target} leaks");
            }
        }
        for _ in 0..50_000 {
            let origin = place.transform_point3(random.point(0.5));
            assert!(bvh.intersect(&Ray::new(origin, random.direction())).is_some());
        }
    }
}

#[test]
fn nothing_is_hit_in_empty_and_degenerate_scenes() {
    let ray = Ray::new(Vec3::ZERO, Vec3::Z);
    assert!(SceneBvh::new(&Scene::default()).unwrap().intersect(&ray).is_none());
    let mut flat = soup(3, 1.0, 1.0, 1);
    flat.positions.fill(Vec3::Z);
    let mut broken = soup(200, 1.0, 1.0, 2);
    broken.positions.fill(Vec3::NAN);
    let collapsed = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
    let line = soup(100, 1.0, 1.0, 2);
    let scene = scene_of(vec![
        (flat, vec![Affine3A::IDENTITY]),
        (broken, vec![Affine3A::IDENTITY, collapsed]),
        (line, vec![Affine3A::from_scale(Vec3::X), Affine3A::from_scale(Vec3::ZERO)]),
    ]);
    assert!(SceneBvh::new(&scene).unwrap().intersect(&ray).is_none());
}

#[test]
fn many_equal_triangles_do_not_break_the_tree() {
    let mut mesh = soup(1, 1.0, 1.0, 3);
    mesh.triangles = vec![mesh.triangles[0]; 3000];
    let scene = scene_of(vec![(mesh, vec![Affine3A::IDENTITY])]);
    check(&scene, 300, 1.0, 1e-5);
}

#[test]
fn hidden_instances_are_seen_by_other_rays_only() {
    for shared in [1, build::SHARED_MESH_TRIANGLES] {
        let mut scene = scene_of(vec![(
            Mesh {
                positions: vec![
                    Vec3::new(-1.0, -1.0, 0.0),
                    Vec3::new(3.0, -1.0, 0.0),
                    Vec3::new(-1.0, 3.0, 0.0),
                ],
                triangles: vec![[0, 1, 2]; shared],
                ..Mesh::default()
            },
            vec![Affine3A::from_translation(Vec3::Z), Affine3A::from_translation(Vec3::Z * 2.0)],
        )]);
        scene.instances[0].visible_glossy = false;
        let bvh = SceneBvh::new(&scene).unwrap();
        let first = |kind| bvh.intersect(&Ray { kind, ..Ray::new(Vec3::ZERO, Vec3::Z) }).unwrap().instance;
        let all = [
            RayKind::Camera,
            RayKind::Diffuse,
            RayKind::Glossy,
            RayKind::Transmission,
            RayKind::Volume,
            RayKind::Shadow,
        ]
        .map(first);
        assert_eq!(all, [0, 0, 1, 0, 0, 0]);
        // What a medium scattered counts as diffuse, too.
        for (visible_diffuse, visible_volume_scatter, seen) in
            [(false, true, 0), (true, false, 0), (false, false, 1)]
        {
            let instance = &mut scene.instances[0];
            (instance.visible_diffuse, instance.visible_volume_scatter) =
                (visible_diffuse, visible_volume_scatter);
            let ray = Ray { kind: RayKind::Volume, ..Ray::new(Vec3::ZERO, Vec3::Z) };
            assert_eq!(SceneBvh::new(&scene).unwrap().intersect(&ray).unwrap().instance, seen);
        }
    }
}

#[test]
fn rays_within_a_body_meet_that_body_alone() {
    let places = vec![
        Affine3A::IDENTITY,
        Affine3A::from_scale_rotation_translation(
            Vec3::new(-1.0, 2.0, 0.5),
            Quat::from_rotation_x(0.7),
            Vec3::X * 0.3,
        ),
    ];
    let mut scene = scene_of(vec![(soup(50, 0.6, 1.0, 8), places), (soup(40, 0.8, 1.0, 9), vec![])]);
    scene.instances.push(Instance::new("alone", 1, Affine3A::IDENTITY, vec![0]));
    let skin = r#"{"name": "skin", "surface": 0, "nodes": [{"type": "subsurface_scattering", "color": 0.5,
        "roughness": 1, "normal": null, "subsurface": {"radius": 1, "scale": 1, "ior": 1.4, "anisotropy": 0,
        "model": {"method": "walk", "inversion": "polynomial", "radius_factor": 1, "anisotropy_limits": [0, 0.9],
        "least_footprint": 0, "is_first_only": false}}}]}"#;
    scene.materials = vec![serde_json::from_str(skin).unwrap()];
    for instance in &mut scene.instances {
        (instance.materials, instance.visible_diffuse) = (vec![0], false);
    }
    let bvh = SceneBvh::new(&scene).unwrap();
    let mut random = Random(4);
    let mut hits = 0;
    for number in 0..3000 {
        let instance = number % 3;
        let alone = Scene {
            instances: vec![scene.instances[instance].clone()],
            meshes: scene.meshes.clone(),
            ..Scene::default()
        };
        let ray = Ray { kind: RayKind::Diffuse, ..Ray::new(random.point(1.2), random.direction()) };
        let (inner, outer) = (brute_force(&alone, &ray, -1e-4), brute_force(&alone, &ray, 1e-4));
        let hit = bvh.intersect_within(&ray, instance as u32);
        let t = hit.map_or(f64::INFINITY, |hit| f64::from(hit.distance));
        let slack = 1e-4 * (1.0 + outer.min(1e30));
        assert!(t >= outer - slack && (t <= inner + slack || t == inner), "{t}, not {outer}..{inner}");
        if let Some(hit) = hit {
            hits += 1;
            assert_eq!(hit.instance, instance as u32);
            let from = Some((hit.instance, hit.primitive));
            let again = bvh.intersect_within(&Ray { from, ..ray }, instance as u32);
            assert_ne!(again.map(|hit| hit.primitive), Some(hit.primitive));
        }
    }
    assert!(hits > 500, "{hits}");
}
