//! OIDN's objects: filters, buffers, devices of GPUs and errors.

use super::{DenoiseError, DenoiseFeatures, DenoiseQuality, Stop};
use oidn::sys;
use std::ffi::{CStr, c_void};

/// OIDN's `RT` filter over buffers on its device. The crate's safe filter can neither say that features are clean (2.5.1
/// sets a parameter that the library does not know) nor denoise the features themselves.
pub(super) struct Filter {
    raw: sys::OIDNFilter,
    width: usize,
    height: usize,
    /// Pixels that the library reads and writes: RGB.
    pixels: OidnImage,
    inputs: Vec<OidnImage>,
}

// SAFETY: the library's objects may be used from any thread, and they keep their device alive.
unsafe impl Send for Filter {}

impl Filter {
    /// A filter of pictures with these features.
    pub fn of_pictures(
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
    pub fn new(
        device: &oidn::Device,
        width: usize,
        height: usize,
        name: &CStr,
    ) -> Result<Self, DenoiseError> {
        let pixels = OidnImage::new(device, width * height * 3)?;
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
        let image = OidnImage::new(device, self.width * self.height * 3)?;
        image.write(values);
        self.image(name, &image);
        self.inputs.push(image);
        Ok(())
    }

    fn image(&self, name: &CStr, image: &OidnImage) {
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

    pub fn commit(&self, quality: DenoiseQuality) {
        let quality = oidn::Quality::from(quality).as_raw_oidn_quality();
        // SAFETY: the filter is alive; the name ends with a zero.
        unsafe {
            sys::oidnSetFilterInt(self.raw, c"quality".as_ptr(), quality);
            sys::oidnCommitFilter(self.raw);
        }
    }

    /// Denoises one image in place; false, and the image as it was, if `stop` said so.
    pub fn run(
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
unsafe extern "C" fn goes_on(stop: *mut c_void, _progress: f64) -> bool {
    // SAFETY: as the caller promises.
    let stop = unsafe { *stop.cast_const().cast::<&Stop<'_>>() };
    !stop()
}

impl Drop for Filter {
    fn drop(&mut self) {
        // SAFETY: the only reference to the filter.
        unsafe { sys::oidnReleaseFilter(self.raw) };
    }
}

/// Floats in memory of a device.
struct OidnImage {
    raw: sys::OIDNBuffer,
    len: usize,
}

impl OidnImage {
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

impl Drop for OidnImage {
    fn drop(&mut self) {
        // SAFETY: our reference; a filter has its own.
        unsafe { sys::oidnReleaseBuffer(self.raw) };
    }
}

/// Null if there is no module for the GPU at this address.
pub(super) fn new_gpu_device(address: &str) -> Result<sys::OIDNDevice, DenoiseError> {
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
pub(super) fn last_error() -> String {
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

pub(super) fn library(error: oidn::Error) -> DenoiseError {
    DenoiseError::Library(error.to_string())
}

impl From<DenoiseQuality> for oidn::Quality {
    fn from(quality: DenoiseQuality) -> Self {
        match quality {
            DenoiseQuality::Fast => Self::Fast,
            DenoiseQuality::Balanced => Self::Balanced,
            DenoiseQuality::High => Self::High,
        }
    }
}
