//! Traces a scene into a bake folder.

pub(crate) mod features;
pub(crate) mod guiding;
mod shards;
pub(crate) mod world;

use crate::bake::guiding::GuidingRecord;
use crate::bake::shards::{ObservedWriter, Work, trace};
use crate::error::SessionError;
use crate::files::contents;
use crate::files::folder_lock::FolderLock;
use crate::files::light_set::LightSet;
use crate::files::names::{
    CONTENTS_FILE, GUIDED_FILE, LIGHTS_FILE, LOCK_FILE, SCENE_FILE, VIEW_FILE, WORLD_FILE,
};
use crate::files::scene_file::write_scene;
use crate::progress::{Monitor, Stage};
use relume_dump::{Dump, DumpError, DumpWriter, Manifest, ShardSink};
use relume_scene::{Light, Scene};
use relume_trace::{TraceSettings, Tracer, guide_targets, manifest};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Largest film exposure, so that what is as bright as may be can be summed still; Blender's own goes to 10.
const MOST_EXPOSURE: f32 = 1e4;

/// Report of a bake.
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
    /// Warnings about things that cannot be represented, for the user.
    pub warnings: Vec<String>,
}

/// Traces a scene into a folder. With `resume`, complete shards of an interrupted bake of the same scene and settings
/// stay. The result is the same as without the interruption; more samples than before extend it.
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
    let lights = || guide_targets(scene, settings);
    let observer = Observer { samples: settings.samples, lights: &lights, prepared: None, passes: &|_| {} };
    bake_observed(scene, settings, folder, resume, monitor, &observer)
}

/// First difference between the bake in a folder and one of this scene with these settings. More or fewer samples are
/// none. Nor is a world that differs from [`Manifest::world_color`] by strength or tint. Nor is another map of the
/// world if all paths are there: its light is gathered from them.
///
/// # Errors
/// If the folder holds no bake that can be read.
pub fn difference(
    scene: &Scene,
    settings: &TraceSettings,
    folder: &Path,
) -> Result<Option<&'static str>, SessionError> {
    let baked = Manifest::read(folder)?;
    let own_color = TraceSettings { world_color: Some(baked.world_color), ..settings.clone() };
    let found = baked.difference(&manifest(scene, &own_color));
    let any_map = found == Some(Manifest::WORLD_MAP) && has_samples(folder, settings.samples)?;
    Ok(found.filter(|_| !any_map))
}

/// True if the whole passes of the bake in a folder hold so many samples.
fn has_samples(folder: &Path, samples: u32) -> Result<bool, SessionError> {
    let dump = Dump::open(folder)?;
    let whole = dump.complete_passes();
    Ok(whole > 0 && dump.passes(0..whole).manifest().samples() >= samples)
}

/// Who watches a bake, and says where its paths look.
pub(crate) struct Observer<'a> {
    /// Samples of the whole bake, if this call traces a part of it; progress counts them.
    pub samples: u32,
    /// Lights that the paths of the next pass are guided towards.
    pub lights: &'a (dyn Fn() -> Vec<Light> + Sync),
    /// Receives the scene as it is made ready.
    pub prepared: Option<&'a dyn Fn(&Tracer<'_>)>,
    /// Receives all whole passes whenever there is one more, from the first on.
    pub passes: &'a (dyn Fn(Dump) + Sync),
}

/// [`bake`] for somebody who watches.
pub(crate) fn bake_observed(
    scene: &Scene,
    settings: &TraceSettings,
    folder: &Path,
    resume: bool,
    monitor: &Monitor,
    observer: &Observer,
) -> Result<BakeReport, SessionError> {
    let start = Instant::now();
    check(scene, settings)?;
    if let Some(dump) = if resume { of_another_world(scene, settings, folder)? } else { None } {
        write_lights(scene, folder)?;
        (observer.passes)(dump.clone());
        if let Some(observe) = observer.prepared {
            observe(&Tracer::new(scene, settings)?);
        }
        return Ok(report(&dump, start, scene.warnings.clone()));
    }
    // What is added to a bake is of the colour that its world began with; the writer refuses a bake of something else.
    let baked = if resume { Manifest::read(folder).ok() } else { None };
    let is_record_lost = baked.is_some() && contents::is_lost(&folder.join(GUIDED_FILE));
    let world_color = baked.map(|baked| baked.world_color).or(settings.world_color);
    let own = TraceSettings { world_color, ..settings.clone() };
    let (tracer, warnings) = ready(scene, &own, monitor)?;
    observer.prepared.iter().for_each(|observe| observe(&tracer));

    let _lock = FolderLock::take(folder)?;
    let writer = begin(&tracer, scene, settings, folder, resume)?;
    let guiding_record =
        if resume { GuidingRecord::of_bake(folder).unwrap_or_default() } else { GuidingRecord::default() };
    let recorder = GuideRecorder {
        folder,
        guiding: settings.guiding,
        lights: observer.lights,
        guiding_record: guiding_record.into(),
        is_lost: is_record_lost,
    };
    let sink = ObservedWriter::new(writer, folder, observer.passes)?;
    let lights = |pass| recorder.lights_of(pass, monitor);
    let mut work = Work::of(&sink, &|_, _| true);
    work.samples = observer.samples;
    trace(&tracer, &sink, &lights, &work, monitor)?;

    Ok(report(&sink.writer.finish()?, start, warnings))
}

