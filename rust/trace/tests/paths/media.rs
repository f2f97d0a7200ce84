//! Paths through media, beside closed forms and quadrature.

use relume_dump::{End, Lobe};
use relume_scene::{
    Camera, Input, Material, Node, PhaseFunction, Projection, Scene,
    glam::{Affine3A, Vec2, Vec3},
};
use relume_trace::{TraceSettings, settings::BounceLimits};

use crate::support::*;

const ISOTROPIC: PhaseFunction = PhaseFunction::HenyeyGreenstein { anisotropy: Input::Float(0.0) };

/// A medium without a surface.
pub fn medium(nodes: Vec<Node>) -> Material {
    let volume = Some(nodes.len() as u32 - 1);
    Material { name: "fog".into(), nodes, surface: None, volume, ..Material::default() }
}

pub fn coefficients(scatter: [f32; 3], absorption: [f32; 3]) -> Node {
    let [scatter, absorption] = [scatter, absorption].map(Input::Rgb);
    Node::VolumeCoefficients { absorption, scatter, emission: Input::Float(0.0), phase: ISOTROPIC }
}

fn fog(scatter: f32, absorption: f32) -> Material {
    medium(vec![coefficients([scatter; 3], [absorption; 3])])
}

/// An orthographic camera above the origin that looks down on a square of this width.
fn from_above(width: f32) -> Camera {
    Camera {
        projection: Projection::Orthographic,
        world_from_camera: Affine3A::from_translation(Vec3::Z * 5.0),
        width: 4,
        height: 4,
        window_min: Vec2::splat(-0.5 * width),
        window_max: Vec2::splat(0.5 * width),
        ..Camera::default()
    }
}

/// A scene of cubes of edge 2 with these media around these places, seen from above before a white world.
fn cubes(media: Vec<(Vec3, Material)>) -> Scene {
    let mut scene = Scene { camera: from_above(1.0), ..Scene::default() };
    scene.world.color = [1.0; 3];
    for (place, material) in media {
        add(&mut scene, cube(), Affine3A::from_translation(place), material);
    }
    scene
}

fn settings(samples: u32) -> TraceSettings {
    let mut settings = TraceSettings { samples, ..TraceSettings::default() };
    settings.paths.filter = relume_trace::filter::PixelFilter::Box;
    settings
}

fn many_bounces(samples: u32) -> TraceSettings {
    let mut settings = settings(samples);
    settings.paths.bounces = BounceLimits { total: 1000, volume: 1000, ..BounceLimits::default() };
    settings
}

/// Mean and standard error of a value over all paths.
fn measured(scene: &Scene, settings: &TraceSettings, value: impl Fn(&Path) -> Vec3) -> (Vec3, Vec3) {
    scene.validate().unwrap();
    let paths = image_paths(scene, settings);
    let count: usize = paths.iter().map(Vec::len).sum();
    let found = mean(&paths, &value);
    let variance = mean(&paths, |path| (value(path) - found).powf(2.0));
    (found, (variance / count as f32).map(f32::sqrt))
}

fn assert_within_noise((found, error): (Vec3, Vec3), expected: Vec3, what: &str) {
    let differs = (found - expected).abs().cmpgt(4.0 * error + 1e-5 * expected.abs()).any();
    assert!(!differs, "{what}: {found} instead of {expected}, error {error}");
    assert!(error.cmplt(0.02 * expected + 2e-3).all(), "{what}: too noisy to tell, {error}");
}

fn world_seen(path: &Path) -> Vec3 {
    path.aovs.world
}

#[test]
fn a_cube_of_fog_lets_through_what_beer_says() {
    let scene = cubes(vec![(Vec3::ZERO, fog(0.0, 0.7))]);
    let seen = measured(&scene, &settings(512), world_seen);
    assert_within_noise(seen, Vec3::splat((-1.4_f32).exp()), "absorbing cube");
    let mut open = settings(512);
    open.paths.film_transparent = true;
    let alpha = measured(&scene, &open, |path| Vec3::splat(path.aovs.alpha));
    assert_within_noise(alpha, Vec3::splat(1.0 - (-1.4_f32).exp()), "film alpha");
}

