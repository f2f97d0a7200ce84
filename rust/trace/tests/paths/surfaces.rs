//! Transparency, mirrors and what they do to alpha and the AOVs.

use relume_dump::{End, Lobe};
use relume_scene::{
    Distribution, Input, Instance, Material, Node, Scene,
    glam::{Affine3A, Vec3},
};
use relume_trace::TraceSettings;

use crate::support::*;

fn transparent(color: f32) -> Material {
    material(Node::Transparent { color: Input::Rgb([color; 3]) })
}

/// Half diffuse, half transparent.
fn half_transparent() -> Material {
    let mut material = diffuse(0.8);
    material.nodes.push(Node::Transparent { color: Input::Rgb([1.0; 3]) });
    material.nodes.push(Node::MixShader { factor: Input::Float(0.5), a: Some(0), b: Some(1) });
    material.surface = Some(2);
    material
}

fn mirror(color: [f32; 3]) -> Material {
    material(Node::Glossy {
        color: Input::Rgb(color),
        roughness: Input::Float(0.0),
        anisotropy: Input::Float(0.0),
        rotation: Input::Float(0.0),
        normal: None,
        tangent: None,
        distribution: Distribution::Ggx,
    })
}

/// Squares above each other, seen from above.
fn stack(materials: Vec<Material>) -> Scene {
    let mut scene = Scene::default();
    for (index, material) in materials.into_iter().enumerate() {
        add(&mut scene, square(-0.1 * index as f32), Affine3A::IDENTITY, material);
    }
    scene.camera = look_at_origin(Vec3::Z * 3.0, 4, 0.1);
    scene
}

fn settings(samples: u32) -> TraceSettings {
    TraceSettings { samples, ..TraceSettings::default() }
}

fn transparent_film(samples: u32) -> TraceSettings {
    let mut settings = settings(samples);
    settings.paths.film_transparent = true;
    settings
}

#[test]
fn transparent_surfaces_keep_the_camera_ray_and_open_the_film() {
    let mut scene = stack(vec![half_transparent()]);
    scene.world.color = [1.0; 3];
    let covered = image_paths(&scene, &settings(1024));
    assert!(covered.iter().flatten().all(|path| path.aovs.alpha == 1.0), "the world covers the film");
    let world = mean(&covered, |path| path.aovs.world);
    assert_close(world, 0.5 + 0.5 * 0.8, 0.02, "world behind and reflected");
    let paths = image_paths(&scene, &transparent_film(1024));
    let alpha = mean(&paths, |path| Vec3::splat(path.aovs.alpha));
    assert_close(alpha, 0.5, 0.02, "alpha");
    let world = mean(&paths, |path| path.aovs.world);
    assert_close(world, 0.5 * 0.8, 0.02, "world reflected");
    for path in paths.iter().flatten().filter(|path| path.aovs.alpha == 0.0) {
        assert_eq!(path.segments.iter().map(|segment| segment.lobe).collect::<Vec<_>>(), [Lobe::Camera; 2]);
        assert!(matches!(path.segments[1].end, End::Escape(direction) if direction.z < -0.9));
    }
    // Reflected rays are rays of their own.
    for path in paths.iter().flatten() {
        let continuing: Vec<_> = path.segments.iter().map(|segment| segment.continues).collect();
        assert_eq!(continuing, [false, path.segments[1].lobe == Lobe::Camera]);
    }
}

#[test]
fn transparent_bounces_end_at_their_own_limit() {
    let scene = stack(vec![transparent(1.0); 12]);
    for (limit, more) in [(0, 0), (0, 1), (3, 0), (3, 1), (8, 0)] {
        let mut settings = settings(2);
        settings.paths.bounces.transparent = limit;
        settings.paths.bounces.more_transparent = more;
        let paths = image_paths(&scene, &settings);
        // Behind the last surface that it goes through, at least one, the path ends on the next one.
        let longest = (limit + more).max(1) as usize + 1;
        assert!(paths.iter().flatten().all(|path| path.segments.len() == longest), "limit {limit} + {more}");
    }
    let paths = image_paths(&scene, &transparent_film(1));
    assert!(paths.iter().flatten().all(|path| path.aovs.alpha == 1.0));
}

