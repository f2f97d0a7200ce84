//! Goals for a picture, as residuals of cells: 0 where a goal is met.

use crate::cells::Cells;
use crate::report::{KEEP_MET, MIREDS_MET, STOPS_MET};
use crate::variable::{LUMINANCE, luminance};
use relume_image::Image;
use std::f32::consts::LN_2;

/// Criterion that a picture is to meet.
#[derive(Clone, Debug, PartialEq)]
pub enum Criterion {
    /// To look like a picture of the view's size, scene-linear RGB.
    Target {
        /// The picture.
        image: Image,
        /// True if only its proportions count, whatever its exposure.
        exposure_invariant: bool,
    },
    /// To be brighter (above 0) or darker than before by at least so many stops.
    Brightness {
        /// Stops of luminance.
        stops: f32,
    },
    /// To have this colour, whatever its brightness.
    Color {
        /// Linear RGB, not black.
        color: [f32; 3],
    },
    /// To be warmer (above 0) or cooler than before by at least so much.
    Temperature {
        /// Change of the light's reciprocal colour temperature, 1e6 / K.
        mireds: f32,
    },
    /// To stay as it was.
    Keep,
}

/// An criterion for a part of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// Criterion that the part is to meet.
    pub criterion: Criterion,
    /// Weight of each pixel, 0..1; all 1 if absent.
    pub pixels: Option<Vec<f32>>,
    /// Weight of the goal beside others.
    pub weight: f32,
}

impl Goal {
    /// Goal for pictures that are so many times smaller along each edge than those of this size ([`Image::shrunk`]).
    #[must_use]
    pub fn shrunk(&self, size: (usize, usize), factor: usize) -> Self {
        let cells = Cells::new(size, factor);
        let pixels = self.pixels.as_ref().map(|weights| self.cell_weights(cells, weights));
        let criterion = match &self.criterion {
            Criterion::Target { image, exposure_invariant } => {
                Criterion::Target { image: image.shrunk(factor), exposure_invariant: *exposure_invariant }
            }
            criterion => criterion.clone(),
        };
        Self { criterion, pixels, weight: self.weight }
    }

    /// Weights of cells from those of pixels. Outside of its place a target may hold anything, which the mean of a cell that it only
    /// touches would mix in; such cells count only if there are no others.
    pub(crate) fn cell_weights(&self, cells: Cells, weights: &[f32]) -> Vec<f32> {
        let inside = match self.criterion {
            Criterion::Target { .. } => cells.least_weights(weights),
            _ => Vec::new(),
        };
        if inside.iter().any(|weight| *weight > 0.0) { inside } else { cells.mean_weights(weights) }
    }

    /// The pixels of an image of the view's size that count, in one row.
    pub(crate) fn within(&self, image: &Image) -> Image {
        let Some(weights) = &self.pixels else { return image.clone() };
        let pixels = image.data.as_chunks::<3>().0.iter().zip(weights);
        let data: Vec<f32> =
            pixels.filter(|(_, weight)| **weight > 0.0).flat_map(|(pixel, _)| *pixel).collect();
        Image { width: data.len() / 3, height: 1, channels: 3, data }
    }
}

/// Weight of a stop beside a difference of tonemapped values: the slope of Reinhard's curve by stops at its middle.
const STOP: f32 = 0.173;
/// Weight of a single cell's excess where at least so much was asked for.
const EXCESS: f32 = 0.3;
/// Weight of a mean of cells that falls short: the amount asked for is the least to be reached.
const SHORT: f32 = 2.0;
/// Stops by which more is done than asked for, and as much of a ratio of channels: a dump and a render differ by a percent or two.
const MARGIN: f32 = 0.02;
/// Number of standard deviations that are asked for beyond the reference of a noisy mean: of many tries the best is
/// seldom as good as it looks.
const SURE: f32 = 2.0;
/// Largest share of the requested amount that is added for noise: a mean that is very noisy may as well be far more
/// already.
const MOST_MORE: f32 = 0.25;
/// Added to exposed values under a logarithm or a quotient: a fiftieth of the mean.
const FLOOR: f32 = 0.01;
/// Weight of a difference of colour ratios beside one of tonemapped values.
const CHROMA: f32 = 0.3;
/// Weight of a change that was not asked for: of colour by a goal about brightness, of brightness by one about warmth.
const SIDE: f32 = 0.3;
/// Weight of an unasked change of the mean colour of cells, beside the mean brightness that was asked for: light from
/// elsewhere has another colour.
const SIDE_OF_MEAN: f32 = 0.2;
/// Weight of single cells beside their mean where a mean was asked for: how evenly it is to be reached. Light that
/// falls from elsewhere never does, and what was asked for goes first.
const EVEN: f32 = 0.01;
/// Weight of single cells beside their mean in a part that is to be kept, where no cell should change.
const EVENLY_KEPT: f32 = 0.2;
/// Change of ln(R / B) by one mired: `c2 (1/lambda_B - 1/lambda_R) 1e-6` of Planck's law (Wien's approximation), with
/// c2 = 14388 um K, 0.46 um and 0.61 um.
pub(crate) const RATIO_PER_MIRED: f32 = 0.00769;