#[test]
fn overlapping_cubes_are_as_dense_as_both_together() {
    let below = Vec3::NEG_Z;
    let scene = cubes(vec![(Vec3::ZERO, fog(0.0, 0.3)), (below, fog(0.0, 0.5)), (below, fog(0.0, 0.1))]);
    // 2 m of the first, 2 m of the others.
    let seen = measured(&scene, &settings(512), world_seen);
    assert_within_noise(seen, Vec3::splat((-1.8_f32).exp()), "overlapping cubes");
}

#[test]
fn cubes_side_by_side_are_both_entered() {
    let scene = cubes(vec![(Vec3::Z, fog(0.0, 0.3)), (Vec3::NEG_Z, fog(0.0, 0.4))]);
    let seen = measured(&scene, &settings(512), world_seen);
    assert_within_noise(seen, Vec3::splat((-1.4_f32).exp()), "cubes that share a face");
}

#[test]
fn a_camera_inside_of_a_cube_is_in_its_medium() {
    for (height, length) in [(0.25, 1.25), (2.5, 2.0)] {
        let mut scene = cubes(vec![(Vec3::ZERO, fog(0.0, 0.7))]);
        scene.camera.world_from_camera = Affine3A::from_translation(Vec3::Z * height);
        // A sheet above that the ray upwards meets, too.
        add(&mut scene, square(3.0), Affine3A::IDENTITY, diffuse(0.5));
        let seen = measured(&scene, &settings(512), world_seen);
        assert_within_noise(seen, Vec3::splat((-0.7 * length as f32).exp()), "camera inside or outside");
    }
}

#[test]
fn channels_are_dimmed_each_by_its_own_extinction() {
    let absorption = [0.2, 0.7, 1.5];
    let scene = cubes(vec![(Vec3::ZERO, medium(vec![coefficients([0.0; 3], absorption)]))]);
    let seen = measured(&scene, &settings(2048), world_seen);
    assert_within_noise(seen, Vec3::from(absorption.map(|a| (-2.0 * a).exp())), "coloured liquid");
    for path in image_paths(&scene, &settings(8)).iter().flatten() {
        let continues: Vec<bool> = path.segments.iter().map(|segment| segment.continues).collect();
        assert!(!continues[0] && continues[1..].iter().all(|continues| *continues), "{continues:?}");
    }
}

#[test]
fn white_media_in_a_white_world_are_not_seen() {
    let coloured = medium(vec![coefficients([0.3, 1.0, 2.0], [0.0; 3])]);
    let droplets = medium(vec![Node::VolumeScatter {
        color: Input::Float(1.0),
        density: Input::Float(1.5),
        phase: PhaseFunction::Mie { diameter: Input::Float(2.0) },
    }]);
    for (material, what) in [(fog(1.5, 0.0), "grey"), (coloured, "coloured"), (droplets, "droplets")] {
        let scene = cubes(vec![(Vec3::ZERO, material)]);
        assert_within_noise(measured(&scene, &many_bounces(256), world_seen), Vec3::ONE, what);
    }
}

#[test]
fn media_that_overlap_more_than_a_stack_holds_are_named() {
    let crowd =
        |count: usize| cubes((0..count).map(|i| (Vec3::X * 1e-3 * i as f32, fog(0.0, 0.01))).collect());
    let warnings =
        |scene: &Scene| relume_trace::Tracer::new(scene, &settings(1)).unwrap().warnings().to_vec();
    assert!(warnings(&crowd(32)).is_empty());
    let [warning] = &warnings(&crowd(33))[..] else { panic!("one warning") };
    assert!(warning.contains("32 volumes"), "{warning}");
}

