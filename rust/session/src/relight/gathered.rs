use crate::device::connections::ConnectedImage;
use crate::device::gather::UnitParts;
use crate::device::image::{DeviceImage, ImageRef};
use crate::error::SessionError;
use crate::relight::denoise::Denoise;
use relume_gather::{DenoiseQuality, Stop};
use relume_gpu::{Gpu, GpuError};
use relume_image::Image;
use std::sync::Arc;

/// Denoised picture.
pub(crate) struct Clean {
    pub image: DeviceImage,
    pub quality: DenoiseQuality,
}

impl Clean {
    /// Denoises a picture; the result is kept where `beside` is. None if `stop` ended it.
    pub fn of(
        mut noisy: Image,
        beside: &DeviceImage,
        denoise: &Denoise,
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<Option<Self>, SessionError> {
        let done = denoise.images_until(std::slice::from_mut(&mut noisy), quality, stop)?;
        Ok(done.then(|| Self { image: DeviceImage::on_device_of(beside, noisy), quality }))
    }
}

/// Picture summed over the paths, one pass after the other.
#[derive(Default)]
pub(crate) struct Gathered {
    /// Mean over the paths of `passes`, without connected light.
    pub mean: DeviceImage,
    pub passes: usize,
    pub samples: u32,
    /// Draw of the error of `mean`; empty for a single pass.
    pub error: DeviceImage,
    /// Number of passes that were denoised, and their denoised mean.
    pub clean: Option<(usize, Clean)>,
    /// Connected light, which is added to `mean`.
    pub connected: Option<Arc<ConnectedImage>>,
}

impl Gathered {
    /// Adds the mean of one more pass. Its connected light, which is of as many paths or more, takes the place of that before.
    pub fn add(&mut self, parts: UnitParts, samples: u32) -> Result<(), GpuError> {
        let UnitParts { crossed: mut image, connected } = parts;
        self.connected = connected;
        let all = self.samples + samples;
        if self.passes == 0 {
            self.mean = image;
        } else {
            let share = samples as f32 / all as f32;
            // Means a and b of m and n independent samples: a - b has the variance v (1/m + 1/n). The mean of all has
            // v / (m + n), which is m n / (m + n)^2 of it.
            let scale = (share * (1.0 - share)).sqrt();
            self.mean.take_in(&mut image, share, scale)?;
            self.error = image;
        }
        self.passes += 1;
        self.samples = all;
        Ok(())
    }

    /// Images that add up to the noisy picture.
    pub fn layers(&self) -> impl Iterator<Item = ImageRef<'_>> {
        let connected = self.connected.as_deref().map(|connected| (&connected.image).into());
        std::iter::once((&self.mean).into()).chain(connected)
    }

