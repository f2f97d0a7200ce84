//! Paths through bodies.

use relume_dump::{End, Segment};
use relume_scene::{
    AlbedoInversion, Input, Instance, Material, Node, Scene, Subsurface, SubsurfaceMethod, SubsurfaceModel,
    glam::{Affine3A, Vec3},
};
use relume_trace::TraceSettings;

use crate::support::*;

const WALK: SubsurfaceModel = SubsurfaceModel {
    method: SubsurfaceMethod::Walk,
    inversion: AlbedoInversion::VanDeHulst,
    radius_factor: 1.0,
    anisotropy_limits: [-0.99, 0.99],
    least_footprint: 0.0,
    is_first_only: false,
};

fn node(color: [f32; 3], radius: [f32; 3], model: SubsurfaceModel) -> Node {
    Node::SubsurfaceScattering {
        color: Input::Rgb(color),
        roughness: Input::Float(1.0),
        normal: None,
        subsurface: Subsurface {
            radius: Input::Rgb(radius),
            scale: Input::Float(1.0),
            ior: Input::Float(1.4),
            anisotropy: Input::Float(0.0),
            model,
        },
    }
}

fn body(albedo: f32, radius: f32, model: SubsurfaceModel) -> Material {
    material(node([albedo; 3], [radius; 3], model))
}

fn white_world() -> Scene {
    let mut scene = Scene::default();
    scene.world.color = [1.0; 3];
    scene
}

fn settings(samples: u32) -> TraceSettings {
    TraceSettings { samples, ..TraceSettings::default() }
}

/// Segments through bodies, which collect nothing: their numbers, and where they end.
fn ways_inside(path: &Path) -> Vec<(usize, Vec3)> {
    let ends = path.segments.iter().enumerate().filter(|(_, segment)| segment.throughput == Vec3::ZERO);
    let vertex = |(number, segment): (usize, &Segment)| match segment.end {
        End::Vertex(vertex) => (number, vertex),
        End::Escape(_) => panic!("a body in nowhere"),
    };
    ends.map(vertex).collect()
}

/// Spheres of radius 1 in a white world, as Cycles of Blender 5.3 renders them with 256 samples: method, how the inside
/// follows, albedo, mean free path, brightness and its standard error. What walks for too long is lost, and Burley's
/// profile does not know of bends.
#[test]
fn spheres_are_as_bright_as_in_cycles() {
    use AlbedoInversion::{Polynomial, VanDeHulst};
    use SubsurfaceMethod::{Disk, Skin, Walk};
    for (method, inversion, albedo, radius, expected, error) in [
        (Walk, VanDeHulst, 1.0, 0.05, 0.9769, 0.0009),
        (Walk, VanDeHulst, 1.0, 2.0, 0.9993, 0.0002),
        (Walk, VanDeHulst, 0.8, 0.005, 0.7738, 0.0010),
        (Walk, VanDeHulst, 0.8, 0.3, 0.9512, 0.0003),
        (Walk, Polynomial, 0.8, 0.005, 0.7863, 0.0010),
        (Walk, Polynomial, 0.8, 0.3, 0.9569, 0.0002),
        (Skin, Polynomial, 0.8, 0.005, 0.7952, 0.0011),
        (Skin, Polynomial, 0.8, 0.3, 0.8197, 0.0009),
        (Skin, Polynomial, 0.8, 2.0, 0.9237, 0.0013),
        (Disk, Polynomial, 0.8, 0.005, 0.8009, 0.0001),
        (Disk, Polynomial, 0.8, 0.3, 0.8916, 0.0021),
        (Disk, Polynomial, 0.8, 2.0, 0.4326, 0.0029),
    ] {
        let mut scene = white_world();
        let model = SubsurfaceModel { method, inversion, ..WALK };
        add(&mut scene, sphere(), Affine3A::IDENTITY, body(albedo, radius, model));
        scene.camera = look_at_origin(Vec3::new(0.0, 0.0, 4.0), 8, 0.2);
        let paths = image_paths(&scene, &settings(64));
        let found = mean(&paths, |path| path.aovs.world).x;
        let pixels = paths.iter().map(|pixel| mean(std::slice::from_ref(pixel), |path| path.aovs.world).x);
        let variance = pixels.map(|pixel| (pixel - found).powi(2)).sum::<f32>() / 63.0;
        let own_error = (variance / 64.0).sqrt();
        let allowed = 3.0 * f32::hypot(error, own_error);
        assert!((found - expected).abs() < allowed, "{method:?} {inversion:?} {albedo} {radius}: {found}");
    }
}

