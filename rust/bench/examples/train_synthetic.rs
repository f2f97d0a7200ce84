//! Trains a proxy on the synthetic room and prints its curve:
//! `cargo run --release -p relume-proxy --example train_synthetic -- fast sphere 4000000`

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use relume_proxy::synthetic::SyntheticRoom;
use relume_proxy::{LightKind, NetworkConfig, SizeRange, TrainConfig, Trainer};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let network = arguments.next().unwrap_or_else(|| "fast".to_owned());
    let kind = match arguments.next().as_deref() {
        Some("quad") => LightKind::Quad,
        _ => LightKind::Sphere,
    };
    let samples = arguments.next().map_or(Ok(4 << 20), |s| s.parse())?;
    let size = SizeRange { min: 0.08, max: 0.5 };
    let mut config = match network.as_str() {
        "fast" => TrainConfig::fast(size),
        _ => TrainConfig { targets: relume_proxy::TargetMode::Raw, ..TrainConfig::reference(size) },
    };
    if let NetworkConfig::Reference { width, layers, .. } = &mut config.network {
        (*width, *layers) = (64, 4);
    }
    config.samples = samples;
    // `field=json` arguments override the configuration.
    let mut value = serde_json::to_value(&config)?;
    for argument in arguments {
        let (field, json) = argument.split_once('=').ok_or("expected field=json")?;
        *value.pointer_mut(field).ok_or("no such field")? = serde_json::from_str(json)?;
    }
    let config = serde_json::from_value(value)?;

    let source = SyntheticRoom::new(160, 96).with_noise(0.3);
    let mut trainer = Trainer::new(Arc::new(source.features()), kind, config, 1)?;
    let (start, mut training, mut next) = (Instant::now(), 0.0, 0.125);
    while !trainer.done() {
        let before = Instant::now();
        let report = trainer.step(&source)?;
        training += before.elapsed().as_secs_f64();
        if report.progress >= next {
            next += 0.125;
            let scores = trainer.validate(&source)?;
            println!(
                "{:8} samples, loss {:.4}, {:.2} dB, SMAPE {:.4}, {:.2} M samples/s",
                report.samples,
                report.loss.unwrap_or(f64::NAN),
                scores.psnr,
                scores.smape,
                report.samples as f64 / training * 1e-6,
            );
        }
    }
    println!("{:.1} s", start.elapsed().as_secs_f64());
    Ok(())
}
