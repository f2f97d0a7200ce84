//! A small scene with closed formulas, for tests and benchmarks: a chequered floor, a back wall and one
//! ball that casts shadows, seen by a pinhole camera.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Affine3A, Quat, Vec2, Vec3};
use relume_image::Image;
use relume_scene::{Camera, LightShape};

use crate::{PixelFeatures, PixelQueries, ProxyError, Rng, TargetSource};

const BALL: Vec3 = Vec3::new(0.2, 0.0, 0.4);
const BALL_RADIUS: f32 = 0.4;
const WALL_Y: f32 = 1.5;
const EYE: Vec3 = Vec3::new(0.0, -3.0, 1.2);

/// The scene at one resolution. Targets are one bounce of diffuse light with shadows, in closed form.
#[derive(Clone, Debug)]
pub struct SyntheticRoom {
    width: usize,
    height: usize,
    noise: f32,
    hits: Vec<SyntheticHit>,
}

#[derive(Clone, Copy, Debug)]
struct SyntheticHit {
    position: Vec3,
    normal: Vec3,
    albedo: [f32; 3],
}

impl SyntheticRoom {
    /// Without noise.
    pub fn new(width: usize, height: usize) -> Self {
        let camera = camera(width, height);
        let hits = (0..width * height).map(|i| first_hit(EYE, camera.pixel_ray(i % width, i / width).1));
        Self { width, height, noise: 0.0, hits: hits.collect() }
    }

    /// Adds zero-mean noise of this relative deviation to single pixels, which depends on pixel and light alone.
    pub fn with_noise(mut self, deviation: f32) -> Self {
        self.noise = deviation;
        self
    }

    /// The AOVs.
    pub fn features(&self) -> PixelFeatures {
        let albedo: Vec<_> = self.hits.iter().map(|hit| hit.albedo).collect();
        let normal: Vec<_> = self.hits.iter().map(|hit| hit.normal.to_array()).collect();
        let depth: Vec<_> = self.hits.iter().map(|hit| (hit.position - EYE).length()).collect();
        PixelFeatures::new(&camera(self.width, self.height), &albedo, &normal, &depth)
    }

    fn radiance(&self, pixel: usize, shape: &LightShape) -> [f32; 3] {
        let hit = &self.hits[pixel];
        let points: Vec<(Vec3, f32)> = match *shape {
            LightShape::Quad { center, edge_u, edge_v, .. } => {
                quad_points(hit.position, center, edge_u, edge_v)
            }
            LightShape::Sphere { center, radius } | LightShape::FacingDisk { center, radius } => {
                vec![(center, PI * radius * radius)]
            }
            // The rectangle of its area.
            LightShape::Ellipse { center, edge_u, edge_v, .. } => {
                let side = 0.5 * PI.sqrt();
                quad_points(hit.position, center, side * edge_u, side * edge_v)
            }
            LightShape::Spot { center, radius, axis, half_angle, blend, .. } => {
                let cosine = axis.dot((hit.position - center).normalize_or_zero());
                let edge = half_angle.cos();
                let x = ((cosine - edge) / ((1.0 - edge) * blend).max(1e-3)).clamp(0.0, 1.0);
                vec![(center, PI * radius * radius * x * x * (3.0 - 2.0 * x))]
            }
            _ => Vec::new(),
        };
        let mut irradiance = 0.0;
        for (point, area) in points {
            let offset = point - hit.position;
            let squared = offset.length_squared() + area;
            let cosine = hit.normal.dot(offset) / squared.sqrt();
            irradiance += area * cosine.max(0.0) / squared * visibility(hit.position, point);
        }
        hit.albedo.map(|albedo| albedo * irradiance / std::f32::consts::PI)
    }
}

impl TargetSource for SyntheticRoom {
    fn bounds(&self) -> (Vec3, Vec3) {
        self.features().visible_bounds()
    }

    fn segment_point(&self, pixel: u32, rng: &mut Rng) -> Option<Vec3> {
        let hit = self.hits[pixel as usize];
        let direction = Vec3::new(rng.next_normal(), rng.next_normal(), rng.next_normal());
        let away = if direction.dot(hit.normal) < 0.0 { -direction } else { direction };
        let length = 2.5 * rng.next_f32();
        Some(hit.position + away / away.length().max(1e-6) * length)
    }

