use crate::simd::LANES;

/// Constant of the loss (paper, equation 4).
const EPSILON: f32 = 0.01;

/// Relative squared error `(p - t)^2 / (sg(p)^2 + 0.01)` (paper, equation 4, after Mueller et al. 2021), summed over one
/// tile of three rows and times `weight`. Writes its gradient.
pub(crate) fn relative_l2(prediction: &[f32], target: &[f32], weight: f32, gradient: &mut [f32]) -> f64 {
    let mut sum = 0.0f32;
    for ((p, t), g) in prediction.iter().zip(target).zip(gradient) {
        let inverse = 1.0 / (p * p + EPSILON);
        let difference = p - t;
        sum += difference * difference * inverse;
        *g = 2.0 * weight * difference * inverse;
    }
    f64::from(weight * sum)
}

/// Values of a tile of predictions.
pub(crate) const TILE: usize = 3 * LANES;
