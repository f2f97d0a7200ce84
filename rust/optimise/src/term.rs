use crate::cells::Cells;
use crate::goal::{Criterion, Goal};
use crate::objective::{Halves, mean};
use crate::variable::{LUMINANCE, luminance};
use relume_image::metrics;

/// A goal at the cells that it concerns.
pub(crate) struct Term<'a> {
    criterion: &'a Criterion,
    pub(crate) weight: f32,
    /// Factor of pictures: the paper's curve I / (1 + I) presumes moderate brightness, ours may be in any unit.
    pub(crate) exposure: f32,
    /// Numbers of the cells with a weight above 0.
    pub(crate) cells: Vec<u32>,
    weights: Vec<f32>,
    /// Reference of each cell.
    references: Vec<[f32; 3]>,
    /// Each cell before, exposed.
    baseline: Vec<[f32; 3]>,
    /// Each cell before, by either half of the paths, where they are told apart.
    baseline_halves: Option<Halves>,
}

/// Cells of the picture before.
pub(crate) struct Baseline {
    pub cells: Vec<[f32; 3]>,
    /// Cells by either half of the paths, exact; where they are told apart.
    pub halves: Option<Halves>,
}

/// Uncertainty of the mean of a term's cells by noise, and the bias of denoising.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertainty {
    /// Standard deviation of what is asked for by amount.
    deviation: f32,
    /// Factor that brings the mean of clean cells to that of exact ones, beside what did so before.
    factor: [f32; 3],
}

impl Uncertainty {
    pub(crate) const NONE: Self = Self { deviation: 0.0, factor: [1.0; 3] };
}

impl<'a> Term<'a> {
    /// `before` is the picture before, and what brings it to moderate brightness.
    pub(crate) fn new(goal: &'a Goal, cells: Cells, baseline: &Baseline, baseline_exposure: f32) -> Self {
        let (reference, exposure) = match &goal.criterion {
            Criterion::Target { image, .. } => (&cells.means(image), metrics::exposure(&goal.within(image))),
            _ => (&baseline.cells, baseline_exposure),
        };
        let weights = goal.pixels.as_ref().map(|weights| goal.cell_weights(cells, weights));
        let weight = |cell: usize| weights.as_ref().map_or(1.0, |weights| weights[cell]);
        let chosen: Vec<usize> = (0..cells.count()).filter(|cell| weight(*cell) > 0.0).collect();
        let exposed = |image: &[[f32; 3]], cell: usize| image[cell].map(|x| exposure * x);
        let all_exposed =
            |image: &Vec<[f32; 3]>| chosen.iter().map(|cell| exposed(image, *cell)).collect::<Vec<_>>();
        Self {
            criterion: &goal.criterion,
            weight: goal.weight,
            exposure,
            weights: chosen.iter().map(|cell| weight(*cell)).collect(),
            references: chosen
                .iter()
                .map(|cell| goal.criterion.reference(exposed(reference, *cell)))
                .collect(),
            baseline: all_exposed(&baseline.cells),
            baseline_halves: baseline.halves.as_ref().map(|halves| halves.each_ref().map(all_exposed)),
            cells: chosen.into_iter().map(|cell| cell as u32).collect(),
        }
    }

    /// The drawn cells of a whole picture.
    pub(crate) fn drawn(&self, picture: &[[f32; 3]], draw: &[u32]) -> Vec<[f32; 3]> {
        draw.iter().map(|number| picture[self.cells[*number as usize] as usize]).collect()
    }

    pub(crate) fn len(&self) -> usize {
        self.cells.len()
    }

