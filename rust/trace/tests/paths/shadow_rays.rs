//! Objects and materials that shadow rays see otherwise than paths: lights follow the shadow rays.

use relume_dump::Lobe;
use relume_scene::{
    Input, Material, Node, Output, Scene,
    glam::{Affine3A, Vec3},
};
use relume_trace::{TraceSettings, settings::BounceLimits};

use crate::{
    media::{coefficients, crossed, medium},
    support::*,
};

const LAMP: (Vec3, f32) = (Vec3::new(0.2, 0.1, 2.0), 0.4);

/// A floor, and the camera below where a plate is put between it and the lamp.
fn floor() -> Scene {
    let mut scene = Scene::default();
    add(&mut scene, square(0.0), Affine3A::from_scale(Vec3::splat(4.0)), diffuse(0.8));
    scene.camera = look_at_origin(Vec3::new(0.3, -0.6, 0.6), 4, 0.1);
    scene
}

fn with_plate(material: Material) -> Scene {
    let mut scene = floor();
    add(&mut scene, square(1.0), Affine3A::from_scale(Vec3::new(4.0, 4.0, 1.0)), material);
    scene
}

fn black() -> Material {
    Material { name: "black".into(), ..Material::default() }
}

fn transparent() -> Material {
    material(Node::Transparent { color: Input::Rgb([1.0; 3]) })
}

/// Black, but transparent to the rays of an output of Light Path.
fn transparent_where(output: Output) -> Material {
    let factor = Input::Link { node: 0, output };
    let nodes = vec![
        Node::LightPath,
        Node::Transparent { color: Input::Rgb([1.0; 3]) },
        Node::MixShader { factor, a: None, b: Some(1) },
    ];
    Material { name: "trick".into(), nodes, surface: Some(2), ..Material::default() }
}

fn light(scene: &Scene) -> Vec3 {
    let settings = TraceSettings { samples: 512, ..TraceSettings::default() };
    let camera = scene.camera.world_from_camera.translation.into();
    mean(&image_paths(scene, &settings), |path| {
        crossed(&Path { start: Some(path.start.unwrap_or(camera)), ..path.clone() }, LAMP.0, LAMP.1)
    })
}

#[test]
fn light_passes_what_shadow_rays_pass_and_nothing_else() {
    let open = light(&floor());
    assert!(open.x > 0.02, "{open}");
    let mut without_shadow = with_plate(black());
    without_shadow.instances[1].visible_shadow = false;
    let mut hidden_blocker = with_plate(black());
    hidden_blocker.instances[1].visible_diffuse = false;
    let opaque = Material { opaque_shadows: true, ..transparent() };
    for (name, scene, expected) in [
        ("black plate", with_plate(black()), 0.0),
        ("clear plate", with_plate(transparent()), open.x),
        ("plate without shadow", without_shadow, open.x),
        ("plate hidden from diffuse rays", hidden_blocker, 0.0),
        ("clear plate without transparent shadows", with_plate(opaque), 0.0),
        ("plate clear to shadow rays", with_plate(transparent_where(Output::IsShadowRay)), open.x),
        ("plate clear to diffuse rays", with_plate(transparent_where(Output::IsDiffuseRay)), 0.0),
    ] {
        let found = light(&scene);
        assert!((found - expected).abs().max_element() < 1e-3 * open.x, "{name}: {found}, not {expected}");
    }
}

#[test]
fn a_path_goes_on_where_it_met_what_lights_passed() {
    // Light of the second bounce: from the floor to the plate, and from there to a lamp below it.
    let lamp = (Vec3::new(0.0, 0.0, 0.5), 0.1);
    let settings = TraceSettings { samples: 1024, ..TraceSettings::default() };
    let light = |scene: &Scene| {
        let camera = scene.camera.world_from_camera.translation.into();
        mean(&image_paths(scene, &settings), |path| {
            crossed(&Path { start: Some(camera), ..path.clone() }, lamp.0, lamp.1)
        })
    };
    let scene = with_plate(diffuse(0.8));
    let mut without_shadow = scene.clone();
    without_shadow.instances[1].visible_shadow = false;
    assert_close(light(&without_shadow), light(&scene).x, 1e-3, "a lamp between floor and plate");
}

#[test]
fn lights_are_seen_through_materials_without_transparent_shadows() {
    // The camera, and a mirror, see lamps by rays of their own.
    let mut scene = with_plate(Material { opaque_shadows: true, ..transparent() });
    scene.camera = look_at_origin(Vec3::Z * 3.0, 2, 0.1);
    let settings = TraceSettings { samples: 4, ..TraceSettings::default() };
    for path in image_paths(&scene, &settings).iter().flatten() {
        let behind = path.segments[1];
        assert!(behind.continues && behind.lobe == Lobe::Camera && behind.throughput == Vec3::ONE);
    }
}

#[test]
fn objects_without_shadow_in_fog_leave_its_light_as_it_is() {
    let fog = |plate: Option<bool>| {
        let mut scene = plate.map_or_else(floor, |_| with_plate(black()));
        if let Some(visible_shadow) = plate {
            scene.instances[1].visible_shadow = visible_shadow;
        }
        let thick = medium(vec![coefficients([0.3; 3], [0.1, 0.2, 0.4])]);
        add(&mut scene, cube(), Affine3A::from_scale(Vec3::splat(3.5)), thick);
        let mut settings = TraceSettings { samples: 4096, ..TraceSettings::default() };
        // Direct light alone: what the plate scatters itself is not there without it.
        settings.paths.bounces = BounceLimits { total: 0, ..BounceLimits::default() };
        let camera = scene.camera.world_from_camera.translation.into();
        mean(&image_paths(&scene, &settings), |path| {
            crossed(&Path { start: Some(camera), ..path.clone() }, LAMP.0, LAMP.1)
        })
    };
    let open = fog(None);
    assert!(fog(Some(true)).x < 0.5 * open.x);
    assert!(((fog(Some(false)) - open) / open).abs().max_element() < 0.04, "{} {open}", fog(Some(false)));
}
