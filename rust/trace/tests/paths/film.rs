//! Alpha of the film: transparent glass and holdouts.

use relume_dump::{End, Lobe};
use relume_scene::{
    Distribution, Input, Material, Node, Scene,
    glam::{Affine3A, Vec3},
};
use relume_trace::TraceSettings;

use crate::support::*;

/// Glass of index 1, which neither bends nor reflects what meets it from above.
fn pane(roughness: f32) -> Material {
    material(Node::Refraction {
        color: Input::Rgb([0.5; 3]),
        roughness: Input::Float(roughness),
        ior: Input::Float(1.0),
        normal: None,
        distribution: Distribution::Ggx,
    })
}

/// A square seen from above, before a white world.
fn before_white(material: Material) -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, square(0.0), Affine3A::IDENTITY, material);
    scene.camera = look_at_origin(Vec3::Z * 3.0, 4, 0.1);
    scene.world.color = [1.0; 3];
    scene
}

fn settings(film_transparent: bool, film_glass: Option<f32>) -> TraceSettings {
    let mut settings = TraceSettings { samples: 64, ..TraceSettings::default() };
    (settings.paths.film_transparent, settings.paths.film_glass) = (film_transparent, film_glass);
    settings
}

/// Mean alpha and light of the world.
fn film(scene: &Scene, settings: &TraceSettings) -> [f32; 2] {
    let paths = image_paths(scene, settings);
    [mean(&paths, |path| Vec3::splat(path.aovs.alpha)), mean(&paths, |path| path.aovs.world)].map(|sum| sum.x)
}

#[test]
fn film_shows_through_glass_up_to_its_roughness() {
    for (roughness, film_transparent, film_glass, expected) in [
        (0.0, true, Some(0.1), [0.5, 0.0]),
        (0.1, true, Some(0.1), [0.5, 0.0]),
        (0.11, true, Some(0.1), [1.0, 0.5]),
        (0.0, true, None, [1.0, 0.5]),
        (0.0, false, Some(0.1), [1.0, 0.5]),
    ] {
        let found = film(&before_white(pane(roughness)), &settings(film_transparent, film_glass));
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-3, "{roughness} {film_glass:?}: {found} {expected}");
        }
    }
}

#[test]
fn behind_glass_of_the_film_segments_have_a_class_of_their_own() {
    let (scene, settings) = (before_white(pane(0.0)), settings(true, Some(0.1)));
    let manifest = relume_trace::manifest(&scene, &settings);
    for path in image_paths(&scene, &settings).iter().flatten() {
        let [camera, behind] = &path.segments[..] else { panic!("two segments") };
        assert!(camera.lobe == Lobe::Camera && camera.receiver < manifest.first_without_world());
        assert!(behind.lobe == Lobe::Transmission && matches!(behind.end, End::Escape(_)));
        assert!(behind.receiver >= manifest.first_without_world());
    }
}

/// Half of one shader and half of another.
fn half(first: Node, second: Node) -> Material {
    let mut mixed = material(first);
    mixed.nodes.push(second);
    mixed.nodes.push(Node::MixShader { factor: Input::Float(0.5), a: Some(0), b: Some(1) });
    mixed.surface = Some(2);
    mixed
}

fn glow() -> Node {
    Node::Emission { color: Input::Rgb([1.0; 3]), strength: Input::Float(1.0) }
}

#[test]
fn holdouts_cut_the_film_and_end_there() {
    let clear = || Node::Transparent { color: Input::Rgb([1.0; 3]) };
    for (name, material, is_holdout, [alpha, emission, world]) in [
        ("shader", material(Node::Holdout), false, [0.0, 0.0, 0.0]),
        ("half of a shader", half(Node::Holdout, glow()), false, [0.5, 0.5, 0.0]),
        ("object", material(glow()), true, [0.0, 0.0, 0.0]),
        ("half of an object", half(glow(), clear()), true, [0.5, 0.0, 0.5]),
    ] {
        let mut scene = before_white(material);
        scene.instances[0].is_holdout = is_holdout;
        let paths = image_paths(&scene, &TraceSettings { samples: 256, ..TraceSettings::default() });
        let found = [
            mean(&paths, |path| Vec3::splat(path.aovs.alpha)),
            mean(&paths, |path| path.aovs.emission),
            mean(&paths, |path| path.aovs.world),
        ];
        for (found, expected) in found.into_iter().zip([alpha, emission, world]) {
            assert!((found.x - expected).abs() < 1e-3, "{name}: {found} {expected}");
        }
    }
}

#[test]
fn a_mirror_shows_a_holdout_object_and_a_black_holdout_shader() {
    for (holdout, is_holdout, emission) in
        [(material(glow()), true, 1.0), (material(Node::Holdout), false, 0.0)]
    {
        let mirror = material(Node::Glossy {
            color: Input::Rgb([1.0; 3]),
            roughness: Input::Float(0.0),
            anisotropy: Input::Float(0.0),
            rotation: Input::Float(0.0),
            normal: None,
            tangent: None,
            distribution: Distribution::Ggx,
        });
        let mut scene = before_white(mirror);
        let above = Affine3A::from_scale_rotation_translation(
            Vec3::splat(50.0),
            relume_scene::glam::Quat::IDENTITY,
            Vec3::Z * 5.0,
        );
        add(&mut scene, square(0.0), above, holdout);
        scene.instances[1].is_holdout = is_holdout;
        let paths = image_paths(&scene, &TraceSettings { samples: 16, ..TraceSettings::default() });
        assert!(paths.iter().flatten().all(|path| path.aovs.alpha == 1.0));
        let found = mean(&paths, |path| path.aovs.emission);
        assert!((found.x - emission).abs() < 1e-3, "{found}");
    }
}
