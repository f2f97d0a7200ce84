use glam::Vec3;
use relume_scene::Camera;

use crate::ProxyError;
use crate::pixel_codes::{self as codes, CodedImage};

/// Features of each pixel for the networks, from the AOVs and the camera. All arrays run row-major from the top left
/// pixel and hold `width * height` entries.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PixelFeatures {
    /// Camera that sees them.
    pub camera: Camera,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Albedo of the first non-specular hit, scene-linear.
    pub albedo: Vec<[f32; 3]>,
    /// Shading normal in world space, unit length; zero where nothing is hit.
    pub normal: Vec<[f32; 3]>,
    /// Distance from the camera in metres; zero where nothing is hit.
    pub depth: Vec<f32>,
    /// First hit in world space, metres; where nothing is hit, a point far along the camera ray.
    pub position: Vec<[f32; 3]>,
    /// Unit direction from the first hit towards the camera, world space.
    pub wo: Vec<[f32; 3]>,
}

/// Distance from the middle of what is seen within which something still counts, as a share of the middle's diagonal.
const BEYOND: f32 = 0.5;

impl PixelFeatures {
    /// Features of AOVs as [`Self`] describes them, finite and of the camera's size. They are rounded to what a proxy's
    /// file holds, so that a network learns on what it is used with.
    pub fn new(camera: &Camera, albedo: &[[f32; 3]], normal: &[[f32; 3]], depth: &[f32]) -> Self {
        Self::of_codes(
            camera,
            &codes::encode_albedo(albedo),
            &codes::encode_normal(normal),
            &codes::encode_depth(depth),
        )
    }

    /// Features of coded images of the camera's size.
    pub(crate) fn of_codes(
        camera: &Camera,
        albedo: &CodedImage,
        normal: &CodedImage,
        depth: &CodedImage,
    ) -> Self {
        let depth = codes::decode_depth(depth);
        let farthest = depth.iter().copied().fold(0.0, f32::max);
        // Background stands well behind everything, at a distance that keeps the network's inputs moderate.
        let background = if farthest > 0.0 { 4.0 * farthest } else { 100.0 };
        let ray = |pixel| camera.pixel_ray(pixel % camera.width, pixel / camera.width);
        let position = |(pixel, depth): (usize, &f32)| {
            let (origin, direction) = ray(pixel);
            let distance = if *depth > 0.0 { *depth } else { background };
            (origin + distance * direction).to_array()
        };
        Self {
            width: camera.width,
            height: camera.height,
            albedo: codes::decode_albedo(albedo),
            normal: codes::decode_normal(normal),
            position: depth.iter().enumerate().map(position).collect(),
            wo: (0..depth.len()).map(|pixel| (-ray(pixel).1).to_array()).collect(),
            camera: camera.clone(),
            depth,
        }
    }

    /// Pixels in the image.
    pub fn pixel_count(&self) -> usize {
        self.width * self.height
    }

    /// Checks all sizes and that every number is finite.
    ///
    /// # Errors
    /// [`ProxyError::Features`] names the array and, for numbers, the first bad pixel.
    pub fn validate(&self) -> Result<(), ProxyError> {
        let count = self.width.checked_mul(self.height).unwrap_or(0);
        if count == 0 || count > u32::MAX as usize {
            return Err(ProxyError::Features(format!("the image is {} x {}", self.width, self.height)));
        }
        let triples = [
            ("albedo", &self.albedo),
            ("normal", &self.normal),
            ("position", &self.position),
            ("wo", &self.wo),
        ];
        for (name, values) in triples {
            check(name, count, values.len(), values.iter().position(|v| v.iter().any(|x| !x.is_finite())))?;
        }
        check("depth", count, self.depth.len(), self.depth.iter().position(|x| !x.is_finite()))
    }

    /// Box of the first hits that are no background, corner to corner; of all positions if every pixel is background. What is
    /// further from the box of the middle nine tenths, axis by axis, than [`BEYOND`] of its diagonal is left out: a few pixels that
    /// show a street through a window should not make the room a speck.
    pub fn visible_bounds(&self) -> (Vec3, Vec3) {
        let hit = |i: &usize| self.depth[*i] > 0.0;
        let all = 0..self.pixel_count();
        let mut points: Vec<usize> = all.clone().filter(hit).collect();
        if points.is_empty() {
            points = all.collect();
        }
        let Some(last) = points.len().checked_sub(1) else { return Default::default() };
        let axes = [0, 1, 2].map(|axis| {
            let mut values: Vec<f32> = points.iter().map(|&i| self.position[i][axis]).collect();
            values.sort_by(f32::total_cmp);
            values
        });
        let at = |rank: usize| Vec3::from(axes.each_ref().map(|values| values[rank]));
        let (low, high) = (at(last / 20), at(last - last / 20));
        let beyond = BEYOND * low.distance(high);
        (at(0).max(low - beyond), at(last).min(high + beyond))
    }
}

fn check(name: &str, expected: usize, found: usize, bad: Option<usize>) -> Result<(), ProxyError> {
    if found != expected {
        return Err(ProxyError::Features(format!("{name} holds {found} pixels instead of {expected}")));
    }
    match bad {
        Some(pixel) => Err(ProxyError::Features(format!("{name} of pixel {pixel} is not finite"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_few_pixels_show_far_away_is_not_in_the_box() {
        // A room of 8 x 6 x 3 metres, its floor for most of it, and two pixels of a street.
        let room = (0..200).map(|i| [(i % 20) as f32 * 8.0 / 19.0, (i / 20) as f32 * 6.0 / 9.0, 0.0]);
        let lamp = [[4.0, 3.0, 3.0]; 4];
        let street = [[100.0, 3.0, 1.0], [4.0, -80.0, 1.0]];
        let bounds = |position: Vec<[f32; 3]>| {
            let count = position.len();
            PixelFeatures { width: count, height: 1, depth: vec![1.0; count], position, ..Default::default() }
                .visible_bounds()
        };
        let (low, high) = bounds(room.clone().chain(lamp).collect());
        assert_eq!((low, high), (Vec3::ZERO, Vec3::new(8.0, 6.0, 3.0)), "a small thing within reach counts");
        let (low, high) = bounds(room.chain(lamp).chain(street).collect());
        assert!(low.y > -6.0 && low.y < 0.0 && high.x < 14.0 && high.x > 8.0, "{low} {high}");
        assert_eq!(high.z, 3.0);
    }
}
