use crate::TrainConfig;
use crate::network::CHUNK;
use crate::optim::StepRates;

/// Share of the training over which the rates rise from zero.
const WARM_UP: f32 = 0.01;

/// Steps between updates of the running mean of weights.
pub(crate) const EMA_EVERY: u64 = 8;

/// Share of the training that is done.
pub(crate) fn progress(config: &TrainConfig, samples: u64) -> f32 {
    (samples as f64 / config.samples as f64).min(1.0) as f32
}

/// Samples of the next step: doubles from start to end in equal shares of the training, a whole number of chunks.
pub(crate) fn batch_size(config: &TrainConfig, progress: f32) -> usize {
    let doublings = (config.batch_end as f32 / config.batch_start as f32).log2();
    let doubled = (progress * (doublings + 1.0)).floor().min(doublings.floor());
    let size = config.batch_start as f32 * doubled.exp2();
    (size as usize).next_multiple_of(CHUNK)
}

/// Learning rates of the next step: a short rise, then a half cosine to the final fraction.
pub(crate) fn rates(config: &TrainConfig, progress: f32) -> StepRates {
    let fraction = config.rates.final_fraction;
    let cosine = 0.5 * (1.0 + (std::f32::consts::PI * progress).cos());
    let rise = ((progress + 1e-4) / WARM_UP).min(1.0);
    let share = rise * (fraction + (1.0 - fraction) * cosine);
    StepRates {
        adam: config.rates.adam * share,
        muon: config.rates.muon * share,
        grid: config.rates.grid * share,
    }
}

/// Share of the way that the running mean goes towards the weights after a step, counted from 1; `None` if it stays.
pub(crate) fn mean_share(config: &TrainConfig, step: u64) -> Option<f32> {
    if config.ema_decay <= 0.0 || !step.is_multiple_of(EMA_EVERY) {
        return None;
    }
    // Early on the mean must forget the start values faster than its decay would.
    let turns = (step / EMA_EVERY) as f32;
    let decay = config.ema_decay.powi(EMA_EVERY as i32).min((turns - 1.0) / (turns + 1.0));
    Some(1.0 - decay)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SizeRange;

    #[test]
    fn batches_double_from_start_to_end() {
        let config = TrainConfig {
            batch_start: 4096,
            batch_end: 16_384,
            ..TrainConfig::fast(SizeRange { min: 0.1, max: 1.0 })
        };
        let sizes = [0.0, 0.3, 0.34, 0.66, 0.67, 1.0].map(|p| batch_size(&config, p));
        assert_eq!(sizes, [4096, 4096, 8192, 8192, 16_384, 16_384]);
    }

    #[test]
    fn rates_rise_then_fall_to_their_final_fraction() {
        let config = TrainConfig::fast(SizeRange { min: 0.1, max: 1.0 });
        let at = |p| rates(&config, p).adam / config.rates.adam;
        assert!(at(0.0) < 0.02 && at(0.01) > 0.99 && at(0.5) < 0.6, "{} {} {}", at(0.0), at(0.01), at(0.5));
        assert!((at(1.0) - config.rates.final_fraction).abs() < 1e-5);
    }
}
