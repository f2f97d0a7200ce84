use super::Context;
use crate::args::EvaluateArgs;
use relume_session::{Relighter, evaluate as evaluate_proxy, proxy::Proxy};

/// Measures a proxy against an independent bake.
pub fn evaluate(args: &EvaluateArgs, context: &Context) -> anyhow::Result<()> {
    let (proxy, reference) = (Proxy::open(&args.proxy)?, Relighter::open(&args.reference)?);
    let mean = evaluate_proxy(&proxy, &reference, args.lights, context.global.seed, context.monitor)?;
    let text = format!(
        "{}: {:.2} dB, SMAPE {:.4}, SSIM {:.4}, FLIP {:.4}",
        args.proxy.display(),
        mean.psnr,
        mean.smape,
        mean.ssim,
        mean.flip
    );
    context.console.result(&text, &mean);
    Ok(())
}
