//! Static layers: light that the scene itself emits.

use std::f32::consts::PI;

use relume_scene::{
    Alpha, ColorEncoding, EmitterLinks, Extension, ImageProjection, Input, Interpolation, MOST_RADIANCE,
    Material, MathOp, Node, Output, ReceiverSet, Scene, Texels, Texture, UvMap,
    glam::{Affine3A, Vec2, Vec3},
};
use relume_trace::{TraceSettings, settings::BounceLimits};

use crate::support::*;

fn emission(color: [f32; 3], strength: f32) -> Node {
    Node::Emission { color: Input::Rgb(color), strength: Input::Float(strength) }
}

/// A wall that reflects `albedo` and emits 1.
fn glowing(albedo: f32) -> Material {
    let mut material = diffuse(albedo);
    material.nodes.push(emission([1.0; 3], 1.0));
    material.nodes.push(Node::AddShader { a: Some(0), b: Some(1) });
    material.surface = Some(2);
    material
}

fn settings(samples: u32, sample_static_lights: bool) -> TraceSettings {
    let mut settings = TraceSettings { samples, ..TraceSettings::default() };
    settings.paths.sample_static_lights = sample_static_lights;
    settings.paths.bounces =
        BounceLimits { total: 200, diffuse: 200, glossy: 200, ..BounceLimits::default() };
    settings
}

/// Mean variance of a value among the paths of a pixel.
fn noise(paths: &[Vec<Path>], value: impl Fn(&Path) -> f32) -> f32 {
    let variance = |pixel: &Vec<Path>| {
        let mean = pixel.iter().map(&value).sum::<f32>() / pixel.len() as f32;
        pixel.iter().map(|path| (value(path) - mean).powi(2)).sum::<f32>() / pixel.len() as f32
    };
    paths.iter().map(variance).sum::<f32>() / paths.len() as f32
}

/// Asserts that both ways to find the emitters give the same mean, to within four standard errors, and sampling them
/// directly at least `gain` times less variance.
fn check_gain(by_bsdf: &[Vec<Path>], sampled: &[Vec<Path>], value: impl Fn(&Path) -> f32, gain: f32) {
    let count: usize = sampled.iter().map(Vec::len).sum();
    let [noise_a, noise_b] = [by_bsdf, sampled].map(|paths| noise(paths, &value));
    let [a, b] = [by_bsdf, sampled].map(|paths| mean(paths, |path| Vec3::splat(value(path))).x);
    let error = ((noise_a + noise_b) / count as f32).sqrt();
    println!("by BSDF {a} (variance {noise_a}), sampled {b} (variance {noise_b})");
    assert!((a - b).abs() < 4.0 * error, "by BSDF {a}, sampled {b}, standard error {error}");
    assert!(noise_b * gain < noise_a, "variance by BSDF {noise_a}, sampled {noise_b}");
}

#[test]
fn closed_glowing_box_sums_the_geometric_series() {
    for albedo in [0.0, 0.5, 0.8] {
        for sampled in [false, true] {
            let mut scene = Scene::default();
            add(&mut scene, cube(), Affine3A::IDENTITY, glowing(albedo));
            scene.camera = look_at_origin(Vec3::new(0.3, -0.8, 0.1), 8, 1.0);
            let paths = image_paths(&scene, &settings(256, sampled));
            let what = format!("albedo {albedo}, emitters sampled: {sampled}");
            assert_close(mean(&paths, |path| path.aovs.emission), 1.0 / (1.0 - albedo), 0.015, &what);
            assert_eq!(mean(&paths, |path| path.aovs.world), Vec3::ZERO);
        }
    }
}

/// A box with a small lamp below the ceiling and a tinted, transparent pane under it.
fn room_with_lamp() -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, cube(), Affine3A::IDENTITY, diffuse(0.6));
    let lamp = Affine3A::from_translation(Vec3::Z * 0.9) * Affine3A::from_scale(Vec3::splat(0.15));
    add(&mut scene, square(0.0), lamp, material(emission([1.0, 0.8, 0.6], 20.0)));
    let pane = Affine3A::from_translation(Vec3::Z * 0.5) * Affine3A::from_scale(Vec3::splat(0.5));
    add(&mut scene, square(0.0), pane, material(Node::Transparent { color: Input::Rgb([0.5, 0.9, 0.2]) }));
    scene.camera = look_at_origin(Vec3::new(0.1, -0.9, -0.2), 8, 1.0);
    scene
}

#[test]
fn sampled_emitters_keep_the_mean_and_cut_the_noise() {
    let scene = room_with_lamp();
    let limited = |sampled| {
        let mut settings = settings(2048, sampled);
        settings.paths.bounces = BounceLimits::default();
        image_paths(&scene, &settings)
    };
    let (by_bsdf, sampled) = (limited(false), limited(true));
    check_gain(&by_bsdf, &sampled, |path| path.aovs.emission.x, 5.0);
    // The dump itself never depends on it.
    for (a, b) in by_bsdf.iter().flatten().zip(sampled.iter().flatten()) {
        assert_eq!(a.segments, b.segments);
    }
}

