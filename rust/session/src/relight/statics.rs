use crate::device::image::DeviceImage;
use crate::error::SessionError;
use crate::relight::denoise::Denoise;
use crate::relight::gathered::Clean;
use relume_dump::Aovs;
use relume_gather::{DenoiseQuality, Stop};
use relume_image::Image;

/// Layer that no light changes.
pub(crate) struct StaticLayer {
    pub image: DeviceImage,
    pub clean: Option<Clean>,
    /// True without any light, such as that of a missing world.
    pub black: bool,
}

impl StaticLayer {
    /// Light of the scene's own emitters, and of the world.
    pub fn of(aovs: &Aovs) -> [Self; 2] {
        [&aovs.emission, &aovs.world].map(|image| Self::new(image.clone()))
    }

    pub fn new(image: Image) -> Self {
        let black = image.data.iter().all(|value| *value == 0.0);
        Self { image: DeviceImage::Cpu(image), clean: None, black }
    }

    /// True if it is denoised at this quality, or black.
    pub fn is_done(&self, quality: DenoiseQuality) -> bool {
        self.black || self.clean.as_ref().is_some_and(|clean| clean.quality >= quality)
    }

    /// Denoises it if it is not done; false if `stop` ended that.
    pub fn denoise(
        &mut self,
        denoise: &Denoise,
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, SessionError> {
        if !self.is_done(quality) {
            let clean = Clean::of(self.image.read()?, &self.image, denoise, quality, stop)?;
            let Some(clean) = clean else { return Ok(false) };
            self.clean = Some(clean);
        }
        Ok(true)
    }

    /// Copy for a final image, denoised.
    pub fn final_image(&mut self, denoise: &Denoise) -> Result<Image, SessionError> {
        self.denoise(denoise, DenoiseQuality::High, None)?;
        Ok(self.clean.as_ref().map_or(&self.image, |clean| &clean.image).read()?)
    }
}
