//! LDR-FLIP: Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom, Fairchild, "FLIP: A Difference Evaluator for
//! Alternating Images", HPG 2020. Section numbers below are the paper's.

use crate::Image;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Pixels per degree of the paper's default viewer: 0.7 m from a 0.7 m wide monitor of 3840 pixels.
const PIXELS_PER_DEGREE: f32 = 0.7 * (3840.0 / 0.7) * (PI / 180.0);
/// Exponent of the colour difference (4.1.3).
const Q_C: f32 = 0.7;
/// Colour differences above this share of the largest one are compressed (4.1.3).
const P_C: f32 = 0.4;
/// Value that the above share maps to (4.1.3).
const P_T: f32 = 0.95;
/// Width of an edge detector in degrees (4.2).
const FEATURE_WIDTH: f32 = 0.082;
/// Exponent of the feature difference (4.2).
const Q_F: f32 = 0.5;

/// Mean FLIP error, 0..1, of RGB pictures given as display-*linear* values in 0..1 (the sRGB curve, with which FLIP
/// itself begins, is taken as already undone). Panics if the shapes differ or are not RGB.
pub fn flip(test: &Image, reference: &Image) -> f64 {
    assert!(test.same_shape(reference) && test.channels == 3, "RGB images of one shape");
    if test.data.is_empty() {
        return 0.0;
    }
    let (test, reference) = (opponent_planes(test), opponent_planes(reference));
    let color = color_difference(&test, &reference);
    let feature = feature_difference(&test, &reference);
    // 4.3: features raise the colour difference.
    let total: f64 = color.iter().zip(&feature).map(|(c, f)| c.powf(1.0 - f) as f64).sum();
    total / color.len() as f64
}

/// One channel of a picture.
#[derive(Clone)]
struct ChannelPlane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

/// 4.1: contrast-filtered colours compared in Hunt-adjusted L*a*b*.
fn color_difference(test: &[ChannelPlane; 3], reference: &[ChannelPlane; 3]) -> Vec<f32> {
    let filter = |planes: &[ChannelPlane; 3]| -> Vec<[f32; 3]> {
        let filtered: Vec<ChannelPlane> =
            planes.par_iter().zip(CONTRAST).map(|(plane, terms)| contrast_filter(plane, &terms)).collect();
        (0..filtered[0].values.len())
            .into_par_iter()
            .map(|i| {
                let opponent = [filtered[0].values[i], filtered[1].values[i], filtered[2].values[i]];
                let rgb = mul(&RGB_FROM_XYZ, xyz_from_opponent(opponent)).map(|v| v.clamp(0.0, 1.0));
                hunt(lab_from_rgb(rgb))
            })
            .collect()
    };
    let largest = hyab(hunt(lab_from_rgb([0.0, 1.0, 0.0])), hunt(lab_from_rgb([0.0, 0.0, 1.0]))).powf(Q_C);
    let (test, reference) = (filter(test), filter(reference));
    let difference = |(a, b): (&[f32; 3], &[f32; 3])| {
        let d = hyab(*a, *b).powf(Q_C);
        let knee = P_C * largest;
        if d < knee { P_T / knee * d } else { P_T + (d - knee) / (largest - knee) * (1.0 - P_T) }
    };
    test.par_iter().zip(&reference).map(difference).collect()
}

