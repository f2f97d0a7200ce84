//! Times at which a camera sees, after Cycles' `kernel/camera/camera.h`.

use relume_scene::{STILL, Shutter};

use crate::discrete::Discrete1D;

/// A shutter ready to draw times.
#[derive(Clone, Debug)]
pub(crate) struct ShutterTable {
    /// Steps of the shutter's curve.
    curve: Option<Discrete1D>,
    rolling: Option<f32>,
}

impl ShutterTable {
    pub fn new(shutter: &Shutter) -> Self {
        Self { curve: Discrete1D::new(&shutter.curve), rolling: shutter.rolling }
    }

    /// Time of a path of row `y`, from the top, of `height`, for a number in 0..1.
    pub fn time(&self, y: usize, height: usize, u: f32) -> f32 {
        let time = self.curve.as_ref().map_or(u, |curve| curve.sample_evenly(u));
        let Some(share) = self.rolling else { return time };
        let line = (y + 1) as f32 / height as f32;
        if share == 0.0 { line } else { (time - STILL) * share + (line - STILL) * (1.0 - share) + STILL }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_time(curve: &[f32], rolling: Option<f32>, y: usize) -> f32 {
        let table = ShutterTable::new(&Shutter { curve: curve.to_vec(), rolling });
        (0..1000).map(|i| table.time(y, 10, (i as f32 + 0.5) / 1000.0)).sum::<f32>() / 1000.0
    }

    #[test]
    fn times_follow_the_curve() {
        assert!((mean_time(&[1.0], None, 0) - 0.5).abs() < 1e-3);
        // Open in the last quarter alone, then twice as far in the second half as in the first.
        assert!((mean_time(&[0.0, 0.0, 0.0, 2.0], None, 0) - 0.875).abs() < 1e-3);
        assert!((mean_time(&[1.0, 2.0], None, 0) - (0.25 + 2.0 * 0.75) / 3.0).abs() < 1e-3);
    }

    #[test]
    fn lines_follow_each_other_from_the_top() {
        assert_eq!(mean_time(&[1.0], Some(0.0), 4), 0.5);
        let [top, bottom] = [0, 9].map(|y| mean_time(&[1.0], Some(0.5), y));
        assert!((top - (0.5 - 0.4 * 0.5)).abs() < 1e-3 && (bottom - (0.5 + 0.5 * 0.5)).abs() < 1e-3);
        let table = ShutterTable::new(&Shutter { curve: vec![1.0], rolling: Some(0.5) });
        assert!((table.time(4, 10, 0.99) - table.time(4, 10, 0.01) - 0.49).abs() < 1e-5);
    }
}
