//! Errors between pictures: what the quality and parity tables print.
//!
//! The "tonemapped space" of PSNR, SSIM and FLIP: both pictures are exposed by the one factor that brings the mean of
//! the *reference* to 0.5, negatives are clipped, and Reinhard's `x / (1 + x)` (paper, equation 6) follows. The
//! factor comes from the reference alone, so that a picture that is too bright as a whole counts as wrong.

use crate::Image;
pub use crate::flip::flip;
pub use crate::ssim::ssim;

/// The figures of one picture against its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// [`psnr_reinhard`], dB.
    pub psnr: f64,
    /// [`smape`].
    pub smape: f64,
    /// [`ssim`] of the tonemapped pictures, mean over channels.
    pub ssim: f64,
    /// [`flip`] of the tonemapped pictures, mean over pixels.
    pub flip: f64,
}

/// All figures of a scene-linear RGB picture against its reference. Panics if the shapes differ.
pub fn quality(test: &Image, reference: &Image) -> Quality {
    let exposure = exposure(reference);
    let (toned_test, toned_reference) = (tonemap(test, exposure), tonemap(reference, exposure));
    Quality {
        psnr: psnr(&toned_test, &toned_reference),
        smape: smape(test, reference),
        ssim: ssim(&toned_test, &toned_reference),
        flip: flip(&toned_test, &toned_reference),
    }
}

/// PSNR in dB of scene-linear pictures in tonemapped space; infinite if they are equal there.
pub fn psnr_reinhard(test: &Image, reference: &Image) -> f64 {
    let exposure = exposure(reference);
    psnr(&tonemap(test, exposure), &tonemap(reference, exposure))
}

/// PSNR in dB of pictures with values in 0..1; infinite if they are equal.
pub fn psnr(test: &Image, reference: &Image) -> f64 {
    let squares = pairs(test, reference).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    -10.0 * (squares / test.data.len() as f64).log10()
}

/// Symmetric mean absolute percentage error of scene-linear pictures, exposed as for PSNR but not tonemapped: the
/// mean of `|a - b| / (|a| + |b| + 0.01)`, 0..1.
pub fn smape(test: &Image, reference: &Image) -> f64 {
    let exposure = exposure(reference) as f64;
    let relative = |(a, b): (f64, f64)| {
        let (a, b) = (exposure * a, exposure * b);
        (a - b).abs() / (a.abs() + b.abs() + 0.01)
    };
    pairs(test, reference).map(relative).sum::<f64>() / test.data.len() as f64
}

/// Relative mean squared error, `mean((a - b)^2 / (b^2 + 0.01))` of scene-linear pictures exposed as for PSNR.
pub fn relative_mse(test: &Image, reference: &Image) -> f64 {
    let exposure = exposure(reference) as f64;
    let relative = |(a, b): (f64, f64)| {
        let (a, b) = (exposure * a, exposure * b);
        (a - b) * (a - b) / (b * b + 0.01)
    };
    pairs(test, reference).map(relative).sum::<f64>() / test.data.len() as f64
}

/// The factor that brings the mean of all values to 0.5; 1 for a black picture.
pub fn exposure(reference: &Image) -> f32 {
    let mean = mean(reference);
    if mean > 0.0 { (0.5 / mean) as f32 } else { 1.0 }
}

/// Reinhard's curve of the exposed picture; negative and NaN values become 0.
pub fn tonemap(image: &Image, exposure: f32) -> Image {
    let tone = |v: &f32| {
        let x = (v * exposure).max(0.0);
        // Infinity is white.
        if x < f32::MAX { x / (1.0 + x) } else { 1.0 }
    };
    Image { data: image.data.iter().map(tone).collect(), ..*image }
}

/// Relative differences of the means over 8 by 8 pixel blocks, for each block and channel: `|a - b| / (max(a, b) +
/// 0.01 m)`, `m` the mean of `b`. Blocks at the right and lower border may be smaller. In block order.
pub fn block_differences(a: &Image, b: &Image) -> Vec<f64> {
    let floor = 0.01 * mean(b);
    let difference = |(a, b): (f64, f64)| {
        let scale = a.max(b) + floor;
        if scale > 0.0 { (a - b).abs() / scale } else { 0.0 }
    };
    assert!(a.same_shape(b), "images of one shape");
    block_means(a).into_iter().zip(block_means(b)).map(difference).collect()
}

/// Median and 95th percentile (nearest rank) of some values; NaN counts as largest. `(0, 0)` if there are none.
pub fn median_and_p95(values: &[f64]) -> (f64, f64) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = |q: f64| sorted.get((q * sorted.len() as f64).ceil() as usize - 1).copied().unwrap_or(0.0);
    if sorted.is_empty() { (0.0, 0.0) } else { (rank(0.5), rank(0.95)) }
}

const BLOCK: usize = 8;

