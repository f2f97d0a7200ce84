//! A frame as weighted images: those without noise are summed, the others are summed and denoised together.

use crate::device::image::ImageRef;
use crate::error::SessionError;
use crate::relight::denoise::Denoise;
use crate::relight::film::{CatcherPlace, Film};
use crate::relight::upsample::upsampled;
use rayon::prelude::*;
use relume_gather::DenoiseQuality;
use relume_gpu::{GpuError, GpuImage};
use relume_image::Image;

/// Image and its weight.
pub(crate) struct WeightedImage<'a> {
    /// Image of the full size, or of half of it; on the GPU only of the full size.
    pub image: ImageRef<'a>,
    pub weight: [f32; 3],
}

/// Images that a frame is the sum of.
#[derive(Default)]
pub(crate) struct FrameImages<'a> {
    pub clean: Vec<WeightedImage<'a>>,
    pub noisy: Vec<WeightedImage<'a>>,
}

/// A picture of 1/`scale` of the full size each way, coarser than the frame.
pub(crate) struct Coarse<'a> {
    /// 2 or 4.
    pub scale: usize,
    /// Its pixels are so many of the frame each way.
    pub by: usize,
    pub denoise: &'a Denoise,
}

impl Coarse<'_> {
    /// Weighted sum of images of the full size beside a frame of `width` by `height` pixels.
    fn sum(&self, images: &[WeightedImage], width: usize, height: usize) -> Result<Image, GpuError> {
        let to_half = if self.by == self.scale { 2 } else { 1 };
        let half = weighted_sum(images, width / to_half, height / to_half)?;
        Ok(if self.scale == 4 { downsampled(&half) } else { half })
    }
}

impl FrameImages<'_> {
    /// Scene-linear RGBA of a film with this alpha, the bottom row first. What is noisy has the size of a coarser picture, if
    /// there is one, until it is denoised. `sum` is for the sum without alpha, whatever it was before: one frame after the other
    /// can use its memory.
    pub fn sum(
        &self,
        film: Film,
        alpha: &Image,
        denoise: &Denoise,
        coarse: Option<Coarse<'_>>,
        sum: &mut Image,
    ) -> Result<Image, SessionError> {
        sum_into(sum, &self.clean, alpha.width, alpha.height)?;
        if !self.noisy.is_empty() {
            let noisy = match coarse {
                Some(coarse) => {
                    let mut noisy = coarse.sum(&self.noisy, alpha.width, alpha.height)?;
                    coarse.denoise.images(std::slice::from_mut(&mut noisy), DenoiseQuality::Fast)?;
                    upsampled(&noisy, coarse.by, coarse.denoise.features(), denoise.features())
                }
                None => {
                    let mut noisy = weighted_sum(&self.noisy, alpha.width, alpha.height)?;
                    denoise.images(std::slice::from_mut(&mut noisy), DenoiseQuality::Fast)?;
                    noisy
                }
            };
            sum.add_scaled(&noisy, &[1.0; 3]);
        }
        if !film.catches() {
            return Ok(with_alpha(sum, alpha));
        }
        let (picture, alpha) = film.develop(std::mem::take(sum), alpha, CatcherPlace::Picture).picture();
        Ok(with_alpha(&picture, &alpha))
    }
}

/// Weighted sum of RGB images, of `width` by `height` pixels; images of twice that size are averaged by two by two. Those on the
/// GPU are summed there and come back as one.
pub(crate) fn weighted_sum(images: &[WeightedImage], width: usize, height: usize) -> Result<Image, GpuError> {
    let mut sum = Image::default();
    sum_into(&mut sum, images, width, height)?;
    Ok(sum)
}

/// [`weighted_sum`] in the place of an image of any size.
fn sum_into(sum: &mut Image, images: &[WeightedImage], width: usize, height: usize) -> Result<(), GpuError> {
    let (mut on_cpu, mut on_gpu) = (Vec::new(), Vec::new());
    for WeightedImage { image, weight } in images {
        match image {
            ImageRef::Cpu(image) => on_cpu.push((*image, weight)),
            ImageRef::Gpu(image) => on_gpu.push((*image, *weight)),
        }
    }
    if sum.data.len() != width * height * 3 {
        sum.data = vec![0.0; width * height * 3];
    }
    (sum.width, sum.height, sum.channels) = (width, height, 3);
    let of_gpu = on_gpu.first();
    if let Some((image, _)) = of_gpu {
        let scale = if (image.width(), image.height()) == (width, height) { 1 } else { 2 };
        GpuImage::weighted_sum(&on_gpu, scale, &mut sum.data)?;
    }
    sum.data.par_chunks_exact_mut(width * 3).enumerate().for_each(|(y, row)| {
        if of_gpu.is_none() {
            row.fill(0.0);
        }
        for (image, weight) in &on_cpu {
            if (image.width, image.height) == (width, height) {
                add_row(row, &image.data[y * width * 3..][..width * 3], weight);
            } else {
                let [upper, lower] =
                    [2 * y, 2 * y + 1].map(|y| &image.data[y * image.width * 3..][..width * 6]);
                add_halved_row(row, upper, lower, &weight.map(|w| 0.25 * w));
            }
        }
    });
    Ok(())
}

