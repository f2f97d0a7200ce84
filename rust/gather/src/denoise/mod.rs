//! Open Image Denoise on the CPU or a GPU, through the `oidn` crate.
//!
//! The module links against `libOpenImageDenoise.so.2`. That is the name under which Blender has loaded its own copy, so
//! inside Blender (and `bpy`) the loader binds to that one, whatever its version from 2.3 on; elsewhere, and in Blenders
//! built without OIDN, the copy bundled with the wheel is found through the run path of the module. So the wheel needs,
//! from the PyPI package `pyoidn` of the version in `scripts/setup`, in one folder:
//! `libOpenImageDenoise.so.2`, `libOpenImageDenoise_core.so.2.x.y`, `libOpenImageDenoise_device_cpu.so.2.x.y` and
//! `libtbb.so.12` (real files, no links), and for GPUs `libOpenImageDenoise_device_cuda.so.2.x.y` and
//! `libOpenImageDenoise_device_hip.so.2.x.y`, each with the run path `$ORIGIN`, and the module with `$ORIGIN/<that folder>`.
//! On Windows they are `OpenImageDenoise.dll`, `OpenImageDenoise_core.dll` and so on, and the Python package names the folder.

#[cfg(oidn)]
mod library;
#[cfg(all(test, oidn))]
mod tests;

#[cfg(oidn)]
use std::cell::RefCell;
use std::sync::Arc;

#[cfg(oidn)]
use library::{Filter, last_error, library, new_gpu_device};
#[cfg(oidn)]
use oidn::sys;
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum DenoiseQuality {
    /// Quality for previews and training targets.
    Fast,
    /// Quality for the viewport.
    #[default]
    Balanced,
    /// Quality for final images.
    High,
}

/// Callback that returns true to stop in the middle.
pub type Stop<'a> = dyn Fn() -> bool + Sync + 'a;

/// Albedo and normals of a view. Denoised once, every picture of the view can trust them ("clean auxiliary images" of
/// OIDN's manual; Cycles' *Accurate* prefilter); noisy, they are ready at once.
#[cfg_attr(not(oidn), expect(dead_code))]
pub struct DenoiseFeatures {
    width: usize,
    height: usize,
    albedo: Vec<f32>,
    normal: Vec<f32>,
    is_clean: bool,
    /// Identity of these features, which no others share.
    identity: Arc<()>,
}

impl DenoiseFeatures {
    /// Features as they are, for pictures that must not wait.
    pub fn noisy(aovs: &Aovs) -> Self {
        let (width, height) = (aovs.albedo.width, aovs.albedo.height);
        let albedo = aovs.albedo.data.iter().map(|value| value.clamp(0.0, 1.0)).collect();
        let (normal, identity) = (aovs.normal.data.clone(), Arc::default());
        Self { width, height, albedo, normal, is_clean: false, identity }
    }
}

/// Device that denoises.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DenoiseDevice {
    /// The CPU, on this many threads; on all cores if not given. Threads are not pinned to cores: the process is often
    /// Blender's.
    Cpu(Option<usize>),
    /// The GPU at this PCI address, `domain:bus:device.function`, hexadecimal; Apple's, whose address is empty.
    Gpu(String),
}

/// A denoising device. It may move between threads; one thread uses it at a time. It keeps what it has made ready for the
/// features that were used last.
pub struct Denoiser {
    #[cfg(oidn)]
    kept: RefCell<Kept>,
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
    pub fn new(_device: &DenoiseDevice) -> Result<Self, DenoiseError> {
        Err(DenoiseError::NotBuilt)
    }

    /// Version of the library in use.
    pub fn version(&self) -> String {
        match self.never {}
    }

    /// Features of a view.
    ///
    /// # Errors
    /// Never: there is no denoiser to call it on.
    pub fn features(&self, _aovs: &Aovs, _quality: DenoiseQuality) -> Result<DenoiseFeatures, DenoiseError> {
        match self.never {}
    }

    /// Denoises images in place.
    ///
    /// # Errors
    /// Never: there is no denoiser to call it on.
    pub fn denoise(
        &self,
        _images: &mut [Image],
        _features: &DenoiseFeatures,
        _quality: DenoiseQuality,
        _stop: Option<&Stop<'_>>,
    ) -> Result<bool, DenoiseError> {
        match self.never {}
    }
}