#[test]
fn a_sampled_sky_keeps_the_mean_and_cuts_the_noise() {
    let (width, height) = (64, 32);
    let mut texels = vec![0.2; width * height * 4];
    let sun = 4 * (26 * width + 20);
    texels[sun..sun + 3].copy_from_slice(&[4000.0, 3000.0, 2000.0]);
    let mut scene = Scene::default();
    scene.textures.push(Texture {
        name: "sky".into(),
        width,
        height,
        texels: Texels::Float(texels),
        encoding: ColorEncoding::Linear,
        alpha: Alpha::None,
    });
    scene.world.color = [1.0; 3];
    scene.world.texture = Some(0);
    add(&mut scene, square(0.0), Affine3A::from_scale(Vec3::splat(20.0)), diffuse(0.5));
    add(&mut scene, sphere(), Affine3A::from_translation(Vec3::Z), diffuse(0.5));
    scene.camera = look_at_origin(Vec3::new(2.0, -6.0, 3.0), 8, 0.6);
    let [by_bsdf, sampled] = [false, true].map(|sampled| image_paths(&scene, &settings(2048, sampled)));
    check_gain(&by_bsdf, &sampled, |path| path.aovs.world.x, 20.0);
}

#[test]
fn film_exposure_multiplies_all_light_and_changes_no_path() {
    let mut scene = Scene::default();
    add(&mut scene, square(0.0), Affine3A::IDENTITY, glowing(0.5));
    scene.world.color = [0.2, 0.4, 0.8];
    scene.camera = look_at_origin(Vec3::new(0.5, -2.0, 1.0), 8, 1.5);
    let exposed = |film_exposure| {
        let mut settings = settings(16, true);
        settings.paths.film_exposure = film_exposure;
        image_paths(&scene, &settings)
    };
    let (plain, bright) = (exposed(1.0), exposed(4.0));
    for light in [|path: &Path| path.aovs.emission, |path: &Path| path.aovs.world] {
        assert!(mean(&plain, light).min_element() > 0.0);
    }
    for (plain, bright) in plain.iter().flatten().zip(bright.iter().flatten()) {
        assert_eq!(plain.segments.len(), bright.segments.len());
        for (a, b) in plain.segments.iter().zip(&bright.segments) {
            assert_eq!((a.end, a.throughput * 4.0), (b.end, b.throughput));
        }
        let light = |path: &Path| [path.aovs.emission, path.aovs.world];
        assert_eq!(light(plain).map(|light| light * 4.0), light(bright));
        assert_eq!((plain.aovs.alpha, plain.aovs.albedo), (bright.aovs.alpha, bright.aovs.albedo));
    }
}

#[test]
fn what_is_brighter_than_can_be_summed_is_as_bright_as_can_be() {
    let mut scene = Scene::default();
    let factor = || Input::Float(1e19);
    let strength = Node::Math {
        operation: MathOp::Multiply,
        clamp: false,
        a: factor(),
        b: factor(),
        c: Input::Float(0.0),
    };
    let strength_of = Input::Link { node: 0, output: Output::Value };
    let glow = Node::Emission { color: Input::Rgb([1.0; 3]), strength: strength_of };
    let neon = Material { nodes: vec![strength, glow], surface: Some(1), ..Material::default() };
    add(&mut scene, square(0.0), Affine3A::IDENTITY, neon);
    scene.textures.push(Texture {
        name: "nova".into(),
        width: 1,
        height: 1,
        texels: Texels::Float(vec![1e19; 4]),
        encoding: ColorEncoding::Linear,
        alpha: Alpha::None,
    });
    scene.world.color = [1e19; 3];
    scene.world.texture = Some(0);
    scene.camera = look_at_origin(Vec3::new(0.5, -2.0, 1.0), 8, 1.5);
    let paths = image_paths(&scene, &settings(4, true));
    for light in [|path: &Path| path.aovs.emission, |path: &Path| path.aovs.world] {
        let brightest = paths.iter().flatten().map(|path| light(path).max_element()).fold(0.0, f32::max);
        assert_eq!(brightest, MOST_RADIANCE);
    }
}