    /// Target for some cells, given by their numbers in the term's own list.
    pub(crate) fn target(&self, draw: &[u32]) -> TermTarget<'a> {
        self.target_with(&Uncertainty::NONE, draw)
    }

    /// Uncertainty of the mean of the drawn cells of a picture, from two independent estimates of them.
    pub(crate) fn uncertainty(&self, exact: &Halves, draw: &[u32]) -> Uncertainty {
        Uncertainty { deviation: self.deviation(exact, draw), ..Uncertainty::NONE }
    }

    /// Uncertainty of a clean picture of these cells: its mean is brought to that of the exact ones where that says
    /// less good of the picture. Denoising moves light to beside where it is bright, which single cells hardly show but
    /// means do; the mean of exact cells may be that of a few that happen to be very bright.
    pub(crate) fn uncertainty_of_clean(
        &self,
        clean: &[[f32; 3]],
        exact: &Halves,
        draw: &[u32],
    ) -> Uncertainty {
        let uncertainty = self.uncertainty(exact, draw);
        let of_exact = Uncertainty { factor: self.factor_to_exact(clean, exact, draw), ..uncertainty };
        let residual = |uncertainty: &Uncertainty| {
            GoalComparison::new(self.target_with(uncertainty, draw), clean.to_vec()).whole
        };
        match (residual(&of_exact), residual(&uncertainty)) {
            (Some((exact, _)), Some((clean, _))) if self.criterion.is_worse(exact, clean) => of_exact,
            _ => uncertainty,
        }
    }

    /// Factor that brings the mean of clean cells to that of exact ones, beside what did so before. Noise says too
    /// little of a colour.
    fn factor_to_exact(&self, clean: &[[f32; 3]], exact: &Halves, draw: &[u32]) -> [f32; 3] {
        let (Some(before), false) =
            (&self.baseline_halves, matches!(self.criterion, Criterion::Color { .. }))
        else {
            return Uncertainty::NONE.factor;
        };
        let shares = self.shares(draw);
        let drawn = |cells: &[[f32; 3]]| sum(draw.iter().map(|number| cells[*number as usize]), &shares);
        let before = quotient(drawn(&mean(before)), drawn(&self.baseline));
        let after = quotient(sum(mean(exact).into_iter(), &shares), sum(clean.iter().copied(), &shares));
        let factor = quotient(after, before);
        let is_known = factor.iter().all(|factor| factor.is_finite() && *factor > 0.0);
        if is_known { factor } else { Uncertainty::NONE.factor }
    }

    /// Standard deviation of what is asked for by amount, told from how much two estimates of each cell differ. Noise that was there
    /// before as well is left out, as it is of what was asked for: where only strengths change there is hardly any.
    fn deviation(&self, halves: &Halves, draw: &[u32]) -> f32 {
        let Some(before) = &self.baseline_halves else { return 0.0 };
        let shares = self.shares(draw);
        let drawn = |half: &Vec<[f32; 3]>| draw.iter().map(|number| half[*number as usize]).collect();
        let exposed = |half: &Vec<[f32; 3]>| half.iter().map(|x| x.map(|x| self.exposure * x)).collect();
        let noise = |halves| noise_of_amount(self.criterion, halves, &shares);
        let (before, after) = (noise(before.each_ref().map(drawn)), noise(halves.each_ref().map(exposed)));
        let (Some(before), Some(after)) = (before, after) else { return 0.0 };
        let noise =
            before.iter().zip(&after).zip(&shares).map(|((before, after), share)| share * (after - before));
        // The mean of two estimates has half of their difference.
        0.5 * noise.map(|noise| noise * noise).sum::<f32>().sqrt()
    }

    /// Share of each drawn cell in all of them.
    fn shares(&self, draw: &[u32]) -> Vec<f32> {
        let weight = |number: &u32| self.weights[*number as usize];
        let total: f32 = draw.iter().map(weight).sum();
        draw.iter().map(|number| weight(number) / total).collect()
    }

    /// Target that asks for more where the mean is uncertain.
    pub(crate) fn target_with(&self, uncertainty: &Uncertainty, draw: &[u32]) -> TermTarget<'a> {
        let shares: Vec<f32> = self.shares(draw).iter().map(|share| self.weight * share).collect();
        let references: Vec<[f32; 3]> = draw.iter().map(|number| self.references[*number as usize]).collect();
        let before = draw.iter().map(|number| self.baseline[*number as usize]);
        let before = sum(before, &shares).map(|sum| sum / self.weight);
        TermTarget {
            criterion: self.criterion,
            weight: self.weight,
            exposure: self.exposure,
            luminance: self.is_exposure_invariant().then(|| luminance_of_target(&references, &shares)),
            factor_of_mean: uncertainty.factor,
            reference_of_mean: self.criterion.reference_of_mean(before, uncertainty.deviation),
            cells: draw.iter().map(|number| self.cells[*number as usize]).collect(),
            references,
            shares,
        }
    }

    /// True if the mean of the cells is compared beside each of them.
    pub(crate) fn has_mean(&self) -> bool {
        !matches!(self.criterion, Criterion::Target { .. })
    }

    /// True if the picture's exposure does not count.
    fn is_exposure_invariant(&self) -> bool {
        matches!(self.criterion, Criterion::Target { exposure_invariant: true, .. })
    }
}

