//! Camera rays and features of a bake's pixels.

use crate::error::SessionError;
use glam::{Vec2, Vec3};
use relume_dump::{Aovs, Manifest};
use relume_proxy::PixelFeatures;
use relume_scene::{Camera, Projection};

/// Camera that a dump was traced from.
pub(crate) fn camera(manifest: &Manifest) -> Result<Camera, SessionError> {
    serde_json::from_value(manifest.camera.clone()).map_err(|error| {
        SessionError::Settings(format!("the bake's camera cannot be read: {error}; bake again"))
    })
}

/// Origin and unit direction of the ray through the middle of a pixel, world space, without lens or clipping; no direction
/// where a lens shows nothing.
pub fn pixel_ray(camera: &Camera, x: usize, y: usize) -> (Vec3, Vec3) {
    let share =
        Vec2::new((x as f32 + 0.5) / camera.width as f32, 1.0 - (y as f32 + 0.5) / camera.height as f32);
    let film = camera.window_min + share * (camera.window_max - camera.window_min);
    let (origin, direction) = match camera.projection {
        Projection::Perspective => (Vec3::ZERO, film.extend(-1.0)),
        Projection::Orthographic => (film.extend(0.0), Vec3::NEG_Z),
        Projection::Panoramic(panorama) => (Vec3::ZERO, panorama.direction(film).unwrap_or_default()),
    };
    let world = &camera.world_from_camera;
    (world.transform_point3(origin), world.transform_vector3(direction).normalize_or_zero())
}

/// About so many points that are seen, spread over the picture.
pub(crate) fn seen_points(aovs: &Aovs, camera: &Camera, count: usize) -> Vec<Vec3> {
    let (width, depth) = (aovs.depth.width, &aovs.depth.data);
    let seen: Vec<usize> = (0..depth.len()).filter(|i| depth[*i] > 0.0 && depth[*i].is_finite()).collect();
    let spread = seen.iter().step_by(seen.len().div_ceil(count).max(1));
    let point = |i: &usize| {
        let (origin, direction) = pixel_ray(camera, i % width, i / width);
        origin + depth[*i] * direction
    };
    spread.map(point).collect()
}

/// Features of each pixel for proxies: AOVs, and positions by depth and camera ray.
pub fn pixel_features(aovs: &Aovs, camera: &Camera) -> PixelFeatures {
    let (width, height) = (aovs.depth.width, aovs.depth.height);
    let triple = |image: &relume_image::Image, i: usize| -> [f32; 3] {
        std::array::from_fn(|c| finite(image.data[i * 3 + c]))
    };
    let depth: Vec<f32> = aovs.depth.data.iter().map(|d| finite(*d).max(0.0)).collect();
    let farthest = depth.iter().copied().fold(0.0, f32::max);
    // Background stands well behind everything, at a distance that keeps the network's inputs moderate.
    let background = if farthest > 0.0 { 4.0 * farthest } else { 100.0 };
    let mut features = PixelFeatures { width, height, ..PixelFeatures::default() };
    for (i, depth) in depth.iter().enumerate() {
        let (origin, direction) = pixel_ray(camera, i % width, i / width);
        let distance = if *depth > 0.0 { *depth } else { background };
        features.albedo.push(triple(&aovs.albedo, i));
        features.normal.push(Vec3::from(triple(&aovs.normal, i)).normalize_or_zero().to_array());
        features.position.push((origin + distance * direction).to_array());
        features.wo.push((-direction).to_array());
    }
    features.depth = depth;
    features
}

fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Affine3A, Quat};
    use relume_image::Image;

    fn camera() -> Camera {
        // At (0, -5, 2), looking along +y.
        let rotation = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
        let place = Affine3A::from_rotation_translation(rotation, Vec3::new(0.0, -5.0, 2.0));
        Camera {
            world_from_camera: place,
            width: 4,
            height: 2,
            window_min: Vec2::new(-1.0, -0.5),
            window_max: Vec2::new(1.0, 0.5),
            ..Camera::default()
        }
    }

    #[test]
    fn first_pixel_is_top_left() {
        let (origin, direction) = pixel_ray(&camera(), 0, 0);
        assert_eq!(origin, Vec3::new(0.0, -5.0, 2.0));
        let expected = Vec3::new(-0.75, 1.0, 0.25).normalize();
        assert!(direction.distance(expected) < 1e-6, "{direction}");
    }

    #[test]
    fn orthographic_rays_are_parallel_and_start_on_the_film() {
        let camera = Camera { projection: Projection::Orthographic, ..camera() };
        let (origin, direction) = pixel_ray(&camera, 3, 1);
        assert!(origin.distance(Vec3::new(0.75, -5.0, 1.75)) < 1e-6, "{origin}");
        assert!(direction.distance(Vec3::Y) < 1e-6);
    }

    #[test]
    fn features_are_finite_and_hits_lie_at_their_depth() {
        let image =
            |channels, value: f32| Image { data: vec![value; 8 * channels], ..Image::new(4, 2, channels) };
        let mut aovs = Aovs {
            albedo: image(3, f32::NAN),
            normal: image(3, 0.5),
            depth: image(1, 3.0),
            emission: image(3, 0.0),
            world: image(3, 0.0),
            alpha: image(1, 1.0),
        };
        aovs.depth.data[5] = 0.0;
        let features = pixel_features(&aovs, &camera());
        features.validate().unwrap();
        let eye = Vec3::new(0.0, -5.0, 2.0);
        let distance = |i: usize| Vec3::from(features.position[i]).distance(eye);
        assert!((distance(0) - 3.0).abs() < 1e-5 && (distance(5) - 12.0).abs() < 1e-4);
        assert!((Vec3::from(features.normal[0]).length() - 1.0).abs() < 1e-6);
    }
}
