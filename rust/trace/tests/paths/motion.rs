//! Things that move while the shutter is open.

use relume_scene::{
    Input, Node, Pose, STILL, Scene, Shutter,
    glam::{Affine3A, Quat, Vec3},
};
use relume_trace::{TraceSettings, Tracer};

use crate::support::*;

const TIMES: usize = 64;

fn glow(strength: f32) -> Node {
    Node::Emission { color: Input::Rgb([1.0; 3]), strength: Input::Float(strength) }
}

fn open() -> Option<Shutter> {
    Some(Shutter { curve: vec![1.0], rolling: None })
}

/// A small lamp that crosses the space above a floor, while it turns and grows.
fn scene() -> Scene {
    let mut scene = Scene { camera: look_at_origin(Vec3::new(0.0, -3.0, 3.0), 4, 0.6), ..Scene::default() };
    add(&mut scene, square(0.0), Affine3A::from_scale(Vec3::splat(2.0)), diffuse(0.7));
    let places = [-1.0, 0.0, 1.0].map(|along: f32| {
        let turn = Quat::from_rotation_x(0.8 * along);
        let scale = Vec3::new(0.15 * (2.0 + along), 0.2, 1.0);
        Affine3A::from_scale_rotation_translation(scale, turn, Vec3::new(1.2 * along, 0.4, 0.8))
    });
    add(&mut scene, square(0.0), places[1], material(glow(5.0)));
    scene.instances[1].motion = Pose::keys(&places);
    scene.camera.shutter = open();
    scene
}

fn settings(samples: u32, sample_static_lights: bool) -> TraceSettings {
    let mut settings = TraceSettings { samples, ..TraceSettings::default() };
    settings.paths.sample_static_lights = sample_static_lights;
    settings
}

/// Emission along each path of each pixel.
fn emissions(scene: &Scene, settings: &TraceSettings) -> Vec<Vec<f32>> {
    let of_pixel = |paths: &Vec<Path>| paths.iter().map(|path| path.aovs.emission.x).collect();
    image_paths(scene, settings).iter().map(of_pixel).collect()
}

/// Mean and its standard error.
fn mean_of(values: &[f32]) -> (f32, f32) {
    let count = values.len() as f32;
    let mean = values.iter().sum::<f32>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / count;
    (mean, (variance / count).sqrt())
}

#[test]
fn moving_lamps_light_a_floor_as_the_mean_of_many_that_stand_still() {
    let moving = scene();
    let mut expected = vec![Vec::new(); 16];
    for number in 0..TIMES {
        let time = (number as f32 + 0.5) / TIMES as f32;
        let mut still = scene();
        still.camera.shutter = None;
        still.instances[1].world_from_object = still.instances[1].world_from_object_at(time);
        still.instances[1].motion.clear();
        for (all, pixel) in expected.iter_mut().zip(emissions(&still, &settings(64, true))) {
            all.extend(pixel);
        }
    }
    for samples_lights in [true, false] {
        for (found, expected) in emissions(&moving, &settings(4096, samples_lights)).iter().zip(&expected) {
            let [(found, error), (expected, other)] = [found, expected].map(|values| mean_of(values));
            let limit = 4.5 * error.hypot(other);
            assert!((found - expected).abs() < limit, "{samples_lights}: {found} {expected} {limit}");
        }
    }
}

#[test]
fn a_pixel_sees_what_covers_it_for_a_part_of_the_time() {
    // The right edge passes the pixel when a quarter of the time is left.
    let mut scene = Scene { camera: look_at_origin(Vec3::Z, 1, 1e-4), ..Scene::default() };
    let places = [-2.5, -1.5, -0.5].map(|x| Affine3A::from_translation(Vec3::new(x, 0.0, 0.0)));
    add(&mut scene, square(0.0), places[1], material(glow(1.0)));
    scene.instances[0].motion = Pose::keys(&places);
    scene.camera.shutter = open();
    let seen = |scene: &Scene| mean_of(&emissions(scene, &settings(1024, true))[0]).0;
    assert!((seen(&scene) - 0.25).abs() < 2e-3, "{}", seen(&scene));
    // The same by a shape that moves, by a camera that does, and by a shutter that opens late.
    let mut bent = scene.clone();
    let at = |x: f32| square(0.0).positions.into_iter().map(move |place| place + Vec3::X * x);
    bent.instances[0].motion.clear();
    bent.meshes[0].motion = [-1.0, 0.0, 1.0].into_iter().flat_map(at).collect();
    assert!((seen(&bent) - 0.25).abs() < 2e-3);
    let mut panned = scene.clone();
    panned.instances[0].motion.clear();
    let eye = scene.camera.world_from_camera;
    let moved = [1.0, 0.0, -1.0].map(|x| Affine3A::from_translation(Vec3::X * x) * eye);
    panned.camera.motion = Pose::keys(&moved);
    assert!((seen(&panned) - 0.25).abs() < 2e-3);
    scene.camera.shutter = Some(Shutter { curve: vec![0.0, 0.0, 1.0, 1.0], rolling: None });
    assert!((seen(&scene) - 0.5).abs() < 2e-3);
}

#[test]
fn without_a_shutter_all_stands_as_in_the_middle_of_the_interval() {
    let mut moving = scene();
    moving.camera.shutter = None;
    let mut still = moving.clone();
    still.instances[1].motion.clear();
    assert_eq!(moving.instances[1].world_from_object_at(STILL), still.instances[1].world_from_object);
    let paths = |scene: &Scene| pixel_paths(&Tracer::new(scene, &settings(16, true)).unwrap(), 1, 2, 0..16);
    let [found, expected] = [&moving, &still]
        .map(|scene| paths(scene).iter().map(|path| path.segments.len()).collect::<Vec<_>>());
    assert_eq!(found, expected);
}
