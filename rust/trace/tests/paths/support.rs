//! Small scenes and a sink that keeps paths.

use relume_dump::{AovSample, Pass, Segment};
use relume_scene::{
    Camera, Input, Instance, Light, LightShape, Material, Mesh, Node, Scene,
    glam::{Affine3A, Quat, Vec2, Vec3},
};
use relume_trace::{PathScratch, PathSink, TraceSettings, Tracer};

/// One path as the tracer gave it.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    pub start: Option<Vec3>,
    pub segments: Vec<Segment>,
    pub aovs: AovSample,
}

#[derive(Default)]
pub struct Recorder(pub Vec<Path>);

impl PathSink for Recorder {
    fn begin_path(&mut self, camera_vertex: Option<Vec3>) {
        self.0.push(Path { start: camera_vertex, segments: Vec::new(), aovs: AovSample::default() });
    }

    fn push(&mut self, segment: Segment) {
        self.0.last_mut().unwrap().segments.push(segment);
    }

    fn end_path(&mut self, aovs: AovSample) {
        self.0.last_mut().unwrap().aovs = aovs;
    }
}

pub fn pixel_paths(tracer: &Tracer, x: usize, y: usize, samples: std::ops::Range<u32>) -> Vec<Path> {
    let mut recorder = Recorder::default();
    let pass = Pass { first_sample: samples.start, samples: samples.end - samples.start };
    tracer.trace_pixel(x, y, pass, &mut PathScratch::default(), &mut recorder);
    recorder.0
}

/// All paths of the image, pixel by pixel.
pub fn image_paths(scene: &Scene, settings: &TraceSettings) -> Vec<Vec<Path>> {
    let tracer = Tracer::new(scene, settings).unwrap();
    let pixels = (0..scene.camera.height).flat_map(|y| (0..scene.camera.width).map(move |x| (x, y)));
    pixels.map(|(x, y)| pixel_paths(&tracer, x, y, 0..settings.samples)).collect()
}

/// Mean of a value over all paths.
pub fn mean(paths: &[Vec<Path>], value: impl Fn(&Path) -> Vec3) -> Vec3 {
    let count: usize = paths.iter().map(Vec::len).sum();
    let sum: Vec3 = paths.iter().flatten().map(value).sum();
    sum / count as f32
}

/// Checks a mean to within a share of it.
pub fn assert_close(found: Vec3, expected: f32, share: f32, what: &str) {
    assert!(
        (found - expected).abs().max_element() <= share * expected.abs(),
        "{what}: {found} instead of {expected}"
    );
}

pub fn material(node: Node) -> Material {
    Material { name: "test".into(), nodes: vec![node], surface: Some(0), ..Material::default() }
}

pub fn diffuse(albedo: f32) -> Material {
    material(Node::Diffuse {
        color: Input::Rgb([albedo; 3]),
        roughness: Input::Float(0.0),
        multiple_scattering: Default::default(),
        normal: None,
    })
}

/// A mesh of the 6 sides of a cube of edge 2 around the origin; normals outwards.
pub fn cube() -> Mesh {
    let mut mesh = Mesh { name: "cube".into(), ..Mesh::default() };
    for (normal, u) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)]
        .into_iter()
        .flat_map(|(n, u)| [(n, u), (-n, u)])
    {
        let v = normal.cross(u);
        add_quad(&mut mesh, [normal - u - v, normal + u - v, normal + u + v, normal - u + v]);
    }
    mesh
}

pub fn add_quad(mesh: &mut Mesh, corners: [Vec3; 4]) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(corners);
    mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
}

/// A horizontal square of edge 2 at `z`, facing up.
pub fn square(z: f32) -> Mesh {
    let mut mesh = Mesh { name: "square".into(), ..Mesh::default() };
    let corner = |x: f32, y: f32| Vec3::new(x, y, z);
    add_quad(&mut mesh, [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    mesh
}

/// A sphere of radius 1 with smooth normals.
pub fn sphere() -> Mesh {
    let mut mesh = Mesh { name: "sphere".into(), ..Mesh::default() };
    let (columns, rows) = (48_u32, 24_u32);
    let point = |column: u32, row: u32| {
        let (sin_t, cos_t) = (std::f32::consts::PI * row as f32 / rows as f32).sin_cos();
        let (sin_p, cos_p) = (std::f32::consts::TAU * (column % columns) as f32 / columns as f32).sin_cos();
        Vec3::new(sin_t * cos_p, sin_t * sin_p, cos_t)
    };
    for row in 0..rows {
        for column in 0..columns {
            let [a, b] = [row, row + 1].map(|row| [point(column, row), point(column + 1, row)]);
            for triangle in [[a[0], b[0], b[1]], [a[0], b[1], a[1]]] {
                let first = mesh.positions.len() as u32;
                mesh.positions.extend(triangle);
                mesh.corner_normals.extend(triangle);
                mesh.triangles.push([first, first + 1, first + 2]);
            }
        }
    }
    mesh
}

pub fn add(scene: &mut Scene, mesh: Mesh, place: Affine3A, material: Material) {
    let name = format!("{} {}", mesh.name, scene.instances.len());
    scene.instances.push(Instance::new(name, scene.meshes.len(), place, vec![scene.materials.len()]));
    scene.meshes.push(mesh);
    scene.materials.push(material);
}

/// A camera of `size` x `size` pixels at `position` that looks at the origin, with a window of `window` at distance 1.
pub fn look_at_origin(position: Vec3, size: usize, window: f32) -> Camera {
    let up = if position.normalize().z.abs() > 0.99 { Vec3::Y } else { Vec3::Z };
    let back = position.normalize();
    let right = up.cross(back).normalize();
    let rotation = relume_scene::glam::Mat3::from_cols(right, back.cross(right), back);
    Camera {
        world_from_camera: Affine3A::from_rotation_translation(Quat::from_mat3(&rotation), position),
        width: size,
        height: size,
        window_min: Vec2::splat(-0.5 * window),
        window_max: Vec2::splat(0.5 * window),
        ..Camera::default()
    }
}

/// A sphere light of radiance 1.
pub fn sphere_light(center: Vec3, radius: f32) -> Light {
    Light { name: "light".into(), ..Light::unit(LightShape::Sphere { center, radius }) }
}
