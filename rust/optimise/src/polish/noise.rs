use std::ops::Range;

/// Noise, in units of its median, at which a cell counts half.
const HALF_TRUST: f32 = 2.0;
/// Cells to either side by which noise is told.
const AROUND: usize = 4;
/// Number of standard deviations that a gain must be above 0 to be believed.
const SURE: f64 = 2.0;

/// Meaning of residuals, three by three: the cells of one goal after the other, each followed by their mean where that
/// was asked for.
pub(super) struct Rows(Vec<RowsOfGoal>);

struct RowsOfGoal {
    cells: Range<usize>,
    mean: Option<usize>,
}

impl Rows {
    /// Rows for goals with these numbers of cells, and whether their means follow.
    pub fn new(goals: impl Iterator<Item = (usize, bool)>) -> Self {
        let mut end = 0;
        let of_goal = |(count, has_mean): (usize, bool)| {
            let cells = end..end + count;
            end = cells.end + usize::from(has_mean);
            RowsOfGoal { mean: has_mean.then_some(cells.end), cells }
        };
        Self(goals.map(of_goal).collect())
    }

    /// Makes one estimate of both of each mean. Products of two are without the noise of each only in sum over many cells: that of
    /// one pair is least where the two differ most. A mean has little noise of its own.
    pub fn join_means(&self, [a, b]: &mut [Vec<f32>; 2]) {
        for row in self.0.iter().filter_map(|goal| goal.mean) {
            for i in 3 * row..3 * (row + 1) {
                let mean = 0.5 * (a[i] + b[i]);
                (a[i], b[i]) = (mean, mean);
            }
        }
    }
}

/// Factors on residuals, less where they are noisy; 1 where there are none, and on means.
#[derive(Default)]
pub(super) struct Trust(Vec<f32>);

impl Trust {
    /// Trust from how much the two estimates differ at the cells around each, not at itself: products of its two
    /// residuals would else count less where their noise happens to be of opposite sign, and their sum be least for the
    /// lights with the least noise. Only cells of one goal are compared: noise of another is in another unit.
    pub fn new([a, b]: &[Vec<f32>; 2], rows: &Rows) -> Self {
        let square = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>();
        let noise: Vec<f32> = a.as_chunks().0.iter().zip(b.as_chunks().0).map(square).collect();
        let of_goal = |goal: &RowsOfGoal| {
            trust_of_cells(&noise[goal.cells.clone()]).chain(goal.mean.map(|_| 1.0)).collect::<Vec<f32>>()
        };
        Self(rows.0.iter().flat_map(of_goal).flat_map(|trust| [trust; 3]).collect())
    }

    /// Trust of a residual by its number.
    pub fn of(&self, number: usize) -> f32 {
        self.0.get(number).copied().unwrap_or(1.0)
    }
}

fn trust_of_cells(noise: &[f32]) -> impl Iterator<Item = f32> + use<> {
    let around = |i: usize| {
        let near = &noise[i.saturating_sub(AROUND)..(i + AROUND + 1).min(noise.len())];
        (near.iter().sum::<f32>() - noise[i]) / (near.len() - 1).max(1) as f32
    };
    let noise: Vec<f32> = (0..noise.len()).map(around).collect();
    let mut sorted = noise.clone();
    sorted.sort_by(f32::total_cmp);
    let half = HALF_TRUST * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let trust = move |noise: f32| if half > 0.0 { (half / (half + noise.max(0.0))).sqrt() } else { 1.0 };
    noise.into_iter().map(trust)
}

/// Decrease of a loss, and the standard deviation of that, estimated from the cells.
pub(super) struct Gain {
    pub mean: f64,
    pub deviation: f64,
    /// Largest possible gain: the loss before, or a standard deviation more.
    pub most: f64,
}

impl Gain {
    pub fn new(before: &[Vec<f32>; 2], after: &[Vec<f32>; 2]) -> Self {
        let gains: Vec<f64> =
            products(before).zip(products(after)).map(|(before, after)| before - after).collect();
        let mean = gains.iter().sum::<f64>();
        let each = mean / gains.len().max(1) as f64;
        let seen = gains.iter().map(|gain| (gain - each).powi(2)).sum::<f64>().sqrt();
        let most = products(before).sum::<f64>().max(0.0) + scatter_of_products(before);
        Self { mean, deviation: seen.max(scatter_of_products(after)), most }
    }