#[test]
fn glass_with_a_medium_inside_is_entered_by_refraction_alone() {
    let glass = Node::Glass {
        color: Input::Float(1.0),
        roughness: Input::Float(0.0),
        ior: Input::Float(1.5),
        normal: None,
        distribution: relume_scene::Distribution::Ggx,
        anisotropy: None,
        rotation: None,
        tangent: None,
        film: None,
    };
    let mut material = medium(vec![coefficients([0.0; 3], [0.5; 3]), glass]);
    (material.surface, material.volume) = (Some(1), Some(0));
    let scene = cubes(vec![(Vec3::ZERO, material)]);
    let mut settings = settings(2048);
    settings.paths.bounces =
        BounceLimits { total: 200, glossy: 200, transmission: 200, ..BounceLimits::default() };
    // Reflected to and fro: R + (1-R)^2 t / (1 - R t), R of the surface, t of the way through.
    let (r, t) = (0.04_f32, (-1.0_f32).exp());
    let back = r + (1.0 - r).powi(2) * r * t * t / (1.0 - r * r * t * t);
    let through = (1.0 - r).powi(2) * t / (1.0 - r * r * t * t);
    assert_within_noise(measured(&scene, &settings, world_seen), Vec3::splat(back + through), "filled glass");
}

/// Light of a small sphere of radiance 1 that is scattered once along the rays of the camera.
fn scattered_once(scene: &Scene, center: Vec3, radius: f32, samples: u32) -> (Vec3, Vec3) {
    measured(scene, &settings(samples), |path| {
        let mut origin = path.start.unwrap();
        let mut sum = Vec3::ZERO;
        for segment in &path.segments {
            let (direction, length, next) = match segment.end {
                End::Vertex(end) => ((end - origin).normalize_or(Vec3::Z), origin.distance(end), end),
                End::Escape(direction) => (direction, f32::INFINITY, origin),
            };
            let along = (center - origin).dot(direction);
            let apart = (center - origin - direction * along).length_squared();
            if segment.lobe == Lobe::Volume && apart < radius * radius && along > 0.0 && along < length {
                sum += segment.throughput;
            }
            origin = next;
        }
        sum
    })
}

/// Quadrature of the same: density at a height, and optical depth between two points, are asked for.
fn single_scattering(
    center: Vec3,
    radius: f32,
    [top, bottom]: [f32; 2],
    scattering: impl Fn(f32) -> f32,
    depth: impl Fn(Vec3, Vec3) -> f32,
) -> f32 {
    let steps = 4000;
    let step = (top - bottom) / steps as f32;
    let at = |i: usize| {
        let place = Vec3::Z * (top - (i as f32 + 0.5) * step);
        let distance = center.distance(place);
        let solid = std::f32::consts::TAU * (1.0 - (1.0 - (radius / distance).powi(2)).sqrt());
        let dimmed = (-depth(Vec3::Z * top, place) - depth(place, center)).exp();
        scattering(place.z) * dimmed * solid / (2.0 * std::f32::consts::TAU) * step
    };
    (0..steps).map(at).sum()
}

#[test]
fn single_scattering_of_a_lamp_equals_its_integral() {
    let (center, radius) = (Vec3::new(0.6, 0.0, 0.2), 0.15);
    let mut scene = cubes(vec![(Vec3::ZERO, fog(0.4, 0.3))]);
    scene.camera = Camera { width: 1, height: 1, ..from_above(0.01) };
    scene.lights = vec![sphere_light(center, radius)];
    let found = scattered_once(&scene, center, radius, 200_000);
    let expected = single_scattering(center, radius, [1.0, -1.0], |_| 0.4, |a, b| 0.7 * a.distance(b));
    assert_within_noise(found, Vec3::splat(expected), "single scattering");
}

/// A medium whose density grows linearly from the bottom of the cube (0) to its top.
fn ramp(density: f32) -> Material {
    let link = |node, output| Input::Link { node, output };
    let coordinates = Node::TextureCoordinate { kind: relume_scene::TexCoord::Generated };
    let height = Node::SeparateXyz { vector: link(0, relume_scene::Output::Vector) };
    let scaled = Node::Math {
        operation: relume_scene::MathOp::Multiply,
        clamp: false,
        a: link(1, relume_scene::Output::Z),
        b: Input::Float(density),
        c: Input::Float(0.0),
    };
    medium(vec![
        coordinates,
        height,
        scaled,
        Node::VolumeScatter {
            color: Input::Float(1.0),
            density: link(2, relume_scene::Output::Value),
            phase: ISOTROPIC,
        },
    ])
}

