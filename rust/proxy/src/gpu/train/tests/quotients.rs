//! Gradients by weights against differences of the losses that the device itself tells.

use super::*;
use crate::gradient::tests::{batch, difference_quotient, params_away_from_kinks, predictions};

/// Compares the gradient by half of each tensor, along itself, with difference quotients of the loss that the device tells.
///
/// The denominator of the loss is not differentiated, but changes with the predictions y. It falls out of the difference
/// between targets y - d and y + d: w ((y' - y + d)^2 - (y' - y - d)^2) / (y'^2 + e) = 4 w d (y' - y) / (y'^2 + e), whose derivative
/// at y' = y leaves the denominator alone, as do the two gradients.
fn check_quotients<N: Network>(network: &N, setup: &Setup, config: &TrainConfig, width: usize, what: &str) {
    let params = params_away_from_kinks(network.layout(), width);
    let mut batch = batch(setup, 1, config.lights_per_pixel);
    let base = predictions(network, setup, &params, &batch);
    let mut rng = Rng::stream(4, 4, 4);
    let offsets: Vec<f32> = base.iter().map(|y| (0.2 + rng.next_f32()) * (y * y + 0.01).sqrt()).collect();
    let mut on_either_side = |sign: f32| {
        batch.targets = base.iter().zip(&offsets).map(|(y, d)| y - sign * d).collect();
        on_device(network, setup, config, &params, &batch)
    };
    let sides = [on_either_side(1.0), on_either_side(-1.0)];
    let [below, above] = sides.each_ref().map(|side| loss_and_gradient(side, 1));
    let between: Vec<f32> = below.1.iter().zip(&above.1).map(|(a, b)| a - b).collect();
    for tensor in &network.layout().tensors {
        let mut direction = vec![0.0; params.len()];
        for at in tensor.range() {
            direction[at] = if rng.next_f32() < 0.5 { between[at] } else { 0.0 };
        }
        let length = norm(direction.iter().copied());
        let value = |by: f32| {
            let by = f64::from(by) / length;
            let to: Vec<f32> =
                params.iter().zip(&direction).map(|(p, d)| p + (by * f64::from(*d)) as f32).collect();
            let [below, above] = sides.each_ref().map(|side| {
                side.upload([&to, &to, &vec![0.0; to.len()], &vec![0.0; to.len()]]);
                f64::from(loss_and_gradient(side, 1).0)
            });
            below - above
        };
        // Losses of about one move by a hundredth of that, beside which rounding is small, and so is curvature.
        let step = (1e-2 / length).min(5e-2) as f32;
        let found = difference_quotient(value, step);
        let rounding = 2e-7 / f64::from(step);
        assert!(
            (found - length).abs() < 2e-3 * length + rounding,
            "{what}, {}: difference quotient {found}, gradient {length}",
            tensor.name
        );
    }
}

#[test]
fn weight_gradients_equal_difference_quotients_of_the_device() {
    let (grid, quads, spheres) = (tiny_grid(), setup(LightKind::Quad), setup(LightKind::Sphere));
    let fast = FastNetwork::new(20, 2, &grid, quads.size, quads.encoding);
    let fast_config = config(NetworkConfig::Fast { width: 20, layers: 2, grid }, 1, 4);
    check_quotients(&fast, &quads, &fast_config, 20, "fast, quad");
    let reference = ReferenceNetwork::new(24, 3, &grid, spheres.size, spheres.encoding);
    let reference_config = config(NetworkConfig::Reference { width: 24, layers: 3, grid }, 1, 8);
    check_quotients(&reference, &spheres, &reference_config, 24, "reference, sphere");
}
