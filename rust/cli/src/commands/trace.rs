use super::Context;
use crate::args::{TraceArgs, Triple, Up};
use relume_session::scene::UpAxis;
use relume_session::trace::TraceSettings;
use relume_session::trace::settings::{BounceLimits, PathSettings};
use relume_session::{LightSet, ObjView, bake, obj_scene};

/// Traces an OBJ scene into a bake folder.
pub fn trace(args: &TraceArgs, context: &Context) -> anyhow::Result<()> {
    let vector = |triple: Triple| triple.0.into();
    let view = ObjView {
        up: match args.up {
            Up::Y => UpAxis::Y,
            Up::Z => UpAxis::Z,
        },
        eye: args.eye.map(vector),
        target: args.target.map(vector),
        fov_degrees: args.fov,
        width: args.width,
        height: args.height,
        world: args.world.0,
    };
    let mut scene = obj_scene(&args.scene, &view)?;
    if let Some(path) = &args.lights {
        let set = LightSet::read(path)?;
        set.notes.iter().for_each(|note| context.monitor.warn(note));
        scene.lights = set.lights;
    }
    let towards = args.towards.as_deref().map(LightSet::read).transpose()?.unwrap_or_default().lights;
    let settings = TraceSettings { towards, ..settings(args, context) };
    let report = bake(&scene, &settings, &args.out, args.resume, context.monitor)?;
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

fn settings(args: &TraceArgs, context: &Context) -> TraceSettings {
    let limit = args.bounces;
    let bounces = BounceLimits {
        total: limit,
        diffuse: limit,
        glossy: limit,
        transmission: limit,
        ..BounceLimits::default()
    };
    TraceSettings {
        samples: args.samples,
        seed: context.global.seed,
        tile_size: args.tile,
        threads: context.global.threads,
        paths: PathSettings { bounces, ..PathSettings::default() },
        ..TraceSettings::default()
    }
}