#[test]
fn varying_density_equals_its_integral() {
    let (center, radius) = (Vec3::new(0.6, 0.0, 0.2), 0.15);
    let mut scene = cubes(vec![(Vec3::ZERO, ramp(1.2))]);
    scene.camera = Camera { width: 1, height: 1, ..from_above(0.01) };
    scene.lights = vec![sphere_light(center, radius)];
    let found = scattered_once(&scene, center, radius, 200_000);
    // Density 0.6 (1 + z); its mean along a straight way is that of the ends.
    let density = |z: f32| 0.6 * (1.0 + z);
    let depth = |a: Vec3, b: Vec3| 0.5 * (density(a.z) + density(b.z)) * a.distance(b);
    let expected = single_scattering(center, radius, [1.0, -1.0], density, depth);
    assert_within_noise(found, Vec3::splat(expected), "single scattering in a ramp");
    scene.lights.clear();
    scene.materials[0] = {
        let mut dark = ramp(1.2);
        dark.nodes[3] = Node::VolumeAbsorption {
            color: Input::Float(0.0),
            density: Input::Link { node: 2, output: relume_scene::Output::Value },
        };
        dark
    };
    let seen = measured(&scene, &settings(20_000), world_seen);
    assert_within_noise(seen, Vec3::splat((-1.2_f32).exp()), "absorbing ramp");
}

#[test]
fn emission_along_the_way_is_summed() {
    let glow = Node::Emission { color: Input::Rgb([1.0, 0.5, 0.25]), strength: Input::Float(2.0) };
    let both = Node::AddShader { a: Some(0), b: Some(1) };
    let mut scene =
        cubes(vec![(Vec3::ZERO, medium(vec![glow.clone(), coefficients([0.0; 3], [0.8; 3]), both]))]);
    scene.world.color = [0.0; 3];
    let glowing = |path: &Path| path.aovs.emission;
    let expected = Vec3::new(2.0, 1.0, 0.5) * (1.0 - (-1.6_f32).exp()) / 0.8;
    assert_within_noise(measured(&scene, &settings(2048), glowing), expected, "glowing fog");
    scene.materials[0] = medium(vec![glow]);
    assert_within_noise(measured(&scene, &settings(16), glowing), Vec3::new(4.0, 2.0, 1.0), "glow alone");
}

#[test]
fn light_of_an_emitter_is_dimmed_on_its_way_to_and_from_a_floor() {
    // A lamp above the fog, a floor within it: what is sampled directly is dimmed as what is met by chance.
    let glow = Node::Emission { color: Input::Float(1.0), strength: Input::Float(1.0) };
    for material in [fog(0.0, 0.6), ramp_absorbing()] {
        let mut scene = cubes(vec![(Vec3::ZERO, material)]);
        scene.world.color = [0.0; 3];
        add(&mut scene, square(-0.5), Affine3A::from_scale(Vec3::new(3.0, 3.0, 1.0)), diffuse(0.8));
        let lamp = Affine3A::from_translation(Vec3::new(3.0, 0.0, 3.0))
            * Affine3A::from_rotation_y(std::f32::consts::FRAC_PI_2);
        add(&mut scene, square(0.0), lamp, crate::support::material(glow.clone()));
        let light = |path: &Path| path.aovs.emission;
        let sampled = measured(&scene, &settings(4096), light);
        let mut by_chance = settings(20_000);
        by_chance.paths.sample_static_lights = false;
        let met = measured(&scene, &by_chance, light);
        let error = (sampled.1.powf(2.0) + met.1.powf(2.0)).map(f32::sqrt);
        assert!((sampled.0 - met.0).abs().cmple(4.0 * error).all(), "{sampled:?} {met:?}");
        assert!(error.max_element() < 0.04 * met.0.x, "{error}");
    }
}