impl Criterion {
    /// Reference of [`Criterion::residual`] for an exposed cell, from the cell before, or in the target, exposed as
    /// well.
    pub(crate) fn reference(&self, exposed: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Target { .. } => exposed.map(|x| reinhard(x).0),
            Self::Brightness { stops } => {
                [stop(luminance(exposed)).0 + stops, ratio(exposed, 0, 1).0, ratio(exposed, 2, 1).0]
            }
            Self::Color { color } => color.map(|c| c / luminance(*color)),
            Self::Temperature { mireds } => {
                [ratio(exposed, 0, 2).0 + RATIO_PER_MIRED * mireds, stop(luminance(exposed)).0, 0.0]
            }
            Self::Keep => exposed.map(|x| stop(x).0),
        }
    }

    /// Weight of single cells beside their mean; a target asks for them alone.
    pub(crate) fn weight_of_cells(&self) -> f32 {
        match self {
            Self::Target { .. } => 1.0,
            Self::Keep => EVENLY_KEPT,
            _ => EVEN,
        }
    }

    /// Reference of [`Criterion::residual_of_mean`] for the mean of exposed cells, from what it was before; a target
    /// asks for each cell by itself. Amounts should be what was asked for, no more and no less, but for `MARGIN` and
    /// what their `deviation` by noise demands.
    pub(crate) fn reference_of_mean(&self, before: [f32; 3], deviation: f32) -> Option<[f32; 3]> {
        let [amount, second, third] = self.reference(before);
        let more = |asked: f32, margin: f32| {
            let more = f32::min(SURE * deviation, MOST_MORE * asked.abs());
            (margin + more).copysign(asked)
        };
        match self {
            Self::Target { .. } => None,
            Self::Brightness { stops } => Some([amount + more(*stops, MARGIN), second, third]),
            Self::Temperature { mireds } => {
                Some([amount + more(RATIO_PER_MIRED * mireds, LN_2 * MARGIN), second, third])
            }
            Self::Color { .. } | Self::Keep => Some([amount, second, third]),
        }
    }

    /// True if, by a residual of [`Criterion::residual_of_mean`], an amount is less than its reference by more than
    /// goes for met, or more by as much and a quarter of what was asked for, or half as much changed of what is kept as
    /// may.
    pub(crate) fn is_off(&self, residual: [f32; 3]) -> bool {
        let (asked, met, short, excess) = match self {
            Self::Brightness { stops } => (*stops, STOPS_MET as f32, SHORT * STOP, STOP),
            Self::Temperature { mireds } => {
                (RATIO_PER_MIRED * mireds, RATIO_PER_MIRED * MIREDS_MET as f32, CHROMA, EXCESS * CHROMA)
            }
            Self::Keep => {
                let change = residual.iter().map(|r| r.abs()).sum::<f32>() / 3.0;
                return change > STOP * (0.5 * KEEP_MET as f32).ln_1p() / LN_2;
            }
            Self::Target { .. } | Self::Color { .. } => return false,
        };
        let residual = residual[0] * asked.signum();
        -residual > short * met || residual > excess * (met + MOST_MORE * asked.abs())
    }

    /// True if a residual of a mean says less good of a picture than another: less of what is asked for by amount, or
    /// further from the rest.
    pub(crate) fn is_worse(&self, residual: [f32; 3], other: [f32; 3]) -> bool {
        let square = |r: [f32; 3]| r.iter().map(|r| r * r).sum::<f32>();
        match self {
            Self::Brightness { stops: asked } | Self::Temperature { mireds: asked } => {
                (residual[0] - other[0]) * asked < 0.0
            }
            Self::Target { .. } | Self::Color { .. } | Self::Keep => square(residual) > square(other),
        }
    }

    /// Slopes of what is asked for by amount, stops or the logarithm of a ratio of channels, by an exposed mean.
    pub(crate) fn slopes_of_amount(&self, mean: [f32; 3]) -> Option<[f32; 3]> {
        match self {
            Self::Brightness { .. } => {
                let (_, slope) = stop(luminance(mean));
                Some(LUMINANCE.map(|w| slope * w))
            }
            Self::Temperature { .. } => Some(ratio(mean, 0, 2).1),
            Self::Target { .. } | Self::Color { .. } | Self::Keep => None,
        }
    }

    /// Residual of the mean of cells; see [`Self::residual`] for a single one.
    pub(crate) fn residual_of_mean(&self, mean: [f32; 3], reference: [f32; 3]) -> ([f32; 3], [[f32; 3]; 3]) {
        match self {
            Self::Brightness { stops } => {
                let weight = |difference: f32| if difference * stops < 0.0 { SHORT } else { 1.0 };
                brightness(mean, reference, SIDE_OF_MEAN, weight)
            }
            _ => self.residual(mean, reference),
        }
    }

    /// Residual of an exposed cell from its reference, and the derivatives of these values (rows) by its channels
    /// (columns).
    pub(crate) fn residual(&self, x: [f32; 3], reference: [f32; 3]) -> ([f32; 3], [[f32; 3]; 3]) {
        match self {
            // The paper's equation 6.
            Self::Target { .. } => each_channel(|c| {
                let (tone, slope) = reinhard(x[c]);
                (tone - reference[c], slope)
            }),
            Self::Brightness { stops } => {
                let weight = |difference: f32| if difference * stops < 0.0 { 1.0 } else { EXCESS };
                brightness(x, reference, SIDE, weight)
            }
            Self::Color { .. } => {
                let floored = luminance(x).max(0.0) + FLOOR;
                let ratio = x.map(|x| x / floored);
                let row = |c: usize| {
                    std::array::from_fn(|k| {
                        let own = if k == c { 1.0 } else { 0.0 };
                        CHROMA * (own - ratio[c] * LUMINANCE[k]) / floored
                    })
                };
                (std::array::from_fn(|c| CHROMA * (ratio[c] - reference[c])), [row(0), row(1), row(2)])
            }
            Self::Temperature { mireds } => {
                let ((warmth, d_warmth), (value, slope)) = (ratio(x, 0, 2), stop(luminance(x)));
                let difference = warmth - reference[0];
                let scale = CHROMA * if difference * mireds < 0.0 { 1.0 } else { EXCESS };
                let side = SIDE * STOP;
                let values = [scale * difference, side * (value - reference[1]), 0.0];
                (values, [d_warmth.map(|d| scale * d), LUMINANCE.map(|w| side * slope * w), [0.0; 3]])
            }
            Self::Keep => each_channel(|c| {
                let (value, slope) = stop(x[c]);
                (STOP * (value - reference[c]), STOP * slope)
            }),
        }
    }
}

