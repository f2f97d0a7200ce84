//! One try of a training: its steps, checkpoints and measurements.

use crate::bake::features::{camera, pixel_features};
use crate::device::compute::Compute;
use crate::device::connections::Connections;
use crate::error::SessionError;
use crate::files::names::{LIGHTS_FILE, VIEW_FILE, measured_path, proxy_path, training_path};
use crate::files::proxies::Measured;
use crate::files::{base_layers, contents};
use crate::progress::{Monitor, Stage, StageProgress};
use crate::relight::denoise::Denoise;
use crate::relight::film::Film;
use crate::train::connected::ConnectedPixels;
use crate::train::measure::measure;
use crate::train::settings::{Clock, CurvePoint, TrainReport, TrainSettings};
use crate::train::targets::{DumpTargets, GpuTargets};
use relume_dump::Dump;
use relume_gather::{Gather, SampleSplit};
use relume_image::write_atomically;
use relume_proxy::{LightKind, PixelFeatures, ProxyInfo, Snapshot, TargetMode, Trainer, read_info};
use std::cell::RefCell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Time between checkpoints: a graphics card does more in it, and may take the process with it at any time.
const CHECKPOINT: Duration = Duration::from_secs(60);
const CHECKPOINT_OF_GPU: Duration = Duration::from_secs(10);
/// Largest share of the time on a GPU for snapshots, which alone are left if it is lost.
const SNAPSHOT_SHARE: f64 = 0.01;
/// Times that the held-out error is measured on the way.
const CURVE_POINTS: f64 = 10.0;
/// Steps of the progress report.
const TRAIN_UNITS: u64 = 1000;
/// References made at once: few are as quick one by one as together, and the first show how long the rest will take.
const REFERENCES_AT_ONCE: usize = 2;
/// Lights of the final comparison.
const MEASURED_LIGHTS: usize = 16;
/// Warning of a GPU without room for parts of the bake.
const NO_ROOM: &str = "the training leaves no room in the GPU's memory for parts of the bake: the CPU gathers for it; raise \
                       --gpu-memory";

/// Training that was asked for.
pub(crate) struct TrainJob<'a> {
    pub bake: &'a Path,
    pub out: &'a Path,
    pub settings: &'a TrainSettings,
    pub resume: bool,
    /// Gives connections in the scene of the bake, if it is at hand; asked where the CPU gathers.
    pub connections: &'a dyn Fn() -> Option<Arc<Connections>>,
}

impl TrainJob<'_> {
    fn state(&self) -> PathBuf {
        training_path(self.out, self.settings.kind)
    }

    /// State that a try after a failed one starts from, in words for the user.
    pub(super) fn start_of_next_try(&self, last_try: &LastTry) -> &'static str {
        match last_try.snapshot {
            Some(_) => " from a moment before",
            None if self.resume && self.state().exists() => " from the last checkpoint",
            None => " from the start",
        }
    }

    /// Trainer in its first state, or in that of the last try or of an interrupted training.
    fn trainer(&self, bake: &TrainBake, snapshot: Option<Snapshot>) -> Result<Trainer, SessionError> {
        let (settings, state) = (self.settings, self.state());
        if snapshot.is_none() && self.resume && state.exists() {
            return resumed(&state, settings, &bake.scene_hash);
        }
        let features = Arc::clone(&bake.features);
        let mut trainer = Trainer::new(features, settings.kind, settings.config.clone(), settings.seed)?;
        trainer.set_scene_hash(bake.scene_hash.clone());
        Ok(match snapshot {
            Some(snapshot) => trainer.from_snapshot(snapshot),
            None => trainer,
        })
    }
}

/// State that a failed try leaves to the next.
#[derive(Clone, Default)]
pub(super) struct LastTry {
    snapshot: Option<Snapshot>,
    /// Time of training up to the snapshot.
    trained: Duration,
    /// Held-out errors up to the snapshot.
    curve: Vec<CurvePoint>,
}

