use super::Context;
use crate::args::OptimiseArgs;
use relume_session::image::read_picture;
use relume_session::solver::{Locks, Settings};
use relume_session::{LightSet, OptimiseOptions, Relighter, optimise as solve};
use serde::Serialize;
use std::path::PathBuf;

#[derive(Serialize)]
struct Found {
    lights: PathBuf,
    loss: f64,
    start_loss: f64,
    start: usize,
    /// Loss of block means before and after the polish; none without a bake.
    polish: Option<[f64; 2]>,
    found: Vec<relume_session::scene::Light>,
}

/// Finds lights that make a target picture.
pub fn optimise(args: &OptimiseArgs, context: &Context) -> anyhow::Result<()> {
    let relighter = Relighter::open(&args.bake)?.on(&context.compute()?);
    let target = read_picture(&args.target)?;
    let start = args.lights.as_deref().map(LightSet::read).transpose()?;
    let options = OptimiseOptions {
        settings: Settings {
            iterations: args.iterations,
            pixel_fraction: args.pixel_fraction,
            seed: context.global.seed,
            ..Settings::default()
        },
        locks: Locks { center: args.lock_center, radius: args.lock_radius, radiance: args.lock_radiance },
        count: args.count,
        starts: args.starts,
        polish: args.polish,
    };
    let optimised = solve(&relighter, &target, start.as_ref(), &options, context.monitor)?;
    optimised.lights.write(&args.out)?;
    let solution = optimised.solution;
    let polish = optimised.polished.map(|polished| [polished.start_loss, polished.loss]);
    let polished = polish
        .map_or(String::new(), |[before, after]| format!(", polished from {before:.3e} to {after:.3e}"));
    let text = format!(
        "{}: {} lights, loss {:.3e} (start {} had {:.3e}){polished}",
        args.out.display(),
        optimised.lights.lights.len(),
        solution.loss,
        solution.start + 1,
        solution.start_loss
    );
    let found = Found {
        lights: args.out.clone(),
        loss: solution.loss,
        start_loss: solution.start_loss,
        start: solution.start,
        polish,
        found: optimised.lights.lights,
    };
    context.console.result(&text, &found);
    Ok(())
}
