//! Shots with shadow catchers.

use super::*;
use crate::train::settings::{Clock, TrainSettings};
use crate::train::train;
use relume_proxy::{LightKind, SizeRange, TrainConfig};

/// The room, whose objects all catch shadows but for one that stands between, on a transparent film.
fn stage(width: usize, height: usize) -> Arc<Scene> {
    let mut scene = Scene::clone(&room(width, height));
    scene.instances.iter_mut().for_each(|instance| instance.is_shadow_catcher = true);
    let mut blocker = scene.instances[0].clone();
    let to_middle = relume_scene::glam::Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.2),
        Default::default(),
        Vec3::new(0.0, 0.5, 0.6),
    );
    blocker.world_from_object = to_middle * blocker.world_from_object;
    (blocker.name, blocker.is_shadow_catcher) = ("blocker".into(), false);
    scene.instances.push(blocker);
    Arc::new(scene)
}

fn transparent(samples: u32) -> TraceSettings {
    let mut settings = settings(samples);
    settings.paths.film_transparent = true;
    settings
}

#[test]
fn a_frame_has_the_alpha_of_caught_shadows_as_the_rendered_picture_has() {
    let folder = tempfile::tempdir().unwrap();
    bake(&stage(48, 32), &transparent(16), folder.path(), false, &Monitor::default()).unwrap();
    let live = opened(folder.path(), Device::Cpu);
    let mut relighter = Relighter::open(folder.path()).unwrap();
    relighter.connect_stored(&Monitor::default());
    let mut pictures = Vec::new();
    for lights in [[lamp(0.3)], [lamp(-0.6)]] {
        let frame = settled(&live, live.relight(request(&lights)));
        assert_eq!((frame.image.width, frame.image.height), (48, 32));
        let lights = request(&lights).lights;
        let relit = relighter.relight(&lights, &RelightOptions::default(), &Monitor::default()).unwrap();
        let expected = with_alpha(&relit.combined(), &relit.alpha);
        let brightest = expected.data.iter().fold(1.0_f32, |a, b| a.max(*b));
        for (shown, expected) in frame.image.data.iter().zip(&expected.data) {
            assert!((shown - expected).abs() <= 2e-3 * brightest, "{shown} {expected}");
        }
        pictures.push(relit.alpha);
    }
    assert!(metrics::smape(&pictures[0], &pictures[1]) > 0.01, "another light casts other shadows");
    assert!(live.status().unlearned.is_empty(), "nothing is to be learned");
}

#[test]
fn a_frame_of_half_the_size_halves_each_plate() {
    let folder = tempfile::tempdir().unwrap();
    bake(&stage(160, 130), &transparent(1), folder.path(), false, &Monitor::default()).unwrap();
    let live = opened(folder.path(), Device::Cpu);
    let asked = LiveRequest { interactive: true, half: Some(true), ..request(&[lamp(0.3)]) };
    let number = live.relight(asked);
    let frame = wait("a frame", || live.frame(0).filter(|frame| frame.shown.request == number));
    assert_eq!((frame.shown.scale, frame.image.width, frame.image.height), (2, 80, 65));
    let alpha: Vec<f32> = frame.image.data.iter().skip(3).step_by(4).copied().collect();
    let (least, most) = alpha.iter().fold((1.0_f32, 0.0_f32), |(a, b), alpha| (a.min(*alpha), b.max(*alpha)));
    // The blocker is some pixels wide, and fills most of one of half the size.
    assert!(least >= 0.0 && (0.5..1.00001).contains(&most), "alpha of {least} to {most}");
}

#[test]
fn lights_of_catchers_are_neither_learned_nor_solved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    bake(&stage(16, 16), &transparent(2), path, false, &Monitor::default()).unwrap();
    let settings = TrainSettings {
        kind: LightKind::Sphere,
        config: TrainConfig::fast(SizeRange { min: 0.1, max: 0.3 }),
        seed: 0,
        seconds: Some(1.0),
        clock: Clock::Wall,
        half_for_measuring: true,
    };
    let trained = train(path, path, &settings, false, &Compute::default(), &Monitor::default());
    assert!(trained.unwrap_err().to_string().contains("shadow catchers"));
    let relighter = Relighter::open(path).unwrap();
    let request = crate::SolveRequest::parse(r#"{"goals": [{"goal": "target", "image": "none"}]}"#).unwrap();
    let solved =
        crate::solve_lights(&[&relighter], &request, &Default::default(), &Monitor::default(), &|_| ());
    assert!(solved.unwrap_err().to_string().contains("shadow catchers"));
}
