//! Fast GI Approximation: rays that are cut, and light that is added.

use relume_dump::{End, Segment, Sight};
use relume_scene::{
    Distribution, Input, Node, Scene,
    glam::{Affine3A, Vec3},
};
use relume_trace::{
    TraceSettings, Tracer,
    settings::{BounceLimits, FastGi},
};

use crate::{
    media::{coefficients, medium},
    support::*,
};

const ALBEDO: f32 = 0.8;

/// The inside of a cube of edge 2, whose floor the camera sees around its middle, in a white world.
fn room() -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, cube(), Affine3A::IDENTITY, diffuse(ALBEDO));
    scene.camera = look_at_origin(Vec3::Z * 0.5, 4, 0.05);
    scene.world.color = [1.0; 3];
    scene
}

fn replace(bounces: u32, distance: f32, factor: f32) -> TraceSettings {
    with(FastGi::Replace { bounces, distance, factor })
}

fn with(fast_gi: FastGi) -> TraceSettings {
    let mut settings = TraceSettings { samples: 256, ..TraceSettings::default() };
    settings.paths.fast_gi = Some(fast_gi);
    settings
}

/// A test for segments that stand for a kind of ray, in scenes without light linking.
fn is_of(scene: &Scene, settings: &TraceSettings, sight: Sight) -> impl Fn(&&Segment) -> bool + use<> {
    let manifest = relume_trace::manifest(scene, settings);
    let (classes, receivers) = (manifest.classes.unwrap(), manifest.receivers.len());
    move |segment| classes.rules(usize::from(segment.receiver) / receivers).0 == sight
}

#[test]
fn rays_that_are_cut_meet_the_world_as_far_as_they_reach() {
    for (bounces, distance, factor, own, expected) in [
        (1, 0.8, 1.0, 0.0, ALBEDO),
        (1, 0.8, 0.5, 0.0, ALBEDO * 0.5),
        (1, 0.0, 1.0, 0.0, ALBEDO),
        (1, 10.0, 1.0, 0.0, 0.0),
        (1, 10.0, 1.0, 0.8, ALBEDO),
        (2, 0.0, 1.0, 0.0, ALBEDO * ALBEDO),
    ] {
        let mut scene = room();
        scene.instances[0].occlusion_distance = own;
        let settings = replace(bounces, distance, factor);
        let paths = image_paths(&scene, &settings);
        let baked = mean(&paths, |path| path.aovs.world);
        let sees_world = is_of(&scene, &settings, Sight::World);
        let gathered = mean(&paths, |path| {
            path.segments.iter().filter(&sees_world).map(|segment| segment.throughput).sum()
        });
        for found in [baked, gathered] {
            assert!((found - expected).abs().max_element() < 1e-4, "{distance} {own}: {found} {expected}");
        }
    }
}

#[test]
fn light_comes_from_afar_where_rays_are_cut() {
    let (scene, settings) = (room(), replace(1, 0.8, 0.5));
    let sees_lights = is_of(&scene, &settings, Sight::ShadowWithoutWorld);
    let sees_world = is_of(&scene, &settings, Sight::World);
    for path in image_paths(&scene, &settings).iter().flatten() {
        let lit: Vec<_> = path.segments.iter().filter(&sees_lights).collect();
        let [to_wall] = &lit[..] else { panic!("{} segments", lit.len()) };
        let End::Vertex(wall) = to_wall.end else { panic!("the room is closed") };
        assert!(
            (wall.abs().max_element() - 1.0).abs() < 1e-4
                && to_wall.throughput.abs_diff_eq(Vec3::splat(ALBEDO), 1e-5)
        );
        let world = path.segments.iter().filter(&sees_world);
        let weighed: Vec<_> = world.filter(|segment| segment.throughput != Vec3::ZERO).collect();
        let [world] = &weighed[..] else { panic!("{} segments", weighed.len()) };
        assert!(
            matches!(world.end, End::Escape(_))
                && world.throughput.abs_diff_eq(Vec3::splat(ALBEDO * 0.5), 1e-5)
        );
    }
}

#[test]
fn mirrors_find_lights_as_far_as_their_cut_rays_reach() {
    let mirror = || {
        material(Node::Glossy {
            color: Input::Rgb([1.0; 3]),
            roughness: Input::Float(0.0),
            anisotropy: Input::Float(0.0),
            rotation: Input::Float(0.0),
            tangent: None,
            normal: None,
            distribution: Distribution::Ggx,
        })
    };
    let mut scene = Scene::default();
    add(&mut scene, square(0.0), Affine3A::IDENTITY, mirror());
    add(&mut scene, square(1.0), Affine3A::IDENTITY, mirror());
    scene.camera = look_at_origin(Vec3::Z * 0.5, 2, 0.01);
    // The first glossy bounce does not count, the second does.
    let settings = replace(1, 0.25, 1.0);
    let finds_lights = is_of(&scene, &settings, Sight::SingularWithoutWorld);
    let sees_world = is_of(&scene, &settings, Sight::World);
    for path in image_paths(&scene, &settings).iter().flatten() {
        let found: Vec<_> = path.segments.iter().filter(&finds_lights).collect();
        let [end] = &found[..] else { panic!("{} segments", found.len()) };
        let End::Vertex(end) = end.end else { panic!("the ray is cut") };
        assert!((end.z - 0.75).abs() < 1e-3, "{end}");
        assert_eq!(path.segments.iter().filter(&sees_world).count(), 1);
    }
}

#[test]
fn added_light_is_what_nothing_nearby_blocks() {
    for (distance, factor, expected) in [(0.8, 1.0, ALBEDO), (0.8, 0.5, ALBEDO * 0.5), (10.0, 1.0, 0.0)] {
        let mut settings = with(FastGi::Add { distance, factor });
        settings.paths.bounces = BounceLimits { total: 0, ..BounceLimits::default() };
        // It counts whatever is sampled for the sake of noise.
        settings.paths.sample_static_lights = false;
        let found = mean(&image_paths(&room(), &settings), |path| path.aovs.emission);
        assert!((found - expected).abs().max_element() < 1e-4, "{distance}: {found} {expected}");
    }
}

#[test]
fn in_scenes_with_volumes_every_bounce_is_traced_which_is_said() {
    let mut scene = room();
    scene.materials.push(medium(vec![coefficients([0.1; 3], [0.0; 3])]));
    scene.world.volume = Some(scene.materials.len() - 1);
    let is_said = |fast_gi| {
        let tracer = Tracer::new(&scene, &with(fast_gi)).unwrap();
        tracer.warnings().iter().any(|warning| warning.starts_with("Fast GI"))
    };
    assert!(is_said(FastGi::Replace { bounces: 1, distance: 1.0, factor: 1.0 }));
    assert!(!is_said(FastGi::Add { distance: 1.0, factor: 1.0 }));
}
