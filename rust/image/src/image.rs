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

    /// Rows from `first` on, `count` of them.
    pub fn rows(&self, first: usize, count: usize) -> Self {
        let row = self.width * self.channels;
        let data = self.data[first * row..][..count * row].to_vec();
        Self { width: self.width, height: count, channels: self.channels, data }
    }

    /// True if both have the same width, height and channels.
    pub fn same_shape(&self, other: &Image) -> bool {
        (self.width, self.height, self.channels) == (other.width, other.height, other.channels)
    }

    /// The image at another size: each pixel the mean of what it covers, by area.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (columns, rows) = (coverage(self.width, width), coverage(self.height, height));
        let mut resized = Self::new(width, height, self.channels);
        for (pixel, sums) in resized.data.chunks_exact_mut(self.channels.max(1)).enumerate() {
            for &(y, of_row) in &rows[pixel / width] {
                for &(x, of_column) in &columns[pixel % width] {
                    for (sum, value) in sums.iter_mut().zip(self.pixel(x, y)) {
                        *sum += of_row * of_column * value;
                    }
                }
            }
        }
        resized
    }

    /// The image so many times smaller along each edge: each pixel the mean of a square, which is smaller at the right and the
    /// bottom. Panics if `factor` is 0.
    pub fn shrunk(&self, factor: usize) -> Self {
        let mut small = Self::new(self.width.div_ceil(factor), self.height.div_ceil(factor), self.channels);
        for (i, pixel) in self.data.chunks_exact(self.channels.max(1)).enumerate() {
            let [x, y] = [i % self.width, i / self.width];
            let along = |at: usize, length: usize| factor.min(length - at / factor * factor) as f32;
            let share = 1.0 / (along(x, self.width) * along(y, self.height));
            let first = (y / factor * small.width + x / factor) * self.channels;
            for (mean, value) in small.data[first..].iter_mut().zip(pixel) {
                *mean += share * value;
            }
        }
        small
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

/// For each of `to` equal parts of a length the shares of the `from` parts that it covers.
fn coverage(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let scale = from as f64 / to.max(1) as f64;
    let part = |i: usize| {
        let (low, high) = (i as f64 * scale, (i + 1) as f64 * scale);
        let covered = low as usize..(high.ceil() as usize).min(from);
        let share = |k: usize| (high.min((k + 1) as f64) - low.max(k as f64)) / scale;
        covered.map(|k| (k, share(k) as f32)).filter(|(_, share)| *share > 0.0).collect()
    };
    (0..to).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_of_a_shrunk_image_are_means_of_squares() {
        let data: Vec<f32> = (0..5 * 3 * 2).map(|i| i as f32).collect();
        let image = Image { width: 5, height: 3, channels: 2, data };
        let small = image.shrunk(2);
        assert_eq!((small.width, small.height, small.channels), (3, 2, 2));
        assert_eq!(small.pixel(1, 0), [(4 + 6 + 14 + 16) as f32 / 4.0, (5 + 7 + 15 + 17) as f32 / 4.0]);
        assert_eq!(small.pixel(2, 0), [(8 + 18) as f32 / 2.0, (9 + 19) as f32 / 2.0], "half a square");
        assert_eq!(small.pixel(2, 1), image.pixel(4, 2), "a quarter");
        assert_eq!(image.shrunk(1), image);
    }

    #[test]
    fn resizing_keeps_means_and_places() {
        let data: Vec<f32> = (0..6 * 4 * 3).map(|i| (i * i % 17) as f32).collect();
        let image = Image { width: 6, height: 4, channels: 3, data };
        let mean = |image: &Image| image.data.iter().sum::<f32>() / image.data.len() as f32;
        for (width, height) in [(3, 2), (12, 8), (5, 3), (1, 1), (6, 4)] {
            let resized = image.resized(width, height);
            assert!((mean(&resized) - mean(&image)).abs() < 1e-4, "{width} x {height}");
        }
        assert_eq!(image.resized(6, 4), image);
        assert_eq!(image.resized(12, 8).pixel(11, 7), image.pixel(5, 3));
    }
}
