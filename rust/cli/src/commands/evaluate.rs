use super::CommandContext;
use crate::args::EvaluateArgs;
use relume_session::{MeanQuality, Relighter, evaluate as evaluate_proxies, proxy::Proxy};

/// Measures proxies against an independent bake.
pub fn evaluate(args: &EvaluateArgs, context: &CommandContext) -> anyhow::Result<()> {
    let proxies = args.proxies.iter().map(|path| Proxy::open(path)).collect::<Result<Vec<_>, _>>()?;
    let mut reference = Relighter::open(&args.reference)?;
    reference.connect_stored(context.monitor);
    let compared = args.gather.as_deref().map(Relighter::open).transpose()?;
    let lights = (args.lights, context.seed());
    let pictures = args.pictures.as_deref();
    let compute = context.compute()?;
    let found = evaluate_proxies(
        &proxies,
        &reference,
        compared.as_ref(),
        lights,
        pictures,
        &compute,
        context.monitor,
    )?;
    let mut lines: Vec<String> = args
        .proxies
        .iter()
        .zip(&found.proxies)
        .map(|(path, mean)| line(&path.display().to_string(), mean))
        .collect();
    lines.extend(found.gather.iter().map(|mean| line("gather", mean)));
    lines.extend(found.gather_denoised.iter().map(|mean| line("gather, denoised", mean)));
    lines.push(line("reference before denoising", &found.reference_noise));
    context.console.result(&lines.join("\n"), &found);
    Ok(())
}

fn line(name: &str, mean: &MeanQuality) -> String {
    let MeanQuality { psnr, smape, ssim, flip } = mean;
    format!("{name}: {psnr:.2} dB, SMAPE {smape:.4}, SSIM {ssim:.4}, FLIP {flip:.4}")
}
