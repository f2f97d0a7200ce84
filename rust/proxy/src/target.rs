use glam::Vec3;
use relume_gpu::Buffer;
use relume_image::Image;
use relume_scene::LightShape;

use crate::{ProxyError, Rng};

/// Source of training targets: where lights may be, and what they do. The session answers from a path dump, tests from
/// closed formulas.
///
/// All answers must depend on the arguments alone: a resumed training asks again for what it has lost, and expects
/// the same.
pub trait TargetSource: Sync {
    /// A box in world space in which lights are worth learning, corner to corner: the visible positions (paper,
    /// section 4.4).
    fn bounds(&self) -> (Vec3, Vec3);

    /// A random point on a random segment of this pixel's paths (paper, section 4.4); `None` if the pixel has none
    /// that is finite.
    fn segment_point(&self, pixel: u32, rng: &mut Rng) -> Option<Vec3>;

    /// Gathers single pixels for radiance 1, linear RGB, into `out`, as long as `queries.lights`.
    ///
    /// # Errors
    /// [`ProxyError::Targets`] wraps whatever went wrong.
    fn pixel_targets(&self, queries: &PixelQueries<'_>, out: &mut [[f32; 3]]) -> Result<(), ProxyError>;

    /// Gathers whole images for radiance 1, three channels, one per light, denoised if asked and possible.
    ///
    /// # Errors
    /// [`ProxyError::Targets`] wraps whatever went wrong.
    fn images(&self, lights: &[LightShape], denoised: bool) -> Result<Vec<Image>, ProxyError>;

    /// The source of single pixels on the device of [`crate::Trainer::on_gpu`], if this source is there too. Trainings on
    /// raw targets then gather there.
    fn on_device(&self) -> Option<&dyn DeviceTargets> {
        None
    }
}

/// The part of a [`TargetSource`] that is on a device.
pub trait DeviceTargets: Sync {
    /// [`TargetSource::pixel_targets`] into a buffer of `pixels.len() * lights_per_pixel` RGB values. May only submit:
    /// `out` is used by what is submitted next, and values that are not finite are found there.
    ///
    /// # Errors
    /// [`ProxyError::Gpu`] or [`ProxyError::Targets`].
    fn pixel_targets(&self, queries: &GroupQueries<'_>, out: &Buffer<f32>) -> Result<(), ProxyError>;
}

/// Pixels to be gathered in groups that share their lights.
#[derive(Clone, Copy, Debug)]
pub struct GroupQueries<'a> {
    /// Pixel numbers, row-major, group by group.
    pub pixels: &'a [u32],
    /// Pixels of a group.
    pub group: usize,
    /// Lights of each group, and so of each of its pixels.
    pub lights_per_pixel: usize,
    /// `pixels.len() / group * lights_per_pixel` lights, group by group.
    pub lights: &'a [LightShape],
}

/// Pixels to be gathered, each for the same number of lights, grouped so that a source can keep a pixel's segments
/// in cache while it tests its lights.
#[derive(Clone, Copy, Debug)]
pub struct PixelQueries<'a> {
    /// Pixel numbers, row-major. A pixel may come more than once.
    pub pixels: &'a [u32],
    /// Lights of each pixel, at least one.
    pub lights_per_pixel: usize,
    /// `pixels.len() * lights_per_pixel` lights, pixel by pixel.
    pub lights: &'a [LightShape],
}

impl<'a> PixelQueries<'a> {
    /// Each pixel with its lights.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &'a [LightShape])> {
        self.pixels.iter().copied().zip(self.lights.chunks_exact(self.lights_per_pixel))
    }
}
