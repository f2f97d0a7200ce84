use super::CommandContext;
use crate::args::{SettingsArgs, TraceArgs, Triple, Up, ViewArgs};
use anyhow::bail;
use relume_session::scene::UpAxis;
use relume_session::trace::TraceSettings;
use relume_session::trace::settings::BounceLimits;
use relume_session::{LightSet, ObjView, SceneFile, bake, obj_scene};
use std::path::Path;

/// Traces a scene file or an OBJ scene into a bake folder.
pub fn trace(args: &TraceArgs, context: &CommandContext) -> anyhow::Result<()> {
    let file = read(&args.scene, &args.settings, context)?;
    let report = bake(&file.scene, &file.settings, &args.out, args.resume, context.monitor)?;
    file.write_view(&args.out)?;
    let text = format!(
        "{}: {} x {} pixels, {} paths per pixel, {} segments, {:.1} MiB, {:.1} s",
        args.out.display(),
        report.width,
        report.height,
        report.samples,
        report.segments,
        report.bytes as f64 / f64::from(1 << 20),
        report.seconds
    );
    context.console.result(&text, &report);
    Ok(())
}

/// Reads a scene file or an OBJ file, with the settings that the options say.
pub fn read(path: &Path, args: &SettingsArgs, context: &CommandContext) -> anyhow::Result<SceneFile> {
    let mut file = read_as_it_is(path, &args.view)?;
    if let Some(path) = &args.lights {
        let set = LightSet::read(path)?;
        set.notes.iter().for_each(|note| context.monitor.warn(note));
        file.scene.lights = set.lights;
    }
    file.settings = overridden(&file.settings, args, context)?;
    Ok(file)
}

fn read_as_it_is(path: &Path, view: &ViewArgs) -> anyhow::Result<SceneFile> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj")) {
        let bounces =
            BounceLimits { total: 12, diffuse: 12, glossy: 12, transmission: 12, ..BounceLimits::default() };
        let mut settings = TraceSettings { samples: 256, ..TraceSettings::default() };
        settings.paths.bounces = bounces;
        return Ok(SceneFile { scene: obj_scene(path, &obj_view(view))?, settings, view: None });
    }
    if *view != ViewArgs::default() {
        bail!(
            "{} has a camera and a world; --width, --height, --eye, --target, --fov, --world and --up are for OBJ files",
            path.display()
        );
    }
    Ok(SceneFile::read(path)?)
}

fn obj_view(args: &ViewArgs) -> ObjView {
    let vector = |triple: Triple| triple.0.into();
    let default = ObjView::default();
    ObjView {
        up: match args.up {
            Some(Up::Z) => UpAxis::Z,
            Some(Up::Y) | None => UpAxis::Y,
        },
        eye: args.eye.map(vector),
        target: args.target.map(vector),
        fov_degrees: args.fov.unwrap_or(default.fov_degrees),
        width: args.width.unwrap_or(default.width),
        height: args.height.unwrap_or(default.height),
        world: args.world.map_or(default.world, |triple| triple.0),
    }
}

/// The scene's settings with what the options override.
fn overridden(
    own: &TraceSettings,
    args: &SettingsArgs,
    context: &CommandContext,
) -> anyhow::Result<TraceSettings> {
    let mut settings = TraceSettings {
        samples: args.samples.unwrap_or(own.samples),
        seed: context.global.seed.unwrap_or(own.seed),
        tile_size: args.tile,
        ..own.clone()
    };
    if let Some(path) = &args.towards {
        settings.guide_targets = LightSet::read(path)?.lights;
    }
    if let Some(limit) = args.bounces {
        let bounces = &mut settings.paths.bounces;
        (bounces.total, bounces.diffuse, bounces.glossy, bounces.transmission) = (limit, limit, limit, limit);
    }
    Ok(settings)
}
