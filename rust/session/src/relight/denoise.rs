use crate::error::SessionError;
use relume_dump::Aovs;
use relume_gather::{DenoiseDevice, DenoiseError, DenoiseFeatures, DenoiseQuality, Denoiser, Stop};
use relume_gpu::Gpu;
use relume_image::Image;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Denoiser for pictures of one view, with its albedo and normals. The device starts when it is first needed. If a GPU
/// fails, the CPU takes over.
pub struct Denoise {
    aovs: Aovs,
    /// PCI address of the GPU to denoise on, if the library knows it.
    gpu: Option<String>,
    /// Quality at which albedo and normals are denoised first, if they are.
    features: Option<DenoiseQuality>,
    device: Mutex<DenoiserState>,
}

enum DenoiserState {
    NotStarted,
    Ready(Ready),
    Missing(String),
}

struct Ready {
    denoiser: Denoiser,
    features: DenoiseFeatures,
    is_gpu: bool,
}

impl Ready {
    fn denoise(
        &self,
        images: &mut [Image],
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, DenoiseError> {
        self.denoiser.denoise(images, &self.features, quality, stop)
    }
}

impl Denoise {
    /// Denoiser for pictures with these features; on the given GPU if the library can, else on the CPU.
    pub fn new(aovs: &Aovs, gpu: Option<&Gpu>) -> Self {
        let hardware = gpu.map(Gpu::summary).filter(|summary| !summary.software);
        let gpu = hardware.map(|summary| summary.pci_bus_id.clone());
        let features = Some(DenoiseQuality::High);
        Self { aovs: aovs.clone(), gpu, features, device: Mutex::new(DenoiserState::NotStarted) }
    }

    /// Sets the quality at which albedo and normals are denoised first. None keeps them noisy: textures come out
    /// softer, the first picture sooner.
    pub fn with_features(self, features: Option<DenoiseQuality>) -> Self {
        Self { features, ..self }
    }

    /// Features of the pictures.
    pub fn features(&self) -> &Aovs {
        &self.aovs
    }

    /// Reason why nothing can be denoised here, for the user; none if denoising works.
    pub fn missing(&self) -> Option<String> {
        match &*self.started() {
            DenoiserState::Missing(reason) => Some(reason.clone()),
            _ => None,
        }
    }

    /// Denoises scene-linear RGB pictures in place; they stay as they are where there is no denoiser
    /// ([`Denoise::missing`]).
    ///
    /// # Errors
    /// If the denoiser fails.
    pub fn images(&self, images: &mut [Image], quality: DenoiseQuality) -> Result<(), SessionError> {
        self.denoise(images, quality, None).map(drop)
    }

    /// [`Denoise::images`] until `stop`, which is asked from any thread many times a picture, returns true. False if it
    /// did: that picture and those after it are noisy then.
    ///
    /// # Errors
    /// If the denoiser fails.
    pub fn images_until(
        &self,
        images: &mut [Image],
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, SessionError> {
        self.denoise(images, quality, stop)
    }

    fn denoise(
        &self,
        images: &mut [Image],
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, SessionError> {
        let rows = self.aovs.depth.height;
        if images.iter().any(|image| image.height > rows) {
            return self.denoise_plates(images, rows, quality, stop);
        }
        let mut device = self.started();
        let DenoiserState::Ready(ready) = &*device else { return Ok(true) };
        if !ready.is_gpu {
            return Ok(ready.denoise(images, quality, stop)?);
        }
        let noisy = images.to_vec();
        match ready.denoise(images, quality, stop) {
            Ok(done) => Ok(done),
            Err(_) => {
                // The card was lost or is full: what has come back from it may be anything.
                images.clone_from_slice(&noisy);
                let on_cpu = self.start_on_cpu()?;
                let result = on_cpu.denoise(images, quality, stop);
                *device = DenoiserState::Ready(on_cpu);
                Ok(result?)
            }
        }
    }

    /// [`Denoise::images_until`] for films of several plates, each with the features of the picture.
    fn denoise_plates(
        &self,
        images: &mut [Image],
        rows: usize,
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, SessionError> {
        for image in images {
            let plates = (0..image.height / rows).map(|plate| image.rows(plate * rows, rows));
            let mut plates: Vec<Image> = plates.collect();
            if !self.denoise(&mut plates, quality, stop)? {
                return Ok(false);
            }
            image.data.clear();
            plates.iter().for_each(|plate| image.data.extend_from_slice(&plate.data));
        }
        Ok(true)
    }

    fn started(&self) -> MutexGuard<'_, DenoiserState> {
        let mut device = self.device.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(*device, DenoiserState::NotStarted) {
            *device = match self.start() {
                Ok(ready) => DenoiserState::Ready(ready),
                Err(error) => DenoiserState::Missing(error.to_string()),
            };
        }
        device
    }

    fn start(&self) -> Result<Ready, DenoiseError> {
        let on_gpu = self.gpu.clone().and_then(|address| self.start_on(&DenoiseDevice::Gpu(address)).ok());
        on_gpu.map_or_else(|| self.start_on_cpu(), Ok)
    }

    fn start_on_cpu(&self) -> Result<Ready, DenoiseError> {
        self.start_on(&DenoiseDevice::Cpu(Some(rayon::current_num_threads())))
    }

    fn start_on(&self, device: &DenoiseDevice) -> Result<Ready, DenoiseError> {
        let denoiser = Denoiser::new(device)?;
        let features = match self.features {
            Some(quality) => denoiser.features(&self.aovs, quality)?,
            None => DenoiseFeatures::noisy(&self.aovs),
        };
        Ok(Ready { denoiser, features, is_gpu: matches!(device, DenoiseDevice::Gpu(_)) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn aovs(width: usize, height: usize) -> Aovs {
        let black = |channels: usize| Image::new(width, height, channels);
        let (albedo, normal, emission, world) = (black(3), black(3), black(3), black(3));
        Aovs { albedo, normal, emission, world, depth: black(1), alpha: black(1) }
    }

    #[test]
    fn what_the_gpu_fails_on_the_cpu_denoises_and_goes_on() {
        let quick = |size: usize| Denoise::new(&aovs(size, size), None).with_features(None);
        let broken = match quick(8).start_on_cpu() {
            Err(error @ DenoiseError::NotBuilt) => return println!("skipped: {error}"),
            broken => broken.unwrap(),
        };
        let noise = |i: usize| (i * 2654435761 % 1000) as f32 / 1000.0;
        let noisy = Image { data: (0..3 * 64 * 64).map(noise).collect(), ..Image::new(64, 64, 3) };
        let denoise = quick(64);
        let mut expected = noisy.clone();
        denoise.images(std::slice::from_mut(&mut expected), DenoiseQuality::Fast).unwrap();
        assert_ne!(expected, noisy);

        *denoise.device.lock().unwrap() = DenoiserState::Ready(Ready { is_gpu: true, ..broken });
        let mut found = noisy.clone();
        denoise.images(std::slice::from_mut(&mut found), DenoiseQuality::Fast).unwrap();
        assert_eq!(found, expected);
        assert!(matches!(
            &*denoise.device.lock().unwrap(),
            DenoiserState::Ready(Ready { is_gpu: false, .. })
        ));
    }
}
