use crate::progress::{Monitor, Stage};
use crate::{LightSet, SessionError};
use relume_dump::DumpWriter;
use relume_scene::Scene;
use relume_trace::{Control, Outcome, TraceSettings, Tracer};
use serde::Serialize;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

/// File of a bake folder that holds the lights that the scene came with ([`LightSet`]).
pub const LIGHTS_FILE: &str = "lights.json";

/// File of a bake folder that holds the scene's view transform, if it is not the sRGB curve: a table for
/// [`relume_image::ViewTransform::read_lut`].
pub const VIEW_FILE: &str = "view.png";

/// What a bake did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BakeReport {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Paths per pixel.
    pub samples: u32,
    /// Paths in the dump.
    pub paths: u64,
    /// Segments in the dump.
    pub segments: u64,
    /// Bytes of the dump's shards.
    pub bytes: u64,
    /// Seconds of this run.
    pub seconds: f64,
    /// What could not be represented, in words for the user.
    pub warnings: Vec<String>,
}

/// Traces a scene into a folder. With `resume`, complete shards of an interrupted bake of the same scene and settings
/// stay, and the result is the same as without the interruption; more samples than before extend it.
///
/// # Errors
/// [`SessionError::Cancelled`] if stopped; otherwise the error names what to change.
pub fn bake(
    scene: &Scene,
    settings: &TraceSettings,
    folder: &Path,
    resume: bool,
    monitor: &Monitor,
) -> Result<BakeReport, SessionError> {
    let start = Instant::now();
    check(scene, settings)?;
    let prepare = monitor.stage(Stage::Prepare, 0, 1);
    let tracer = Tracer::new(scene, settings)?;
    prepare.advance(1, "");
    let warnings: Vec<String> = scene.warnings.iter().chain(tracer.warnings()).cloned().collect();
    warnings.iter().for_each(|warning| monitor.warn(warning));

    let manifest = tracer.manifest();
    let writer = match resume {
        true => DumpWriter::resume(folder, manifest)?,
        false => DumpWriter::create(folder, manifest)?,
    };
    let lights =
        LightSet { name: scene.camera.name.clone(), lights: scene.lights.clone(), notes: Vec::new() };
    lights.write(&folder.join(LIGHTS_FILE))?;
    trace(&tracer, &writer, monitor)?;

    let dump = writer.finish()?;
    let samples = dump.manifest().samples();
    Ok(BakeReport {
        width: scene.camera.width,
        height: scene.camera.height,
        samples,
        paths: u64::from(samples) * (scene.camera.width * scene.camera.height) as u64,
        segments: dump.record_count() as u64,
        bytes: dump.shards().map(|shard| shard.as_bytes().len() as u64).sum(),
        seconds: start.elapsed().as_secs_f64(),
        warnings,
    })
}

fn check(scene: &Scene, settings: &TraceSettings) -> Result<(), SessionError> {
    let settings_error = |reason: &str| Err(SessionError::Settings(reason.into()));
    if settings.samples == 0 {
        return settings_error("samples must be at least 1");
    }
    if settings.tile_size == 0 {
        return settings_error("the tile size must be at least 1 pixel");
    }
    scene.validate().map_err(|problems| {
        SessionError::Settings(problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
    })
}

/// Runs the tracer with its progress and the cancel flag passed on.
fn trace(tracer: &Tracer, writer: &DumpWriter, monitor: &Monitor) -> Result<(), SessionError> {
    let stage = OnceLock::new();
    let on_progress = |progress: relume_trace::Progress| {
        let stage = stage.get_or_init(|| monitor.stage(Stage::Trace, progress.paths, progress.paths_total));
        stage.set(progress.paths, &format!("{} of {} shards", progress.shards, progress.shards_total));
    };
    let cancel = monitor.cancel().flag().clone();
    let control = Control { cancel, on_progress: Some(Box::new(on_progress)) };
    match tracer.trace(writer, &control)? {
        Outcome::Complete => Ok(()),
        Outcome::Cancelled => Err(SessionError::Cancelled),
    }
}