/// Whole bake that is trained on.
pub(super) struct TrainBake {
    scene_hash: String,
    features: Arc<PixelFeatures>,
    denoise: Denoise,
    gather: Gather,
    /// Connections of single pixels, where the CPU gathers and the scene is at hand.
    connected_pixels: Option<ConnectedPixels>,
}

impl TrainBake {
    /// Opens the bake, and writes beside the proxy what relighting without the bake needs.
    pub fn open(job: &TrainJob, compute: &Compute, monitor: &Monitor) -> Result<Self, SessionError> {
        let dump = Dump::open(job.bake)?;
        if let Some((tile, pass)) = dump.missing().first() {
            let reason = format!(
                "the bake in {} is unfinished (tile {tile}, pass {pass}); resume it first",
                job.bake.display()
            );
            return Err(SessionError::Settings(reason));
        }
        std::fs::create_dir_all(job.out).map_err(SessionError::io("create the folder", job.out))?;
        let (camera, aovs) = (camera(dump.manifest())?, dump.aovs());
        if Film::of(dump.manifest(), &camera)?.catches() {
            let reason =
                "lights of scenes with shadow catchers are not learned; they are summed from the samples";
            return Err(SessionError::Settings(reason.into()));
        }
        let scene_hash = dump.manifest().scene_hash.clone();
        copy_companions(job.bake, job.out)?;
        base_layers::write(job.out, &aovs, &camera, &scene_hash)?;
        let features = Arc::new(pixel_features(&aovs, &camera));
        let denoise = Denoise::new(&aovs, compute.gpu.as_deref());
        let gather = Gather::new(dump);
        let connections = if compute.gpu.is_none() { (job.connections)() } else { None };
        let connected_pixels = match connections {
            Some(connections) if connections.is_of(gather.dump().manifest()) => {
                let stop = || monitor.cancelled();
                let connected = ConnectedPixels::new(connections, &gather, splits(job.settings).0, &stop);
                Some(connected.ok_or(SessionError::Cancelled)?)
            }
            _ => None,
        };
        Ok(Self { scene_hash, features, denoise, gather, connected_pixels })
    }

    /// Targets on the GPU, if there is one.
    pub fn on_gpu(&self, compute: &Compute) -> Result<Option<GpuTargets>, SessionError> {
        Ok(compute.gpu.as_ref().map(|gpu| GpuTargets::new(gpu, &self.gather)).transpose()?)
    }

    pub fn targets<'a>(
        &'a self,
        settings: &TrainSettings,
        on_gpu: Option<&'a GpuTargets>,
    ) -> TrainTargets<'a> {
        let splits = splits(settings);
        let bounds = self.features.visible_bounds();
        let of = |split| DumpTargets::new(&self.gather, split, bounds, &self.denoise).on(on_gpu);
        let training = of(splits.0).with_pixels_connected(self.connected_pixels.as_ref());
        let held_out = of(splits.1);
        TrainTargets { gather: &self.gather, on_gpu, splits, training, held_out }
    }
}

/// Paths that are trained on, and those that it is measured by.
fn splits(settings: &TrainSettings) -> (SampleSplit, SampleSplit) {
    match settings.half_for_measuring {
        true => (SampleSplit::First, SampleSplit::Second),
        false => (SampleSplit::All, SampleSplit::All),
    }
}

/// Targets of a training, and those that it is measured on.
pub(super) struct TrainTargets<'a> {
    gather: &'a Gather,
    on_gpu: Option<&'a GpuTargets>,
    /// Paths behind `training` and `held_out`.
    splits: (SampleSplit, SampleSplit),
    training: DumpTargets<'a>,
    held_out: DumpTargets<'a>,
}

/// One try of a training.
pub(super) struct TrainRun<'a> {
    job: &'a TrainJob<'a>,
    trainer: Trainer,
    /// Time between checkpoints.
    checkpoint: Duration,
    /// Time of the next snapshot; none on the CPU, which is never lost.
    next_snapshot: Option<Instant>,
    trained: Duration,
    /// Part of `trained` that tells nothing about the speed: by a failed try, or while the pool of denoised images was
    /// filled.
    uncounted: Duration,
    comparisons: Comparisons,
    curve: Vec<CurvePoint>,
    /// Samples that an interrupted run had done.
    samples_before: u64,
    /// True if a measured proxy of the scene is there.
    replaces_measured: bool,
    last_try: &'a RefCell<LastTry>,
}

