use crate::TermTarget;
use relume_scene::{LANES, Light};

/// Whatever a relighter reports.
pub type RelightError = Box<dyn std::error::Error + Send + Sync>;

/// Pictures of a light for radiance 1 at some cells, and their derivatives by the lanes of its shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Linear {
    /// Linear RGB, one for each cell.
    pub values: Vec<[f32; 3]>,
    /// Derivatives by [`relume_scene::lane`], one for each cell.
    pub slopes: Vec<[[f32; 3]; LANES]>,
}

impl AsRef<[[f32; 3]]> for Linear {
    fn as_ref(&self) -> &[[f32; 3]] {
        &self.values
    }
}

/// Something that makes pictures of lights for radiance 1 and their gradients, such as a proxy or a smoothed gather.
///
/// Values are given for cells: squares of [`Relight::cell`] pixels along each edge (smaller at the right and the
/// bottom), numbered row by row from the top left. The value of a cell is the mean of its pixels.
pub trait Relight: Sync {
    /// Width and height of its pictures, pixels.
    fn size(&self) -> (usize, usize);

    /// Pixels along the edge of a cell.
    fn cell(&self) -> usize {
        1
    }

    /// Values of a light for radiance 1 at some cells, linear RGB. `softness` (0..1, of the scene's size) says how much the
    /// light may be smoothed; 0 is exact.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn values(&self, light: &Light, softness: f32, cells: &[u32]) -> Result<Vec<[f32; 3]>, RelightError>;

    /// Derivative of a loss by the lanes of a light's shape from its derivative by those cells' values.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn pull_back(
        &self,
        light: &Light,
        softness: f32,
        cells: &[u32],
        d_values: &[[f32; 3]],
    ) -> Result<[f32; LANES], RelightError>;

    /// Values and derivatives at once, from a relighter to which the latter come with the former.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn linearise(
        &self,
        _light: &Light,
        _softness: f32,
        _cells: &[u32],
    ) -> Result<Option<Linear>, RelightError> {
        Ok(None)
    }

    /// Values of some lights for radiance 1 at some cells, exact: two estimates with independent noise, or twice the same if there is
    /// none. Squared differences from noisy pictures are least for the lights with the least noise, products of the differences
    /// from two such estimates are not.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn half_values(&self, lights: &[&Light], cells: &[u32]) -> Result<Vec<[Vec<[f32; 3]>; 2]>, RelightError> {
        let twice = |light: &&Light| {
            let values = self.values(light, 0.0, cells)?;
            Ok([values.clone(), values])
        };
        lights.iter().map(twice).collect()
    }

    /// Sum of what some lights, each with its radiance, add to each cell of the picture.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn picture(&self, lights: &[&Light]) -> Result<PictureCells, RelightError> {
        let (width, height) = self.size();
        let cells: Vec<u32> =
            (0..(width.div_ceil(self.cell()) * height.div_ceil(self.cell())) as u32).collect();
        let halves = self.half_values(lights, &cells)?;
        let sum = |half: usize| {
            let mut sum = vec![[0.0; 3]; halves.first().map_or(0, |halves| halves[half].len())];
            for (light, halves) in lights.iter().zip(&halves) {
                for (sum, unit) in sum.iter_mut().zip(&halves[half]) {
                    (0..3).for_each(|c| sum[c] += light.radiance[c] * unit[c]);
                }
            }
            sum
        };
        let exact = [sum(0), sum(1)];
        Ok(PictureCells { clean: exact.clone(), exact })
    }

    /// Takes over the comparison with what is wanted, if that is better done where the pictures are made: on a device, from which
    /// they then need not come back. `base` is what is there anyway, `still` are pictures of lights that stay for radiance 1; all of all cells.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn comparison<'a>(
        &'a self,
        _base: &[[f32; 3]],
        _still: &[&[[f32; 3]]],
    ) -> Result<Option<Box<dyn Compare + 'a>>, RelightError> {
        Ok(None)
    }
}

/// The cells of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureCells {
    /// Two exact estimates with independent noise, or twice the same if there is none.
    pub exact: [Vec<[f32; 3]>; 2],
    /// Cells with as little noise as they can be made, which need not be exact any more.
    pub clean: [Vec<[f32; 3]>; 2],
}

/// Compares a base with lights over it to what goals want.
pub trait Compare: Sync {
    /// The loss of all goals together ([`TermTarget::compare`]) and its derivatives by these lights, and by the radiances of those that stay.
    /// Nothing if the device cannot do it: then it is for whoever asks.
    ///
    /// # Errors
    /// Whatever the relighter reports.
    fn gradient(
        &self,
        lights: &[&Light],
        still: &[[f32; 3]],
        softness: f32,
        targets: &[TermTarget],
    ) -> Result<Option<LossGradient>, RelightError>;
}

/// A loss and its derivatives.
#[derive(Clone, Debug, PartialEq)]
pub struct LossGradient {
    /// The loss.
    pub loss: f64,
    /// Derivatives by the lanes of each light's shape and by its radiance.
    pub lights: Vec<([f32; LANES], [f32; 3])>,
    /// Derivatives by the radiances of lights that stay.
    pub still: Vec<[f32; 3]>,
}