#[test]
fn lights_are_seen_through_fewer_transparent_surfaces_than_paths_may_go_through() {
    // A floor below clear panes above the camera, so that only reflected rays meet them.
    let mut scene = stack(vec![diffuse(0.8)]);
    for pane in 0..4 {
        add(
            &mut scene,
            square(0.0),
            Affine3A::from_translation(Vec3::Z * (4.0 + 0.01 * pane as f32)),
            transparent(1.0),
        );
    }
    for more in [0, 1] {
        let mut settings = settings(64);
        settings.paths.bounces.transparent = 2;
        settings.paths.bounces.more_transparent = more;
        let paths = image_paths(&scene, &settings);
        let longest = paths.iter().flatten().map(|path| path.segments.len()).max();
        assert_eq!(longest, Some(4), "camera, floor to pane, and behind two panes; {more} more");
    }
}

#[test]
fn segments_behind_unrecorded_ones_start_where_these_end() {
    // As above, and a mirror above the panes, behind which lights are seen again.
    const MIRROR: f32 = 5.0;
    let mut scene = stack(vec![diffuse(0.8)]);
    let mut put = |height: f32, material| {
        add(&mut scene, square(0.0), Affine3A::from_translation(Vec3::Z * height), material);
    };
    (0..4).for_each(|pane| put(4.0 + 0.01 * pane as f32, transparent(1.0)));
    put(MIRROR, mirror([1.0; 3]));
    let mut settings = settings(64);
    settings.paths.bounces.transparent = 2;
    settings.paths.bounces.more_transparent = 4;
    settings.paths.filter_glossy = 0.0;
    let paths = image_paths(&scene, &settings);
    let mut mirrored = 0;
    for segments in paths.iter().flatten().map(|path| &path.segments) {
        for pair in segments.windows(2).filter(|pair| pair[0].throughput == Vec3::ZERO) {
            let heights = [pair[0].end, pair[1].end].map(|end| match end {
                End::Vertex(vertex) => vertex.z,
                End::Escape(_) => f32::INFINITY,
            });
            let meets_pane = (heights[1] - 4.03).abs() < 1e-4 || heights[1].is_infinite();
            assert!((heights[0] - MIRROR).abs() < 1e-4 && meets_pane, "{heights:?}");
            assert!(!pair[0].continues && !pair[1].continues && pair[1].throughput.x > 0.0);
            mirrored += 1;
        }
    }
    assert!(mirrored > 5, "{mirrored} paths are seen again");
}

#[test]
fn a_world_hidden_from_the_camera_still_lights() {
    let mut scene = stack(vec![half_transparent()]);
    scene.world.color = [1.0; 3];
    scene.world.visible_camera = false;
    let world = mean(&image_paths(&scene, &settings(1024)), |path| path.aovs.world);
    assert_close(world, 0.5 * 0.8, 0.02, "reflected world alone");
}

#[test]
fn features_look_into_mirrors_with_their_tint() {
    let mut scene = stack(vec![mirror([0.5, 1.0, 0.25])]);
    // A ceiling above the camera, which the mirror shows.
    add(&mut scene, square(0.0), Affine3A::from_translation(Vec3::Z * 5.0), diffuse(0.8));
    let paths = image_paths(&scene, &settings(16));
    for path in paths.iter().flatten() {
        assert!((path.aovs.albedo - Vec3::new(0.4, 0.8, 0.2)).length() < 0.02, "{}", path.aovs.albedo);
        assert!((path.aovs.normal - Vec3::NEG_Z).length() < 1e-3, "{}", path.aovs.normal);
        assert!((path.aovs.depth.unwrap() - 3.0).abs() < 0.02, "depth of the mirror itself");
        assert_eq!(path.segments[1].lobe, Lobe::Glossy);
    }
}

