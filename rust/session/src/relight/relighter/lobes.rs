//! Pictures of lights parted by lobes.

use std::sync::PoisonError;

use relume_gather::DenoiseQuality;
use relume_image::Image;
use relume_scene::Light;

use super::Relighter;
use crate::error::SessionError;
use crate::progress::{Monitor, Stage};
use crate::relight::light_cache::key;
use crate::relight::options::RelightOptions;
use crate::relight::source::{Method, UnitSource};

/// Lobes of a light's unit image, denoised or not.
pub(super) struct KeptLobes {
    light: Light,
    denoised: bool,
    parts: Vec<Image>,
}

impl Relighter {
    /// Makes ahead what a picture of lights needs; [`Self::relight`] with the same options then only sums. Lobes are kept for one
    /// picture.
    ///
    /// # Errors
    /// Fails like [`Self::relight`].
    pub fn prepare(
        &self,
        lights: &[Light],
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> Result<(), SessionError> {
        let options = &self.usable(options, monitor)?;
        let units = self.unit_images(lights, options, monitor)?;
        let lobes = self.lobes(lights, &units, options, monitor)?;
        self.statics(options.denoise)?;
        let kept = lights.iter().zip(lobes).map(|(light, parts)| KeptLobes {
            light: key(light),
            denoised: options.denoise,
            parts,
        });
        self.lobes.lock().unwrap_or_else(PoisonError::into_inner).extend(kept);
        Ok(())
    }

    /// Options as far as they can be met: without denoising if there is no denoiser, with a warning; lobes by the bake's paths.
    ///
    /// # Errors
    /// If lobes are asked for and there is no dump.
    pub(super) fn usable(
        &self,
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> Result<RelightOptions, SessionError> {
        let options = self.without_missing_denoiser(options, monitor);
        if options.lobes && self.gather.is_none() {
            let folder = self.folder.display();
            let text = format!("{folder} holds no bake; only the paths of a bake tell lobes apart");
            return Err(SessionError::Settings(text));
        }
        Ok(RelightOptions { method: if options.lobes { Method::Gather } else { options.method }, ..options })
    }

    /// Lobes of each light's unit image, which add up to it, in the order of [`relume_gather::LobePart::ALL`]; none unless asked for.
    pub(super) fn lobes(
        &self,
        lights: &[Light],
        units: &[(Image, UnitSource)],
        options: &RelightOptions,
        monitor: &Monitor,
    ) -> Result<Vec<Vec<Image>>, SessionError> {
        if !options.lobes {
            return Ok(Vec::new());
        }
        let stage = monitor.stage(Stage::Gather, 0, lights.len() as u64);
        let mut lobes = Vec::with_capacity(lights.len());
        for (light, (unit, _)) in lights.iter().zip(units) {
            lobes.push(match self.take_lobes(light, options.denoise) {
                Some(parts) => parts,
                None => self.parted(light, unit, options.denoise, monitor)?,
            });
            stage.advance(1, &light.name);
        }
        Ok(lobes)
    }

    fn take_lobes(&self, light: &Light, denoised: bool) -> Option<Vec<Image>> {
        let mut kept = self.lobes.lock().unwrap_or_else(PoisonError::into_inner);
        let key = key(light);
        let found = kept.iter().position(|kept| kept.denoised == denoised && kept.light == key)?;
        Some(kept.swap_remove(found).parts)
    }

    /// Parts of a light's unit image. Each is denoised by itself; all are scaled to the image then.
    fn parted(
        &self,
        light: &Light,
        unit: &Image,
        denoise: bool,
        monitor: &Monitor,
    ) -> Result<Vec<Image>, SessionError> {
        let Some(gather) = &self.gather else { return Ok(Vec::new()) };
        let mut parts = gather.part_images(light, &|| monitor.cancelled())?;
        if denoise {
            for part in parts.iter_mut().filter(|part| part.data.iter().any(|value| *value != 0.0)) {
                if monitor.cancelled() {
                    return Err(SessionError::Cancelled);
                }
                self.denoise.images(std::slice::from_mut(part), DenoiseQuality::High)?;
            }
        }
        fit(&mut parts, unit);
        Ok(parts)
    }
}

/// Scales parts value by value so that they add up to the whole. Where all are black and it is not, the brightest picture of them takes
/// it.
fn fit(parts: &mut [Image], whole: &Image) {
    let total = |image: &Image| image.data.iter().sum::<f32>();
    let brightest = (0..parts.len()).max_by(|a, b| total(&parts[*a]).total_cmp(&total(&parts[*b])));
    let Some(brightest) = brightest else { return };
    for (index, whole) in whole.data.iter().enumerate() {
        let sum: f32 = parts.iter().map(|part| part.data[index]).sum();
        let factor = whole / sum;
        if sum > 0.0 && factor.is_finite() {
            parts.iter_mut().for_each(|part| part.data[index] *= factor);
        } else {
            parts.iter_mut().for_each(|part| part.data[index] = 0.0);
            parts[brightest].data[index] = *whole;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: [f32; 6]) -> Image {
        Image { data: values.to_vec(), ..Image::new(2, 1, 3) }
    }

    #[test]
    fn parts_are_scaled_to_the_whole_and_the_brightest_takes_what_none_has() {
        let mut parts = [image([1.0, 2.0, 0.0, 0.0, 1.0, 0.0]), image([3.0, 2.0, 4.0, 0.0, 1.0, 0.0])];
        fit(&mut parts, &image([2.0, 4.0, 0.0, 5.0, 1.0, 0.0]));
        assert_eq!(parts[0], image([0.5, 2.0, 0.0, 0.0, 0.5, 0.0]));
        assert_eq!(parts[1], image([1.5, 2.0, 0.0, 5.0, 0.5, 0.0]));
    }
}
