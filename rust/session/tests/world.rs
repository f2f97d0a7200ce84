//! Another world is gathered from the paths of a bake, without new ones.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{RAW, room_scene};
use glam::Mat3;
use relume_session::image::Image;
use relume_session::scene::{Alpha, ColorEncoding, Scene, Texels, Texture, World};
use relume_session::trace::TraceSettings;
use relume_session::{Monitor, Relighter, bake, difference, validate};
use std::path::Path;

/// The room under a sky whose red is much brighter in one half, turned about the vertical axis.
fn under_a_sky(turn: f32) -> Scene {
    let mut scene = room_scene();
    let (width, height) = (16, 8);
    let red = |i: usize| if i % width < width / 2 { 8.0 } else { 1.0 };
    let texel = |i: usize| [red(i), (i / width) as f32, 1.0, 1.0];
    scene.textures.push(Texture {
        name: "sky".into(),
        width,
        height,
        texels: Texels::Float((0..width * height).flat_map(texel).collect()),
        encoding: ColorEncoding::Linear,
        alpha: Alpha::None,
    });
    scene.world = World {
        color: [1.0, 2.0, 0.5],
        texture: Some(scene.textures.len() - 1),
        texture_from_world: Mat3::from_rotation_z(turn),
        ..World::default()
    };
    scene
}

fn settings(samples: u32) -> TraceSettings {
    TraceSettings { samples, ..TraceSettings::default() }
}

fn traced(scene: &Scene, settings: &TraceSettings, folder: &Path) {
    bake(scene, settings, folder, false, &Monitor::default()).unwrap();
}

fn shards(folder: &Path) -> Vec<Vec<u8>> {
    let relighter = Relighter::open(folder).unwrap();
    relighter.gather().unwrap().dump().shards().map(|shard| shard.as_bytes().to_vec()).collect()
}

/// Means of each channel over four parts of a picture.
fn means(image: &Image) -> Vec<f64> {
    let mut sums = vec![0.0; 12];
    for (pixel, rgb) in image.data.chunks_exact(3).enumerate() {
        let (x, y) = (pixel % image.width, pixel / image.width);
        let part = 2 * usize::from(2 * y >= image.height) + usize::from(2 * x >= image.width);
        for c in 0..3 {
            sums[3 * part + c] += f64::from(rgb[c]) / (image.width * image.height / 4) as f64;
        }
    }
    sums
}

#[test]
fn a_turned_sky_gathered_is_the_one_traced() {
    const SEEDS: u64 = 12;
    let (before, turned) = (under_a_sky(0.0), under_a_sky(3.0));
    let mut differences = vec![Vec::new(); 12];
    let mut brightness = vec![0.0; 12];
    let mut was = 0.0;
    for seed in 0..SEEDS {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = [folder.path().join("a"), folder.path().join("b")];
        // Other numbers for both: the errors of one tell nothing of the other's.
        let settings = |seed| TraceSettings { seed, ..settings(64) };
        traced(&before, &settings(seed), &a);
        traced(&turned, &settings(seed + SEEDS), &b);
        let mut relighter = Relighter::open(&a).unwrap();
        let own = means(&relighter.aovs().world);
        relighter.show_world_of(&turned, &Monitor::default()).unwrap();
        assert_eq!(relighter.world_color(), Some(turned.world.color));
        let gathered = means(&relighter.relight(&[], &RAW, &Monitor::default()).unwrap().world);
        let expected = means(&Relighter::open(&b).unwrap().aovs().world);
        for (i, difference) in differences.iter_mut().enumerate() {
            difference.push(gathered[i] - expected[i]);
            brightness[i] += expected[i] / SEEDS as f64;
        }
        let changes = own.iter().zip(&expected).map(|(own, expected)| (own / expected - 1.0).abs());
        was += changes.fold(0.0, f64::max) / SEEDS as f64;
    }
    assert!(was > 0.2, "the turn changes the picture by {was} only");
    for (differences, brightness) in differences.iter().zip(brightness) {
        let mean = differences.iter().sum::<f64>() / SEEDS as f64;
        let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (SEEDS - 1) as f64;
        let error = (variance / SEEDS as f64).sqrt();
        assert!(error < 0.02 * brightness, "too noisy to tell: {error} of {brightness}");
        // Student's t of 11 degrees of freedom is beyond 5 once in 2,500 tests; there are 12, of fixed seeds.
        assert!(mean.abs() < 5.0 * error, "differs by {mean} +- {error} of {brightness}");
    }
}

