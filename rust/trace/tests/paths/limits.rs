//! Bounce limits and roulette, as Blender means them.

use relume_dump::{End, Lobe};
use relume_scene::{
    Scene,
    glam::{Affine3A, Vec3},
};
use relume_trace::{
    TraceSettings,
    settings::{BounceLimits, FastGi},
};

use crate::support::*;

/// The inside of a closed white box: no path ever leaves it.
fn closed_box(albedo: f32) -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, cube(), Affine3A::IDENTITY, diffuse(albedo));
    scene.camera = look_at_origin(Vec3::new(0.3, -0.8, 0.1), 8, 1.0);
    scene
}

fn limited(limits: BounceLimits, samples: u32) -> TraceSettings {
    let mut settings = TraceSettings { samples, ..TraceSettings::default() };
    settings.paths.bounces = limits;
    settings
}

#[test]
fn paths_have_a_segment_more_than_bounces_are_allowed_and_the_camera_ray() {
    for (total, diffuse, expected) in [(0, 4, 2), (3, 12, 5), (12, 4, 6), (12, 0, 2)] {
        let limits = BounceLimits { total, diffuse, ..BounceLimits::default() };
        let paths = image_paths(&closed_box(1.0), &limited(limits, 4));
        let longest = paths.iter().flatten().map(|path| path.segments.len()).max();
        assert_eq!(longest, Some(expected), "total {total}, diffuse {diffuse}");
    }
}

#[test]
fn segments_carry_the_lobe_that_made_them_and_join_up() {
    let scene = closed_box(0.8);
    for path in image_paths(&scene, &limited(BounceLimits::default(), 4)).iter().flatten() {
        assert_eq!(path.segments[0].lobe, Lobe::Camera);
        assert_eq!(path.segments[0].throughput, Vec3::ONE);
        assert!(path.segments[1..].iter().all(|segment| segment.lobe == Lobe::Diffuse));
        for segment in &path.segments {
            let End::Vertex(position) = segment.end else { panic!("the box is closed") };
            assert!((position.abs().max_element() - 1.0).abs() < 1e-5, "{position}");
        }
    }
}

#[test]
fn roulette_keeps_the_mean_of_the_throughput() {
    let limits = BounceLimits { total: 12, diffuse: 12, min_total: 0, ..BounceLimits::default() };
    let paths = image_paths(&closed_box(0.5), &limited(limits, 1024));
    for depth in 1..6 {
        let throughput =
            mean(&paths, |path| path.segments.get(depth).map_or(Vec3::ZERO, |segment| segment.throughput));
        assert_close(throughput, 0.5_f32.powi(depth as i32), 0.05, "mean throughput");
    }
    let ended = paths.iter().flatten().filter(|path| path.segments.len() < 10).count();
    assert!(ended > 40_000, "roulette hardly ever ends a path: {ended}");
}

#[test]
fn an_empty_scene_shows_the_world_alone() {
    let mut scene = Scene { camera: look_at_origin(Vec3::Z * 2.0, 4, 0.5), ..Scene::default() };
    scene.world.color = [0.5; 3];
    let mut settings = TraceSettings { samples: 4, ..TraceSettings::default() };
    settings.paths.fast_gi = Some(FastGi::Replace { bounces: 1, distance: 1.0, factor: 0.5 });
    assert_eq!(relume_trace::manifest(&scene, &settings).classes, None);
    for path in image_paths(&scene, &settings).iter().flatten() {
        assert!(path.aovs.world == Vec3::splat(0.5) && path.segments.len() == 1);
    }
}