#[test]
fn placed_and_mirrored_bodies_look_alike() {
    let look = |scale: Vec3, instances: usize| {
        let mut scene = white_world();
        add(&mut scene, sphere(), Affine3A::from_scale(scale), body(0.8, 0.3, WALK));
        for other in 1..instances {
            let place = Affine3A::from_translation(Vec3::Z * -10.0 * other as f32);
            scene.instances.push(Instance::new("far", 0, place, vec![0]));
        }
        scene.camera = look_at_origin(Vec3::new(0.0, 0.0, 4.0), 8, 0.2);
        mean(&image_paths(&scene, &settings(256)), |path| path.aovs.world)
    };
    let plain = look(Vec3::ONE, 1);
    for (scale, instances) in [(Vec3::ONE, 2), (Vec3::new(-1.0, 1.0, 1.0), 1), (Vec3::new(1.0, 1.0, -1.0), 2)]
    {
        assert_close(look(scale, instances), plain.x, 0.01, &format!("{scale}, {instances} instances"));
    }
}

#[test]
fn bodies_that_touch_share_no_light_inside() {
    let mut scene = white_world();
    for (x, receiver) in [(-1.0, 0), (1.0, 1)] {
        add(&mut scene, cube(), Affine3A::from_translation(Vec3::X * x), body(0.9, 1.0, WALK));
        scene.instances[usize::from(receiver)].receiver = receiver;
    }
    scene.camera = look_at_origin(Vec3::new(-1.0, -6.0, 1.0), 8, 0.2);
    let mut exits = 0;
    for path in image_paths(&scene, &settings(64)).iter().flatten() {
        for (number, exit) in ways_inside(path) {
            exits += 1;
            let End::Vertex(entered) = path.segments[number - 1].end else { panic!("a body in nowhere") };
            let side = |vertex: Vec3| vertex.x > 0.0;
            // A vertex in the common face belongs to either.
            if entered.x.abs() > 1e-3 && exit.x.abs() > 1e-3 {
                assert_eq!(side(entered), side(exit), "{entered} to {exit}");
            }
            if let Some(segment) = path.segments.get(number + 1) {
                assert!(exit.x.abs() < 1e-3 || usize::from(segment.receiver) == usize::from(side(exit)));
            }
        }
    }
    assert!(exits > 1000, "{exits}");
}

#[test]
fn paths_leave_closed_bodies_on_their_surface() {
    let mut scene = white_world();
    add(&mut scene, sphere(), Affine3A::IDENTITY, body(1.0, 0.2, WALK));
    scene.camera = look_at_origin(Vec3::new(0.0, 0.0, 4.0), 8, 0.2);
    let paths = image_paths(&scene, &settings(256));
    let ended = paths.iter().flatten().filter(|path| ways_inside(path).is_empty()).count();
    // Of 16384, some come in from below the coarse mesh's horizon, and some walk too long.
    assert!(ended < 100, "{ended} paths ended inside");
    for (_, exit) in paths.iter().flatten().flat_map(ways_inside) {
        assert!(exit.length() < 1.001 && exit.length() > 0.98, "{exit}");
    }
}

#[test]
fn open_meshes_end_paths() {
    let mut scene = white_world();
    add(&mut scene, square(0.0), Affine3A::IDENTITY, body(0.9, 0.5, WALK));
    scene.camera = look_at_origin(Vec3::new(0.0, 0.0, 4.0), 8, 0.2);
    for path in image_paths(&scene, &settings(64)).iter().flatten() {
        assert!(path.aovs.world.is_finite());
        for (_, exit) in ways_inside(path) {
            assert!(exit.z.abs() < 1e-4);
        }
    }
}

#[test]
fn channels_without_radius_are_diffuse() {
    let mut scene = white_world();
    let marble = material(node([0.8, 0.6, 0.4], [0.1, 0.0, 0.1], WALK));
    add(&mut scene, sphere(), Affine3A::IDENTITY, marble);
    scene.camera = look_at_origin(Vec3::new(0.0, 0.0, 4.0), 8, 0.2);
    let paths = image_paths(&scene, &settings(256));
    for path in paths.iter().flatten() {
        let scatters = !ways_inside(path).is_empty();
        for Segment { throughput, .. } in path.segments[1..].iter().filter(|s| s.throughput != Vec3::ZERO) {
            assert_eq!((throughput.x + throughput.z > 0.0, throughput.y > 0.0), (scatters, !scatters));
        }
    }
    let green = mean(&paths, |path| path.aovs.world).y;
    assert!((green - 0.6).abs() < 0.01, "{green}");
}

#[test]
fn paths_that_were_scattered_before_find_some_bodies_diffuse() {
    let walks = |is_first_only: bool| {
        let mut scene = white_world();
        let model = SubsurfaceModel { is_first_only, ..WALK };
        add(&mut scene, cube(), Affine3A::IDENTITY, body(0.9, 0.1, model));
        // From inside, every path meets the cube again and again.
        scene.camera = look_at_origin(Vec3::new(0.1, -0.5, 0.2), 4, 0.2);
        let paths = image_paths(&scene, &settings(64));
        paths.iter().flatten().map(|path| ways_inside(path).len()).max()
    };
    assert_eq!(walks(true), Some(1));
    assert!(walks(false) > Some(1));
}
