//! The purpose of it all: gather(dump, light) is what tracing with that light gives. A glowing mesh is traced as part of the
//! scene; then the same mesh is black, paths are dumped, and a virtual light of its shape is added up. Both traces
//! take the same random numbers, so their paths are the same, and pixels may differ by packing alone.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

use glam::{Affine3A, Quat, Vec2, Vec3};
use relume_dump::{Dump, MemoryWriter};
use relume_gather::{Gather, SampleSplit, SoftGather};
use relume_image::Image;
use relume_scene::{
    Camera, Input, Instance, LANES, Light, LightShape, LobeFactors, Material, Mesh, Node, Scene,
};
use relume_trace::{Control, TraceSettings, Tracer};

const CENTER: Vec3 = Vec3::new(0.3, 0.2, 0.25);
const RADIUS: f32 = 0.3;

fn material(node: Node) -> Material {
    Material { name: "test".into(), nodes: vec![node], surface: Some(0), ..Material::default() }
}

fn diffuse(albedo: f32) -> Material {
    material(Node::Diffuse {
        color: Input::Rgb([albedo; 3]),
        roughness: Input::Float(0.0),
        multiple_scattering: Default::default(),
        normal: None,
    })
}

fn glow() -> Material {
    material(Node::Emission { color: Input::Rgb([1.0; 3]), strength: Input::Float(1.0) })
}

/// A grid of `columns` x `rows` quads over the unit square, placed by a map.
fn surface(columns: u32, rows: u32, place: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let point = |column: u32, row: u32| place(column as f32 / columns as f32, row as f32 / rows as f32);
    let mut mesh = Mesh { name: "surface".into(), ..Mesh::default() };
    for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
        let first = mesh.positions.len() as u32;
        let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(dx, dy)| point(column + dx, row + dy));
        mesh.positions.extend(corners);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh
}

/// Fine enough that its outline is that of the sphere to 0.01 %.
fn ball() -> Mesh {
    surface(512, 256, |u, v| {
        let ((sin_u, cos_u), (sin_v, cos_v)) =
            ((std::f32::consts::TAU * u).sin_cos(), (std::f32::consts::PI * v).sin_cos());
        CENTER + Vec3::new(sin_v * cos_u, sin_v * sin_u, cos_v) * RADIUS
    })
}

fn pane() -> Mesh {
    surface(1, 1, |u, v| CENTER + Vec3::new(u - 0.5, v - 0.5, 0.0))
}

fn room() -> Vec<Mesh> {
    let walls = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|normal| [normal, -normal]);
    walls
        .map(|normal| {
            let u = normal.any_orthonormal_vector();
            let v = normal.cross(u);
            surface(1, 1, |s, t| normal + u * (2.0 * s - 1.0) + v * (2.0 * t - 1.0))
        })
        .collect()
}

fn scene(lamp: Mesh, lamp_material: Material) -> Scene {
    let mut scene = Scene { materials: vec![diffuse(0.6), lamp_material], ..Scene::default() };
    for (mesh, material) in room().into_iter().map(|mesh| (mesh, 0)).chain([(lamp, 1)]) {
        let index = scene.meshes.len();
        scene.instances.push(Instance::new(format!("{index}"), index, Affine3A::IDENTITY, vec![material]));
        scene.meshes.push(mesh);
    }
    // From a corner of the floor up to the middle.
    let position = Vec3::new(-0.8, -0.9, -0.7);
    let rotation = Quat::from_rotation_arc(Vec3::NEG_Z, -position.normalize());
    scene.camera = Camera {
        world_from_camera: Affine3A::from_rotation_translation(rotation, position),
        width: 16,
        height: 16,
        window_min: Vec2::splat(-0.8),
        window_max: Vec2::splat(0.8),
        ..Camera::default()
    };
    scene
}

fn trace(scene: &Scene, samples: u32) -> Dump {
    let mut settings = TraceSettings { samples, ..TraceSettings::default() };
    settings.paths.sample_static_lights = false;
    let tracer = Tracer::new(scene, &settings).unwrap();
    let sink = MemoryWriter::new(tracer.manifest()).unwrap();
    tracer.trace(&sink, &Control::default()).unwrap();
    sink.snapshot()
}

fn lamp(shape: LightShape, lobes: LobeFactors) -> Light {
    Light { name: "lamp".into(), lobes, ..Light::unit(shape) }
}

fn gathered(dump: Dump, shapes: &[LightShape]) -> Image {
    let gather = Gather::new(dump);
    let lobes = LobeFactors { camera: 1.0, ..LobeFactors::default() };
    let lights = shapes.iter().map(|&shape| lamp(shape, lobes)).collect::<Vec<_>>();
    let lights = gather.prepare_all(&lights).unwrap();
    let images = gather.unit_images(&lights, SampleSplit::All);
    relume_gather::relight((16, 16), &images.iter().map(|image| (image, [1.0; 3])).collect::<Vec<_>>())
}