/// Change of the requested amount of two estimates' mean if only one of their exposed cells differed, for each cell.
fn noise_of_amount(criterion: &Criterion, halves: Halves, shares: &[f32]) -> Option<Vec<f32>> {
    let slopes = criterion.slopes_of_amount(sum(mean(&halves).into_iter(), shares))?;
    let [first, second] = &halves;
    let difference = |(a, b): (&[f32; 3], &[f32; 3])| dot(slopes, std::array::from_fn(|c| a[c] - b[c]));
    Some(first.iter().zip(second).map(difference).collect())
}

/// Luminance of a target, each cell times its share.
fn luminance_of_target(references: &[[f32; 3]], shares: &[f32]) -> f32 {
    // References are tonemapped: t / (1 - t) is what they were.
    let exposed = references.iter().map(|reference| reference.map(|t| t / (1.0 - t).max(1e-6)));
    luminance(sum(exposed, shares))
}

/// The sum of values, each times its share.
fn sum(values: impl Iterator<Item = [f32; 3]>, shares: &[f32]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (value, share) in values.zip(shares) {
        (0..3).for_each(|c| sum[c] += share * value[c]);
    }
    sum
}

fn quotient(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| a[c] / b[c])
}

/// Target of a goal at some cells: all that a comparison needs beside the picture.
#[derive(Clone, Debug)]
pub struct TermTarget<'a> {
    /// Criterion of the goal.
    pub criterion: &'a Criterion,
    /// Weight of the goal beside others.
    pub weight: f32,
    /// Factor of pictures before they are compared.
    pub exposure: f32,
    /// Luminance that the exposed cells, each times its share, are brought to before they are compared, where their own
    /// exposure does not matter.
    pub luminance: Option<f32>,
    /// Factor of the mean of the exposed cells before it is compared.
    pub factor_of_mean: [f32; 3],
    /// Reference of the mean, for a goal that asks for one.
    pub reference_of_mean: Option<[f32; 3]>,
    /// Numbers of the cells.
    pub cells: Vec<u32>,
    /// Reference of each exposed cell.
    pub references: Vec<[f32; 3]>,
    /// Weight of each cell in the loss; their sum is the weight of the goal.
    pub shares: Vec<f32>,
}

impl<'a> TermTarget<'a> {
    /// The loss of these cells of a picture, scene-linear RGB, and its derivative by each of their values.
    pub fn compare(self, picture: Vec<[f32; 3]>) -> (f64, Vec<[f32; 3]>) {
        let comparison = GoalComparison::new(self, picture);
        (comparison.loss(), comparison.pull_back())
    }
}

/// A goal at some cells of a picture.
pub(crate) struct GoalComparison<'a> {
    target: TermTarget<'a>,
    /// Exposed cells, before `gain`.
    exposed: Vec<[f32; 3]>,
    /// Brings the cells to the mean luminance of the target where its exposure does not matter; else 1.
    gain: f32,
    /// Derivative of the gain by the mean luminance of the cells.
    gain_slope: f32,
    residuals: Vec<[f32; 3]>,
    slopes: Vec<[[f32; 3]; 3]>,
    /// Residual of the mean of the cells, and its derivatives. A target asks for each cell by itself.
    whole: Option<([f32; 3], [[f32; 3]; 3])>,
}

impl<'a> GoalComparison<'a> {
    pub(crate) fn new(target: TermTarget<'a>, picture: Vec<[f32; 3]>) -> Self {
        let TermTarget { criterion, references, shares, .. } = &target;
        let exposed: Vec<[f32; 3]> = picture.iter().map(|p| p.map(|p| target.exposure * p)).collect();
        let sum = sum(exposed.iter().copied(), shares);
        let mean = luminance(sum);
        let (gain, gain_slope) = match target.luminance.map(|target| target / mean) {
            Some(gain) if gain.is_finite() && gain > 0.0 => (gain, -gain / mean),
            _ => (1.0, 0.0),
        };
        let compare =
            |(x, reference): (&[f32; 3], &[f32; 3])| criterion.residual(x.map(|x| gain * x), *reference);
        let (residuals, slopes) = exposed.iter().zip(references).map(compare).unzip();
        let factor = target.factor_of_mean;
        let whole = target.reference_of_mean.map(|reference| {
            let mean_of_cells = std::array::from_fn(|c| factor[c] * sum[c] / target.weight);
            let (residual, slopes) = criterion.residual_of_mean(mean_of_cells, reference);
            (residual, slopes.map(|slopes| std::array::from_fn(|c| factor[c] * slopes[c])))
        });
        Self { target, exposed, gain, gain_slope, residuals, slopes, whole }
    }

