use crate::device::image::DeviceImage;
use relume_gather::DenoiseQuality;
use relume_gpu::{Gpu, GpuError};

/// A denoised picture.
pub(super) struct Clean {
    pub image: DeviceImage,
    pub quality: DenoiseQuality,
}

/// A picture that grows by one pass of the paths at a time.
#[derive(Default)]
pub(super) struct Gathered {
    /// Mean over the paths of `passes`.
    pub mean: DeviceImage,
    pub passes: usize,
    pub samples: u32,
    /// A draw of the error of `mean`; empty for a single pass.
    pub error: DeviceImage,
    /// The mean of so many passes, denoised.
    pub clean: Option<(usize, Clean)>,
}

impl Gathered {
    /// Takes the mean of one more pass in.
    pub fn add(&mut self, mut image: DeviceImage, samples: u32) -> Result<(), GpuError> {
        let all = self.samples + samples;
        if self.passes == 0 {
            self.mean = image;
        } else {
            let share = samples as f32 / all as f32;
            // Means a and b of independent samples, m and n of them: a - b has the variance v (1/m + 1/n), the mean of all has
            // v / (m + n), which is m n / (m + n)^2 of it.
            let scale = (share * (1.0 - share)).sqrt();
            self.mean.take_in(&mut image, share, scale)?;
            self.error = image;
        }
        self.passes += 1;
        self.samples = all;
        Ok(())
    }

    /// Whether there is a denoised picture of as many or fewer paths.
    pub fn has_clean(&self) -> bool {
        self.clean.is_some()
    }

    /// Whether all that was gathered is denoised as well as that, or there is nothing yet.
    pub fn is_done(&self, quality: DenoiseQuality) -> bool {
        let is_newest = |(passes, clean): &(usize, Clean)| *passes == self.passes && clean.quality >= quality;
        self.passes == 0 || self.clean.as_ref().is_some_and(is_newest)
    }

    /// All its images.
    pub fn images(&self) -> impl Iterator<Item = &DeviceImage> {
        let clean = self.clean.as_ref().map(|(_, clean)| &clean.image);
        [Some(&self.mean), Some(&self.error), clean].into_iter().flatten()
    }

    /// Brings it to the CPU.
    pub fn leave_gpu(&mut self) -> Result<(), GpuError> {
        let clean = self.clean.as_mut().map(|(_, clean)| &mut clean.image);
        for image in [&mut self.mean, &mut self.error].into_iter().chain(clean) {
            image.bring_down()?;
        }
        Ok(())
    }

    /// The GPU that some of it is on.
    pub fn gpu(&self) -> Option<&Gpu> {
        self.images().find_map(DeviceImage::on_gpu).map(|image| &**image.gpu())
    }
}
