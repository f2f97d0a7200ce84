use crate::SessionError;
use relume_dump::Aovs;
use relume_gather::{DenoiseDevice, DenoiseError, DenoiseFeatures, DenoiseQuality, Denoiser};
use relume_gpu::Gpu;
use relume_image::Image;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A denoiser for pictures of one view, with its albedo and normals. The device starts when it is first needed.
pub struct Denoise {
    aovs: Aovs,
    /// PCI address of the GPU to denoise on, if the library knows it.
    gpu: Option<String>,
    /// Whether albedo and normals are denoised first.
    cleans: bool,
    device: Mutex<Device>,
}

enum Device {
    NotStarted,
    Ready(Denoiser, DenoiseFeatures),
    Missing(String),
}

impl Denoise {
    /// For pictures with these features; on the given GPU where the library can, else on the CPU.
    pub fn new(aovs: &Aovs, gpu: Option<&Gpu>) -> Self {
        let hardware = gpu.map(Gpu::summary).filter(|summary| !summary.software);
        let gpu = hardware.map(|summary| summary.pci_bus_id.clone());
        Self { aovs: aovs.clone(), gpu, cleans: true, device: Mutex::new(Device::NotStarted) }
    }

    /// The same with albedo and normals as they are: textures come out softer, the first picture at once.
    pub fn quick(aovs: &Aovs, gpu: Option<&Gpu>) -> Self {
        Self { cleans: false, ..Self::new(aovs, gpu) }
    }

    /// Why nothing can be denoised here, in words for the user; none if it can.
    pub fn missing(&self) -> Option<String> {
        match &*self.started() {
            Device::Missing(reason) => Some(reason.clone()),
            _ => None,
        }
    }

    /// Denoises scene-linear RGB pictures in place; they stay as they are where there is no denoiser
    /// ([`Denoise::missing`]).
    ///
    /// # Errors
    /// If the denoiser fails.
    pub fn images(&self, images: &mut [Image], quality: DenoiseQuality) -> Result<(), SessionError> {
        match &*self.started() {
            Device::Ready(denoiser, features) => Ok(denoiser.denoise(images, features, quality)?),
            _ => Ok(()),
        }
    }

    fn started(&self) -> MutexGuard<'_, Device> {
        let mut device = self.device.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(*device, Device::NotStarted) {
            *device = match self.start() {
                Ok((denoiser, features)) => Device::Ready(denoiser, features),
                Err(error) => Device::Missing(error.to_string()),
            };
        }
        device
    }

    fn start(&self) -> Result<(Denoiser, DenoiseFeatures), DenoiseError> {
        let start = |device: &DenoiseDevice| {
            let denoiser = Denoiser::new(device)?;
            let features = match self.cleans {
                true => denoiser.features(&self.aovs)?,
                false => DenoiseFeatures::noisy(&self.aovs),
            };
            Ok((denoiser, features))
        };
        let on_gpu = self.gpu.clone().and_then(|address| start(&DenoiseDevice::Gpu(address)).ok());
        let threads = rayon::current_num_threads();
        on_gpu.map_or_else(|| start(&DenoiseDevice::Cpu(Some(threads))), Ok)
    }
}