/// Makes a folder ready for the paths of a bake, which others trace: it has all files of the bake but its shards. A
/// bake of the same scene that is there goes on.
pub(crate) fn prepare(
    scene: &Scene,
    settings: &TraceSettings,
    folder: &Path,
    monitor: &Monitor,
) -> Result<Manifest, SessionError> {
    check(scene, settings)?;
    let (tracer, _) = ready(scene, settings, monitor)?;
    let _lock = FolderLock::take(folder)?;
    let dump = begin(&tracer, scene, settings, folder, true)?.finish()?;
    if !dump.missing().is_empty() {
        let mut guiding_record = GuidingRecord::of_bake(folder)?;
        let lights = guide_targets(scene, settings);
        if guiding_record.note(dump.complete_passes(), &lights, settings.guiding) {
            guiding_record.write(folder)?;
        }
    }
    Ok(dump.manifest().clone())
}

/// Traces some shards of a bake whose folder is ready ([`prepare`]); whole ones that are there stay. Returns how many
/// there were to trace, and to have.
pub(crate) fn trace_part(
    scene: &Scene,
    settings: &TraceSettings,
    folder: &Path,
    is_mine: &(dyn Fn(usize, usize) -> bool + Sync),
    monitor: &Monitor,
) -> Result<[usize; 2], SessionError> {
    check(scene, settings)?;
    let sink = DumpWriter::join(folder, is_mine)?;
    let work = Work::of(&sink, is_mine);
    if work.missing > 0 {
        let world_color = Some(sink.manifest().world_color);
        let (tracer, _) = ready(scene, &TraceSettings { world_color, ..settings.clone() }, monitor)?;
        let targets = guide_targets(scene, settings);
        trace(&tracer, &sink, &|_| targets.clone(), &work, monitor)?;
    }
    Ok([work.missing, work.shards])
}

/// A scene made ready for tracing, and all warnings about it, which are told.
fn ready<'a>(
    scene: &'a Scene,
    settings: &TraceSettings,
    monitor: &Monitor,
) -> Result<(Tracer<'a>, Vec<String>), SessionError> {
    let prepare = monitor.stage(Stage::Prepare, 0, 1);
    let tracer = Tracer::new(scene, settings)?;
    prepare.advance(1, "");
    let warnings: Vec<String> = scene.warnings.iter().chain(tracer.warnings()).cloned().collect();
    warnings.iter().for_each(|warning| monitor.warn(warning));
    Ok((tracer, warnings))
}

/// Begins the dump of a bake in a folder, or goes on with it; with what lies beside its paths.
fn begin(
    tracer: &Tracer,
    scene: &Scene,
    settings: &TraceSettings,
    folder: &Path,
    resume: bool,
) -> Result<DumpWriter, SessionError> {
    let writer = match resume {
        true => DumpWriter::resume(folder, tracer.manifest())?,
        false => DumpWriter::create(folder, tracer.manifest())?,
    };
    contents::note(&folder.join(Manifest::FILE))?;
    write_lights(scene, folder)?;
    let scene_path = folder.join(SCENE_FILE);
    if !(resume && scene_path.exists()) {
        // Equal for equal paths, wherever lights stand and however many samples there are.
        let own =
            TraceSettings { paths: settings.paths.clone(), seed: settings.seed, ..TraceSettings::default() };
        write_scene(&scene_path, scene, &own, None)?;
    }
    Ok(writer)
}

