//! Camera rays and features of a bake's pixels.

use crate::error::SessionError;
use glam::Vec3;
use relume_dump::{Aovs, Manifest};
use relume_image::Image;
use relume_proxy::PixelFeatures;
use relume_scene::Camera;

/// Camera that a dump was traced from.
pub(crate) fn camera(manifest: &Manifest) -> Result<Camera, SessionError> {
    serde_json::from_value(manifest.camera.clone()).map_err(|error| {
        SessionError::Settings(format!("the bake's camera cannot be read: {error}; bake again"))
    })
}

/// About so many points that are seen, spread over the picture.
pub(crate) fn seen_points(aovs: &Aovs, camera: &Camera, count: usize) -> Vec<Vec3> {
    let (width, depth) = (aovs.depth.width, &aovs.depth.data);
    let seen: Vec<usize> = (0..depth.len()).filter(|i| depth[*i] > 0.0 && depth[*i].is_finite()).collect();
    let spread = seen.iter().step_by(seen.len().div_ceil(count).max(1));
    let point = |i: &usize| {
        let (origin, direction) = camera.pixel_ray(i % width, i / width);
        origin + depth[*i] * direction
    };
    spread.map(point).collect()
}

/// Features of each pixel for proxies: AOVs, and positions by depth and camera ray.
pub fn pixel_features(aovs: &Aovs, camera: &Camera) -> PixelFeatures {
    let triples = |image: &Image| -> Vec<[f32; 3]> {
        image.data.as_chunks().0.iter().map(|values: &[f32; 3]| values.map(finite)).collect()
    };
    let depth: Vec<f32> = aovs.depth.data.iter().copied().map(finite).collect();
    PixelFeatures::new(camera, &triples(&aovs.albedo), &triples(&aovs.normal), &depth)
}

fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let camera = Camera { width: 4, height: 2, ..Camera::default() };
        let features = pixel_features(&aovs, &camera);
        features.validate().unwrap();
        let distance = |i: usize| Vec3::from(features.position[i]).length();
        // Depths are rounded by less than 0.02 percent.
        assert!((distance(0) - 3.0).abs() < 6e-4 && (distance(5) - 12.0).abs() < 2.4e-3);
        assert!((Vec3::from(features.normal[0]).length() - 1.0).abs() < 1e-6);
    }
}