#[cfg(oidn)]
impl Denoiser {
    /// Starts a device.
    ///
    /// # Errors
    /// If the library cannot start it, for instance because its module for that device is missing.
    pub fn new(device: &DenoiseDevice) -> Result<Self, DenoiseError> {
        let (raw, threads) = match device {
            DenoiseDevice::Cpu(threads) => {
                // SAFETY: creates a device of our own, which is checked for null below.
                (unsafe { sys::oidnNewDevice(sys::OIDNDeviceType_OIDN_DEVICE_TYPE_CPU) }, *threads)
            }
            DenoiseDevice::Gpu(address) => (new_gpu_device(address)?, None),
        };
        if raw.is_null() {
            // Why, the library tells whoever asks for no device's error.
            return Err(DenoiseError::Library(last_error()));
        }
        // SAFETY: the device is not null, and `Device::from_raw` takes over the only reference. The parameter names end
        // with a zero; on GPUs the library ignores those of the CPU.
        let device = unsafe {
            if matches!(device, DenoiseDevice::Cpu(_)) {
                sys::oidnSetDeviceBool(raw, c"setAffinity".as_ptr(), false);
            }
            if let Some(threads) = threads {
                sys::oidnSetDeviceInt(raw, c"numThreads".as_ptr(), threads.clamp(1, 1024) as i32);
            }
            sys::oidnCommitDevice(raw);
            oidn::Device::from_raw(raw)
        };
        device.get_error().map_err(library)?;
        Ok(Self { kept: RefCell::default(), device })
    }

    /// Version of the library in use: Blender's or the bundled one.
    pub fn version(&self) -> String {
        // SAFETY: the device lives as long as `self`; the name ends with a zero.
        let version = unsafe { sys::oidnGetDeviceInt(self.device.raw(), c"version".as_ptr()) };
        format!("{}.{}.{}", version / 10000, version / 100 % 100, version % 100)
    }

    /// Makes the features of a view ready: one pass over its albedo, one over its normals.
    ///
    /// # Errors
    /// If the library fails.
    pub fn features(&self, aovs: &Aovs, quality: DenoiseQuality) -> Result<DenoiseFeatures, DenoiseError> {
        let mut features = DenoiseFeatures::noisy(aovs);
        for (name, values) in [(c"albedo", &mut features.albedo), (c"normal", &mut features.normal)] {
            let filter = Filter::new(&self.device, features.width, features.height, name)?;
            filter.commit(quality);
            filter.run(&self.device, values, None)?;
        }
        features.is_clean = true;
        Ok(features)
    }

    /// Denoises images in place, all with the same features: RGB, scene-linear, any range. Values that are not finite or
    /// below zero count as 0. False if `stop`, which the library asks from its own threads many times an image, said so: the
    /// image that was worked on and those after it are noisy then.
    ///
    /// # Errors
    /// If the sizes differ or the library fails; images denoised before the failure stay so.
    pub fn denoise(
        &self,
        images: &mut [Image],
        features: &DenoiseFeatures,
        quality: DenoiseQuality,
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, DenoiseError> {
        let mut kept = self.kept.borrow_mut();
        let filter = kept.filter(&self.device, features, quality)?;
        let denoise = |image: &mut Image| {
            if (image.width, image.height, image.channels) != (features.width, features.height, 3) {
                let found = format!("{} x {}, {} channels", image.width, image.height, image.channels);
                let features = format!("{} x {}", features.width, features.height);
                return Err(DenoiseError::Size { image: found, features });
            }
            let clean = |value: &mut f32| *value = if value.is_finite() { value.max(0.0) } else { 0.0 };
            image.data.iter_mut().for_each(clean);
            filter.run(&self.device, &mut image.data, stop)
        };
        let result = images.iter_mut().try_fold(true, |goes_on, image| Ok(goes_on && denoise(image)?));
        if matches!(result, Err(DenoiseError::Library(_))) {
            *kept = Kept::default();
        }
        result
    }
}

/// Filters for pictures with the same features: to make one takes a while, and memory of the device.
#[cfg(oidn)]
#[derive(Default)]
struct Kept {
    features: Option<Arc<()>>,
    filters: Vec<(DenoiseQuality, Filter)>,
}

#[cfg(oidn)]
impl Kept {
    /// The filter of this quality; those of other features are dropped.
    fn filter(
        &mut self,
        device: &oidn::Device,
        features: &DenoiseFeatures,
        quality: DenoiseQuality,
    ) -> Result<&Filter, DenoiseError> {
        if !self.features.as_ref().is_some_and(|kept| Arc::ptr_eq(kept, &features.identity)) {
            *self = Self { features: Some(Arc::clone(&features.identity)), filters: Vec::new() };
        }
        let known = self.filters.iter().position(|(of, _)| *of == quality);
        let place = match known {
            Some(place) => place,
            None => {
                self.filters.push((quality, Filter::of_pictures(device, features, quality)?));
                self.filters.len() - 1
            }
        };
        Ok(&self.filters[place].1)
    }
}
