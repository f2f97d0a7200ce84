use crate::cells::Cells;
use crate::goal::{Aim, Goal};
use crate::variable::{LUMINANCE, luminance};
use relume_image::metrics;

/// A goal at the cells that it concerns.
pub(crate) struct Term<'a> {
    aim: &'a Aim,
    weight: f32,
    /// What pictures are multiplied with: the paper's curve I / (1 + I) presumes moderate brightness, ours may be in any unit.
    pub(crate) exposure: f32,
    /// Numbers of the cells with a weight above 0.
    pub(crate) cells: Vec<u32>,
    weights: Vec<f32>,
    /// What each is compared to.
    references: Vec<[f32; 3]>,
}

impl<'a> Term<'a> {
    /// `before` is the picture before, and what brings it to moderate brightness.
    pub(crate) fn new(goal: &'a Goal, cells: Cells, before: &[[f32; 3]], of_before: f32) -> Self {
        let (reference, exposure) = match &goal.aim {
            Aim::Target { image, .. } => (&cells.means(image), metrics::exposure(image)),
            _ => (&before.to_vec(), of_before),
        };
        let weights = goal.pixels.as_ref().map(|weights| cells.mean_weights(weights));
        let weight = |cell: usize| weights.as_ref().map_or(1.0, |weights| weights[cell]);
        let chosen: Vec<usize> = (0..cells.count()).filter(|cell| weight(*cell) > 0.0).collect();
        let at = |cell: &usize| goal.aim.reference(reference[*cell].map(|x| exposure * x));
        Self {
            aim: &goal.aim,
            weight: goal.weight,
            exposure,
            weights: chosen.iter().map(|cell| weight(*cell)).collect(),
            references: chosen.iter().map(at).collect(),
            cells: chosen.into_iter().map(|cell| cell as u32).collect(),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether the picture's exposure does not count.
    fn is_exposure_invariant(&self) -> bool {
        matches!(self.aim, Aim::Target { exposure_invariant: true, .. })
    }
}

/// A term at drawn cells of a picture.
pub(crate) struct Comparison<'a> {
    term: &'a Term<'a>,
    /// Place of its first cell among those of all terms.
    first: usize,
    /// Exposed cells, before `gain`.
    exposed: Vec<[f32; 3]>,
    /// Weights that sum up to the term's.
    shares: Vec<f32>,
    /// Brings the cells to the mean luminance of the target where its exposure does not matter; else 1.
    gain: f32,
    /// Derivative of the gain by the mean luminance of the cells.
    gain_slope: f32,
    residuals: Vec<[f32; 3]>,
    slopes: Vec<[[f32; 3]; 3]>,
}

impl<'a> Comparison<'a> {
    pub(crate) fn new(term: &'a Term<'a>, draw: &[u32], picture: Vec<[f32; 3]>, first: usize) -> Self {
        let total: f32 = draw.iter().map(|number| term.weights[*number as usize]).sum();
        let share = |number: &u32| term.weight * term.weights[*number as usize] / total;
        let shares: Vec<f32> = draw.iter().map(share).collect();
        let exposed: Vec<[f32; 3]> = picture.iter().map(|p| p.map(|p| term.exposure * p)).collect();
        let reference = |number: &u32| term.references[*number as usize];
        let weigh = |(value, share): ([f32; 3], &f32)| luminance(value) * share;
        // References are tonemapped: t / (1 - t) is what they were.
        let targets = draw.iter().map(|number| reference(number).map(|t| t / (1.0 - t).max(1e-6)));
        let target: f32 = targets.zip(&shares).map(weigh).sum();
        let mean: f32 = exposed.iter().copied().zip(&shares).map(weigh).sum();
        let (gain, gain_slope) = match target / mean {
            gain if term.is_exposure_invariant() && gain.is_finite() && gain > 0.0 => (gain, -gain / mean),
            _ => (1.0, 0.0),
        };
        let compare =
            |(x, number): (&[f32; 3], &u32)| term.aim.residual(x.map(|x| gain * x), reference(number));
        let (residuals, slopes) = exposed.iter().zip(draw).map(compare).unzip();
        Self { term, first, exposed, shares, gain, gain_slope, residuals, slopes }
    }

    /// Places of its cells among those of all terms.
    pub(crate) fn places(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.exposed.len()
    }

    pub(crate) fn loss(&self) -> f64 {
        let square = |(r, share): (&[f32; 3], &f32)| f64::from(share * r.iter().map(|r| r * r).sum::<f32>());
        self.residuals.iter().zip(&self.shares).map(square).sum()
    }

    /// Residuals times the roots of their weights, so that the loss is the sum of their squares.
    pub(crate) fn weighted_residuals(&self) -> impl Iterator<Item = f32> {
        self.residuals.iter().zip(&self.shares).flat_map(|(r, share)| r.map(|r| share.sqrt() * r))
    }

    /// Derivative of the loss by each value of the picture.
    pub(crate) fn pull_back(&self) -> Vec<[f32; 3]> {
        let by_gained = |k: usize| -> [f32; 3] {
            std::array::from_fn(|c| {
                2.0 * self.shares[k]
                    * (0..3).map(|j| self.residuals[k][j] * self.slopes[k][j][c]).sum::<f32>()
            })
        };
        let by_gained: Vec<[f32; 3]> = (0..self.exposed.len()).map(by_gained).collect();
        let by_gain: f32 = by_gained.iter().zip(&self.exposed).map(|(d, x)| dot(*d, *x)).sum();
        let by_value = |(k, d): (usize, &[f32; 3])| {
            let gain_slope = self.gain_slope(k);
            std::array::from_fn(|c| self.term.exposure * (self.gain * d[c] + by_gain * gain_slope[c]))
        };
        by_gained.iter().enumerate().map(by_value).collect()
    }

    /// Change of the weighted residuals with a change of the picture.
    pub(crate) fn push_forward(&self, d_picture: impl Iterator<Item = [f32; 3]>) -> Vec<f32> {
        let d_exposed: Vec<[f32; 3]> = d_picture.map(|d| d.map(|d| self.term.exposure * d)).collect();
        let d_gain: f32 = d_exposed.iter().enumerate().map(|(k, d)| dot(self.gain_slope(k), *d)).sum();
        let change = |(k, d): (usize, &[f32; 3])| -> [f32; 3] {
            let d_gained = std::array::from_fn(|c| self.gain * d[c] + d_gain * self.exposed[k][c]);
            self.slopes[k].map(|row| self.shares[k].sqrt() * dot(row, d_gained))
        };
        d_exposed.iter().enumerate().flat_map(change).collect()
    }

    /// Derivative of the gain by an exposed cell.
    fn gain_slope(&self, k: usize) -> [f32; 3] {
        LUMINANCE.map(|w| self.gain_slope * w * self.shares[k])
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