#[test]
fn the_worlds_own_map_is_shown_as_it_was_traced() {
    let folder = tempfile::tempdir().unwrap();
    let scene = under_a_sky(0.0);
    traced(&scene, &settings(8), folder.path());
    let mut relighter = Relighter::open(folder.path()).unwrap();
    let own = relighter.aovs().world.clone();
    let monitor = Monitor::default();
    relighter.show_world_of(&under_a_sky(1.0), &monitor).unwrap();
    assert_ne!(relighter.aovs().world, own);
    relighter.show_world_of(&scene, &monitor).unwrap();
    assert_eq!(relighter.aovs().world, own);

    // Hidden from the camera, which sees nothing of it but its light.
    let mut hidden = scene.clone();
    hidden.world.visible_camera = false;
    relighter.show_world_of(&hidden, &monitor).unwrap();
    assert!(means(&relighter.aovs().world).iter().zip(means(&own)).all(|(hidden, seen)| *hidden < seen));
    // One of a single colour, black in a channel.
    let plain = World { color: [0.5, 0.0, 0.25], ..World::default() };
    relighter.show_world_of(&Scene { world: plain, ..scene }, &monitor).unwrap();
    let pixels = relighter.aovs().world.data.chunks_exact(3);
    assert!(pixels.clone().all(|rgb| rgb[1] == 0.0));
    assert!(pixels.clone().any(|rgb| rgb[0] > 0.0 && rgb[2] > 0.0));
}

#[test]
fn paths_do_not_depend_on_the_world_and_none_is_traced_for_another() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = [folder.path().join("a"), folder.path().join("b")];
    let (before, turned) = (under_a_sky(0.0), under_a_sky(1.0));
    traced(&before, &settings(16), &a);
    traced(&turned, &settings(16), &b);
    let gathered = |folder: &Path| {
        let mut relighter = Relighter::open(folder).unwrap();
        let world = under_a_sky(0.5).world;
        relighter.set_world(&world, &turned.textures, &Monitor::default()).unwrap();
        relighter.aovs().world.clone()
    };
    assert_eq!(gathered(&a), gathered(&b));

    let found = shards(&a);
    let fewer = bake(&turned, &settings(4), &a, true, &Monitor::default());
    assert_eq!(fewer.unwrap().samples, 4);
    assert_eq!(difference(&turned, &settings(16), &a).unwrap(), Some("map of the world"));
    let report = bake(&turned, &settings(16), &a, true, &Monitor::default());
    let error = report.unwrap_err().to_string();
    assert!(error.contains("map of the world"), "{error}");
    bake(&before, &settings(16), &a, true, &Monitor::default()).unwrap();
    assert_eq!(shards(&a), found);
    assert_eq!(bake(&turned, &settings(16), &a, true, &Monitor::default()).unwrap().samples, 16);
    assert_eq!(shards(&a), found);
    assert_eq!(validate(&a, &Monitor::default()).unwrap(), [""; 0], "what was written anew was noted");
}

#[test]
fn a_bake_that_is_not_whole_takes_no_paths_of_another_world() {
    let folder = tempfile::tempdir().unwrap();
    let (before, turned) = (under_a_sky(0.0), under_a_sky(1.0));
    traced(&before, &settings(16), folder.path());
    assert_eq!(difference(&turned, &settings(17), folder.path()).unwrap(), Some("map of the world"));
    let last = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
    let last = last.filter(|path| path.extension().is_some_and(|end| end == "safetensors")).max().unwrap();
    std::fs::remove_file(last).unwrap();
    assert_eq!(difference(&turned, &settings(16), folder.path()).unwrap(), Some("map of the world"));
    assert_eq!(difference(&turned, &settings(1), folder.path()).unwrap(), None);
    assert_eq!(difference(&before, &settings(16), folder.path()).unwrap(), None);
    let error = bake(&turned, &settings(16), folder.path(), true, &Monitor::default()).unwrap_err();
    assert!(error.to_string().contains("map of the world"), "{error}");
}
