use super::CommandContext;
use super::out_file::check_out;
use crate::args::{self, GatherArgs, PictureArgs, RelightArgs};
use relume_session::image::{BitDepth, Precision, ViewTransform};
use relume_session::scene::World;
use relume_session::{
    LightSet, Method, RelightOptions, Relighter, SceneFile, Stage, UnitSource, environment_texture,
};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Serialize)]
struct Written {
    exr: PathBuf,
    png: PathBuf,
    lights: Vec<WrittenLight>,
}

#[derive(Serialize)]
struct WrittenLight {
    name: String,
    #[serde(rename = "maker")]
    source: UnitSource,
}

/// Sums lights over a bake, without a proxy.
pub fn gather(args: &GatherArgs, context: &CommandContext) -> anyhow::Result<()> {
    write_picture(&args.bake, Method::Gather, &args.picture, context)
}

/// Relights a bake or proxies.
pub fn relight(args: &RelightArgs, context: &CommandContext) -> anyhow::Result<()> {
    let method = match args.method {
        args::MethodArg::Auto => Method::Auto,
        args::MethodArg::Gather => Method::Gather,
        args::MethodArg::Proxy => Method::Proxy,
    };
    write_picture(&args.bake, method, &args.picture, context)
}

fn write_picture(
    bake: &Path,
    method: Method,
    args: &PictureArgs,
    context: &CommandContext,
) -> anyhow::Result<()> {
    check_out(&args.out, "exr", "pictures are written as a multi-layer EXR, with a PNG beside it")?;
    let mut relighter = context.relighter(bake, &context.compute()?)?;
    warn_if_unfinished(&relighter, context);
    change_world(&mut relighter, args, context)?;
    match &args.scene {
        Some(path) => relighter.connect(Arc::new(SceneFile::read(path)?.scene))?,
        None => relighter.connect_stored(context.monitor),
    }
    let view = match &args.view {
        Some(path) => ViewTransform::read_lut(path)?,
        None => relighter.view(context.monitor),
    };
    let set = light_set(args.lights.as_deref(), &relighter, context)?;
    let options = RelightOptions { method, denoise: !args.no_denoise };
    let relit = relighter.relight(&set.lights, &options, context.monitor)?;

    let png = args.out.with_extension("png");
    let stage = context.monitor.stage(Stage::Write, 0, 2);
    relit.write_exr(&args.out, if args.float { Precision::Float } else { Precision::Half })?;
    stage.advance(1, "");
    relit.write_png(&png, &view, if args.sixteen_bit { BitDepth::Sixteen } else { BitDepth::Eight })?;
    stage.advance(1, "");

    let lights: Vec<WrittenLight> = relit
        .lights
        .iter()
        .map(|light| WrittenLight { name: light.name.clone(), source: light.source })
        .collect();
    let by_proxy = lights.iter().filter(|light| light.source == UnitSource::Proxy).count();
    let text = format!(
        "{} and {}: {} lights, {} of them by proxy",
        args.out.display(),
        png.display(),
        lights.len(),
        by_proxy
    );
    context.console.result(&text, &Written { exr: args.out.clone(), png, lights });
    Ok(())
}

/// An unfinished bake relights, black where nothing has been traced.
fn warn_if_unfinished(relighter: &Relighter, context: &CommandContext) {
    let missing = relighter.gather().map_or(0, |gather| gather.dump().missing().len());
    if missing > 0 {
        context.monitor.warn(&format!(
            "the bake is unfinished, {missing} shards are missing; resume it for the whole picture"
        ));
    }
}

/// Shows another world, if the command names one.
fn change_world(
    relighter: &mut Relighter,
    args: &PictureArgs,
    context: &CommandContext,
) -> anyhow::Result<()> {
    if args.world.is_none() && args.environment.is_none() {
        return Ok(());
    }
    let environment = args.environment.as_deref().map(environment_texture).transpose()?;
    let (texture, warning) = environment.unzip();
    warning.flatten().iter().for_each(|warning| context.monitor.warn(warning));
    let world = World {
        color: args.world.map_or([1.0; 3], |world| world.0),
        texture: texture.as_ref().map(|_| 0),
        ..World::default()
    };
    let textures: Vec<_> = texture.into_iter().collect();
    Ok(relighter.set_world(&world, &textures, context.monitor)?)
}

/// The light set of a file, or the scene's own.
fn light_set(
    path: Option<&Path>,
    relighter: &Relighter,
    context: &CommandContext,
) -> anyhow::Result<LightSet> {
    let set = match path {
        Some(path) => LightSet::read(path)?,
        None => relighter.scene_lights()?,
    };
    set.notes.iter().for_each(|note| context.monitor.warn(note));
    if set.lights.is_empty() {
        context
            .monitor
            .warn("there are no lights; only the scene's own emission and world are seen (see --lights)");
    }
    Ok(set)
}