    /// Sum with a gain that is known exactly.
    pub fn plus(self, gain: f64) -> Self {
        Self { mean: self.mean + gain, most: self.most + gain, ..self }
    }

    /// Gain less its uncertainty: above 0 if it is hardly noise. Of many tries with noisy pictures some seem to gain
    /// more than there is: that much of it is noise.
    pub fn least(&self) -> f64 {
        self.mean.min(self.most) - SURE * self.deviation
    }
}

/// Products of both pictures' residuals, summed over each cell.
fn products([a, b]: &[Vec<f32>; 2]) -> impl Iterator<Item = f64> {
    let of_cell = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] * b[c])).sum();
    a.as_chunks().0.iter().zip(b.as_chunks().0).map(of_cell)
}

/// Standard deviation of the sum of products by the noise of one residual, the same for all cells. A light that few segments meet
/// makes few and bright cells: both halves of one are seldom among them, though half of the loss is there, and what is seen
/// of the products scatters too little.
fn scatter_of_products([a, b]: &[Vec<f32>; 2]) -> f64 {
    let square = |(a, b): (&f32, &f32)| 0.5 * f64::from(a - b).powi(2);
    let cells = (a.len() / 3).max(1) as f64;
    a.iter().zip(b).map(square).sum::<f64>() / cells.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLS: usize = 4096;

    /// Residuals of a light that lacks altogether, but for hits in every n-th cell of either half, never of both.
    fn residuals(every: usize) -> [Vec<f32>; 2] {
        let hit = every as f32;
        [0, every / 2].map(|first| {
            let value = |cell: usize| if cell % every == first { hit - 1.0 } else { -1.0 };
            (0..CELLS).flat_map(|cell| [value(cell); 3]).collect()
        })
    }

    #[test]
    fn hits_that_no_cell_has_in_both_halves_are_no_gain() {
        let dark = [0, 1].map(|_| vec![-1.0; 3 * CELLS]);
        let gain = Gain::new(&dark, &residuals(256));
        assert!(gain.mean > 0.0 && gain.least() < 0.0, "{} of {}", gain.mean, gain.deviation);
        // What every cell sees is believed.
        let bright = [0.1, -0.1].map(|noise| vec![noise; 3 * CELLS]);
        let gain = Gain::new(&dark, &bright);
        assert!(gain.least() > 0.9 * (3 * CELLS) as f64, "{} of {}", gain.mean, gain.deviation);
    }

    #[test]
    fn more_than_there_is_to_gain_is_noise() {
        let nearly_right = [0, 1].map(|_| vec![0.1; 3 * CELLS]);
        // Halves that happen to be of opposite sign in three cells of five.
        let value = |half: usize, cell: usize| if half == 1 && cell % 5 < 3 { -1.0 } else { 1.0 };
        let noisy = [0, 1].map(|half| (0..CELLS).flat_map(|cell| [value(half, cell); 3]).collect());
        let gain = Gain::new(&nearly_right, &noisy);
        assert!(gain.mean > 4.0 * gain.deviation && gain.least() < 0.0, "{} of {}", gain.mean, gain.most);
    }

    #[test]
    fn noise_is_told_within_a_goal_and_means_are_trusted() {
        // Cells of a stroke, their mean, and what is kept of the rest, whose residuals are a thousand times smaller.
        let rows = Rows::new([(20, true), (400, false)].into_iter());
        let noise = |half: f32| {
            let cells = (0..421).map(move |cell| half * if cell <= 20 { 1.0 } else { 1e-3 });
            cells.flat_map(|noise| [noise; 3]).collect::<Vec<f32>>()
        };
        let residuals = [noise(1.0), noise(-1.0)];
        let trust = Trust::new(&residuals, &rows);
        let of_cells: Vec<f32> = (0..421).map(|cell| trust.of(3 * cell)).collect();
        assert_eq!(of_cells[20], 1.0);
        let usual = of_cells[0];
        assert!(
            usual > 0.5 && of_cells[..20].iter().chain(&of_cells[21..]).all(|of| *of == usual),
            "{of_cells:?}"
        );
    }

    #[test]
    fn a_mean_is_one_estimate_and_cells_stay_two() {
        let rows = Rows::new([(2, false), (1, true)].into_iter());
        let mut residuals = [vec![3.0; 12], vec![-1.0; 12]];
        rows.join_means(&mut residuals);
        let expected = [3.0, -1.0].map(|of_half| [vec![of_half; 9], vec![1.0; 3]].concat());
        assert_eq!(residuals, expected);
    }
}
