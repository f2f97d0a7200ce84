//! The purpose of it all: lights added up from the paths equal lights that were there while tracing.

use relume_dump::{End, Lobe, Segment};
use relume_scene::{
    Light, LightShape, Scene,
    glam::{Affine3A, DVec3, Vec3},
};
use relume_trace::{TraceSettings, settings::BounceLimits};

use crate::support::*;

const LIGHT_CENTER: Vec3 = Vec3::new(0.25, -0.1, 0.45);
const LIGHT_RADIUS: f32 = 0.25;
const ALBEDO: f32 = 0.6;

/// A box without its front (-y) side, so that paths leave it.
fn open_box() -> Scene {
    let mut mesh = cube();
    mesh.triangles.retain(|triangle| !triangle.iter().all(|v| mesh.positions[*v as usize].y < -0.99));
    let mut scene = Scene::default();
    add(&mut scene, mesh, Affine3A::IDENTITY, diffuse(ALBEDO));
    scene.camera = look_at_origin(Vec3::new(0.0, -4.0, 0.0), 6, 0.5);
    scene
}

/// True if the sphere light is crossed on the way from `origin` along the unit `direction` up to `length`.
fn crosses(origin: Vec3, direction: Vec3, length: f32) -> bool {
    let to_center = LIGHT_CENTER - origin;
    let along = to_center.dot(direction);
    let reach = LIGHT_RADIUS * LIGHT_RADIUS - (to_center - direction * along).length_squared();
    if reach < 0.0 {
        return false;
    }
    let (enter, exit) = (along - reach.sqrt(), along + reach.sqrt());
    (enter > 0.0 && enter < length) || (exit > 0.0 && exit < length)
}

/// Radiance 1 of a light, collected from a path (paper, equation 1); invisible to the camera.
fn gather(start: Vec3, path: &Path, crosses: impl Fn(Vec3, Vec3, f32) -> bool) -> Vec3 {
    let mut origin = start;
    let mut sum = Vec3::ZERO;
    for segment in &path.segments {
        let (direction, length, next) = match segment.end {
            End::Vertex(end) => ((end - origin).normalize_or(Vec3::Z), origin.distance(end), end),
            End::Escape(direction) => (direction, f32::INFINITY, origin),
        };
        if segment.lobe != Lobe::Camera && crosses(origin, direction, length) {
            sum += segment.throughput;
        }
        origin = next;
    }
    sum
}

/// An independent tracer of the same scene with the same light, in double precision: the light is sampled by its cone
/// at each surface and hit by nothing else.
struct Direct {
    state: u64,
}

impl Direct {
    fn random(&mut self) -> f64 {
        self.state = self.state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.state >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// The inner wall that a ray from inside (or from the open side) meets: its point and normal.
    fn wall(origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
        let mut nearest: Option<(f64, DVec3)> = None;
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                if axis == 1 && side < 0.0 {
                    continue;
                }
                let t = (side - origin[axis]) / direction[axis];
                let point = origin + direction * t;
                let inside = (0..3).all(|other| other == axis || point[other].abs() <= 1.0);
                if t > 1e-9 && inside && nearest.is_none_or(|(best, _)| t < best) {
                    let mut normal = DVec3::ZERO;
                    normal[axis] = -side;
                    nearest = Some((t, normal));
                }
            }
        }
        nearest
    }

    fn around(&mut self, axis: DVec3, cos: f64) -> DVec3 {
        let (x, y) = axis.any_orthonormal_pair();
        let (sin_phi, cos_phi) = (std::f64::consts::TAU * self.random()).sin_cos();
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        x * (sin * cos_phi) + y * (sin * sin_phi) + axis * cos
    }

    /// Radiance along a camera ray, with light met after up to `bounces` surfaces.
    fn radiance(&mut self, mut origin: DVec3, mut direction: DVec3, bounces: u32) -> f64 {
        let (mut throughput, mut sum) = (1.0, 0.0);
        for _ in 0..bounces {
            let Some((t, normal)) = Self::wall(origin, direction) else { break };
            origin += direction * t;
            throughput *= f64::from(ALBEDO);
            let to_center = LIGHT_CENTER.as_dvec3() - origin;
            let sin2 = f64::from(LIGHT_RADIUS).powi(2) / to_center.length_squared();
            let cos_max = (1.0 - sin2).sqrt();
            let cos = 1.0 - self.random() * (1.0 - cos_max);
            let towards = self.around(to_center.normalize(), cos);
            let facing = normal.dot(towards);
            // The walls are convex and the light stands free of them, so that nothing blocks it.
            if facing > 0.0 {
                sum += throughput * facing / std::f64::consts::PI * std::f64::consts::TAU * (1.0 - cos_max);
            }
            let cos = self.random().sqrt();
            direction = self.around(normal, cos);
        }
        sum
    }
}