/// Light samples that are too weak for the film are left to chance: on a film exposed by more, fewer are.
#[test]
fn film_exposure_decides_which_light_samples_are_too_weak() {
    let mut scene = Scene::default();
    add(&mut scene, square(0.0), Affine3A::IDENTITY, diffuse(0.5));
    let lamp = Affine3A::from_translation(Vec3::Z * 2.0) * Affine3A::from_scale(Vec3::splat(0.1));
    add(&mut scene, square(0.0), lamp, material(emission([1.0; 3], 0.5)));
    scene.camera = look_at_origin(Vec3::new(0.3, -0.6, 1.5), 4, 0.4);
    let lit = |film_exposure| {
        let mut settings = settings(256, true);
        settings.paths.film_exposure = film_exposure;
        let paths = image_paths(&scene, &settings);
        mean(&paths, |path| Vec3::splat(f32::from(path.aovs.emission.x > 0.0))).x
    };
    let (plain, bright) = (lit(1.0), lit(1000.0));
    assert!(plain < 0.5 && bright > 0.95, "{plain} of the paths, {bright} of the bright ones");
}

#[test]
fn screens_that_are_black_in_the_middle_are_sampled_where_they_shine() {
    let mut scene = Scene::default();
    add(&mut scene, cube(), Affine3A::IDENTITY, diffuse(0.6));
    let mut screen = square(0.0);
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    screen.uv_maps = vec![UvMap { name: "UVMap".into(), coords: corners.map(Vec2::from).to_vec() }];
    // Only the first and the last of four rows shine, which hold the middle of neither triangle.
    let row = |value: f32| [value, value, value, 1.0].repeat(4);
    scene.textures.push(Texture {
        name: "screen".into(),
        width: 4,
        height: 4,
        texels: Texels::Float([row(1.0), row(0.0), row(0.0), row(1.0)].concat()),
        encoding: ColorEncoding::Linear,
        alpha: Alpha::None,
    });
    let image = Node::ImageTexture {
        texture: 0,
        tiles: Vec::new(),
        vector: None,
        interpolation: Interpolation::Closest,
        extension: Extension::Repeat,
        projection: ImageProjection::Flat,
    };
    let color = Input::Link { node: 0, output: Output::Color };
    let shows = Node::Emission { color, strength: Input::Float(20.0) };
    let material = Material {
        name: "screen".into(),
        nodes: vec![image, shows],
        surface: Some(1),
        ..Material::default()
    };
    let place = Affine3A::from_translation(Vec3::Z * 0.9) * Affine3A::from_scale(Vec3::splat(0.15));
    add(&mut scene, screen, place, material);
    scene.camera = look_at_origin(Vec3::new(0.1, -0.9, -0.2), 8, 1.0);
    let [by_bsdf, sampled] = [false, true].map(|sampled| {
        let mut settings = settings(2048, sampled);
        settings.paths.bounces = BounceLimits::default();
        image_paths(&scene, &settings)
    });
    check_gain(&by_bsdf, &sampled, |path| path.aovs.emission.x, 3.0);
}

/// Mean light on a floor below a plate below a lamp, whose receiver numbers are 0, 1 and 2, for the lamp's links.
fn light_below_plate(receivers: Option<Vec<u16>>, blockers: Option<Vec<u16>>) -> f32 {
    let mut scene = Scene::default();
    let lamp = Affine3A::from_translation(Vec3::Z * 0.9) * Affine3A::from_scale(Vec3::splat(0.4));
    add(&mut scene, square(0.0), Affine3A::IDENTITY, diffuse(0.5));
    add(&mut scene, square(0.5), Affine3A::IDENTITY, diffuse(0.5));
    add(&mut scene, square(0.0), lamp, material(emission([1.0; 3], 10.0)));
    for (receiver, instance) in scene.instances.iter_mut().enumerate() {
        instance.receiver = receiver as u16;
    }
    let [receivers, blockers] =
        [receivers, blockers].map(|numbers| numbers.map(|receivers| ReceiverSet { receivers }));
    scene.instances[2].links = Some(Box::new(EmitterLinks { receivers, blockers }));
    scene.camera = look_at_origin(Vec3::new(0.0, -0.8, 0.25), 4, 0.1);
    let mut settings = settings(256, true);
    settings.paths.bounces.total = 1;
    mean(&image_paths(&scene, &settings), |path| path.aovs.emission).x
}

#[test]
fn meshes_light_what_they_are_linked_to() {
    assert_eq!(light_below_plate(None, None), 0.0);
    assert_eq!(light_below_plate(None, Some(vec![0, 1])), 0.0);
    let through = light_below_plate(None, Some(vec![0]));
    // Half of what a square of radiance 10 sends straight down, by its form factor from the origin.
    let side = 0.4f32 / 0.9;
    let corner = side / (1.0 + side * side).sqrt() * (side / (1.0 + side * side).sqrt()).atan() / PI;
    assert!((through / (0.5 * 10.0 * 4.0 * corner) - 1.0).abs() < 0.03, "{through}");
    assert_eq!(light_below_plate(Some(vec![1, 2]), Some(vec![0])), 0.0);
    assert_eq!(light_below_plate(Some(vec![0, 2]), Some(vec![0])), through);
}