/// Brightness and colour ratios against a reference; `side` is what the ratios count, `weight` what a difference of stops does.
fn brightness(
    x: [f32; 3],
    reference: [f32; 3],
    side: f32,
    weight: impl Fn(f32) -> f32,
) -> ([f32; 3], [[f32; 3]; 3]) {
    let ((value, slope), (red, d_red), (blue, d_blue)) = (stop(luminance(x)), ratio(x, 0, 1), ratio(x, 2, 1));
    let difference = value - reference[0];
    let (scale, side) = (STOP * weight(difference), side * CHROMA);
    let values = [scale * difference, side * (red - reference[1]), side * (blue - reference[2])];
    (values, [LUMINANCE.map(|w| scale * slope * w), d_red.map(|d| side * d), d_blue.map(|d| side * d)])
}

/// Values and a diagonal of derivatives from one function for each channel.
fn each_channel(of: impl Fn(usize) -> (f32, f32)) -> ([f32; 3], [[f32; 3]; 3]) {
    let pairs: [(f32, f32); 3] = std::array::from_fn(of);
    let mut slopes = [[0.0; 3]; 3];
    (0..3).for_each(|c| slopes[c][c] = pairs[c].1);
    (pairs.map(|pair| pair.0), slopes)
}

/// `x / (1 + x)` and its slope, continued as an odd function so that a negative prediction keeps a gradient.
fn reinhard(x: f32) -> (f32, f32) {
    let scale = 1.0 / (1.0 + x.abs());
    (x * scale, scale * scale)
}

