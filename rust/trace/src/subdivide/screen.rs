//! Sizes of edges as the dicing camera sees them (Cycles' `Camera::world_to_raster_size`).

use glam::{Affine3A, Vec2, Vec3};
use relume_scene::{Camera, Projection};

/// Camera that sizes are measured for, and the object that they belong to.
#[derive(Clone, Debug)]
pub struct Screen {
    camera_from_object: Affine3A,
    projection: Projection,
    window: [Vec2; 2],
    /// Size of a pixel straight ahead: in metres, per metre of distance unless rays are parallel.
    pixel: f32,
    /// See [`Screen::new`].
    offscreen_scale: f32,
}

impl Screen {
    /// Takes a camera and the place of an object. Outside of what the camera sees, pixels grow with the distance from
    /// it, the more the larger `offscreen_scale` is; not at all if it is 1.
    pub fn new(camera: &Camera, world_from_object: Affine3A, offscreen_scale: f32) -> Self {
        let window = [camera.window_min.min(camera.window_max), camera.window_min.max(camera.window_max)];
        let size = Vec2::new(camera.width as f32, camera.height as f32);
        let step = (window[1] - window[0]) / size;
        let middle = 0.5 * (window[0] + window[1]);
        let pixel = match camera.projection {
            Projection::Orthographic => step.min_element(),
            Projection::Perspective => {
                let aside = if step.x < step.y { Vec2::new(step.x, 0.0) } else { Vec2::new(0.0, step.y) };
                let ahead = middle.extend(-1.0).normalize();
                ((middle + aside).extend(-1.0).normalize() - ahead).reject_from_normalized(ahead).length()
            }
            Projection::Panoramic(panorama) => {
                let direction = |film: Vec2| panorama.direction(film);
                let ahead = direction(middle).unwrap_or(Vec3::NEG_Z);
                let aside = |step: Vec2| (direction(middle + step).unwrap_or(ahead) - ahead).length();
                0.5 * (aside(Vec2::new(step.x, 0.0)) + aside(Vec2::new(0.0, step.y)))
            }
        };
        Self {
            camera_from_object: camera.world_from_camera.inverse() * world_from_object,
            projection: camera.projection,
            window,
            pixel: pixel.max(f32::MIN_POSITIVE),
            offscreen_scale,
        }
    }

    /// Pixels between two points of the object, as if their edge faced the camera.
    pub fn length(&self, a: Vec3, b: Vec3) -> f32 {
        let [a, b] = [a, b].map(|point| self.camera_from_object.transform_point3(point));
        (b - a).length() / self.pixel_at(0.5 * (a + b))
    }

    /// Size of a pixel at a point in camera space, metres.
    fn pixel_at(&self, point: Vec3) -> f32 {
        let more = self.offscreen_scale.max(1.0) - 1.0;
        match self.projection {
            Projection::Perspective => self.pixel * (point.length() + more * self.distance_to_view(point)),
            Projection::Orthographic => {
                let [low, high] = self.window;
                let beside = point.truncate() - point.truncate().clamp(low, high);
                let behind = point.z.max(0.0);
                let half = (0.5 * high.length_squared()).sqrt().max(f32::MIN_POSITIVE);
                self.pixel * (1.0 + more * beside.extend(behind).length() / half)
            }
            Projection::Panoramic(_) => self.pixel * point.length(),
        }
    }

    /// Distance of a point from the pyramid that a perspective camera sees, roughly beside its edges.
    fn distance_to_view(&self, point: Vec3) -> f32 {
        let [low, high] = self.window;
        // Slope of each side, and the axis across it.
        let sides = [(high.x, Vec3::X), (-low.x, Vec3::NEG_X), (high.y, Vec3::Y), (-low.y, Vec3::NEG_Y)];
        let outside = sides.map(|(slope, axis)| point.dot((axis + slope * Vec3::Z).normalize()));
        if outside.iter().all(|distance| *distance > 0.0) {
            return point.length();
        }
        let (mut farthest, mut is_behind) = (0.0_f32, false);
        for (distance, (slope, axis)) in outside.into_iter().zip(sides) {
            if distance > 0.0 {
                if point.dot(slope * axis - Vec3::Z) >= 0.0 {
                    farthest = farthest.max(distance);
                } else {
                    is_behind = true;
                }
            }
        }
        match (is_behind, farthest > 0.0) {
            (true, true) => farthest.min(point.length()),
            (true, false) => point.length(),
            _ => farthest,
        }
    }
}