#[test]
fn segments_name_the_object_that_they_scattered_at() {
    let mut scene = stack(vec![diffuse(0.5)]);
    add(&mut scene, square(0.0), Affine3A::from_translation(Vec3::Z * 0.5), transparent(1.0));
    scene.instances[0].receiver = 7;
    scene.instances[1].receiver = 9;
    for path in image_paths(&scene, &settings(4)).iter().flatten() {
        let receivers: Vec<u16> = path.segments.iter().map(|segment| segment.receiver).collect();
        // From the camera, on through the pane, off the floor, and perhaps on through the pane again.
        assert_eq!(receivers[..3], [0, 0, 7]);
        assert!(receivers[3..].iter().all(|receiver| *receiver == 7));
    }
}

/// Number of glossy segments in a picture of so many samples, with or without reflective caustics.
fn glossy_segments(scene: &Scene, samples: u32, caustics: bool) -> usize {
    let mut settings = settings(samples);
    settings.paths.caustics_reflective = caustics;
    let paths = image_paths(scene, &settings);
    let segments = paths.iter().flatten().flat_map(|path| &path.segments);
    segments.filter(|segment| segment.lobe.ray_kind() == Lobe::Glossy).count()
}

#[test]
fn caustics_can_be_switched_off() {
    // A diffuse floor below a mirror: diffuse rays may not see the mirror's reflection.
    let mut scene = stack(vec![diffuse(0.5)]);
    add(&mut scene, square(0.0), Affine3A::from_translation(Vec3::Z * 4.0), mirror([1.0; 3]));
    assert!(glossy_segments(&scene, 256, true) > 50);
    assert_eq!(glossy_segments(&scene, 256, false), 0);
}

#[test]
fn what_comes_through_a_translucent_surface_is_diffuse_for_caustics() {
    // A curtain above a mirror that faces it.
    let curtain = material(Node::Translucent { color: Input::Rgb([0.8; 3]), normal: None });
    let mut scene = stack(vec![curtain]);
    add(&mut scene, square(0.0), Affine3A::from_translation(Vec3::Z * -0.5), mirror([1.0; 3]));
    assert!(glossy_segments(&scene, 64, true) > 50);
    assert_eq!(glossy_segments(&scene, 64, false), 0);
}

#[test]
fn instances_give_the_paths_of_copied_meshes() {
    let places = [Affine3A::from_translation(Vec3::X), Affine3A::from_scale(Vec3::new(0.5, -1.0, 0.7))];
    let mut shared = Scene::default();
    shared.world.color = [1.0; 3];
    shared.materials.push(diffuse(0.7));
    shared.camera = look_at_origin(Vec3::new(2.0, -3.0, 2.0), 8, 1.0);
    let mut copied = shared.clone();
    shared.meshes.push(sphere());
    for place in places {
        shared.instances.push(Instance::new("shared", 0, place, vec![0]));
        copied.instances.push(Instance::new("copied", copied.meshes.len(), place, vec![0]));
        copied.meshes.push(sphere());
    }
    let [a, b] = [&shared, &copied].map(|scene| image_paths(scene, &settings(64)));
    let same =
        a.iter().flatten().zip(b.iter().flatten()).filter(|(a, b)| a.segments.len() == b.segments.len());
    assert!(same.count() > 64 * 64 * 99 / 100, "more than rounding differs");
    let [a, b] = [&a, &b].map(|paths| mean(paths, |path| path.aovs.world).x);
    assert!((a - b).abs() < 0.005, "{a} {b}");
}

/// A square that is shaded like a dome, seen from above.
fn dome() -> Scene {
    let mut scene = stack(vec![diffuse(1.0)]);
    let mesh = &mut scene.meshes[0];
    let normal = |vertex: &u32| (mesh.positions[*vertex as usize] + Vec3::Z).normalize();
    mesh.corner_normals = mesh.triangles.iter().flatten().map(normal).collect();
    scene.camera = look_at_origin(Vec3::Z * 3.0, 4, 0.6);
    scene
}

#[test]
fn smooth_shading_sees_lights_beyond_the_true_horizon_and_no_path_goes_on_there() {
    let mut dipping = 0;
    for path in image_paths(&dome(), &settings(256)).iter().flatten() {
        let Some(second) = path.segments.get(1) else { continue };
        if let End::Escape(direction) = second.end {
            dipping += u32::from(direction.z < 0.0);
        }
        assert!(path.segments.len() == 2, "{path:?}");
    }
    assert!(dipping > 100, "{dipping}");
}
