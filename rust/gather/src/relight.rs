use rayon::prelude::*;
use relume_image::Image;

/// Sums unit images weighted with their lights' radiances, RGB: the step that a change of colour, strength or mute costs.
/// `size` is the size of the result where there are no lights.
///
/// # Panics
/// If the images differ in size or are not RGB.
pub fn relight(size: (usize, usize), lights: &[(&Image, [f32; 3])]) -> Image {
    const ROWS: usize = 16;
    let mut sum = Image::new(size.0, size.1, 3);
    for (unit, _) in lights {
        assert_eq!(
            (unit.width, unit.height, unit.channels),
            (sum.width, sum.height, 3),
            "size of a unit image"
        );
    }
    let chunk = (sum.width * 3 * ROWS).max(1);
    sum.data.par_chunks_mut(chunk).enumerate().for_each(|(index, values)| {
        for (unit, radiance) in lights {
            let unit = &unit.data[index * chunk..][..values.len()];
            for (sum, unit) in values.as_chunks_mut::<3>().0.iter_mut().zip(unit.as_chunks::<3>().0) {
                for channel in 0..3 {
                    sum[channel] += unit[channel] * radiance[channel];
                }
            }
        }
    });
    sum
}

/// Noise of the average of two independent halves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Root of the mean square error over pixels and channels, in the units of the images.
    pub rmse: f32,
    /// Mean of the average.
    pub mean: f32,
}

impl Noise {
    /// Estimates it from unit images of [`crate::SampleSplit::First`] and [`crate::SampleSplit::Second`]: half of their difference has the
    /// variance of their average.
    pub fn between(first: &Image, second: &Image) -> Self {
        let pairs = || first.data.iter().zip(&second.data).map(|(&a, &b)| (f64::from(a), f64::from(b)));
        let count = first.data.len().max(1) as f64;
        let square: f64 = pairs().map(|(a, b)| 0.25 * (a - b) * (a - b)).sum();
        let mean: f64 = pairs().map(|(a, b)| 0.5 * (a + b)).sum();
        Self { rmse: (square / count).sqrt() as f32, mean: (mean / count) as f32 }
    }

    /// The error relative to the mean; 0 for a black image.
    pub fn relative(&self) -> f32 {
        if self.mean > 0.0 { self.rmse / self.mean } else { 0.0 }
    }
}
