/// Adam (Kingma, Ba 2015) with its usual constants.
pub(crate) struct Adam {
    learning_rate: f32,
    step: i32,
    mean: Vec<f32>,
    square: Vec<f32>,
}

const BETA_MEAN: f32 = 0.9;
const BETA_SQUARE: f32 = 0.999;
const EPSILON: f32 = 1e-8;

impl Adam {
    pub(crate) fn new(count: usize, learning_rate: f32) -> Self {
        Self { learning_rate, step: 0, mean: vec![0.0; count], square: vec![0.0; count] }
    }

    /// Step of the values for this gradient.
    pub(crate) fn step(&mut self, gradient: &[f32]) -> Vec<f32> {
        self.step += 1;
        let mean_scale = 1.0 / (1.0 - BETA_MEAN.powi(self.step));
        let square_scale = 1.0 / (1.0 - BETA_SQUARE.powi(self.step));
        let step = |(i, g): (usize, &f32)| {
            self.mean[i] += (1.0 - BETA_MEAN) * (g - self.mean[i]);
            self.square[i] += (1.0 - BETA_SQUARE) * (g * g - self.square[i]);
            let root = (self.square[i] * square_scale).sqrt();
            -self.learning_rate * self.mean[i] * mean_scale / (root + EPSILON)
        };
        gradient.iter().enumerate().map(step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_step_is_the_learning_rate_whatever_the_gradient() {
        let step = Adam::new(3, 0.05).step(&[1e-3, -40.0, 0.0]);
        assert!((step[0] + 0.05).abs() < 1e-5 && (step[1] - 0.05).abs() < 1e-5 && step[2] == 0.0);
    }
}