/// Number of comparisons in this try, and their time.
#[derive(Default)]
struct Comparisons {
    times: u32,
    took: Duration,
}

impl<'a> TrainRun<'a> {
    /// Starts anew, or from what the last try or an interrupted training left.
    pub fn open(
        job: &'a TrainJob,
        bake: &TrainBake,
        compute: &Compute,
        last_try: &'a RefCell<LastTry>,
    ) -> Result<Self, SessionError> {
        let LastTry { snapshot, trained, curve } = last_try.borrow().clone();
        let trainer = job.trainer(bake, snapshot)?;
        let trainer = match &compute.gpu {
            Some(gpu) => trainer.on_gpu(Arc::clone(gpu))?,
            None => trainer,
        };
        Ok(Self {
            job,
            samples_before: trainer.samples(),
            trainer,
            checkpoint: if compute.gpu.is_some() { CHECKPOINT_OF_GPU } else { CHECKPOINT },
            next_snapshot: compute.gpu.as_ref().map(|_| Instant::now()),
            trained,
            uncounted: trained,
            comparisons: Comparisons::default(),
            curve,
            replaces_measured: has_measured(job.out, job.settings.kind, &bake.scene_hash),
            last_try,
        })
    }

    /// Makes the pictures that the proxy is compared with on the way, or as many as a cancel leaves time for.
    pub fn make_references(&mut self, targets: &TrainTargets, monitor: &Monitor) -> Result<(), SessionError> {
        self.warn_of_little_memory(targets.on_gpu, monitor);
        if !self.job.settings.half_for_measuring {
            return Ok(());
        }
        let stage = monitor.stage(Stage::References, 0, self.trainer.held_out_lights() as u64);
        while !monitor.cancelled() {
            match self.trainer.hold_out(&targets.held_out, REFERENCES_AT_ONCE)? {
                0 => break,
                made => stage.advance(made as u64, ""),
            }
        }
        Ok(())
    }

    /// Warns of work that the CPU does because the GPU's memory is too small.
    fn warn_of_little_memory(&self, on_gpu: Option<&GpuTargets>, monitor: &Monitor) {
        let gathers_pixels = on_gpu.is_none_or(GpuTargets::gathers_pixels);
        if self.job.settings.config.targets == TargetMode::Raw && !gathers_pixels {
            monitor.warn(NO_ROOM);
        }
        if self.trainer.pool_stays_on_cpu() {
            monitor.warn(
            "the pictures that the training learns from do not fit into half of the GPU's memory beside it: the CPU keeps them \
             and picks what a step needs; raise --gpu-memory, or train with a smaller pool",
        );
        }
    }

    /// Measures the trained proxy and writes it; only writes it after a cancel.
    pub fn finish(mut self, targets: &TrainTargets, monitor: &Monitor) -> Result<TrainReport, SessionError> {
        let settings = self.job.settings;
        // The last figures belong to the last weights, wherever the training was interrupted.
        if settings.half_for_measuring && self.trainer.done() && !self.has_scores() {
            self.trainer.validate(&targets.held_out)?;
        }
        self.save()?;
        if monitor.cancelled() {
            return Err(SessionError::Cancelled);
        }
        let measured = settings.half_for_measuring.then(|| self.measure(targets, monitor)).transpose()?;
        self.publish(measured.as_ref())?;
        Ok(TrainReport {
            proxy: proxy_path(self.job.out, settings.kind),
            steps: self.trainer.steps(),
            samples: self.trainer.samples(),
            seconds: self.trained.as_secs_f64(),
            complete: self.trainer.done(),
            curve: self.curve,
            copied: targets.on_gpu.map_or(0, GpuTargets::copied_bytes),
            measured,
        })
    }