fn write_lights(scene: &Scene, folder: &Path) -> Result<(), SessionError> {
    let lights =
        LightSet { name: scene.camera.name.clone(), lights: scene.lights.clone(), notes: Vec::new() };
    let path = folder.join(LIGHTS_FILE);
    lights.write(&path)?;
    contents::note(&path)
}

fn report(dump: &Dump, start: Instant, warnings: Vec<String>) -> BakeReport {
    let Manifest { width, height, .. } = *dump.manifest();
    let samples = dump.manifest().samples();
    BakeReport {
        width,
        height,
        samples,
        paths: u64::from(samples) * (width * height) as u64,
        segments: dump.record_count() as u64,
        bytes: dump.shards().map(|shard| shard.as_bytes().len() as u64).sum(),
        seconds: start.elapsed().as_secs_f64(),
        warnings,
    }
}

/// Dump of a folder that differs from the bake that is asked for by the map of its world alone. No path is missing from
/// it.
fn of_another_world(
    scene: &Scene,
    settings: &TraceSettings,
    folder: &Path,
) -> Result<Option<Dump>, SessionError> {
    if !folder.join(Manifest::FILE).exists() || Manifest::is_of_another_version(folder) {
        return Ok(None);
    }
    let Manifest { world_map, world_color, .. } = Manifest::read(folder)?;
    if world_map == scene.world_map() || difference(scene, settings, folder)?.is_some() {
        return Ok(None);
    }
    let dump = DumpWriter::resume(folder, Manifest { world_map, world_color, ..manifest(scene, settings) })?
        .finish()?;
    contents::note(&folder.join(Manifest::FILE))?;
    if dump.missing().is_empty() {
        return Ok(Some(dump));
    }
    // Damaged files were removed; what would be traced in their place is of the other world.
    Err(DumpError::OtherBake { path: folder.to_owned(), difference: Manifest::WORLD_MAP }.into())
}

fn check(scene: &Scene, settings: &TraceSettings) -> Result<(), SessionError> {
    let settings_error = |reason: &str| Err(SessionError::Settings(reason.into()));
    if settings.samples == 0 {
        return settings_error("samples must be at least 1");
    }
    if settings.tile_size == 0 {
        return settings_error("the tile size must be at least 1 pixel");
    }
    let exposure = settings.paths.film_exposure;
    if !(0.0..=MOST_EXPOSURE).contains(&exposure) {
        return settings_error(&format!("the film exposure must be a number from 0 to {MOST_EXPOSURE}"));
    }
    check_scene(scene).map_err(SessionError::Settings)
}

/// Reasons why the tracer cannot take a scene, in one line.
pub(crate) fn check_scene(scene: &Scene) -> Result<(), String> {
    scene
        .validate()
        .map_err(|problems| problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
}

/// Records the lights that the paths of each pass are guided towards.
struct GuideRecorder<'a> {
    folder: &'a Path,
    guiding: f32,
    lights: &'a (dyn Fn() -> Vec<Light> + Sync),
    guiding_record: Mutex<GuidingRecord>,
    /// True if the guiding record of existing paths is lost. A record of new paths alone would hide that.
    is_lost: bool,
}

impl GuideRecorder<'_> {
    fn lights_of(&self, pass: usize, monitor: &Monitor) -> Vec<Light> {
        let lights = (self.lights)();
        let mut guiding_record = self.guiding_record.lock().unwrap_or_else(PoisonError::into_inner);
        if guiding_record.note(pass, &lights, self.guiding)
            && !self.is_lost
            && let Err(error) = guiding_record.write(self.folder)
        {
            monitor.warn(&error.to_string());
        }
        lights
    }
}

/// Removes a bake with its proxies from a folder, and nothing else. The manifest goes first: the rest is never taken
/// for a bake after a crash.
///
/// # Errors
/// If the folder holds no bake, or a file cannot be removed.
pub(crate) fn clear(folder: &Path) -> Result<(), SessionError> {
    remove(
        folder,
        &["tile_", "proxy_", "training_"],
        &["base.exr", WORLD_FILE, LIGHTS_FILE, GUIDED_FILE, VIEW_FILE, SCENE_FILE, CONTENTS_FILE, LOCK_FILE],
    )
}