fn ramp_absorbing() -> Material {
    let mut dark = ramp(1.2);
    let density = Input::Link { node: 2, output: relume_scene::Output::Value };
    dark.nodes[3] = Node::VolumeAbsorption { color: Input::Float(0.0), density };
    dark
}

#[test]
fn fog_of_all_space_lets_no_world_through_and_records_what_is_near() {
    let (center, radius) = (Vec3::new(1.5, 0.0, -1.0), 0.3);
    let mut scene = Scene { camera: Camera { width: 1, height: 1, ..from_above(0.01) }, ..Scene::default() };
    add(&mut scene, square(-2.0), Affine3A::from_scale(Vec3::new(2.0, 2.0, 1.0)), diffuse(0.0));
    scene.materials.push(fog(0.05, 0.0));
    scene.world = relume_scene::World { color: [1.0; 3], volume: Some(1), ..relume_scene::World::default() };
    scene.lights = vec![sphere_light(center, radius)];
    let found = scattered_once(&scene, center, radius, 200_000);
    let expected = single_scattering(center, radius, [5.0, -2.0], |_| 0.05, |a, b| 0.05 * a.distance(b));
    assert_within_noise(found, Vec3::splat(expected), "world fog");
    // The world is seen by nobody, and positions stay near however far paths go.
    let mut settings = many_bounces(256);
    settings.paths.sample_static_lights = false;
    for path in image_paths(&scene, &settings).iter().flatten() {
        assert_eq!(path.aovs.world, Vec3::ZERO);
        for segment in &path.segments {
            let End::Vertex(end) = segment.end else { panic!("it escapes") };
            assert!(end.abs().max_element() < 20.0, "{end}");
        }
    }
}

#[test]
fn paths_that_leave_the_recorded_box_come_back_with_all_they_carry() {
    // Thin fog and a lamp: most of what is scattered twice goes far away. Two scenes whose boxes differ give the same light.
    let (center, radius) = (Vec3::new(0.0, 0.0, 2.0), 0.5);
    let measured = |width: f32| {
        let mut scene =
            Scene { camera: Camera { width: 1, height: 1, ..from_above(0.01) }, ..Scene::default() };
        add(&mut scene, square(-width), Affine3A::from_scale(Vec3::new(1e-3, 1e-3, 1.0)), diffuse(0.0));
        scene.materials.push(fog(0.2, 0.0));
        scene.world = relume_scene::World { volume: Some(1), ..relume_scene::World::default() };
        scene.camera.world_from_camera.translation.x = 1.0;
        let mut settings = many_bounces(100_000);
        settings.paths.bounces.volume = 3;
        measured(&scene, &settings, |path| crossed(path, center, radius))
    };
    let (near, far) = (measured(0.5), measured(60.0));
    let error = (near.1.powf(2.0) + far.1.powf(2.0)).map(f32::sqrt);
    assert!((near.0 - far.0).abs().cmple(4.0 * error).all(), "{near:?} {far:?}");
    assert!(error.x < 0.04 * far.0.x, "{error}");
}

/// Light of a sphere of radiance 1 that a path collects, the camera's own ray apart.
pub fn crossed(path: &Path, center: Vec3, radius: f32) -> Vec3 {
    let mut origin = path.start.unwrap();
    let mut sum = Vec3::ZERO;
    for segment in &path.segments {
        let (direction, length, next) = match segment.end {
            End::Vertex(end) => ((end - origin).normalize_or(Vec3::Z), origin.distance(end), end),
            End::Escape(direction) => (direction, f32::INFINITY, origin),
        };
        let along = (center - origin).dot(direction);
        let reach = radius * radius - (center - origin - direction * along).length_squared();
        if reach > 0.0 && segment.lobe != Lobe::Camera {
            // A sphere is met where it is entered; from inside, where it is left.
            let (enter, exit) = (along - reach.sqrt(), along + reach.sqrt());
            if (enter > 0.0 && enter < length) || (enter <= 0.0 && exit > 0.0 && exit < length) {
                sum += segment.throughput;
            }
        }
        origin = next;
    }
    sum
}
