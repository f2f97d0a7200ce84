//! A discrete distribution by its cumulative sums.

/// Indices with probabilities in proportion to weights.
#[derive(Clone, Debug)]
pub(crate) struct Discrete1D {
    /// Cumulative probability up to and including each index; the last is 1.
    cumulative: Vec<f32>,
    /// First index that each of equal parts of 0..1 can give (Chen and Asau 1974, the guide table method), so that a
    /// search takes a step or two.
    guide: Vec<u32>,
}

impl Discrete1D {
    /// Distribution of these weights; nothing if none is above 0. Negative and non-finite weights count as 0.
    pub fn new(weights: &[f32]) -> Option<Self> {
        let usable = |weight: f32| if weight.is_finite() { f64::from(weight.max(0.0)) } else { 0.0 };
        let total: f64 = weights.iter().map(|weight| usable(*weight)).sum();
        if total <= 0.0 || !total.is_finite() {
            return None;
        }
        let mut sum = 0.0;
        let mut cumulative: Vec<f32> = weights
            .iter()
            .map(|weight| {
                sum += usable(*weight);
                (sum / total) as f32
            })
            .collect();
        if let Some(last) = cumulative.last_mut() {
            *last = 1.0;
        }
        let parts = cumulative.len();
        let mut index = 0;
        let guide = (0..parts)
            .map(|part| {
                while index + 1 < parts && cumulative[index] <= part as f32 / parts as f32 {
                    index += 1;
                }
                index as u32
            })
            .collect();
        Some(Self { cumulative, guide })
    }

    /// The index whose range of 0..1 holds `u`.
    pub fn sample(&self, u: f32) -> usize {
        let parts = self.guide.len();
        let part = ((u * parts as f32) as usize).min(parts - 1);
        // Rounding of the part may start one index late.
        let mut index = self.guide[part].saturating_sub(1) as usize;
        while index + 1 < parts && self.cumulative[index] <= u {
            index += 1;
        }
        index
    }

    /// Place in 0..1, divided evenly among the indices, with a density that is the same within the part of each.
    pub fn sample_evenly(&self, u: f32) -> f32 {
        let index = self.sample(u);
        let probability = self.probability(index).max(f32::MIN_POSITIVE);
        let within = 1.0 - (self.cumulative[index] - u) / probability;
        (index as f32 + within.clamp(0.0, 1.0)) / self.cumulative.len() as f32
    }

    /// Probability of an index.
    pub fn probability(&self, index: usize) -> f32 {
        let before = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        self.cumulative[index] - before
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_come_as_often_as_their_weights() {
        let distribution = Discrete1D::new(&[0.0, 1.0, f32::NAN, 3.0, 0.0]).unwrap();
        let mut counts = [0; 5];
        for step in 0..1000 {
            counts[distribution.sample((step as f32 + 0.5) / 1000.0)] += 1;
        }
        assert_eq!(counts, [0, 250, 0, 750, 0]);
        assert!((distribution.probability(3) - 0.75).abs() < 1e-6);
        assert!(Discrete1D::new(&[0.0, -1.0]).is_none());
        assert!(Discrete1D::new(&[]).is_none());
    }
}