/// Removes the paths but keeps the proxies, which stay right for the same scene under any world.
pub(crate) fn clear_paths(folder: &Path) -> Result<(), SessionError> {
    remove(folder, &["tile_", "training_"], &[WORLD_FILE, GUIDED_FILE])
}

/// Removes the manifest, then what has such a name or begins so.
fn remove(folder: &Path, beginnings: &[&str], names: &[&str]) -> Result<(), SessionError> {
    Manifest::read(folder)?;
    let remove = |path: &Path| {
        std::fs::remove_file(path).map_err(SessionError::io("remove the old bake's file", path))
    };
    remove(&folder.join(Manifest::FILE))?;
    let entries = std::fs::read_dir(folder).map_err(SessionError::io("read the folder", folder))?;
    let is_ours = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let by_beginning = beginnings.iter().any(|start| name.starts_with(start))
            && [".safetensors", ".json"].iter().any(|end| name.ends_with(end));
        by_beginning || names.contains(&name.as_ref())
    };
    let ours: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_ours).collect();
    contents::forget(folder, &ours)?;
    ours.iter().try_for_each(|path| remove(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::contents::lost_files;
    use crate::files::obj_scene::{ObjView, obj_scene};
    use crate::progress::{Cancel, Listener, Progress};
    use crate::test_room::room;
    use std::sync::Arc;

    #[derive(Default)]
    struct Traced(Mutex<Vec<Progress>>);

    impl Listener for Traced {
        fn progress(&self, progress: &Progress) {
            if progress.stage == Stage::Trace {
                self.0.lock().unwrap().push(progress.clone());
            }
        }
        fn warning(&self, _: &str) {}
    }

    #[test]
    fn progress_of_a_part_is_that_of_all_samples_and_the_pace_that_of_new_ones() {
        let scene = obj_scene(&room(), &ObjView { width: 8, height: 8, ..ObjView::default() }).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let traced = Arc::new(Traced::default());
        let monitor = Monitor::new(traced.clone(), Cancel::default());
        for (there, samples) in [(0, 2), (2, 8)] {
            traced.0.lock().unwrap().clear();
            let settings = TraceSettings { samples, threads: 1, ..TraceSettings::default() };
            let observer = Observer { samples: 8, lights: &Vec::new, prepared: None, passes: &|_| {} };
            bake_observed(&scene, &settings, folder.path(), true, &monitor, &observer).unwrap();
            let reports = traced.0.lock().unwrap();
            assert!(reports.iter().all(|report| report.done >= there * 64));
            let done = |report: &Progress| (report.done, report.total);
            assert_eq!(done(reports.first().unwrap()), (there * 64, 8 * 64));
            assert_eq!(done(reports.last().unwrap()), (u64::from(samples) * 64, 8 * 64));
            for report in reports.iter().filter(|report| report.done > there * 64) {
                let pace = report.elapsed_s / (report.done - there * 64) as f64;
                let left = pace * (report.total - report.done) as f64;
                assert!((report.remaining_s.unwrap() - left).abs() < 1e-9, "{report:?}");
            }
        }
    }

    #[test]
    fn a_record_that_is_gone_stays_missed_when_samples_are_added() {
        let scene = obj_scene(&room(), &ObjView { width: 8, height: 8, ..ObjView::default() }).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let bake = |samples, resume| {
            let settings = TraceSettings { samples, threads: 1, ..TraceSettings::default() };
            bake(&scene, &settings, folder.path(), resume, &Monitor::default()).unwrap();
            lost_files(folder.path())
        };
        assert_eq!(bake(2, false), [""; 0]);
        std::fs::remove_file(folder.path().join(GUIDED_FILE)).unwrap();
        let lost = bake(4, true);
        assert!(lost.len() == 1 && lost[0].starts_with(GUIDED_FILE), "{lost:?}");
        clear_paths(folder.path()).unwrap();
        assert_eq!(bake(4, true), [""; 0], "new paths have a record of their own");
    }

    #[test]
    fn a_film_exposure_that_no_picture_can_hold_is_refused() {
        let scene = obj_scene(&room(), &ObjView { width: 8, height: 8, ..ObjView::default() }).unwrap();
        for exposure in [-1.0, f32::NAN, 1e20] {
            let mut settings = TraceSettings::default();
            settings.paths.film_exposure = exposure;
            let error = check(&scene, &settings).unwrap_err().to_string();
            assert!(error.contains("film exposure must be a number from 0 to 10000"), "{error}");
        }
    }
}