/// Stops of an exposed value, and the slope.
fn stop(x: f32) -> (f32, f32) {
    let floored = x.max(0.0) + FLOOR;
    (floored.log2(), if x > 0.0 { std::f32::consts::LOG2_E / floored } else { 0.0 })
}

/// Logarithm of the ratio of two channels, and the slopes.
fn ratio(x: [f32; 3], above: usize, below: usize) -> (f32, [f32; 3]) {
    let floored = x.map(|x| x.max(0.0) + FLOOR);
    let mut slopes = [0.0; 3];
    slopes[above] = if x[above] > 0.0 { 1.0 / floored[above] } else { 0.0 };
    slopes[below] = if x[below] > 0.0 { -1.0 / floored[below] } else { 0.0 };
    ((floored[above] / floored[below]).ln(), slopes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn criteria() -> Vec<Criterion> {
        vec![
            Criterion::Target { image: Image::default(), exposure_invariant: false },
            Criterion::Brightness { stops: 1.0 },
            Criterion::Brightness { stops: -0.5 },
            Criterion::Color { color: [0.9, 0.5, 0.2] },
            Criterion::Temperature { mireds: 80.0 },
            Criterion::Temperature { mireds: -80.0 },
            Criterion::Keep,
        ]
    }

    #[test]
    fn derivatives_are_differences() {
        let before = [0.4, 0.6, 0.2];
        for criterion in criteria() {
            for x in [[0.3, 0.5, 0.4], [2.0, 1.0, 0.1], [0.02, 0.01, 0.05]] {
                let reference = criterion.reference(before);
                let (_, slopes) = criterion.residual(x, reference);
                for k in 0..3 {
                    let step = 1e-2 * x[k];
                    let at = |delta: f32| {
                        let mut x = x;
                        x[k] += delta;
                        criterion.residual(x, reference).0
                    };
                    let (low, high) = (at(-step), at(step));
                    for j in 0..3 {
                        let slope = (high[j] - low[j]) / (2.0 * step);
                        let error = (slope - slopes[j][k]).abs();
                        assert!(
                            error < 1e-2 * slope.abs() + 1e-3,
                            "{criterion:?} {j} {k}: {slope} {}",
                            slopes[j][k]
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_asked_for_has_no_residual() {
        let before = [0.4, 0.6, 0.2];
        let done: [[f32; 3]; 7] = [
            before,
            [0.81, 1.21, 0.41],
            before.map(|x| (x + FLOOR) / 2f32.sqrt() - FLOOR),
            [90.0, 50.0, 20.0],
            [0.4, 0.6, 0.21 * (-80.0 * RATIO_PER_MIRED).exp() - FLOOR],
            [0.4, 0.6, 0.21 * (80.0 * RATIO_PER_MIRED).exp() - FLOOR],
            before,
        ];
        for (criterion, x) in criteria().into_iter().zip(done) {
            let (residual, _) = criterion.residual(x, criterion.reference(before));
            assert!(residual.iter().all(|r| r.abs() < 2e-3), "{criterion:?}: {residual:?}");
        }
    }

    #[test]
    fn of_a_smaller_picture_a_target_counts_where_all_of_a_square_is_in_its_place() {
        let weights = [vec![1.0; 6], vec![0.0, 1.0, 1.0, 1.0, 1.0, 1.0]].concat();
        let data = (0..36).map(|i| i as f32).collect();
        let image = Image { width: 6, height: 2, channels: 3, data };
        let target = Criterion::Target { image: image.clone(), exposure_invariant: true };
        let goal = |criterion: &Criterion| Goal {
            criterion: criterion.clone(),
            pixels: Some(weights.clone()),
            weight: 2.0,
        };
        let small = goal(&target).shrunk((6, 2), 2);
        assert_eq!(small.criterion, Criterion::Target { image: image.shrunk(2), exposure_invariant: true });
        assert_eq!((small.pixels, small.weight), (Some(vec![0.0, 1.0, 1.0]), 2.0));
        assert_eq!(goal(&Criterion::Keep).shrunk((6, 2), 2).pixels, Some(vec![0.75, 1.0, 1.0]));
    }

    #[test]
    fn too_little_counts_more_than_too_much() {
        let criterion = Criterion::Brightness { stops: 1.0 };
        let reference = criterion.reference([0.5; 3]);
        let miss = |x: f32| criterion.residual([x; 3], reference).0[0].abs();
        assert!(miss(0.5) > 2.0 * miss(2.0));
    }
}
