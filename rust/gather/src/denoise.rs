//! Open Image Denoise on the CPU or a GPU, through the `oidn` crate.
//!
//! The module links against `libOpenImageDenoise.so.2`. That is the name under which Blender has loaded its own copy, so
//! inside Blender (and `bpy`) the loader binds to that one, whatever its version from 2.3 on; elsewhere, and in Blenders
//! built without OIDN, the copy bundled with the wheel is found through the run path of the module. So the wheel needs,
//! from the PyPI package `pyoidn` of the version in `scripts/setup`, in one folder:
//! `libOpenImageDenoise.so.2`, `libOpenImageDenoise_core.so.2.x.y`, `libOpenImageDenoise_device_cpu.so.2.x.y` and
//! `libtbb.so.12` (real files, no links), and for GPUs `libOpenImageDenoise_device_cuda.so.2.x.y` and `libOpenImageDenoise_device_hip.so.2.x.y`, each with the run path `$ORIGIN`, and the module with `$ORIGIN/<that folder>`.
//! On Windows they are `OpenImageDenoise.dll`, `OpenImageDenoise_core.dll` and so on, and the Python package names the folder.

#[cfg(oidn)]
use std::cell::RefCell;
#[cfg(oidn)]
use std::ffi::{CStr, c_void};
use std::sync::Arc;

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
    /// For previews and training targets.
    Fast,
    /// For the viewport.
    #[default]
    Balanced,
    /// For final images.
    High,
}

/// Whether to stop in the middle.
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
    /// The same in no others.
    identity: Arc<()>,
}

impl DenoiseFeatures {
    /// As they are, for pictures that must not wait.
    pub fn noisy(aovs: &Aovs) -> Self {
        let (width, height) = (aovs.albedo.width, aovs.albedo.height);
        let albedo = aovs.albedo.data.iter().map(|value| value.clamp(0.0, 1.0)).collect();
        let (normal, identity) = (aovs.normal.data.clone(), Arc::default());
        Self { width, height, albedo, normal, is_clean: false, identity }
    }
}

