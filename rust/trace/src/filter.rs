//! Pixel filters, sampled by importance so that every path has weight 1.

use std::f32::consts::TAU;

/// Distribution of the starts of paths around the centre of their pixel.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum PixelFilter {
    /// Uniform over a square of one pixel.
    Box,
    /// Cycles' Blackman-Harris; offsets reach `width` pixels to each side.
    BlackmanHarris {
        /// Blender's filter width, pixels.
        width: f32,
    },
    /// Cycles' Gaussian, whose standard deviation is a quarter of `width`; offsets reach 1.5 `width` pixels to each side.
    Gaussian {
        /// Blender's filter width, pixels.
        width: f32,
    },
}

impl Default for PixelFilter {
    fn default() -> Self {
        Self::BlackmanHarris { width: 1.5 }
    }
}

/// Entries of the inverted distribution, as many as in Cycles.
const TABLE_SIZE: usize = 1024;

/// Offsets of one axis by their quantile.
#[derive(Clone, Debug)]
pub(crate) struct FilterTable {
    offsets: Vec<f32>,
}

impl FilterTable {
    pub fn new(filter: PixelFilter) -> Self {
        let quantile = |index: usize| index as f64 / (TABLE_SIZE - 1) as f64;
        let offsets = match filter {
            PixelFilter::Box => vec![-0.5, 0.5],
            PixelFilter::BlackmanHarris { width } => (0..TABLE_SIZE)
                .map(|index| 2.0 * width * (invert_blackman_harris(quantile(index)) as f32 - 0.5))
                .collect(),
            PixelFilter::Gaussian { width } => {
                (0..TABLE_SIZE).map(|index| width * invert_gaussian(quantile(index)) as f32).collect()
            }
        };
        Self { offsets }
    }

    /// Offset from the pixel's centre for a number in 0..1.
    #[inline]
    pub fn sample(&self, u: f32) -> f32 {
        let position = u * (self.offsets.len() - 1) as f32;
        let below = (position as usize).min(self.offsets.len() - 2);
        let fraction = position - below as f32;
        self.offsets[below] + (self.offsets[below + 1] - self.offsets[below]) * fraction
    }
}

/// Place in 0..1 at which the integral of the window reaches `quantile` of its total, by bisection. The coefficients
/// are those of the four-term Blackman-Harris window (Harris 1978), as in Cycles' `scene/film.cpp`.
fn invert_blackman_harris(quantile: f64) -> f64 {
    const COEFFICIENTS: [f64; 4] = [0.35875, -0.48829, 0.14128, -0.01168];
    let integral = |x: f64| {
        let waves = (1..4).map(|k| {
            let frequency = f64::from(TAU) * k as f64;
            COEFFICIENTS[k] * (frequency * x).sin() / frequency
        });
        COEFFICIENTS[0] * x + waves.sum::<f64>()
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if integral(middle) < quantile * COEFFICIENTS[0] { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Place in -1.5..1.5 at which the integral of a Gaussian of deviation 1/4, cut off there, reaches `quantile` of its
/// total, by bisection. Cycles' `scene/film.cpp` has `exp(-2 (6 x / w)^2)` for a support of `w = 3`.
fn invert_gaussian(quantile: f64) -> f64 {
    // The integral from the middle, by the midpoint rule: right to 1e-7 of the total.
    const STEPS: usize = 512;
    let integral = |x: f64| {
        let step = x / STEPS as f64;
        let value = |index: usize| (-8.0 * ((index as f64 + 0.5) * step).powi(2)).exp();
        (0..STEPS).map(value).sum::<f64>() * step
    };
    let wanted = (2.0 * quantile - 1.0) * integral(1.5);
    let (mut low, mut high) = (-1.5, 1.5);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if integral(middle) < wanted { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_are_symmetric_and_stay_within_the_width() {
        let table = FilterTable::new(PixelFilter::BlackmanHarris { width: 1.5 });
        for step in 0..=1000 {
            let u = step as f32 / 1000.0;
            assert!((table.sample(u) + table.sample(1.0 - u)).abs() < 1e-4);
            assert!(table.sample(u).abs() <= 1.5);
        }
        assert_eq!(FilterTable::new(PixelFilter::Box).sample(0.25), -0.25);
    }

    #[test]
    fn variance_is_that_of_the_window() {
        let table = FilterTable::new(PixelFilter::BlackmanHarris { width: 1.5 });
        let variance = (0..100_000).map(|i| table.sample((i as f32 + 0.5) / 1e5).powi(2)).sum::<f32>() / 1e5;
        // Second moment of the window over a support of 3 pixels, by summation.
        let window = |x: f64| {
            let v = std::f64::consts::TAU * (x / 3.0 + 0.5);
            0.35875 - 0.48829 * v.cos() + 0.14128 * (2.0 * v).cos() - 0.01168 * (3.0 * v).cos()
        };
        let samples = (0..30_000).map(|i| (f64::from(i) + 0.5) / 1e4 - 1.5);
        let (moment, weight) = samples.fold((0.0, 0.0), |(m, w), x| (m + x * x * window(x), w + window(x)));
        assert!((f64::from(variance) - moment / weight).abs() < 1e-3, "{variance} {}", moment / weight);
    }

    #[test]
    fn quantiles_of_a_gaussian_are_at_quarters_of_its_width() {
        let table = FilterTable::new(PixelFilter::Gaussian { width: 2.0 });
        // Shares of a normal distribution below one and two deviations.
        for (quantile, offset) in [(0.5, 0.0), (0.841_344_7, 0.5), (0.977_249_9, 1.0), (0.158_655_3, -0.5)] {
            assert!((table.sample(quantile) - offset).abs() < 1e-3, "{quantile}");
        }
        assert_eq!([table.sample(0.0), table.sample(1.0)], [-3.0, 3.0]);
    }
}
