//! Open Image Denoise on the CPU, through the `oidn` crate.
//!
//! The module links against `libOpenImageDenoise.so.2`. That is the name under which Blender has loaded its own copy, so
//! inside Blender (and `bpy`) the loader binds to that one, whatever its version from 2.3 on; elsewhere, and in Blenders
//! built without OIDN, the copy bundled with the wheel is found through the run path of the module. So the wheel needs,
//! from the PyPI package `pyoidn` of the version in `scripts/setup`, in one folder:
//! `libOpenImageDenoise.so.2`, `libOpenImageDenoise_core.so.2.x.y`, `libOpenImageDenoise_device_cpu.so.2.x.y` and
//! `libtbb.so.12` (real files, no links), each with the run path `$ORIGIN`, and the module with `$ORIGIN/<that folder>`.

use relume_dump::Aovs;
use relume_image::Image;

/// Why an image was not denoised. The image is as it was; to show it undenoised is the caller's choice.
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// This build has no denoiser.
    #[error(
        "this build has no denoiser: set OIDN_DIR to an Open Image Denoise 2 and build again, or go without denoising"
    )]
    NotBuilt,
    /// Open Image Denoise reports a failure.
    #[error("Open Image Denoise failed: {0}; go on without denoising, or free memory and try again")]
    Library(String),
    /// The images do not fit together.
    #[error("cannot denoise an image of {image} with features of {features}: sizes or channels differ")]
    Size {
        /// Width, height and channels of the image.
        image: String,
        /// Width and height of the features.
        features: String,
    },
}

/// Trade of time for quality; on the CPU about 2.4, 4.7 and 11 microseconds a pixel and thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DenoiseQuality {
    /// For previews and training targets.
    Fast,
    /// For the viewport.
    #[default]
    Balanced,
    /// For final images.
    High,
}

/// A denoising device. It may move between threads; one thread uses it at a time.
pub struct Denoiser {
    #[cfg(oidn)]
    device: oidn::Device,
    #[cfg(not(oidn))]
    never: std::convert::Infallible,
}

#[cfg(not(oidn))]
impl Denoiser {
    /// This build has no denoiser.
    ///
    /// # Errors
    /// Always.
    pub fn new(_threads: Option<usize>) -> Result<Self, DenoiseError> {
        Err(DenoiseError::NotBuilt)
    }

    /// Version of the library in use.
    pub fn version(&self) -> String {
        match self.never {}
    }

    /// Denoises images in place.
    ///
    /// # Errors
    /// Never: there is no denoiser to call it on.
    pub fn denoise(
        &self,
        _images: &mut [Image],
        _aovs: &Aovs,
        _quality: DenoiseQuality,
    ) -> Result<(), DenoiseError> {
        match self.never {}
    }
}

#[cfg(oidn)]
impl Denoiser {
    /// Starts a device; `threads` limits it, all cores otherwise. Threads are not pinned to cores: the process is often
    /// Blender's.
    ///
    /// # Errors
    /// If the library cannot start its CPU device, for instance because its device module is missing.
    pub fn new(threads: Option<usize>) -> Result<Self, DenoiseError> {
        use oidn::sys;
        // SAFETY: creates a device of our own; null is checked for before anything else is done with it, and
        // `Device::from_raw` takes over the only reference. The parameter names end with a zero.
        let device = unsafe {
            let raw = sys::oidnNewDevice(sys::OIDNDeviceType_OIDN_DEVICE_TYPE_CPU);
            if raw.is_null() {
                // Reports the reason of the failure, which the raw call has left with no device.
                oidn::Device::cpu().map_err(library)?
            } else {
                sys::oidnSetDeviceBool(raw, c"setAffinity".as_ptr(), false);
                if let Some(threads) = threads {
                    sys::oidnSetDeviceInt(raw, c"numThreads".as_ptr(), threads.clamp(1, 1024) as i32);
                }
                sys::oidnCommitDevice(raw);
                oidn::Device::from_raw(raw)
            }
        };
        device.get_error().map_err(library)?;
        Ok(Self { device })
    }

    /// Version of the library in use: Blender's or the bundled one.
    pub fn version(&self) -> String {
        // SAFETY: the device lives as long as `self`; the name ends with a zero.
        let version = unsafe { oidn::sys::oidnGetDeviceInt(self.device.raw(), c"version".as_ptr()) };
        format!("{}.{}.{}", version / 10000, version / 100 % 100, version % 100)
    }

    /// Denoises images in place, all with the same features: RGB, scene-linear, any range. Values that are not finite or
    /// below zero count as 0.
    ///
    /// # Errors
    /// If the sizes differ or the library fails; images denoised before the failure stay so.
    pub fn denoise(
        &self,
        images: &mut [Image],
        aovs: &Aovs,
        quality: DenoiseQuality,
    ) -> Result<(), DenoiseError> {
        let (width, height) = (aovs.albedo.width, aovs.albedo.height);
        for image in images.iter() {
            if (image.width, image.height, image.channels) != (width, height, 3) {
                let found = format!("{} x {}, {} channels", image.width, image.height, image.channels);
                return Err(DenoiseError::Size { image: found, features: format!("{width} x {height}") });
            }
        }
        let albedo: Vec<_> = aovs.albedo.data.iter().map(|value| value.clamp(0.0, 1.0)).collect();
        let mut filter = oidn::RayTracing::try_new(&self.device).map_err(library)?;
        filter.hdr(true).filter_quality(quality.into()).image_dimensions(width, height);
        filter.albedo_normal(&albedo, &aovs.normal.data);
        for image in images {
            let clean = |value: &mut f32| *value = if value.is_finite() { value.max(0.0) } else { 0.0 };
            image.data.iter_mut().for_each(clean);
            filter.filter_in_place(&mut image.data).map_err(library)?;
        }
        Ok(())
    }
}

#[cfg(oidn)]
fn library(error: oidn::Error) -> DenoiseError {
    DenoiseError::Library(error.to_string())
}

#[cfg(oidn)]
impl From<DenoiseQuality> for oidn::Quality {
    fn from(quality: DenoiseQuality) -> Self {
        match quality {
            DenoiseQuality::Fast => Self::Fast,
            DenoiseQuality::Balanced => Self::Balanced,
            DenoiseQuality::High => Self::High,
        }
    }
}