/// Where to denoise.
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
    pub fn features(&self, _aovs: &Aovs) -> Result<DenoiseFeatures, DenoiseError> {
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
    pub fn features(&self, aovs: &Aovs) -> Result<DenoiseFeatures, DenoiseError> {
        let mut features = DenoiseFeatures::noisy(aovs);
        for (name, values) in [(c"albedo", &mut features.albedo), (c"normal", &mut features.normal)] {
            let filter = Filter::new(&self.device, features.width, features.height, name)?;
            filter.commit(DenoiseQuality::High);
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

/// OIDN's `RT` filter over buffers on its device. The crate's safe filter can neither say that features are clean (2.5.1
/// sets a parameter that the library does not know) nor denoise the features themselves.
#[cfg(oidn)]
struct Filter {
    raw: sys::OIDNFilter,
    width: usize,
    height: usize,
    /// What the library reads and writes: RGB.
    pixels: DeviceImage,
    inputs: Vec<DeviceImage>,
}

// SAFETY: the library's objects may be used from any thread, and they keep their device alive.
#[cfg(oidn)]
unsafe impl Send for Filter {}

#[cfg(oidn)]
impl Filter {
    /// A filter of pictures with these features.
    fn of_pictures(
        device: &oidn::Device,
        features: &DenoiseFeatures,
        quality: DenoiseQuality,
    ) -> Result<Self, DenoiseError> {
        let mut filter = Self::new(device, features.width, features.height, c"color")?;
        filter.input(device, c"albedo", &features.albedo)?;
        filter.input(device, c"normal", &features.normal)?;
        filter.flag(c"hdr");
        if features.is_clean {
            filter.flag(c"cleanAux");
        }
        filter.commit(quality);
        Ok(filter)
    }

    /// A filter of the image that the library calls `name`.
    fn new(device: &oidn::Device, width: usize, height: usize, name: &CStr) -> Result<Self, DenoiseError> {
        let pixels = DeviceImage::new(device, width * height * 3)?;
        // SAFETY: the device is alive; the name ends with a zero; null is checked for before the filter is used.
        let raw = unsafe { sys::oidnNewFilter(device.raw(), c"RT".as_ptr()) };
        if raw.is_null() {
            device.get_error().map_err(library)?;
            return Err(DenoiseError::Library("it has no ray tracing filter".into()));
        }
        let filter = Self { raw, width, height, pixels, inputs: Vec::new() };
        filter.image(name, &filter.pixels);
        filter.image(c"output", &filter.pixels);
        Ok(filter)
    }

    /// An RGB image that the filter only reads.
    fn input(&mut self, device: &oidn::Device, name: &CStr, values: &[f32]) -> Result<(), DenoiseError> {
        let image = DeviceImage::new(device, self.width * self.height * 3)?;
        image.write(values);
        self.image(name, &image);
        self.inputs.push(image);
        Ok(())
    }

    fn image(&self, name: &CStr, image: &DeviceImage) {
        let (format, name) = (sys::OIDNFormat_OIDN_FORMAT_FLOAT3, name.as_ptr());
        assert_eq!(image.len, self.width * self.height * 3, "an RGB image of the filter's size");
        // SAFETY: filter and buffer are alive, the buffer has the stated size, and the filter keeps a reference to it.
        unsafe {
            sys::oidnSetFilterImage(self.raw, name, image.raw, format, self.width, self.height, 0, 0, 0)
        };
    }

    fn flag(&self, name: &CStr) {
        // SAFETY: the filter is alive; the name ends with a zero.
        unsafe { sys::oidnSetFilterBool(self.raw, name.as_ptr(), true) };
    }

    fn commit(&self, quality: DenoiseQuality) {
        let quality = oidn::Quality::from(quality).as_raw_oidn_quality();
        // SAFETY: the filter is alive; the name ends with a zero.
        unsafe {
            sys::oidnSetFilterInt(self.raw, c"quality".as_ptr(), quality);
            sys::oidnCommitFilter(self.raw);
        }
    }

    /// Denoises one image in place; false, and the image as it was, if `stop` said so.
    fn run(
        &self,
        device: &oidn::Device,
        image: &mut [f32],
        stop: Option<&Stop<'_>>,
    ) -> Result<bool, DenoiseError> {
        self.pixels.write(image);
        // GPUs wait for every answer, so without `stop` nobody asks.
        let (ask, user) = match &stop {
            Some(stop) => (Some(goes_on as _), (&raw const *stop).cast_mut().cast()),
            None => (None, std::ptr::null_mut()),
        };
        // SAFETY: the filter is committed, and its images are alive. The library asks, from any of its threads, only until the
        // call of execution returns: `stop` outlives that, and it is `Sync`.
        unsafe {
            sys::oidnSetFilterProgressMonitorFunction(self.raw, ask, user);
            sys::oidnExecuteFilter(self.raw);
        }
        match device.get_error() {
            Err(error) if error.kind() == oidn::ErrorKind::Canceled => return Ok(false),
            done => done.map_err(library)?,
        }
        self.pixels.read(image);
        device.get_error().map_err(library)?;
        Ok(true)
    }
}

/// The library's question whether to go on.
///
/// # Safety
/// `stop` points to a `&Stop`.
#[cfg(oidn)]
unsafe extern "C" fn goes_on(stop: *mut c_void, _progress: f64) -> bool {
    // SAFETY: as the caller promises.
    let stop = unsafe { *stop.cast_const().cast::<&Stop<'_>>() };
    !stop()
}

#[cfg(oidn)]
impl Drop for Filter {
    fn drop(&mut self) {
        // SAFETY: the only reference to the filter.
        unsafe { sys::oidnReleaseFilter(self.raw) };
    }
}

/// Floats in memory of a device.
#[cfg(oidn)]
struct DeviceImage {
    raw: sys::OIDNBuffer,
    len: usize,
}

#[cfg(oidn)]
impl DeviceImage {
    fn new(device: &oidn::Device, len: usize) -> Result<Self, DenoiseError> {
        // SAFETY: the device is alive; null is checked for.
        let raw = unsafe { sys::oidnNewBuffer(device.raw(), len * size_of::<f32>()) };
        if raw.is_null() {
            device.get_error().map_err(library)?;
            return Err(DenoiseError::Library(format!("no memory for {len} values on its device")));
        }
        Ok(Self { raw, len })
    }

    fn write(&self, values: &[f32]) {
        assert_eq!(values.len(), self.len, "values of an image on the device");
        // SAFETY: as many bytes as the buffer holds are read from a slice of that length (checked above).
        unsafe { sys::oidnWriteBuffer(self.raw, 0, size_of_val(values), values.as_ptr().cast()) };
    }

    /// Waits for what the device has to do first.
    fn read(&self, values: &mut [f32]) {
        assert_eq!(values.len(), self.len, "values of an image on the device");
        // SAFETY: as many bytes as the buffer holds are written to a slice of that length (checked above).
        unsafe { sys::oidnReadBuffer(self.raw, 0, size_of_val(values), values.as_mut_ptr().cast()) };
    }
}

#[cfg(oidn)]
impl Drop for DeviceImage {
    fn drop(&mut self) {
        // SAFETY: our reference; a filter has its own.
        unsafe { sys::oidnReleaseBuffer(self.raw) };
    }
}

/// Null if there is no module for the GPU at this address.
#[cfg(oidn)]
fn new_gpu_device(address: &str) -> Result<sys::OIDNDevice, DenoiseError> {
    if address.is_empty() && cfg!(target_os = "macos") {
        // SAFETY: creates a device of our own; the caller checks for null.
        return Ok(unsafe { sys::oidnNewDevice(sys::OIDNDeviceType_OIDN_DEVICE_TYPE_METAL) });
    }
    let numbers: Vec<_> = address.split([':', '.']).map(|part| i32::from_str_radix(part, 16)).collect();
    let [Ok(domain), Ok(bus), Ok(device), Ok(function)] = numbers[..] else {
        return Err(DenoiseError::Library(format!("'{address}' is not the PCI address of a GPU")));
    };
    // SAFETY: creates a device of our own; the caller checks for null.
    Ok(unsafe { sys::oidnNewDeviceByPCIAddress(domain, bus, device, function) })
}

/// The library's last error of this thread that belongs to no device.
#[cfg(oidn)]
fn last_error() -> String {
    let mut message = std::ptr::null();
    // SAFETY: a null device asks for this thread's error; the message is null, or a string that lives until the next call.
    unsafe {
        sys::oidnGetDeviceError(std::ptr::null_mut(), &raw mut message);
        if message.is_null() {
            return "it has no module for this device".into();
        }
        CStr::from_ptr(message).to_string_lossy().into_owned()
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

#[cfg(all(test, oidn))]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn noise(seed: usize, channels: usize) -> Image {
        let value = |i: usize| ((i + seed) * 2_654_435_761 % 1000) as f32 / 1000.0;
        Image { data: (0..64 * 48 * channels).map(value).collect(), ..Image::new(64, 48, channels) }
    }

    fn features(denoiser: &Denoiser, seed: usize) -> DenoiseFeatures {
        let aovs = Aovs {
            albedo: noise(seed, 3),
            normal: noise(seed + 1, 3),
            depth: noise(0, 1),
            emission: noise(0, 3),
            world: noise(0, 3),
            alpha: noise(0, 1),
        };
        denoiser.features(&aovs).unwrap()
    }

    #[test]
    fn what_is_stopped_stays_noisy_and_the_next_is_denoised() {
        let denoiser = Denoiser::new(&DenoiseDevice::Cpu(Some(1))).unwrap();
        let view = features(&denoiser, 7);
        let (noisy, asked) = (noise(3, 3), AtomicUsize::new(0));
        let stop = || asked.fetch_add(1, Ordering::Relaxed) > 0;
        let mut images = [noisy.clone(), noisy.clone()];
        assert!(!denoiser.denoise(&mut images, &view, DenoiseQuality::High, Some(&stop)).unwrap());
        assert_eq!(asked.into_inner(), 2, "asked once more after it had said to go on, and then no more");
        assert_eq!(images, [noisy.clone(), noisy]);
        assert!(denoiser.denoise(&mut images, &view, DenoiseQuality::High, None).unwrap());
        let mut expected = [noise(3, 3)];
        denoiser.denoise(&mut expected, &view, DenoiseQuality::High, None).unwrap();
        assert_eq!(images[1], expected[0]);
    }

    #[test]
    fn a_filter_is_made_once_for_its_features_and_quality() {
        let new = || Denoiser::new(&DenoiseDevice::Cpu(Some(1))).unwrap();
        let denoiser = new();
        let views = [features(&denoiser, 7), features(&denoiser, 70)];
        let (fast, balanced) = (DenoiseQuality::Fast, DenoiseQuality::Balanced);
        // Which view, in which quality, and how many filters there are then.
        for (seed, (view, quality, kept)) in
            [(0, fast, 1), (0, balanced, 2), (0, fast, 2), (1, fast, 1), (0, fast, 1)].into_iter().enumerate()
        {
            let [mut found, mut expected] = [0; 2].map(|_| [noise(100 * seed, 3)]);
            denoiser.denoise(&mut found, &views[view], quality, None).unwrap();
            new().denoise(&mut expected, &views[view], quality, None).unwrap();
            assert_eq!(found, expected, "picture {seed}");
            assert_eq!(denoiser.kept.borrow().filters.len(), kept, "picture {seed}");
        }
    }
}
