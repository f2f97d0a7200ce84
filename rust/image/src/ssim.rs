//! Structural similarity: Wang, Bovik, Sheikh, Simoncelli, "Image Quality Assessment: From Error Visibility to
//! Structural Similarity", IEEE TIP 2004.

use crate::Image;
use rayon::prelude::*;

const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Mean SSIM of pictures with values in 0..1: Gaussian window of 11 by 11 pixels and sigma 1.5, only where it fits
/// (smaller pictures take the largest odd window that fits), mean over channels. 1 for equal pictures.
pub fn ssim(test: &Image, reference: &Image) -> f64 {
    assert!(test.same_shape(reference), "images of one shape");
    let shorter = test.width.min(test.height);
    if shorter == 0 || test.channels == 0 {
        return 1.0;
    }
    let window = WINDOW.min((shorter - 1) | 1);
    let total: f64 =
        (0..test.channels).into_par_iter().map(|c| channel_ssim(test, reference, c, window)).sum();
    total / test.channels as f64
}

fn channel_ssim(test: &Image, reference: &Image, channel: usize, window: usize) -> f64 {
    let plane = |image: &Image| -> Vec<f64> {
        image.data.iter().skip(channel).step_by(image.channels).map(|v| *v as f64).collect()
    };
    let (a, b) = (plane(test), plane(reference));
    let blur = |values: &[f64]| blur_where_it_fits(values, test.width, test.height, window);
    let product = |x: &[f64], y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x * y).collect() };
    let (mean_a, mean_b) = (blur(&a), blur(&b));
    let (aa, bb, ab) = (blur(&product(&a, &a)), blur(&product(&b, &b)), blur(&product(&a, &b)));
    let at = |i: usize| {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb, cov) = (aa[i] - ma * ma, bb[i] - mb * mb, ab[i] - ma * mb);
        (2.0 * ma * mb + C1) * (2.0 * cov + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
    };
    (0..mean_a.len()).map(at).sum::<f64>() / mean_a.len() as f64
}

/// Separable Gaussian; the result is smaller by `window - 1` along each axis.
fn blur_where_it_fits(values: &[f64], width: usize, height: usize, window: usize) -> Vec<f64> {
    let half = (window / 2) as f64;
    let weight = |i: usize| (-0.5 * ((i as f64 - half) / SIGMA).powi(2)).exp();
    let sum: f64 = (0..window).map(weight).sum();
    let kernel: Vec<f64> = (0..window).map(|i| weight(i) / sum).collect();
    let (out_width, out_height) = (width + 1 - window, height + 1 - window);

    let mut rows = Vec::with_capacity(out_width * height);
    for row in values.chunks_exact(width) {
        rows.extend(row.windows(window).map(|w| w.iter().zip(&kernel).map(|(v, k)| v * k).sum::<f64>()));
    }
    let mut out = vec![0.0; out_width * out_height];
    for (y, row) in out.chunks_exact_mut(out_width).enumerate() {
        for (k, weight) in kernel.iter().enumerate() {
            let from = &rows[(y + k) * out_width..(y + k + 1) * out_width];
            row.iter_mut().zip(from).for_each(|(sum, v)| *sum += weight * v);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(f: impl Fn(usize, usize) -> f32) -> Image {
        let (width, height) = (40, 30);
        let data = (0..width * height).map(|i| f(i % width, i / width)).collect();
        Image { width, height, channels: 1, data }
    }

    #[test]
    fn equal_pictures_have_one() {
        let a = image(|x, y| ((x * 7 + y * 13) % 17) as f32 / 17.0);
        assert!((ssim(&a, &a) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn constants_leave_the_luminance_term() {
        // Without structure SSIM is (2ab + C1) / (a2 + b2 + C1).
        let expected = (2.0 * 0.25 * 0.75 + C1) / (0.25 * 0.25 + 0.75 * 0.75 + C1);
        assert!((ssim(&image(|_, _| 0.25), &image(|_, _| 0.75)) - expected).abs() < 1e-9);
        assert!(ssim(&image(|_, _| 0.0), &image(|_, _| 1.0)) < 1e-3);
    }

    #[test]
    fn inverted_structure_is_negative() {
        let a = image(|x, y| ((x + y) % 2) as f32);
        let b = image(|x, y| ((x + y + 1) % 2) as f32);
        assert!(ssim(&a, &b) < -0.9);
    }

    #[test]
    fn tiny_pictures_have_a_figure() {
        let a = Image { width: 3, height: 2, channels: 1, data: vec![0.1, 0.5, 0.3, 0.2, 0.9, 0.4] };
        assert!((ssim(&a, &a) - 1.0).abs() < 1e-12);
    }
}
