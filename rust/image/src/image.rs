/// A float image, row-major from the top left pixel, channels interleaved. Values are scene-linear.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values per pixel.
    pub channels: usize,
    /// `height * width * channels` values.
    pub data: Vec<f32>,
}

impl Image {
    /// A black image.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// Number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.width * self.height
    }

    /// The values of one pixel.
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let start = (y * self.width + x) * self.channels;
        &self.data[start..start + self.channels]
    }

    /// Whether both have the same width, height and channels.
    pub fn same_shape(&self, other: &Image) -> bool {
        (self.width, self.height, self.channels) == (other.width, other.height, other.channels)
    }

    /// Adds `factor` times `other`, channel by channel. Panics if the channels of `factor` or the shapes differ.
    pub fn add_scaled(&mut self, other: &Image, factor: &[f32]) {
        assert!(self.same_shape(other) && factor.len() == self.channels, "images of one shape");
        for (sum, value) in
            self.data.chunks_exact_mut(factor.len()).zip(other.data.chunks_exact(factor.len()))
        {
            for c in 0..factor.len() {
                sum[c] += factor[c] * value[c];
            }
        }
    }
}