fn block_means(image: &Image) -> Vec<f64> {
    let channels = image.channels;
    let mut means = Vec::new();
    for y0 in (0..image.height).step_by(BLOCK) {
        for x0 in (0..image.width).step_by(BLOCK) {
            let (x1, y1) = ((x0 + BLOCK).min(image.width), (y0 + BLOCK).min(image.height));
            let mut sums = vec![0.0; channels];
            for y in y0..y1 {
                let row = &image.data[(y * image.width + x0) * channels..(y * image.width + x1) * channels];
                row.iter().enumerate().for_each(|(i, v)| sums[i % channels] += *v as f64);
            }
            let count = ((x1 - x0) * (y1 - y0)) as f64;
            means.extend(sums.iter().map(|sum| sum / count));
        }
    }
    means
}

fn mean(image: &Image) -> f64 {
    image.data.iter().map(|v| *v as f64).sum::<f64>() / image.data.len().max(1) as f64
}

fn pairs<'a>(test: &'a Image, reference: &'a Image) -> impl Iterator<Item = (f64, f64)> + 'a {
    assert!(test.same_shape(reference), "images of one shape");
    test.data.iter().zip(&reference.data).map(|(a, b)| (*a as f64, *b as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(value: f32) -> Image {
        Image { width: 20, height: 12, channels: 3, data: vec![value; 20 * 12 * 3] }
    }

    #[test]
    fn psnr_of_a_known_error_is_its_formula() {
        // Mean of the reference is 2, so the exposure is 1/4: tones 1/3 and 3/7.
        let expected = -20.0 * (3.0f64 / 7.0 - 1.0 / 3.0).log10();
        assert!((psnr_reinhard(&constant(3.0), &constant(2.0)) - expected).abs() < 1e-4);
        assert_eq!(psnr_reinhard(&constant(2.0), &constant(2.0)), f64::INFINITY);
    }

    #[test]
    fn psnr_sees_a_wrong_exposure() {
        assert!(psnr_reinhard(&constant(2.0), &constant(1.0)) < 20.0);
    }

    #[test]
    fn figures_do_not_depend_on_the_unit_of_light() {
        let (a, b) = (constant(0.3), constant(0.2));
        let (a1000, b1000) = (constant(300.0), constant(200.0));
        assert!((psnr_reinhard(&a, &b) - psnr_reinhard(&a1000, &b1000)).abs() < 1e-3);
        assert!((smape(&a, &b) - smape(&a1000, &b1000)).abs() < 1e-5);
        assert!((relative_mse(&a, &b) - relative_mse(&a1000, &b1000)).abs() < 1e-5);
    }

    #[test]
    fn smape_is_symmetric_in_shape_and_bounded() {
        assert_eq!(smape(&constant(0.4), &constant(0.4)), 0.0);
        assert!((smape(&constant(0.0), &constant(1.0)) - 0.5 / 0.51).abs() < 1e-6);
    }

    #[test]
    fn black_reference_gives_finite_figures() {
        let figures = quality(&constant(0.0), &constant(0.0));
        assert_eq!((figures.psnr, figures.smape, figures.ssim, figures.flip), (f64::INFINITY, 0.0, 1.0, 0.0));
    }

    #[test]
    fn infinite_pixel_is_white_and_nan_black() {
        let image = Image { width: 2, height: 1, channels: 1, data: vec![f32::INFINITY, f32::NAN] };
        assert_eq!(tonemap(&image, 1.0).data, [1.0, 0.0]);
    }

    #[test]
    fn blocks_average_before_they_compare() {
        let (mut a, b) = (constant(1.0), constant(1.0));
        // Noise that cancels inside a block is not an error.
        for (i, pixel) in a.data.chunks_exact_mut(3).enumerate() {
            pixel.fill(if i % 2 == 0 { 0.5 } else { 1.5 });
        }
        let differences = block_differences(&a, &b);
        assert_eq!(differences.len(), 3 * 2 * 3);
        assert!(differences.iter().all(|d| *d < 1e-6));
        // A whole block off by a quarter is: |1.25 - 1| / (1.25 + 0.01).
        for y in 0..8 {
            for x in 8..16 {
                a.data[(y * 20 + x) * 3] = 1.25;
                a.data[(y * 20 + x) * 3 + 1] = 1.0;
                a.data[(y * 20 + x) * 3 + 2] = 1.0;
            }
        }
        let differences = block_differences(&a, &b);
        assert!((differences[3] - 0.25 / 1.26).abs() < 1e-6);
        assert!(differences.iter().enumerate().all(|(i, d)| i == 3 || *d < 1e-6));
    }

    #[test]
    fn percentiles_are_nearest_ranks() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!(median_and_p95(&values), (50.0, 95.0));
        assert_eq!(median_and_p95(&[]), (0.0, 0.0));
        assert_eq!(median_and_p95(&[7.0]), (7.0, 7.0));
    }
}