fn add_row(row: &mut [f32], values: &[f32], weight: &[f32; 3]) {
    for (sum, value) in row.as_chunks_mut::<3>().0.iter_mut().zip(values.as_chunks::<3>().0) {
        for c in 0..3 {
            sum[c] += weight[c] * value[c];
        }
    }
}

fn add_halved_row(row: &mut [f32], upper: &[f32], lower: &[f32], weight: &[f32; 3]) {
    let pairs = upper.as_chunks::<6>().0.iter().zip(lower.as_chunks::<6>().0);
    for (sum, (a, b)) in row.as_chunks_mut::<3>().0.iter_mut().zip(pairs) {
        for c in 0..3 {
            sum[c] += weight[c] * (a[c] + a[c + 3] + b[c] + b[c + 3]);
        }
    }
}

/// RGBA from colour and alpha, bottom row first.
pub(crate) fn with_alpha(rgb: &Image, alpha: &Image) -> Image {
    let mut out = Image::new(rgb.width, rgb.height, 4);
    let rows = rgb.data.par_chunks_exact(3 * rgb.width).zip(alpha.data.par_chunks_exact(rgb.width)).rev();
    out.data.par_chunks_exact_mut(4 * rgb.width).zip(rows).for_each(|(out, (rgb, alpha))| {
        let pixels = rgb.as_chunks::<3>().0.iter().zip(alpha);
        for (out, ([r, g, b], a)) in out.as_chunks_mut::<4>().0.iter_mut().zip(pixels) {
            *out = [*r, *g, *b, *a];
        }
    });
    out
}

/// Half of the size by averages of two by two pixels; an odd last column or row is left out, as in
/// [`relume_proxy::Proxy::coarse_pixels`]. Pictures of a single row or column stay as they are.
pub(crate) fn downsampled(image: &Image) -> Image {
    if image.width < 2 || image.height < 2 {
        return image.clone();
    }
    let mut out = Image::new(image.width / 2, image.height / 2, image.channels);
    let row = out.width * out.channels;
    for (y, target) in out.data.chunks_exact_mut(row).enumerate() {
        let [upper, lower] = [2 * y, 2 * y + 1]
            .map(|y| &image.data[y * image.width * image.channels..][..image.width * image.channels]);
        for (i, value) in target.iter_mut().enumerate() {
            let (x, c) = (i / image.channels, i % image.channels);
            let [a, b] = [2 * x, 2 * x + 1].map(|x| x * image.channels + c);
            *value = 0.25 * (upper[a] + upper[b] + lower[a] + lower[b]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::image::DeviceImage;

    #[test]
    fn layers_of_both_sizes_add_up() {
        let values: Vec<f32> = (0..4 * 3 * 3).map(|i| i as f32).collect();
        let gpu = relume_gpu::Gpu::open(&relume_gpu::GpuChoice::Best).expect("tests need a GPU");
        let there = DeviceImage::Gpu(GpuImage::of(&gpu, 4, 3, &values).unwrap());
        let full = Image { data: values, ..Image::new(4, 3, 3) };
        assert_eq!(downsampled(&full).data[..3], [7.5, 8.5, 9.5]);
        let here = DeviceImage::Cpu(full);
        let half = DeviceImage::Cpu(Image { data: vec![1.0; 2 * 3], ..Image::new(2, 1, 3) });
        let before = || [Image::default(), Image { data: vec![f32::NAN; 2 * 3], ..Image::new(3, 2, 1) }];
        for (full, mut sum) in [&here, &there].into_iter().flat_map(|full| before().map(|sum| (full, sum))) {
            let layers = [
                WeightedImage { image: full.into(), weight: [1.0, 2.0, 0.0] },
                WeightedImage { image: (&half).into(), weight: [0.0, 0.0, 5.0] },
            ];
            sum_into(&mut sum, &layers, 2, 1).unwrap();
            assert_eq!((sum.width, sum.height, sum.channels), (2, 1, 3));
            // Means of rows 0 and 1, columns 0 and 1, then 2 and 3, of the red and green channel.
            assert_eq!(sum.data, [7.5, 17.0, 5.0, 13.5, 29.0, 5.0]);
        }
    }

    #[test]
    fn frames_begin_with_the_bottom_row() {
        let rgb = Image { data: (0..6).map(|i| i as f32).collect(), ..Image::new(1, 2, 3) };
        let alpha = Image { data: vec![0.5, 1.0], ..Image::new(1, 2, 1) };
        assert_eq!(with_alpha(&rgb, &alpha).data, [3.0, 4.0, 5.0, 1.0, 0.0, 1.0, 2.0, 0.5]);
    }
}
