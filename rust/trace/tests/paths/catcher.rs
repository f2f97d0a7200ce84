//! Shadow catchers: what each plate of their film shows.

use relume_scene::{
    Scene,
    glam::{Affine3A, Quat, Vec3},
};
use relume_trace::TraceSettings;

use crate::support::*;

/// A grey floor seen from above, under a white world, and half a metre above one half of it a lid that the camera does not see.
fn covered_floor() -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, square(0.0), Affine3A::from_scale(Vec3::splat(50.0)), diffuse(0.5));
    let lid = Affine3A::from_scale_rotation_translation(
        Vec3::splat(50.0),
        Quat::IDENTITY,
        Vec3::new(50.0, 0.0, 0.5),
    );
    add(&mut scene, square(0.0), lid, diffuse(0.0));
    scene.instances[0].is_shadow_catcher = true;
    scene.instances[1].visible_camera = false;
    scene.camera = look_at_origin(Vec3::Z * 3.0, 4, 0.01);
    scene.world.color = [1.0; 3];
    scene
}

/// Means over the picture of each plate: alpha, light of the world, emission.
fn plates(scene: &Scene, film_transparent: bool) -> Vec<[f32; 3]> {
    let mut settings = TraceSettings { samples: 256, ..TraceSettings::default() };
    settings.paths.film_transparent = film_transparent;
    let tracer = relume_trace::Tracer::new(scene, &settings).unwrap();
    let (size, rows) = (scene.camera.width, tracer.manifest().height);
    let plate = |first: usize| {
        let pixels = (first..first + size).flat_map(|y| (0..size).map(move |x| (x, y)));
        let paths: Vec<_> = pixels.map(|(x, y)| pixel_paths(&tracer, x, y, 0..settings.samples)).collect();
        let of = |value: fn(&Path) -> Vec3| mean(&paths, value).x;
        [of(|path| Vec3::splat(path.aovs.alpha)), of(|path| path.aovs.world), of(|path| path.aovs.emission)]
    };
    (0..rows).step_by(size).map(plate).collect()
}

fn assert_plates(found: &[[f32; 3]], expected: &[[f32; 3]]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 0.01, "{found} {expected}");
    }
}

#[test]
fn a_catcher_is_lit_with_and_without_what_casts_shadows() {
    let scene = covered_floor();
    // Below the edge of the lid half of the sky is hidden.
    let expected = [[0.0, 0.0, 0.0], [1.0, 0.25, 0.0], [1.0, 0.5, 0.0]];
    assert_plates(&plates(&scene, true), &expected);
    // Behind an opaque film the world is seen.
    assert_plates(&plates(&scene, false), &[&expected[..], &[[1.0, 1.0, 0.0]]].concat());
}

#[test]
fn what_stands_before_a_catcher_is_on_the_matte_alone() {
    let mut scene = covered_floor();
    (scene.instances[1].visible_camera, scene.world.color) = (true, [0.0; 3]);
    scene.materials[1] = material(relume_scene::Node::Emission {
        color: relume_scene::Input::Rgb([1.0; 3]),
        strength: relume_scene::Input::Float(1.0),
    });
    // The lid covers the right half of the picture and shines on the left one, which does not see it in its Clear plate.
    let [matte, shadowed, clear] = plates(&scene, true)[..] else { panic!("three plates") };
    assert!((matte[0] - 0.5).abs() < 0.01 && (matte[2] - 0.5).abs() < 0.01, "{matte:?}");
    assert!(shadowed[0] == 1.0 && (shadowed[2] - 0.125).abs() < 0.01, "{shadowed:?}");
    assert!((clear[0] - 0.5).abs() < 0.01 && clear[2] == 0.0, "{clear:?}");
}

#[test]
fn where_nothing_casts_a_shadow_both_plates_are_the_same_path_by_path() {
    let mut scene = covered_floor();
    scene.instances[1].world_from_object.translation.z = -1.0;
    let settings = TraceSettings { samples: 64, ..TraceSettings::default() };
    let tracer = relume_trace::Tracer::new(&scene, &settings).unwrap();
    let rows = scene.camera.height;
    let paths = |plate: usize| pixel_paths(&tracer, 1, 2 + plate * rows, 0..64);
    assert_eq!(paths(1), paths(2));
    assert!(paths(1).iter().any(|path| path.segments.iter().any(|segment| segment.throughput != Vec3::ZERO)));
}

#[test]
fn holdouts_and_what_mirrors_show_are_no_catchers() {
    let mut scene = covered_floor();
    scene.instances[0].is_holdout = true;
    assert_plates(&plates(&scene, false), &[[0.0, 0.0, 0.0]]);
    let mut scene = covered_floor();
    scene.instances[0].is_shadow_catcher = false;
    let whole = plates(&scene, false);
    (scene.instances[1].is_shadow_catcher, scene.instances[1].visible_camera) = (true, false);
    assert_eq!(plates(&scene, false)[0], whole[0]);
}