    fn pixel_targets(&self, queries: &PixelQueries<'_>, out: &mut [[f32; 3]]) -> Result<(), ProxyError> {
        let all = queries.iter().flat_map(|(pixel, lights)| lights.iter().map(move |light| (pixel, light)));
        for ((pixel, light), out) in all.zip(out) {
            let key =
                format!("{light:?}").bytes().fold(0u64, |k, b| k.wrapping_mul(31).wrapping_add(u64::from(b)));
            let noise = 1.0 + self.noise * Rng::stream(key, u64::from(pixel), 0).next_normal();
            *out = self.radiance(pixel as usize, light).map(|x| x * noise);
        }
        Ok(())
    }

    fn images(&self, lights: &[LightShape], _denoised: bool) -> Result<Vec<Image>, ProxyError> {
        let image = |light: &LightShape| Image {
            width: self.width,
            height: self.height,
            channels: 3,
            data: (0..self.hits.len()).flat_map(|pixel| self.radiance(pixel, light)).collect(),
        };
        Ok(lights.iter().map(image).collect())
    }
}

/// Camera at the eye that looks along +y and a little down.
fn camera(width: usize, height: usize) -> Camera {
    let half = Vec2::new(0.6, 0.6 * height as f32 / width as f32);
    let middle = Vec2::new(0.0, -0.2);
    Camera {
        world_from_camera: Affine3A::from_rotation_translation(Quat::from_rotation_x(FRAC_PI_2), EYE),
        width,
        height,
        window_min: middle - half,
        window_max: middle + half,
        ..Camera::default()
    }
}

fn first_hit(origin: Vec3, direction: Vec3) -> SyntheticHit {
    let floor = if direction.z < 0.0 { -origin.z / direction.z } else { f32::INFINITY };
    let wall = (WALL_Y - origin.y) / direction.y;
    let ball = ball_distance(origin, direction).unwrap_or(f32::INFINITY);
    let position = origin + direction * floor.min(wall).min(ball);
    if ball < floor && ball < wall {
        SyntheticHit { position, normal: (position - BALL) / BALL_RADIUS, albedo: [0.8, 0.3, 0.2] }
    } else if wall < floor {
        SyntheticHit { position, normal: Vec3::NEG_Y, albedo: [0.6, 0.6, 0.5] }
    } else {
        let dark = ((position.x * 3.0).floor() + (position.y * 3.0).floor()).rem_euclid(2.0) > 0.5;
        SyntheticHit {
            position,
            normal: Vec3::Z,
            albedo: if dark { [0.1, 0.1, 0.2] } else { [0.7, 0.7, 0.7] },
        }
    }
}

fn ball_distance(origin: Vec3, direction: Vec3) -> Option<f32> {
    let offset = origin - BALL;
    let b = offset.dot(direction);
    let discriminant = b * b - offset.length_squared() + BALL_RADIUS * BALL_RADIUS;
    let t = -b - discriminant.max(0.0).sqrt();
    (discriminant > 0.0 && t > 1e-3).then_some(t)
}

/// 1 if the ball leaves the way free, falling to 0 over a short distance inside its rim.
fn visibility(from: Vec3, to: Vec3) -> f32 {
    let offset = to - from;
    let along = ((BALL - from).dot(offset) / offset.length_squared().max(1e-9)).clamp(0.0, 1.0);
    let nearest = (from + offset * along - BALL).length();
    ((nearest / BALL_RADIUS - 0.85) / 0.15).clamp(0.0, 1.0)
}

/// Sixteen points on a quad with their areas projected towards `from`; none if it shows its back.
fn quad_points(from: Vec3, center: Vec3, edge_u: Vec3, edge_v: Vec3) -> Vec<(Vec3, f32)> {
    let normal = edge_u.cross(edge_v);
    let point = |i: usize| {
        let (u, v) = ((i % 4) as f32 / 4.0 - 0.375, (i / 4) as f32 / 4.0 - 0.375);
        let point = center + edge_u * u + edge_v * v;
        let facing = normal.dot((from - point).normalize_or_zero()).max(0.0);
        (point, facing / 16.0)
    };
    (0..16).map(point).collect()
}
