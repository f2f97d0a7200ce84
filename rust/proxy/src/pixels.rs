use glam::Vec3;

use crate::ProxyError;

/// What the networks know of each pixel, from the AOVs and the camera. All arrays run row-major from the top left
/// pixel and hold `width * height` entries.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PixelFeatures {
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

impl PixelFeatures {
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

    /// Bounding box of the first hits that are no background, corner to corner; the whole box of all positions if
    /// every pixel is background.
    pub fn visible_bounds(&self) -> (Vec3, Vec3) {
        let hit = |i: &usize| self.depth[*i] > 0.0;
        let all = 0..self.pixel_count();
        let mut points: Vec<usize> = all.clone().filter(hit).collect();
        if points.is_empty() {
            points = all.collect();
        }
        points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &i| {
            let p = Vec3::from(self.position[i]);
            (low.min(p), high.max(p))
        })
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
