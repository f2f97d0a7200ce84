use std::sync::Arc;

use crate::{Buffer, Gpu, GpuError};

/// Values of a workgroup of `shaders/common/sum.wgsl` and `mean.wgsl`.
const GROUP: usize = 64;
/// Images that `sum.wgsl` adds at a time.
const IMAGES: usize = 8;

/// An RGB image on a GPU, row by row from the top.
#[derive(Debug)]
pub struct GpuImage {
    gpu: Arc<Gpu>,
    width: usize,
    height: usize,
    values: Buffer<f32>,
}

/// Arguments of `sum.wgsl`, described there.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct ImageSumArguments {
    width: u32,
    height: u32,
    row: u32,
    scale: u32,
    first: u32,
    count: u32,
}

/// Arguments of `mean.wgsl`, described there.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct MeanArguments {
    values: u32,
    share: f32,
    scale: f32,
}

impl GpuImage {
    /// A black one.
    ///
    /// # Errors
    /// See [`Gpu::zeros`].
    pub fn black(gpu: &Arc<Gpu>, width: usize, height: usize) -> Result<Self, GpuError> {
        let values = gpu.zeros("image", 3 * width * height)?;
        Ok(Self { gpu: Arc::clone(gpu), width, height, values })
    }

    /// One of these values, `3 * width * height`.
    ///
    /// # Errors
    /// See [`Gpu::zeros`].
    ///
    /// # Panics
    /// If there are more.
    pub fn of(gpu: &Arc<Gpu>, width: usize, height: usize, values: &[f32]) -> Result<Self, GpuError> {
        let image = Self::black(gpu, width, height)?;
        gpu.write(&image.values, 0, values);
        Ok(image)
    }

    /// Device of the image.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Values that kernels read and write.
    pub fn values(&self) -> &Buffer<f32> {
        &self.values
    }

    /// Copies it to the CPU.
    ///
    /// # Errors
    /// See [`Gpu::read`].
    pub fn read(&self) -> Result<Vec<f32>, GpuError> {
        self.gpu.read(&self.values, 0..self.values.len())
    }

    /// Moves by `share` towards another image, which becomes `scale` times what it differed by.
    ///
    /// # Errors
    /// If the device was lost, or refuses the kernel.
    ///
    /// # Panics
    /// If their sizes differ.
    pub fn take_in(&mut self, other: &mut Self, share: f32, scale: f32) -> Result<(), GpuError> {
        assert_eq!((self.width, self.height), (other.width, other.height), "images of one size");
        other.gpu.check()?;
        let kernel = self.gpu.kernel("common/mean", "take_in", &[])?;
        let bound = kernel.bind(&[self.values.whole(), other.values.whole()])?;
        let values = self.values.len();
        let arguments = MeanArguments { values: values as u32, share, scale };
        let mut commands = self.gpu.commands("mean");
        commands.run(&bound, values.div_ceil(GROUP) as u32, bytemuck::bytes_of(&arguments));
        commands.submit()
    }

