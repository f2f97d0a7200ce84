//! Scenes whose radiance is known in closed form.

use relume_scene::{
    Scene,
    glam::{Affine3A, Vec3},
};
use relume_trace::TraceSettings;

use crate::support::*;

fn world(color: [f32; 3]) -> Scene {
    let mut scene = Scene::default();
    scene.world.color = color;
    scene
}

#[test]
fn furnace_sphere_returns_one() {
    let mut scene = world([1.0; 3]);
    add(&mut scene, sphere(), Affine3A::IDENTITY, diffuse(1.0));
    scene.camera = look_at_origin(Vec3::new(3.0, -1.0, 0.7), 16, 0.7);
    let paths = image_paths(&scene, &TraceSettings { samples: 16, ..TraceSettings::default() });
    let covered = paths.iter().flatten().filter(|path| path.segments.len() > 1).count();
    assert!(covered > 2000, "{covered}");
    assert_close(mean(&paths, |path| path.aovs.world), 1.0, 0.01, "white sphere in a white world");
}

#[test]
fn grey_sphere_returns_its_albedo() {
    let mut scene = world([1.0; 3]);
    add(&mut scene, sphere(), Affine3A::IDENTITY, diffuse(0.5));
    scene.camera = look_at_origin(Vec3::new(0.0, 0.0, 4.0), 8, 0.2);
    let paths = image_paths(&scene, &TraceSettings { samples: 64, ..TraceSettings::default() });
    assert_close(mean(&paths, |path| path.aovs.world), 0.5, 0.01, "grey sphere in a white world");
}

#[test]
fn tilted_square_over_a_floor_loses_no_energy() {
    // Concave corners: a floor with a wall, both white, under a white sky.
    let mut scene = world([1.0; 3]);
    add(&mut scene, square(0.0), Affine3A::from_scale(Vec3::splat(3.0)), diffuse(1.0));
    add(
        &mut scene,
        square(0.0),
        Affine3A::from_rotation_y(0.9) * Affine3A::from_translation(Vec3::new(0.0, 0.0, 0.4)),
        diffuse(1.0),
    );
    scene.camera = look_at_origin(Vec3::new(2.0, -3.0, 1.5), 16, 0.5);
    let mut settings = TraceSettings { samples: 64, ..TraceSettings::default() };
    settings.paths.bounces.diffuse = 200;
    settings.paths.bounces.total = 200;
    let paths = image_paths(&scene, &settings);
    assert_close(mean(&paths, |path| path.aovs.world), 1.0, 0.005, "white scene under a white sky");
}
