use relume_gpu::{GpuError, GpuImage};
use relume_image::Image;

/// An RGB image that stays where it was made: on the GPU, or on the CPU.
pub(crate) enum DeviceImage {
    Cpu(Image),
    Gpu(GpuImage),
}

/// An RGB image wherever it is.
#[derive(Clone, Copy)]
pub(crate) enum ImageRef<'a> {
    Cpu(&'a Image),
    Gpu(&'a GpuImage),
}

impl<'a> From<&'a DeviceImage> for ImageRef<'a> {
    fn from(image: &'a DeviceImage) -> Self {
        match image {
            DeviceImage::Cpu(image) => Self::Cpu(image),
            DeviceImage::Gpu(image) => Self::Gpu(image),
        }
    }
}

impl<'a> From<&'a Image> for ImageRef<'a> {
    fn from(image: &'a Image) -> Self {
        Self::Cpu(image)
    }
}

impl Default for DeviceImage {
    /// One without pixels.
    fn default() -> Self {
        Self::Cpu(Image::default())
    }
}

impl DeviceImage {
    /// Image made on the GPU. It stays there if that leaves room for others.
    pub fn from_gpu(image: GpuImage) -> Result<Self, GpuError> {
        let mut made = Self::Gpu(image);
        if !made.leaves_room() {
            made.move_to_cpu()?;
        }
        Ok(made)
    }

    /// Image made from `other`, on whose device it is put if that leaves room for others.
    pub fn on_device_of(other: &Self, image: Image) -> Self {
        let copy = |other: &GpuImage| GpuImage::of(other.gpu(), image.width, image.height, &image.data);
        // Where the GPU fails, whoever next needs the other one says so.
        let copy = other.on_gpu().and_then(|other| copy(other).ok()).map(Self::Gpu);
        copy.filter(Self::leaves_room).unwrap_or(Self::Cpu(image))
    }

    /// True if the GPU has room left for the images of gathers and sums.
    fn leaves_room(&self) -> bool {
        const IMAGES: usize = 32;
        self.on_gpu().is_some_and(|image| image.gpu().free_memory() >= (IMAGES * self.bytes()) as u64)
    }

    pub fn is_empty(&self) -> bool {
        self.bytes() == 0
    }

    /// Bytes of memory, wherever it is.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Cpu(image) => size_of_val(image.data.as_slice()),
            Self::Gpu(image) => image.values().len() * size_of::<f32>(),
        }
    }

    pub fn on_gpu(&self) -> Option<&GpuImage> {
        match self {
            Self::Gpu(image) => Some(image),
            Self::Cpu(_) => None,
        }
    }

    /// Copy on the CPU.
    pub fn read(&self) -> Result<Image, GpuError> {
        match self {
            Self::Cpu(image) => Ok(image.clone()),
            Self::Gpu(image) => {
                let (width, height, channels) = (image.width(), image.height(), 3);
                Ok(Image { width, height, channels, data: image.read()? })
            }
        }
    }

    /// Moves it to the CPU.
    pub fn move_to_cpu(&mut self) -> Result<(), GpuError> {
        if self.on_gpu().is_some() {
            *self = Self::Cpu(self.read()?);
        }
        Ok(())
    }

    /// Moves by `share` towards another image of its size, which becomes `scale` times their difference. Both come to
    /// the CPU unless both are on the GPU.
    pub fn take_in(&mut self, other: &mut Self, share: f32, scale: f32) -> Result<(), GpuError> {
        if let (Self::Gpu(image), Self::Gpu(other)) = (&mut *self, &mut *other) {
            return image.take_in(other, share, scale);
        }
        self.move_to_cpu()?;
        other.move_to_cpu()?;
        if let (Self::Cpu(image), Self::Cpu(other)) = (self, other) {
            for (value, other) in image.data.iter_mut().zip(&mut other.data) {
                let difference = *other - *value;
                *value += share * difference;
                *other = scale * difference;
            }
        }
        Ok(())
    }
}