    /// True if the mean has too little or far too much of what was asked for.
    pub(crate) fn is_off(&self) -> bool {
        self.whole.is_some_and(|(residual, _)| self.target.criterion.is_off(residual))
    }

    pub(crate) fn loss(&self) -> f64 {
        let square = |(r, share): (&[f32; 3], &f32)| f64::from(share * r.iter().map(|r| r * r).sum::<f32>());
        let cells: f64 = self.residuals.iter().zip(&self.target.shares).map(square).sum();
        let whole = self.whole.map_or(0.0, |(r, _)| square((&r, &self.target.weight)));
        f64::from(self.target.criterion.weight_of_cells()) * cells + whole
    }

    /// Residuals times the roots of their weights, of another picture with these cells, to first order in what differs: where that
    /// is noise around 0, the residuals have no more than such noise either.
    pub(crate) fn weighted_residuals<'b>(&'b self, cells: &'b [[f32; 3]]) -> impl Iterator<Item = f32> + 'b {
        let of_cells = self.target.criterion.weight_of_cells();
        let differences: Vec<[f32; 3]> = cells
            .iter()
            .zip(&self.exposed)
            .map(|(cell, exposed)| std::array::from_fn(|c| self.target.exposure * cell[c] - exposed[c]))
            .collect();
        let mean = sum(differences.iter().copied(), &self.target.shares);
        let gain_change = self.gain_slope * luminance(mean);
        let beside = |r: &[f32; 3], slopes: &[[f32; 3]; 3], d: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|j| r[j] + dot(slopes[j], d))
        };
        let whole = self
            .whole
            .as_ref()
            .map(|(r, slopes)| (beside(r, slopes, mean.map(|d| d / self.target.weight)), self.target.weight));
        let cell = move |k: usize| {
            let d = std::array::from_fn(|c| self.gain * differences[k][c] + gain_change * self.exposed[k][c]);
            (beside(&self.residuals[k], &self.slopes[k], d), of_cells * self.target.shares[k])
        };
        (0..self.exposed.len()).map(cell).chain(whole).flat_map(|(r, weight)| r.map(|r| weight.sqrt() * r))
    }

    /// Derivative of the loss by each value of the picture.
    pub(crate) fn pull_back(&self) -> Vec<[f32; 3]> {
        let half_slope = |r: &[f32; 3], slopes: &[[f32; 3]; 3], c: usize| -> f32 {
            (0..3).map(|j| r[j] * slopes[j][c]).sum()
        };
        let by_gained = |k: usize| -> [f32; 3] {
            std::array::from_fn(|c| {
                let cell = self.target.criterion.weight_of_cells()
                    * half_slope(&self.residuals[k], &self.slopes[k], c);
                let whole = self.whole.as_ref().map_or(0.0, |(r, slopes)| half_slope(r, slopes, c));
                2.0 * self.target.shares[k] * (cell + whole)
            })
        };
        let by_gained: Vec<[f32; 3]> = (0..self.exposed.len()).map(by_gained).collect();
        let by_gain: f32 = by_gained.iter().zip(&self.exposed).map(|(d, x)| dot(*d, *x)).sum();
        let by_value = |(k, d): (usize, &[f32; 3])| {
            let gain_slope = self.gain_slope(k);
            std::array::from_fn(|c| self.target.exposure * (self.gain * d[c] + by_gain * gain_slope[c]))
        };
        by_gained.iter().enumerate().map(by_value).collect()
    }

    /// Derivative of the gain by an exposed cell.
    fn gain_slope(&self, k: usize) -> [f32; 3] {
        LUMINANCE.map(|w| self.gain_slope * w * self.target.shares[k])
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const SIZE: (usize, usize) = (64, 64);

    /// Cells around a value, with noise of this standard deviation.
    fn noisy(value: f32, noise: f32, random: &mut Random) -> Vec<[f32; 3]> {
        let uniform = 12f32.sqrt();
        (0..SIZE.0 * SIZE.1).map(|_| [value + noise * uniform * (random.next_f32() - 0.5); 3]).collect()
    }

    /// Reference of a mean, by a picture before and one after of two estimates each.
    fn first_of_reference(criterion: &Criterion, before: Halves, after: &Halves) -> f32 {
        let goal = Goal { criterion: criterion.clone(), pixels: None, weight: 1.0 };
        let before = Baseline { cells: mean(&before), halves: Some(before) };
        let term = Term::new(&goal, Cells::new(SIZE, 1), &before, 1.0);
        let draw: Vec<u32> = (0..term.len() as u32).collect();
        let [told, untold] = [term.target_with(&term.uncertainty(after, &draw), &draw), term.target(&draw)];
        told.reference_of_mean.unwrap()[0] - untold.reference_of_mean.unwrap()[0]
    }

    #[test]
    fn more_is_asked_for_of_what_is_noisy() {
        let mut random = Random::new(1);
        let mut two = |value: f32, noise: f32| [0, 1].map(|_| noisy(value, noise, &mut random));
        let (before, after) = (two(1.0, 0.0), two(2.0, 0.8));
        // Standard deviation of the mean of both estimates, as a share of it.
        let deviation = 0.8 / 2.0 / (2.0 * (SIZE.0 * SIZE.1) as f32).sqrt();
        let more = |criterion: &Criterion| first_of_reference(criterion, before.clone(), &after);
        let [up, down] = [1.0, -1.0].map(|stops| more(&Criterion::Brightness { stops }));
        let expected = 2.0 * deviation * std::f32::consts::LOG2_E;
        assert!((up / expected - 1.0).abs() < 0.05, "{up}, expected {expected}");
        assert_eq!(down, -up);
        let little = more(&Criterion::Brightness { stops: 0.01 });
        assert!((little / 0.0025 - 1.0).abs() < 1e-2, "a quarter of what was asked for at most: {little}");
        // Grey noise has no colour, and what is kept is not asked for by amount.
        assert!(more(&Criterion::Temperature { mireds: 50.0 }).abs() < 1e-4 * expected);
        assert_eq!(more(&Criterion::Keep), 0.0);
    }

    #[test]
    fn a_mean_is_that_of_clean_or_of_exact_cells_whichever_says_less_good_of_the_picture() {
        let of = |value: f32| vec![[value; 3]; SIZE.0 * SIZE.1];
        let factor = |criterion: Criterion, clean: f32, exact: f32| {
            let goal = Goal { criterion, pixels: None, weight: 2.0 };
            // Cleaning took a tenth of the light before.
            let before = Baseline { cells: of(0.9), halves: Some([of(1.0), of(1.0)]) };
            let term = Term::new(&goal, Cells::new(SIZE, 1), &before, 0.5);
            let draw: Vec<u32> = (0..term.len() as u32).collect();
            term.uncertainty_of_clean(&of(clean), &[of(exact), of(exact)], &draw).factor[0]
        };
        let (up, down) = (|| Criterion::Brightness { stops: 1.0 }, || Criterion::Brightness { stops: -1.0 });
        let expect =
            |found: f32, expected: f32| assert!((found - expected).abs() < 1e-4, "{found} {expected}");
        // Exact cells show less of what was asked for than clean ones, or more.
        expect(factor(up(), 1.8, 1.8), 0.9);
        expect(factor(up(), 1.8, 2.4), 1.0);
        expect(factor(down(), 0.45, 0.6), 1.2);
        expect(factor(down(), 0.45, 0.4), 1.0);
        expect(factor(up(), 3.6, 3.6), 0.9);
        // What is kept should not change by either.
        expect(factor(Criterion::Keep, 0.9, 1.3), 1.3);
        expect(factor(Criterion::Keep, 1.2, 1.1), 1.0);
        expect(factor(Criterion::Color { color: [1.0, 0.5, 0.5] }, 0.9, 1.3), 1.0);
        expect(factor(up(), 0.0, 1.0), 1.0);
    }

    #[test]
    fn noise_that_was_there_before_does_not_count() {
        let mut random = Random::new(2);
        let before = [0, 1].map(|_| noisy(100.0, 40.0, &mut random));
        let doubled = before.each_ref().map(|half| half.iter().map(|x| x.map(|x| 2.0 * x)).collect());
        let other = [0, 1].map(|_| noisy(200.0, 80.0, &mut random));
        let criterion = Criterion::Brightness { stops: 1.0 };
        let [same, independent] =
            [doubled, other].map(|after| first_of_reference(&criterion, before.clone(), &after));
        assert!(independent > 0.01 && same < 1e-3 * independent, "{same} {independent}");
    }
}