fn compare(lamp: Mesh, shapes: &[LightShape]) {
    let traced = trace(&scene(lamp.clone(), glow()), 256).aovs().emission;
    let gathered = gathered(trace(&scene(lamp, diffuse(0.0)), 256), shapes);
    let mean = |image: &Image| image.data.iter().sum::<f32>() / image.data.len() as f32;
    assert!(mean(&traced) > 0.05, "the lamp lights nothing: {}", mean(&traced));
    assert!((mean(&gathered) / mean(&traced) - 1.0).abs() < 1e-3, "{} {}", mean(&gathered), mean(&traced));
    let mut differences: Vec<_> = std::iter::zip(&gathered.data, &traced.data)
        .map(|(a, b)| (a - b).abs() / (a.max(*b) + 0.01 * mean(&traced)))
        .collect();
    differences.sort_by(f32::total_cmp);
    let [median, p95] = [50, 95].map(|percent| differences[differences.len() * percent / 100]);
    assert!(median < 2e-3 && p95 < 1e-2, "median {median}, 95th percentile {p95}");
}

#[test]
fn a_gathered_sphere_is_the_traced_sphere() {
    // Around the mesh by more than the rounding of stored positions, 2 m / 131070.
    compare(ball(), &[LightShape::Sphere { center: CENTER, radius: RADIUS * 1.0001 }]);
}

#[test]
fn two_gathered_quads_back_to_back_are_the_traced_pane() {
    let quad = |side: f32| LightShape::Quad {
        center: CENTER + Vec3::Z * side * 1e-4,
        edge_u: Vec3::X,
        edge_v: Vec3::Y * side,
        spread: std::f32::consts::PI,
    };
    compare(pane(), &[quad(1.0), quad(-1.0)]);
}

/// Means of the green channel over the four quarters of a picture.
fn quarters(image: &Image) -> [f32; 4] {
    [0, 1, 2, 3].map(|cell| {
        let pixels = (0..64).map(|p| image.pixel(cell % 2 * 8 + p % 8, cell / 2 * 8 + p / 8)[1]);
        pixels.sum::<f32>() / 64.0
    })
}

/// Against central differences of the exact gather over 5 cm or 0.05 radians, root mean square over the quarters of the
/// picture: to 5 %, and to the noise of both with 130 000 paths in a quarter (halved by four times as many).
#[test]
fn smoothed_slopes_tell_how_the_traced_picture_changes() {
    const STEP: f32 = 0.05;
    // The black pane lies outside of the room.
    let outside = surface(1, 1, |u, v| Vec3::new(u, v, 9.0));
    let gather = Gather::new(trace(&scene(outside, diffuse(0.0)), 2048));
    let soft = SoftGather::new(&gather, 8);
    let (edge_u, edge_v, spread) = (Vec3::X * 0.8, Vec3::NEG_Y * 0.6, std::f32::consts::PI);
    let (axis, half_angle, blend, soft_falloff) = (Vec3::NEG_Z, 0.8, 0.3, true);
    let shapes = [
        LightShape::Sphere { center: CENTER, radius: RADIUS },
        LightShape::Spot { center: CENTER, radius: RADIUS, axis, half_angle, blend, soft_falloff },
        LightShape::Quad { center: CENTER, edge_u, edge_v, spread },
    ];
    for (shape, lane) in shapes.iter().flat_map(|shape| (0..LANES).map(move |lane| (shape, lane))) {
        let exact = |by: f32| {
            let mut step = [0.0; LANES];
            step[lane] = by;
            let moved = lamp(shape.moved(&step), LobeFactors::default());
            quarters(&gather.unit_images(&[gather.prepare(&moved).unwrap()], SampleSplit::All)[0])
        };
        let (above, below) = (exact(STEP), exact(-STEP));
        let lamp = lamp(*shape, LobeFactors::default());
        let slopes = soft.linearise(&lamp, 0.02, &[0, 1, 2, 3]).unwrap().slopes;
        let change = |cell: usize| (above[cell] - below[cell]) / (2.0 * STEP);
        let norm = (0..4).map(|cell| change(cell).powi(2)).sum::<f32>().sqrt();
        let error = (0..4).map(|cell| (slopes[cell][lane][1] - change(cell)).powi(2)).sum::<f32>().sqrt();
        assert!(error <= 0.05 * norm + 4e-3, "{shape:?}, lane {lane}: {error} of {norm}");
    }
}