    fn measure(&self, targets: &TrainTargets, monitor: &Monitor) -> Result<Measured, SessionError> {
        let TrainTargets { gather, splits, held_out, .. } = targets;
        let (proxy, settings) = (self.trainer.proxy()?, self.job.settings);
        let measured = measure(&proxy, gather, *splits, held_out, MEASURED_LIGHTS, settings.seed, monitor)?;
        Ok(Measured { seconds: settings.seconds, ..measured })
    }

    /// Trains until the schedule ends or a cancel.
    pub fn steps(&mut self, targets: &TrainTargets, monitor: &Monitor) -> Result<(), SessionError> {
        let no_room = Once::new();
        let stage = monitor.stage(Stage::Train, self.units_done(), TRAIN_UNITS);
        let mut saved = Instant::now();
        let mut next_measure = self.progress() + 1.0 / CURVE_POINTS;
        while !self.trainer.done() && !monitor.cancelled() {
            let (report, took) = self.job.settings.clock.time(|| self.trainer.step(&targets.training));
            let report = report?;
            if let Some(pixel) = report.bad_target {
                monitor.warn(&format!(
                    "the GPU gathered a value for pixel {pixel} that is not finite; targets are gathered on the CPU from \
                     here on"
                ));
            }
            if targets.on_gpu.is_some_and(GpuTargets::lacked_room) {
                no_room.call_once(|| monitor.warn(NO_ROOM));
            }
            self.trained += took;
            self.fit_schedule_to_time();
            if self.next_snapshot.is_some_and(|due| due <= Instant::now()) && self.trainer.steps() > 0 {
                self.keep_snapshot()?;
            }
            let message = match report.loss {
                Some(loss) => format!("loss {loss:.4}{}", self.last_scores()),
                None => format!("{} blocks of targets to gather", report.missing),
            };
            stage.set_until(self.units_done(), self.seconds_left(), &message);
            if self.job.settings.half_for_measuring && self.progress() >= next_measure {
                next_measure += 1.0 / CURVE_POINTS;
                self.add_curve_point(&targets.held_out, &stage)?;
            }
            if saved.elapsed() > self.checkpoint {
                self.save()?;
                saved = Instant::now();
            }
        }
        Ok(())
    }

    fn units_done(&self) -> u64 {
        (self.progress() * TRAIN_UNITS as f64) as u64
    }

    /// Share of the schedule that is done.
    fn progress(&self) -> f64 {
        self.trainer.samples() as f64 / self.trainer.config().samples as f64
    }

    /// Adapts the number of samples to the speed so far under a time limit, so that the schedule ends with it.
    fn fit_schedule_to_time(&mut self) {
        let Some(seconds) = self.job.settings.seconds else { return };
        let (trained, samples) = (self.trained.as_secs_f64(), self.trainer.samples());
        if samples == self.samples_before {
            self.uncounted = self.trained;
            return;
        }
        let rate = (samples - self.samples_before) as f64 / (trained - self.uncounted.as_secs_f64());
        self.trainer.set_samples(samples + ((seconds - trained).max(0.0) * rate) as u64);
    }

    /// Seconds to the end of a time limit by the wall clock, with comparisons, which do not count towards it. The pace
    /// would tell less: the first steps take longer.
    fn seconds_left(&self) -> Option<f64> {
        let seconds = self.job.settings.seconds.filter(|_| self.job.settings.clock == Clock::Wall)?;
        let times_left = ((1.0 - self.progress()) * CURVE_POINTS).ceil().max(0.0);
        let each = self.comparisons.took.as_secs_f64() / f64::from(self.comparisons.times.max(1));
        Some((seconds - self.trained.as_secs_f64()).max(0.0) + times_left * each)
    }

    /// True if the last comparison was of the present weights.
    fn has_scores(&self) -> bool {
        self.trainer.scores().is_some_and(|scores| scores.samples == self.trainer.samples())
    }

