/// Noise, in units of its median, at which a cell counts half.
const HALF_TRUST: f32 = 2.0;
/// Cells to either side by which noise is told.
const AROUND: usize = 4;
/// By so many of its standard deviations a gain must be above 0 to be believed.
const SURE: f64 = 2.0;

/// Factors on residuals, less where they are noisy; 1 where there are none.
#[derive(Default)]
pub(super) struct Trust(Vec<f32>);

impl Trust {
    /// From how much the two estimates differ at the cells around each, not at itself: products of its two residuals would else
    /// count less where their noise happens to be of opposite sign, and their sum be least for the lights with the least noise.
    pub fn new([a, b]: &[Vec<f32>; 2]) -> Self {
        let square = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>();
        let noise: Vec<f32> = a.as_chunks().0.iter().zip(b.as_chunks().0).map(square).collect();
        let around = |i: usize| {
            let near = &noise[i.saturating_sub(AROUND)..(i + AROUND + 1).min(noise.len())];
            (near.iter().sum::<f32>() - noise[i]) / (near.len() - 1).max(1) as f32
        };
        let noise: Vec<f32> = (0..noise.len()).map(around).collect();
        let mut sorted = noise.clone();
        sorted.sort_by(f32::total_cmp);
        let half = HALF_TRUST * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let trust = |noise: &f32| if half > 0.0 { (half / (half + noise.max(0.0))).sqrt() } else { 1.0 };
        Self(noise.iter().flat_map(|noise| [trust(noise); 3]).collect())
    }

    /// That of a residual by its number.
    pub fn of(&self, number: usize) -> f32 {
        self.0.get(number).copied().unwrap_or(1.0)
    }
}

/// By how much a loss is less than before, and the standard deviation of that. Both are estimated from the cells.
pub(super) struct Gain {
    pub mean: f64,
    pub deviation: f64,
}

impl Gain {
    pub fn new(before: &[Vec<f32>; 2], after: &[Vec<f32>; 2]) -> Self {
        let products = |[a, b]: &[Vec<f32>; 2]| -> Vec<f64> {
            let of_cell = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] * b[c])).sum();
            a.as_chunks().0.iter().zip(b.as_chunks().0).map(of_cell).collect()
        };
        let gains: Vec<f64> =
            products(before).iter().zip(products(after)).map(|(before, after)| before - after).collect();
        let mean = gains.iter().sum::<f64>();
        let each = mean / gains.len().max(1) as f64;
        Self { mean, deviation: gains.iter().map(|gain| (gain - each).powi(2)).sum::<f64>().sqrt() }
    }

    /// What is left of it for sure: above 0 if there is little doubt.
    pub fn least(&self) -> f64 {
        self.mean - SURE * self.deviation
    }
}
