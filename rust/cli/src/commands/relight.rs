use super::CommandContext;
use super::out_file::check_out;
use super::shot_pictures::relight_shots;
use crate::args::{self, GatherArgs, PictureArgs, RelightArgs};
use anyhow::Context as _;
use relume_session::image::{BitDepth, Image, Precision, ViewTransform};
use relume_session::live::{LiveRequest, RequestOptions};
use relume_session::scene::World;
use relume_session::{
    Compute, ExrLayout, LightSet, Method, RelightOptions, Relighter, Relit, RelitLight, SceneFile, Stage,
    UnitSource, environment_texture,
};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Files of a picture.
#[derive(Serialize)]
pub struct Written {
    pub exr: PathBuf,
    pub png: PathBuf,
    pub lights: Vec<WrittenLight>,
}

/// A light's layer.
#[derive(Serialize)]
pub struct WrittenLight {
    pub name: String,
    #[serde(rename = "maker")]
    pub source: UnitSource,
}

/// Sums lights over a bake, without a proxy.
pub fn gather(args: &GatherArgs, context: &CommandContext) -> anyhow::Result<()> {
    write_pictures(Method::Gather, &args.picture, context)
}

/// Relights a bake or proxies.
pub fn relight(args: &RelightArgs, context: &CommandContext) -> anyhow::Result<()> {
    let method = match args.method {
        args::MethodArg::Auto => Method::Auto,
        args::MethodArg::Gather => Method::Gather,
        args::MethodArg::Proxy => Method::Proxy,
    };
    write_pictures(method, &args.picture, context)
}

fn write_pictures(method: Method, args: &PictureArgs, context: &CommandContext) -> anyhow::Result<()> {
    let (bake, out) = match (&args.shots, &args.bake, &args.out) {
        (Some(list), ..) => return relight_shots(list, method, args, context),
        (None, Some(bake), Some(out)) => (bake, out),
        _ => anyhow::bail!("name a bake folder and --out, or a list of --shots"),
    };
    check_picture(out)?;
    let picture = Picture::relit(bake, None, method, args, &context.compute()?, context)?;
    let written = picture.write(out, args, context)?;
    let by_proxy = written.lights.iter().filter(|light| light.source == UnitSource::Proxy).count();
    let (exr, png) = (written.exr.display(), written.png.display());
    let text = format!("{exr} and {png}: {} lights, {by_proxy} of them by proxy", written.lights.len());
    context.console.result(&text, &written);
    Ok(())
}

/// Refuses, before the work, a file that no picture is written to.
pub fn check_picture(out: &Path) -> anyhow::Result<()> {
    check_out(out, "exr", "pictures are written as a multi-layer EXR, with a PNG beside it")
}

/// A relit picture, and how it is shown.
pub struct Picture {
    pub relit: Relit,
    pub view: ViewTransform,
}

impl Picture {
    /// Relights one bake, as that of a shot of a list if it has such a name.
    pub fn relit(
        bake: &Path,
        shot: Option<&str>,
        method: Method,
        args: &PictureArgs,
        compute: &Compute,
        context: &CommandContext,
    ) -> anyhow::Result<Self> {
        let mut relighter = context.relighter(bake, compute)?;
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
        let wanted = wanted(args, shot, &relighter, context)?;
        let options = RelightOptions { method, denoise: !args.no_denoise, lobes: args.lobes };
        let mut relit = relighter.relight(&wanted.lights, &options, context.monitor)?;
        scale(&mut relit.static_light, wanted.static_light);
        for image in [Some(&mut relit.world), relit.backdrop.as_mut()].into_iter().flatten() {
            scale(image, wanted.world);
        }
        Ok(Self { relit, view })
    }

    /// Writes EXR and PNG.
    pub fn write(&self, out: &Path, args: &PictureArgs, context: &CommandContext) -> anyhow::Result<Written> {
        let png = out.with_extension("png");
        let stage = context.monitor.stage(Stage::Write, 0, 2);
        let layout = match args.layout {
            args::LayoutArg::Blender => ExrLayout::Blender,
            args::LayoutArg::Plain => ExrLayout::Plain,
        };
        self.relit.write_exr(out, layout, if args.float { Precision::Float } else { Precision::Half })?;
        stage.advance(1, "");
        let depth = if args.sixteen_bit { BitDepth::Sixteen } else { BitDepth::Eight };
        self.relit.write_png(&png, &self.view, depth)?;
        stage.advance(1, "");
        let of = |light: &RelitLight| WrittenLight { name: light.name.clone(), source: light.source };
        Ok(Written { exr: out.to_owned(), png, lights: self.relit.lights.iter().map(of).collect() })
    }
}

fn scale(image: &mut Image, factor: [f32; 3]) {
    if factor != [1.0; 3] {
        image.data.chunks_exact_mut(3).for_each(|pixel| (0..3).for_each(|c| pixel[c] *= factor[c]));
    }
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

/// The lights of a file or the scene's own, and factors on other light.
fn wanted(
    args: &PictureArgs,
    shot: Option<&str>,
    relighter: &Relighter,
    context: &CommandContext,
) -> anyhow::Result<LiveRequest> {
    let read = |path: &PathBuf| -> anyhow::Result<LiveRequest> {
        let text =
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        let request = match shot {
            Some(shot) => LiveRequest::parse_for(&text, shot),
            None => LiveRequest::parse(&text),
        };
        request.map_err(|reason| anyhow::anyhow!("request {}: {reason}", path.display()))
    };
    let set = || match &args.lights {
        Some(path) => LightSet::read(path),
        None => relighter.scene_lights(),
    };
    let wanted = match &args.request {
        Some(path) => read(path)?,
        None => LiveRequest::new(set()?, RequestOptions::default()).map_err(anyhow::Error::msg)?,
    };
    wanted.notes.iter().for_each(|note| context.monitor.warn(note));
    if wanted.lights.is_empty() {
        context
            .monitor
            .warn("there are no lights; only the scene's own emission and world are seen (see --lights)");
    }
    Ok(wanted)
}