    fn add_curve_point(&mut self, held_out: &DumpTargets, stage: &StageProgress) -> Result<(), SessionError> {
        let start = Instant::now();
        let scores = self.trainer.validate(held_out)?;
        self.comparisons.times += 1;
        self.comparisons.took += start.elapsed();
        let (seconds, samples) = (self.trained.as_secs_f64(), self.trainer.samples());
        self.curve.push(CurvePoint { seconds, samples, psnr: scores.psnr, smape: scores.smape });
        let left = self.seconds_left();
        stage.set_until(
            self.units_done(),
            left,
            &format!("held out {:.1} dB, SMAPE {:.3}", scores.psnr, scores.smape),
        );
        Ok(())
    }

    fn last_scores(&self) -> String {
        let scores = self.trainer.scores();
        scores.map(|s| format!(", held out {:.1} dB, SMAPE {:.3}", s.psnr, s.smape)).unwrap_or_default()
    }

    /// Keeps a snapshot. The next is due once this one took [`SNAPSHOT_SHARE`] of the time.
    fn keep_snapshot(&mut self) -> Result<(), SessionError> {
        let start = Instant::now();
        let snapshot = Some(self.trainer.snapshot()?);
        self.last_try.replace(LastTry { snapshot, trained: self.trained, curve: self.curve.clone() });
        self.next_snapshot = Some(Instant::now() + start.elapsed().div_f64(SNAPSHOT_SHARE));
        Ok(())
    }

    /// Writes the checkpoint and the present proxy, unless that would replace a measured one.
    fn save(&mut self) -> Result<(), SessionError> {
        if self.trainer.steps() == 0 {
            return Ok(());
        }
        self.trainer.save(&self.job.state())?;
        if self.replaces_measured { Ok(()) } else { self.publish(None) }
    }

    /// Writes the present proxy and its measurement. An older measurement was of other weights and goes first.
    fn publish(&self, measured: Option<&Measured>) -> Result<(), SessionError> {
        let path = measured_path(self.job.out, self.job.settings.kind);
        contents::forget(self.job.out, std::slice::from_ref(&path))?;
        if path.exists() {
            std::fs::remove_file(&path).map_err(SessionError::io("remove", &path))?;
        }
        let proxy = proxy_path(self.job.out, self.job.settings.kind);
        self.trainer.proxy()?.save(&proxy)?;
        contents::note(&proxy)?;
        let Some(measured) = measured else { return Ok(()) };
        write_atomically(&path, |writer| Ok(serde_json::to_writer_pretty(writer, measured)?))?;
        contents::note(&path)
    }
}

/// True if a folder has a measured proxy of the scene.
fn has_measured(out: &Path, kind: LightKind, scene_hash: &str) -> bool {
    let is_of_scene = |info: ProxyInfo| info.scene_hash == scene_hash;
    measured_path(out, kind).exists() && read_info(&proxy_path(out, kind)).is_ok_and(is_of_scene)
}

/// Goes on with a training of the same scene and settings, but for the number of samples.
fn resumed(state: &Path, settings: &TrainSettings, scene_hash: &str) -> Result<Trainer, SessionError> {
    let other = |what: &str| {
        let reason = format!("{} was started with another {what}; train without --resume", state.display());
        SessionError::Settings(reason)
    };
    if read_info(state)?.scene_hash != scene_hash {
        return Err(other("scene"));
    }
    let mut trainer = Trainer::resume(state)?;
    trainer.set_samples(settings.config.samples);
    if *trainer.config() != settings.config {
        return Err(other("network or schedule"));
    }
    Ok(trainer)
}

/// Lights and view transform belong to a folder of proxies too, if it is another.
fn copy_companions(bake: &Path, out: &Path) -> Result<(), SessionError> {
    let place = |folder: &Path| folder.canonicalize().map_err(SessionError::io("open the folder", folder));
    if place(bake)? == place(out)? {
        return Ok(());
    }
    for name in [LIGHTS_FILE, VIEW_FILE] {
        let from = bake.join(name);
        if from.exists() {
            let bytes = std::fs::read(&from).map_err(SessionError::io("read", &from))?;
            write_atomically(&out.join(name), |writer| writer.write_all(&bytes))?;
        }
    }
    Ok(())
}