#[test]
fn gather_equals_direct_trace_of_the_same_light() {
    let mut scene = open_box();
    let mut settings = TraceSettings { samples: 16384, ..TraceSettings::default() };
    settings.paths.bounces = BounceLimits { total: 3, diffuse: 3, ..BounceLimits::default() };
    let camera = scene.camera.world_from_camera.translation.into();

    // The filter of the tracer reaches beyond the picture, so the direct tracer uses the same rays.
    let rays = relume_trace::camera::CameraSampler::new(&scene.camera, settings.paths.filter);
    let mut direct = Direct { state: 1 };
    let (mut sum, mut count) = (0.0, 0);
    for pixel in 0..36 {
        for _ in 0..8192 {
            let u = [(); 4].map(|()| direct.random() as f32);
            let ray = rays.ray(pixel % 6, pixel / 6, 0.5, u).unwrap();
            sum += direct.radiance(ray.origin.as_dvec3(), ray.direction.as_dvec3(), 4);
            count += 1;
        }
    }
    let expected = (sum / f64::from(count)) as f32;

    let mut variance = |lights: Vec<Light>| {
        scene.lights = lights;
        let paths = image_paths(&scene, &settings);
        let gathered = mean(&paths, |path| gather(camera, path, crosses)).x;
        assert!((gathered / expected - 1.0).abs() < 0.015, "gathered {gathered}, direct {expected}");
        mean(&paths, |path| (gather(camera, path, crosses) - gathered).powf(2.0)).x
    };
    let unguided = variance(Vec::new());
    let guided = variance(vec![sphere_light(LIGHT_CENTER, LIGHT_RADIUS)]);
    assert!(guided < 0.4 * unguided, "{guided} beside {unguided}");
    // Paths that look elsewhere are right for this light, too, and have no more than a third more of noise at each bounce.
    let misled = variance(vec![sphere_light(Vec3::new(-0.6, 0.5, -0.5), 0.05)]);
    assert!(misled < (4.0_f32 / 3.0).powi(3) * unguided, "{misled} beside {unguided}");
}

/// A strip of 1.2 x 0.03 m under the ceiling, facing down.
const STRIP: LightShape = LightShape::Quad {
    center: Vec3::new(0.0, 0.0, 0.9),
    edge_u: Vec3::new(1.2, 0.0, 0.0),
    edge_v: Vec3::new(0.0, -0.03, 0.0),
    spread: std::f32::consts::PI,
};

fn crosses_strip(origin: Vec3, direction: Vec3, length: f32) -> bool {
    let distance = (0.9 - origin.z) / direction.z;
    let place = origin + direction * distance;
    let is_met = direction.z > 0.0 && distance > 0.0 && distance < length;
    is_met && place.x.abs() <= 0.6 && place.y.abs() <= 0.015
}

#[test]
fn paths_look_for_strips_as_they_are() {
    let mut scene = open_box();
    let settings = TraceSettings { samples: 8192, ..TraceSettings::default() };
    let camera = scene.camera.world_from_camera.translation.into();
    let mut measured = |lights: Vec<Light>| {
        scene.lights = lights;
        let paths = image_paths(&scene, &settings);
        let gathered = mean(&paths, |path| gather(camera, path, crosses_strip)).x;
        (gathered, mean(&paths, |path| (gather(camera, path, crosses_strip) - gathered).powf(2.0)).x)
    };
    let (expected, unguided) = measured(Vec::new());
    let (gathered, guided) = measured(vec![Light { shape: STRIP, ..sphere_light(Vec3::ZERO, 1.0) }]);
    let error = ((unguided + guided) / (36.0 * settings.samples as f32)).sqrt();
    assert!((gathered - expected).abs() < 4.0 * error, "{gathered} instead of {expected}, error {error}");
    assert!(guided < 0.1 * unguided, "{guided} beside {unguided}");
}

#[test]
fn a_sun_behind_a_surface_changes_none_of_its_paths() {
    let mut scene = Scene::default();
    add(&mut scene, square(0.0), Affine3A::from_scale(Vec3::splat(9.0)), diffuse(0.5));
    scene.camera = look_at_origin(Vec3::new(0.5, -2.0, 1.0), 4, 0.5);
    let settings = TraceSettings { samples: 64, ..TraceSettings::default() };
    let unguided = image_paths(&scene, &settings);
    let direction = Vec3::new(0.6, 0.0, -0.8);
    let sun = LightShape::Sun { direction, half_angle: 0.005 };
    scene.lights = vec![Light { shape: sun, ..sphere_light(Vec3::ZERO, 1.0) }];
    assert!(image_paths(&scene, &settings) == unguided, "paths are guided to what cannot light them");
    // From below they are guided to it.
    scene.camera = look_at_origin(Vec3::new(0.5, -2.0, -1.0), 4, 0.5);
    let towards = |path: &Path| matches!(path.segments.last(), Some(Segment { end: End::Escape(wi), .. }) if wi.dot(direction) > 0.999);
    let share = mean(&image_paths(&scene, &settings), |path| Vec3::splat(f32::from(towards(path)))).x;
    assert!(share > 0.1, "{share} of the paths");
}

#[test]
fn escaped_segments_carry_the_throughput_of_the_world() {
    let mut scene = open_box();
    scene.world.color = [1.0, 2.0, 4.0];
    let mut settings = TraceSettings { samples: 8, ..TraceSettings::default() };
    settings.paths.sample_static_lights = false;
    for path in image_paths(&scene, &settings).iter().flatten() {
        let collected: Vec3 = path
            .segments
            .iter()
            .filter(|segment| matches!(segment.end, End::Escape(_)))
            .map(|segment| segment.throughput)
            .sum();
        assert_eq!(path.aovs.world, collected * Vec3::new(1.0, 2.0, 4.0));
    }
}
