use super::CommandContext;
use crate::args::{LightKindArg, NetworkArg, PlacementArg, TrainArgs};
use relume_session::proxy::{LightKind, LightPlacement, NetworkConfig, SizeRange, TargetMode, TrainConfig};
use relume_session::{Clock, TrainSettings, default_sizes, train as train_proxy};

/// Trains a proxy on a bake.
pub fn train(args: &TrainArgs, context: &CommandContext) -> anyhow::Result<()> {
    let kind = match args.kind {
        LightKindArg::Sphere => LightKind::Sphere,
        LightKindArg::FacingDisk => LightKind::FacingDisk,
        LightKindArg::Quad => LightKind::Quad,
        LightKindArg::Ellipse => LightKind::Ellipse,
        LightKindArg::Spot => LightKind::Spot,
        LightKindArg::SphereSpot => LightKind::SphereSpot,
    };
    let settings = TrainSettings {
        kind,
        config: config(args, kind)?,
        seed: context.seed(),
        seconds: args.seconds,
        clock: if args.processor_time { Clock::Processor } else { Clock::Wall },
        half_for_measuring: !args.all_paths,
    };
    let out = args.out.as_deref().unwrap_or(&args.bake);
    let report = train_proxy(&args.bake, out, &settings, args.resume, &context.compute()?, context.monitor)?;
    let mut text = format!(
        "{}: {} steps, {:.1} M samples, {:.1} s",
        report.proxy.display(),
        report.steps,
        report.samples as f64 / 1e6,
        report.seconds,
    );
    if let Some(m) = &report.measured {
        text += &format!(
            "; on {} held-out lights proxy {:.1} dB (SMAPE {:.3}), gather of {} samples {:.1} dB ({:.3}), denoised \
             {:.1} dB ({:.3})",
            m.lights,
            m.proxy.psnr,
            m.proxy.smape,
            m.samples,
            m.gather.psnr,
            m.gather.smape,
            m.gather_denoised.psnr,
            m.gather_denoised.smape,
        );
    }
    context.console.result(&text, &report);
    Ok(())
}

fn config(args: &TrainArgs, kind: LightKind) -> anyhow::Result<TrainConfig> {
    let size = sizes(args, kind)?;
    let mut config = match args.network {
        NetworkArg::Fast => TrainConfig::fast(size),
        NetworkArg::Reference => TrainConfig::reference(size),
    };
    config.samples = (args.million_samples * 1e6) as u64;
    config.placement = match args.placement {
        PlacementArg::Segments => LightPlacement::Segments,
        PlacementArg::Bounds => LightPlacement::Bounds,
    };
    if let Some(size) = args.pool {
        config.targets = TargetMode::Pool { size, denoised: true };
    }
    let (NetworkConfig::Fast { width, layers, .. } | NetworkConfig::Reference { width, layers, .. }) =
        &mut config.network;
    *width = args.neurons.unwrap_or(*width);
    *layers = args.layers.unwrap_or(*layers);
    Ok(config)
}

/// Sizes from the options, or those that suit the bake.
fn sizes(args: &TrainArgs, kind: LightKind) -> anyhow::Result<SizeRange> {
    if let (Some(min), Some(max)) = (args.size_min, args.size_max) {
        return Ok(SizeRange { min, max });
    }
    let range = default_sizes(&args.bake, kind)?;
    Ok(SizeRange { min: args.size_min.unwrap_or(range.min), max: args.size_max.unwrap_or(range.max) })
}