/// 4.2: difference of edges and points in the achromatic channel.
fn feature_difference(test: &[ChannelPlane; 3], reference: &[ChannelPlane; 3]) -> Vec<f32> {
    let sigma = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * sigma).ceil() as i32;
    let gauss: Vec<f32> =
        (-radius..=radius).map(|x| (-(x * x) as f32 / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f32 = gauss.iter().sum();
    let smooth: Vec<f32> = gauss.iter().map(|g| g / sum).collect();
    let edge = signed_unit((-radius..=radius).zip(&gauss).map(|(x, g)| -x as f32 * g).collect());
    let point = signed_unit(
        (-radius..=radius).zip(&gauss).map(|(x, g)| ((x * x) as f32 / (sigma * sigma) - 1.0) * g).collect(),
    );
    let strength = |planes: &[ChannelPlane; 3], kernel: &[f32]| -> Vec<f32> {
        let mut luminance = planes[0].clone();
        luminance.values.iter_mut().for_each(|y| *y = (*y + 16.0) / 116.0);
        let (along_x, along_y) =
            (convolve(&luminance, kernel, &smooth), convolve(&luminance, &smooth, kernel));
        along_x.values.iter().zip(&along_y.values).map(|(x, y)| x.hypot(*y)).collect()
    };
    let (edges_a, edges_b) = (strength(test, &edge), strength(reference, &edge));
    let (points_a, points_b) = (strength(test, &point), strength(reference, &point));
    let difference = |i: usize| {
        let larger = (edges_a[i] - edges_b[i]).abs().max((points_a[i] - points_b[i]).abs());
        (std::f32::consts::FRAC_1_SQRT_2 * larger).powf(Q_F)
    };
    (0..edges_a.len()).map(difference).collect()
}

/// Scales positive weights to sum 1 and negative ones to sum -1.
fn signed_unit(kernel: Vec<f32>) -> Vec<f32> {
    let positive: f32 = kernel.iter().filter(|k| **k > 0.0).sum();
    let negative: f32 = -kernel.iter().filter(|k| **k < 0.0).sum::<f32>();
    kernel.into_iter().map(|k| if k > 0.0 { k / positive } else { k / negative }).collect()
}

/// Contrast sensitivity of the three opponent channels as sums of two Gaussians `a sqrt(pi / b) exp(-pi^2 d^2 / b)`
/// of the angle `d` in degrees (4.1.1, table 1): `[a1, b1, a2, b2]` for achromatic, red-green, blue-yellow.
const CONTRAST: [[f32; 4]; 3] =
    [[1.0, 0.0047, 0.0, 1.0e-5], [1.0, 0.0053, 0.0, 1.0e-5], [34.1, 0.04, 13.5, 0.025]];

/// Convolves with the contrast sensitivity. Each Gaussian is separable; the sum is normalised as a whole.
fn contrast_filter(plane: &ChannelPlane, &[a1, b1, a2, b2]: &[f32; 4]) -> ChannelPlane {
    // 4.1.1: one radius for all channels, three standard deviations of the widest Gaussian.
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let gauss = |b: f32| -> Vec<f32> {
        let angle = |x: i32| x as f32 / PIXELS_PER_DEGREE;
        (-radius..=radius).map(|x| (-PI * PI * angle(x) * angle(x) / b).exp()).collect()
    };
    let term = |a: f32, b: f32| {
        let kernel = gauss(b);
        let weight = a * (PI / b).sqrt();
        (weight * kernel.iter().sum::<f32>().powi(2), weight, kernel)
    };
    let (sum1, weight1, kernel1) = term(a1, b1);
    let (sum2, weight2, kernel2) = term(a2, b2);
    let mut out = convolve(plane, &kernel1, &kernel1);
    let total = sum1 + sum2;
    out.values.iter_mut().for_each(|v| *v *= weight1 / total);
    if a2 > 0.0 {
        let second = convolve(plane, &kernel2, &kernel2);
        out.values.iter_mut().zip(&second.values).for_each(|(v, s)| *v += weight2 / total * s);
    }
    out
}

/// Separable convolution (as correlation: kernels are symmetric or only their magnitude counts), edges repeated.
fn convolve(plane: &ChannelPlane, kernel_x: &[f32], kernel_y: &[f32]) -> ChannelPlane {
    let (width, height) = (plane.width, plane.height);
    let mut rows = vec![0.0; plane.values.len()];
    rows.par_chunks_exact_mut(width).zip(plane.values.par_chunks_exact(width)).for_each(|(out, row)| {
        for (x, sum) in out.iter_mut().enumerate() {
            *sum =
                kernel_x.iter().enumerate().map(|(k, w)| w * row[clamped(x, k, kernel_x.len(), width)]).sum();
        }
    });
    let mut values = vec![0.0; plane.values.len()];
    values.par_chunks_exact_mut(width).enumerate().for_each(|(y, out)| {
        for (k, weight) in kernel_y.iter().enumerate() {
            let from = clamped(y, k, kernel_y.len(), height) * width;
            out.iter_mut().zip(&rows[from..from + width]).for_each(|(sum, v)| *sum += weight * v);
        }
    });
    ChannelPlane { width, height, values }
}

fn clamped(at: usize, k: usize, kernel_len: usize, len: usize) -> usize {
    (at + k).saturating_sub(kernel_len / 2).min(len - 1)
}

/// XYZ from linear RGB with sRGB primaries and D65, the rational values that FLIP's authors publish.
const XYZ_FROM_RGB: [[f32; 3]; 3] = [
    [10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0],
    [2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0],
    [1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0],
];

/// The inverse of [`XYZ_FROM_RGB`].
const RGB_FROM_XYZ: [[f32; 3]; 3] = inverse(XYZ_FROM_RGB);

const fn inverse(m: [[f32; 3]; 3]) -> [[f32; 3]; 3] {
    let mut out = [[0.0; 3]; 3];
    let mut row = 0;
    while row < 3 {
        let mut column = 0;
        while column < 3 {
            let (r1, r2, c1, c2) = ((column + 1) % 3, (column + 2) % 3, (row + 1) % 3, (row + 2) % 3);
            out[row][column] = m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1];
            column += 1;
        }
        row += 1;
    }
    let determinant = m[0][0] * out[0][0] + m[0][1] * out[1][0] + m[0][2] * out[2][0];
    let mut i = 0;
    while i < 9 {
        out[i / 3][i % 3] /= determinant;
        i += 1;
    }
    out
}

fn mul(m: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2])
}

/// XYZ relative to the white of linear RGB (1, 1, 1).
fn relative_xyz(rgb: [f32; 3]) -> [f32; 3] {
    let (xyz, white) = (mul(&XYZ_FROM_RGB, rgb), mul(&XYZ_FROM_RGB, [1.0; 3]));
    std::array::from_fn(|i| xyz[i] / white[i])
}