    /// Images that add up to a draw of the picture's error; none for a single pass.
    pub fn errors(&self) -> Option<impl Iterator<Item = ImageRef<'_>>> {
        let connected = self.connected.as_deref().map(|connected| &connected.error);
        let connected = connected.filter(|error| !error.data.is_empty()).map(ImageRef::from);
        (!self.error.is_empty()).then(|| std::iter::once((&self.error).into()).chain(connected))
    }

    /// Copy of the noisy picture.
    pub fn noisy(&self) -> Result<Image, GpuError> {
        let mut image = self.mean.read()?;
        if let Some(connected) = &self.connected {
            image.add_scaled(&connected.image, &[1.0; 3]);
        }
        Ok(image)
    }

    /// Number of levels of its connected light; none if there is no such light.
    pub fn connected_levels(&self) -> Option<usize> {
        self.connected.as_ref().map(|connected| connected.levels)
    }

    /// Side of the blocks of pixels in which its light is connected.
    pub fn block(&self) -> usize {
        self.connected.as_ref().map_or(1, |connected| connected.block)
    }

    /// Takes connected light of more levels. What was denoised is of fewer paths then.
    pub fn take_connected(&mut self, connected: Arc<ConnectedImage>) {
        self.connected = Some(connected);
        self.clean.iter_mut().for_each(|(passes, _)| *passes = 0);
    }

    /// Denoises the picture; false if `stop` ended it.
    pub fn denoise(
        &mut self,
        denoise: &Denoise,
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, SessionError> {
        let clean = Clean::of(self.noisy()?, &self.mean, denoise, quality, stop)?;
        let Some(clean) = clean else { return Ok(false) };
        self.clean = Some((self.passes, clean));
        Ok(true)
    }

    /// Copy for a final image, denoised if a denoiser is given.
    pub fn final_image(&mut self, denoise: Option<&Denoise>) -> Result<Image, SessionError> {
        if let Some(denoise) = denoise {
            self.denoise(denoise, DenoiseQuality::High, None)?;
        }
        let clean = self.newest_clean(DenoiseQuality::High).filter(|_| denoise.is_some());
        Ok(clean.map_or_else(|| self.noisy(), DeviceImage::read)?)
    }

    /// Keeps the denoised picture alone, once nothing is added any more.
    pub fn drop_noisy(&mut self) {
        (self.mean, self.error) = Default::default();
    }

    /// True if there is a denoised picture, of as many paths or fewer.
    pub fn has_clean(&self) -> bool {
        self.clean.is_some()
    }

    /// Denoised mean of all passes, if it has this quality.
    pub fn newest_clean(&self, quality: DenoiseQuality) -> Option<&DeviceImage> {
        let newest = self.clean.as_ref().filter(|(passes, _)| *passes == self.passes);
        newest.filter(|(_, clean)| clean.quality >= quality).map(|(_, clean)| &clean.image)
    }

    /// True if all passes are denoised at this quality, or there is none yet.
    pub fn is_done(&self, quality: DenoiseQuality) -> bool {
        self.passes == 0 || self.newest_clean(quality).is_some()
    }

    /// All images in it.
    pub fn images(&self) -> impl Iterator<Item = &DeviceImage> {
        let clean = self.clean.as_ref().map(|(_, clean)| &clean.image);
        [Some(&self.mean), Some(&self.error), clean].into_iter().flatten()
    }

    /// Moves all images to the CPU.
    pub fn leave_gpu(&mut self) -> Result<(), GpuError> {
        let clean = self.clean.as_mut().map(|(_, clean)| &mut clean.image);
        for image in [&mut self.mean, &mut self.error].into_iter().chain(clean) {
            image.move_to_cpu()?;
        }
        Ok(())
    }

    /// GPU that holds some of it.
    pub fn gpu(&self) -> Option<&Gpu> {
        self.images().find_map(DeviceImage::on_gpu).map(|image| &**image.gpu())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::relight::frame::{WeightedImage, weighted_sum};
    use relume_gpu::{GpuChoice, GpuImage};

    fn flat(value: f32) -> Image {
        Image { data: vec![value; 2 * 3], ..Image::new(2, 1, 3) }
    }

    fn value(image: &Image) -> f32 {
        assert!(image.data.iter().all(|value| *value == image.data[0]));
        image.data[0]
    }

    #[test]
    fn connected_light_is_added_to_a_mean_that_stays_on_the_gpu() {
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU");
        let pass = |crossed: f32, connected: ConnectedImage| UnitParts {
            crossed: DeviceImage::Gpu(GpuImage::of(&gpu, 2, 1, &flat(crossed).data).unwrap()),
            connected: Some(Arc::new(connected)),
        };
        let connected = |levels: usize, value: f32, error: Image| ConnectedImage {
            levels,
            block: 1,
            paths: 4,
            image: flat(value),
            error,
        };
        let summed = |images: Vec<ImageRef>| {
            let weighted = |image| WeightedImage { image, weight: [1.0; 3] };
            let images: Vec<WeightedImage> = images.into_iter().map(weighted).collect();
            value(&weighted_sum(&images, 2, 1).unwrap())
        };
        let mut gathered = Gathered::default();
        gathered.add(pass(1.0, connected(1, 8.0, Image::default())), 4).unwrap();
        assert!(gathered.gpu().is_some() && gathered.errors().is_none());
        assert_eq!((value(&gathered.noisy().unwrap()), summed(gathered.layers().collect())), (9.0, 9.0));
        gathered.add(pass(3.0, connected(2, 16.0, flat(32.0))), 4).unwrap();
        assert_eq!((value(&gathered.noisy().unwrap()), summed(gathered.layers().collect())), (18.0, 18.0));
        // Half of the difference of two passes of as many paths.
        assert_eq!(summed(gathered.errors().unwrap().collect()), 1.0 + 32.0);
        gathered.take_connected(Arc::new(connected(3, 0.0, flat(-1.0))));
        assert_eq!((value(&gathered.noisy().unwrap()), gathered.connected_levels()), (2.0, Some(3)));
        assert_eq!(summed(gathered.errors().unwrap().collect()), 0.0);
        assert!(gathered.gpu().is_some());
    }
}
