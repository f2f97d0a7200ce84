use crate::device::connections::ConnectedImage;
use crate::device::gather::UnitParts;
use crate::device::image::DeviceImage;
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
    /// Denoises a picture, beside which the result is kept. None if `stop` ended it.
    pub fn of(
        noisy: &DeviceImage,
        denoise: &Denoise,
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<Option<Self>, SessionError> {
        let mut image = noisy.read()?;
        let done = denoise.images_until(std::slice::from_mut(&mut image), quality, stop)?;
        Ok(done.then(|| Self { image: DeviceImage::on_device_of(noisy, image), quality }))
    }
}

/// Picture summed over the paths, one pass after the other.
#[derive(Default)]
pub(crate) struct Gathered {
    /// Mean over the paths of `passes`.
    pub mean: DeviceImage,
    pub passes: usize,
    pub samples: u32,
    /// Draw of the error of `mean`; empty for a single pass.
    pub error: DeviceImage,
    /// Number of passes that were denoised, and their denoised mean.
    pub clean: Option<(usize, Clean)>,
    /// Connected light that is part of `mean`.
    pub connected: Option<Arc<ConnectedImage>>,
}

impl Gathered {
    /// Adds the mean of one more pass. Its connected light, of more paths, takes the place of that before.
    pub fn add(&mut self, parts: UnitParts, samples: u32) -> Result<(), GpuError> {
        let UnitParts { crossed: mut image, connected } = parts;
        let before = std::mem::replace(&mut self.connected, connected);
        if let Some(in_mean) = before.as_ref().or(self.connected.as_ref()) {
            image.add(&in_mean.image, 1.0)?;
        }
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
            self.renew_connected(before)?;
        }
        self.passes += 1;
        self.samples = all;
        Ok(())
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
    pub fn take_connected(&mut self, connected: Arc<ConnectedImage>) -> Result<(), GpuError> {
        let before = self.connected.replace(connected);
        if let Some(before) =
            before.as_ref().filter(|before| !before.error.data.is_empty() && !self.error.is_empty())
        {
            self.error.add(&before.error, -1.0)?;
        }
        self.renew_connected(before)?;
        self.clean.iter_mut().for_each(|(passes, _)| *passes = 0);
        Ok(())
    }

    /// Puts new connected light in the place of that before, and its error into that of all.
    fn renew_connected(&mut self, before: Option<Arc<ConnectedImage>>) -> Result<(), GpuError> {
        let (Some(now), Some(before)) = (&self.connected, before) else { return Ok(()) };
        if !Arc::ptr_eq(now, &before) {
            self.mean.add(&before.image, -1.0)?;
            self.mean.add(&now.image, 1.0)?;
        }
        if !now.error.data.is_empty() && !self.error.is_empty() {
            self.error.add(&now.error, 1.0)?;
        }
        Ok(())
    }

    /// Denoises the mean; false if `stop` ended it.
    pub fn denoise(
        &mut self,
        denoise: &Denoise,
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, SessionError> {
        let Some(clean) = Clean::of(&self.mean, denoise, quality, stop)? else { return Ok(false) };
        self.clean = Some((self.passes, clean));
        Ok(true)
    }

    /// Copy for a final image, denoised if a denoiser is given.
    pub fn final_image(&mut self, denoise: Option<&Denoise>) -> Result<Image, SessionError> {
        if let Some(denoise) = denoise {
            self.denoise(denoise, DenoiseQuality::High, None)?;
        }
        let clean = self.newest_clean(DenoiseQuality::High).filter(|_| denoise.is_some());
        Ok(clean.unwrap_or(&self.mean).read()?)
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