/// The linear opponent space Y y Cx Cz (4.1.1).
fn opponent_planes(image: &Image) -> [ChannelPlane; 3] {
    let opponent: Vec<[f32; 3]> = image
        .data
        .par_chunks_exact(3)
        .map(|rgb| {
            let [x, y, z] = relative_xyz([rgb[0], rgb[1], rgb[2]].map(|v| v.clamp(0.0, 1.0)));
            [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
        })
        .collect();
    std::array::from_fn(|c| ChannelPlane {
        width: image.width,
        height: image.height,
        values: opponent.iter().map(|o| o[c]).collect(),
    })
}

fn xyz_from_opponent([yy, cx, cz]: [f32; 3]) -> [f32; 3] {
    let y = (yy + 16.0) / 116.0;
    let white = mul(&XYZ_FROM_RGB, [1.0; 3]);
    [(y + cx / 500.0) * white[0], y * white[1], (y - cz / 200.0) * white[2]]
}

/// CIE L*a*b*.
fn lab_from_rgb(rgb: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let [x, y, z] = relative_xyz(rgb)
        .map(|t| if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Chroma weighs less in the dark (4.1.2).
fn hunt([l, a, b]: [f32; 3]) -> [f32; 3] {
    [l, 0.01 * l * a, 0.01 * l * b]
}

/// Distance for large colour differences (4.1.2).
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(rgb: [f32; 3]) -> Image {
        Image { width: 48, height: 32, channels: 3, data: rgb.repeat(48 * 32) }
    }

    #[test]
    fn equal_pictures_have_zero() {
        let mut a = constant([0.2, 0.5, 0.7]);
        a.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i * 37 % 101) as f32 / 101.0);
        assert_eq!(flip(&a, &a), 0.0);
    }

    #[test]
    fn black_against_white_is_near_one() {
        // L* differs by 100; 100^0.7 lies above the knee of the map: 0.967 by hand.
        let error = flip(&constant([0.0; 3]), &constant([1.0; 3]));
        assert!((error - 0.967).abs() < 2e-3, "{error}");
    }

    #[test]
    fn green_against_blue_is_the_largest_difference() {
        let error = flip(&constant([0.0, 1.0, 0.0]), &constant([0.0, 0.0, 1.0]));
        assert!((error - 1.0).abs() < 1e-4, "{error}");
    }

    #[test]
    fn error_is_symmetric_and_grows_with_the_difference() {
        let (a, b, c) = (constant([0.5; 3]), constant([0.55; 3]), constant([0.8; 3]));
        assert_eq!(flip(&a, &b), flip(&b, &a));
        assert!(0.0 < flip(&a, &b) && flip(&a, &b) < flip(&a, &c));
    }

    #[test]
    fn single_pixel_noise_is_seen_less_than_a_broad_difference() {
        let grey = constant([0.4; 3]);
        let (mut noisy, mut shifted) = (grey.clone(), grey.clone());
        for (i, pixel) in noisy.data.chunks_exact_mut(3).enumerate() {
            pixel[0] += if (i % 48 + i / 48) % 2 == 0 { 0.1 } else { -0.1 };
        }
        shifted.data.chunks_exact_mut(3).for_each(|pixel| pixel[0] += 0.1);
        assert!(flip(&noisy, &grey) < 0.5 * flip(&shifted, &grey));
    }

    #[test]
    fn an_edge_raises_the_error_around_it() {
        // The same mean colour difference, once with a structure in it.
        let grey = constant([0.3; 3]);
        let mut lines = grey.clone();
        for (i, pixel) in lines.data.chunks_exact_mut(3).enumerate() {
            if i % 48 == 24 {
                pixel.fill(0.9);
            }
        }
        let (test, reference) = (opponent_planes(&lines), opponent_planes(&grey));
        let features = feature_difference(&test, &reference);
        // By hand: the point detector has sigma 2.75 pixels and 0.299 of its negative weight in the middle; the line
        // is 0.6 brighter: sqrt(0.6 * 0.299 / sqrt(2)).
        assert!((features[16 * 48 + 24] - 0.356).abs() < 2e-3, "{}", features[16 * 48 + 24]);
        assert_eq!(features[16 * 48 + 4], 0.0);
    }

    #[test]
    fn opponent_space_inverts() {
        for rgb in [[0.1, 0.9, 0.3], [1.0, 0.0, 0.0], [0.25; 3]] {
            let planes = opponent_planes(&Image { width: 1, height: 1, channels: 3, data: rgb.to_vec() });
            let opponent = [planes[0].values[0], planes[1].values[0], planes[2].values[0]];
            let back = mul(&RGB_FROM_XYZ, xyz_from_opponent(opponent));
            assert!((0..3).all(|c| (back[c] - rgb[c]).abs() < 1e-4), "{rgb:?} {back:?}");
        }
    }
}