    /// Copies to the CPU the sum of images of one size and device, each times its weight: of their size if `scale` is 1, or of half
    /// of it if that is 2, by means of two by two pixels without an odd last column or row.
    ///
    /// # Errors
    /// See [`Gpu::zeros`] and [`Gpu::read`].
    ///
    /// # Panics
    /// If there are none, their sizes differ, or there is no place for just as many values.
    pub fn weighted_sum(
        images: &[(&Self, [f32; 3])],
        scale: usize,
        values: &mut [f32],
    ) -> Result<(), GpuError> {
        let Self { gpu, width: row, height: rows, .. } = images[0].0;
        let weights: Vec<[f32; 4]> = images.iter().map(|(_, [r, g, b])| [*r, *g, *b, 0.0]).collect();
        let weights = gpu.buffer_of("weights", &weights)?;
        let sum = Self::black(gpu, row / scale, rows / scale)?;
        assert_eq!(values.len(), sum.values.len(), "values of the sum");
        let kernel = gpu.kernel("common/sum", "add_images", &[])?;
        let mut commands = gpu.commands("weighted sum");
        for (number, images) in images.chunks(IMAGES).enumerate() {
            let mut bindings = vec![weights.whole()];
            // Places without an image of their own are not read.
            bindings.extend((0..IMAGES).map(|i| images.get(i).unwrap_or(&images[0]).0.values.whole()));
            bindings.push(sum.values.whole());
            for (image, _) in images {
                assert_eq!((image.width, image.height), (*row, *rows), "images of one size");
                image.gpu.check()?;
            }
            let arguments = ImageSumArguments {
                width: sum.width as u32,
                height: sum.height as u32,
                row: *row as u32,
                scale: scale as u32,
                first: (number * IMAGES) as u32,
                count: images.len() as u32,
            };
            let groups = sum.values.len().div_ceil(GROUP) as u32;
            commands.run(&kernel.bind(&bindings)?, groups, bytemuck::bytes_of(&arguments));
        }
        commands.submit()?;
        gpu.read_into(&sum.values, 0, values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GpuChoice;

    fn gpu() -> Arc<Gpu> {
        Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
    }

    /// Values without a pattern, of both signs.
    fn values(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|i| ((i + 7919 * seed) * 2_654_435_761 % 1000) as f32 / 250.0 - 2.0).collect()
    }

    #[test]
    fn arguments_have_the_layout_of_their_wgsl_twins() {
        crate::assert_mirror!(ImageSumArguments as "common/sum", "Arguments", {
            width, height, row, scale, first, count,
        });
        crate::assert_mirror!(MeanArguments as "common/mean", "Arguments", { values, share, scale });
    }

    #[test]
    fn any_number_of_images_is_summed_at_both_sizes_and_read_back_once() {
        let gpu = gpu();
        for (width, height) in [(7, 5), (64, 2), (1, 1)] {
            for count in [1, 7, 8, 9, 20] {
                let all: Vec<Vec<f32>> = (0..count).map(|i| values(3 * width * height, i)).collect();
                let images: Vec<GpuImage> =
                    all.iter().map(|values| GpuImage::of(&gpu, width, height, values).unwrap()).collect();
                let weight = |i: usize| [0.5 + i as f32, -1.0, 1.0 / (1.0 + i as f32)];
                let layers: Vec<_> = images.iter().zip((0..count).map(weight)).collect();
                for scale in [1, 2] {
                    let before = gpu.bytes_read();
                    let (wide, high) = (width / scale, height / scale);
                    let mut found = vec![f32::NAN; 3 * wide * high];
                    GpuImage::weighted_sum(&layers, scale, &mut found).unwrap();
                    assert_eq!(gpu.bytes_read() - before, 4 * found.len() as u64);
                    for (at, found) in found.iter().enumerate() {
                        let (x, y, channel) = (at / 3 % wide, at / 3 / wide, at % 3);
                        let (mut sum, mut size) = (0.0, 0.0);
                        for (i, values) in all.iter().enumerate() {
                            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                                if dx < scale && dy < scale {
                                    let pixel = (scale * y + dy) * width + scale * x + dx;
                                    let value = f64::from(weight(i)[channel] * values[3 * pixel + channel]);
                                    sum += value / (scale * scale) as f64;
                                    size += value.abs();
                                }
                            }
                        }
                        assert!((f64::from(*found) - sum).abs() <= 1e-6 * size, "{found} {sum}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_mean_takes_images_in_and_leaves_their_differences() {
        let gpu = gpu();
        let (before, other) = (values(3 * 35, 1), values(3 * 35, 2));
        let [mut mean, mut image] = [&before, &other].map(|v| GpuImage::of(&gpu, 7, 5, v).unwrap());
        mean.take_in(&mut image, 0.25, 3.0).unwrap();
        let (mean, image) = (mean.read().unwrap(), image.read().unwrap());
        for i in 0..before.len() {
            let difference = other[i] - before[i];
            assert!((mean[i] - (before[i] + 0.25 * difference)).abs() <= 1e-6);
            assert!((image[i] - 3.0 * difference).abs() <= 1e-6);
        }
    }

    #[test]
    fn images_on_a_gpu_that_was_lost_say_so() {
        let (gpu, lost) = (gpu(), gpu());
        let [mut here, mut gone] = [&gpu, &lost].map(|gpu| GpuImage::black(gpu, 4, 4).unwrap());
        lost.lose();
        assert!(matches!(gone.read(), Err(GpuError::Lost(_))));
        assert!(matches!(here.take_in(&mut gone, 0.5, 1.0), Err(GpuError::Lost(_))));
        for layers in [[&here, &gone], [&gone, &here]].map(|images| images.map(|image| (image, [1.0; 3]))) {
            let mut sum = [7.0; 48];
            assert!(matches!(GpuImage::weighted_sum(&layers, 1, &mut sum), Err(GpuError::Lost(_))));
            assert_eq!(sum, [7.0; 48]);
        }
        assert_eq!(here.read().unwrap(), [0.0; 48]);
    }
}
