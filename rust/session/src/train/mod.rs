//! Trains a proxy on a bake.

pub(crate) mod measure;
pub(crate) mod sizes;
pub(crate) mod targets;

use crate::bake::features::{camera, pixel_features};
use crate::device::compute::Compute;
use crate::error::SessionError;
use crate::files::names::{measured_path, proxy_path, training_path};
use crate::files::proxies::Measured;
use crate::files::{base_layers, contents};
use crate::progress::{Monitor, Stage, StageProgress};
use crate::relight::denoise::Denoise;
use crate::train::measure::measure;
use crate::train::targets::{DumpTargets, GpuTargets};
use cpu_time::ProcessTime;
use relume_dump::Dump;
use relume_gather::{Gather, SampleSplit};
use relume_image::write_atomically;
use relume_proxy::{LightKind, ProxyInfo, Snapshot, TargetMode, TrainConfig, Trainer, read_info};
use serde::Serialize;
use std::cell::RefCell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// What to train, and for how long.
#[derive(Clone, Debug)]
pub struct TrainSettings {
    /// Type of light.
    pub kind: LightKind,
    /// Network, targets, rates, number of samples.
    pub config: TrainConfig,
    /// Seed of weights, lights and batches.
    pub seed: u64,
    /// Train for so many seconds instead of so many samples: the schedule is stretched to end with them.
    pub seconds: Option<f64>,
    /// What counts as a second.
    pub clock: Clock,
    /// Train on the earlier half of each pixel's paths and measure on the later half, which is independent of it;
    /// otherwise train on all paths and measure nothing.
    pub half_for_measuring: bool,
}

/// Time as a training counts it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// The clock on the wall.
    #[default]
    Wall,
    /// Time of this process on all processors, divided by the threads: what a machine without other load would take, if
    /// all threads are busy.
    Processor,
}

impl Clock {
    /// Runs some work and says how long it took.
    fn time<T>(self, work: impl FnOnce() -> T) -> (T, Duration) {
        match self {
            Self::Wall => {
                let start = Instant::now();
                (work(), start.elapsed())
            }
            Self::Processor => {
                let start = ProcessTime::now();
                (work(), start.elapsed() / rayon::current_num_threads() as u32)
            }
        }
    }
}

/// The error of a proxy as training went on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Seconds of training (without measuring) in this run.
    pub seconds: f64,
    /// Samples trained.
    pub samples: u64,
    /// dB on held-out lights.
    pub psnr: f32,
    /// SMAPE on held-out lights.
    pub smape: f32,
}

/// What a training did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrainReport {
    /// The proxy's file.
    pub proxy: PathBuf,
    /// Steps in all.
    pub steps: u64,
    /// Samples in all.
    pub samples: u64,
    /// Seconds of training in this run, without measuring.
    pub seconds: f64,
    /// Whether the configured number of samples was reached.
    pub complete: bool,
    /// Held-out error on the way.
    pub curve: Vec<CurvePoint>,
    /// Bytes of the bake that were copied to a GPU which gathered single pixels of them, in this run; 0 if all of the bake stayed
    /// there, or the CPU gathered.
    pub copied: u64,
    /// The proxy against gathering; none if all paths were trained on, which leaves none to measure on.
    pub measured: Option<Measured>,
}

/// Time between checkpoints: a graphics card does more in it, and may take the process with it at any time.
const CHECKPOINT: Duration = Duration::from_secs(60);
const CHECKPOINT_OF_GPU: Duration = Duration::from_secs(10);
/// Most of the time of a training on a GPU that may go into snapshots of it, which are all that is left where that is lost.
const SNAPSHOT_SHARE: f64 = 0.01;
/// Times that the held-out error is measured on the way.
const CURVE_POINTS: f64 = 10.0;
/// Steps of the progress report.
const TRAIN_UNITS: u64 = 1000;
/// Pictures made at once to compare with: few are gathered no slower one by one than together, and the first tell how long the
/// rest will take.
const REFERENCES_AT_ONCE: usize = 2;
/// Lights of the final comparison.
const MEASURED_LIGHTS: usize = 16;

/// Trains a proxy on a bake and writes it into `out`, with all that relighting without the bake needs. With `resume` it
/// goes on where a stopped training was, and ends as if it had never stopped. A GPU that is lost is opened again, once; where it
/// fails and the CPU may go on, that does so: from a snapshot of a moment before ([`SNAPSHOT_SHARE`]).
///
/// # Errors
/// [`SessionError::Cancelled`] if stopped, with a checkpoint and a usable proxy written.
pub fn train(
    bake: &Path,
    out: &Path,
    settings: &TrainSettings,
    resume: bool,
    compute: &Compute,
    monitor: &Monitor,
) -> Result<TrainReport, SessionError> {
    let kept = RefCell::<Kept>::default();
    let from = || match kept.borrow().snapshot {
        Some(_) => " from a moment before",
        None if resume && training_path(out, settings.kind).exists() => " from the last checkpoint",
        None => " from the start",
    };
    compute.attempt(monitor, from, |compute| train_on(compute, bake, out, settings, resume, monitor, &kept))
}

/// What is left of a try that failed.
#[derive(Clone, Default)]
struct Kept {
    snapshot: Option<Snapshot>,
    /// Time of training, and held-out errors, up to it.
    trained: Duration,
    curve: Vec<CurvePoint>,
}

/// [`train`] without another try. `kept` is of the one before, and afterwards of this one.
fn train_on(
    compute: &Compute,
    bake: &Path,
    out: &Path,
    settings: &TrainSettings,
    resume: bool,
    monitor: &Monitor,
    kept: &RefCell<Kept>,
) -> Result<TrainReport, SessionError> {
    let dump = Dump::open(bake)?;
    if let Some((tile, pass)) = dump.missing().first() {
        let reason = format!(
            "the bake in {} is unfinished (tile {tile}, pass {pass}); resume it first",
            bake.display()
        );
        return Err(SessionError::Settings(reason));
    }
    std::fs::create_dir_all(out).map_err(SessionError::io("create the folder", out))?;
    let (camera, aovs) = (camera(dump.manifest())?, dump.aovs());
    let scene_hash = dump.manifest().scene_hash.clone();
    copy_companions(bake, out)?;
    base_layers::write(out, &aovs, &camera, &scene_hash)?;

    let features = Arc::new(pixel_features(&aovs, &camera));
    let (denoise, bounds) = (Denoise::new(&aovs, compute.gpu.as_deref()), features.visible_bounds());
    let gather = Gather::new(dump);
    let state = training_path(out, settings.kind);
    let Kept { snapshot, trained, curve } = kept.borrow().clone();
    let trainer = if snapshot.is_none() && resume && state.exists() {
        resumed(&state, settings, &scene_hash)?
    } else {
        let mut trainer = Trainer::new(features, settings.kind, settings.config.clone(), settings.seed)?;
        trainer.set_scene_hash(scene_hash.clone());
        match snapshot {
            Some(snapshot) => trainer.from_snapshot(snapshot),
            None => trainer,
        }
    };
    let mut trainer = match &compute.gpu {
        Some(gpu) => trainer.on_gpu(Arc::clone(gpu))?,
        None => trainer,
    };
    // After the training: what is left of the memory is the dump's, which can be streamed, or gathered from on the CPU.
    let on_gpu = compute.gpu.as_ref().map(|gpu| GpuTargets::new(gpu, &gather)).transpose()?;
    let gathers_pixels = on_gpu.as_ref().is_none_or(GpuTargets::gathers_pixels);
    warn_of_little_memory(settings.config.targets, gathers_pixels, trainer.pool_stays_on_cpu(), monitor);
    let halves = if settings.half_for_measuring {
        (SampleSplit::First, SampleSplit::Second)
    } else {
        (SampleSplit::All, SampleSplit::All)
    };
    let targets = |half| DumpTargets::new(&gather, half, bounds, &denoise).on(on_gpu.as_ref());
    let (training, held_out) = (targets(halves.0), targets(halves.1));
    let samples_before = trainer.samples();
    let checkpoint = if compute.gpu.is_some() { CHECKPOINT_OF_GPU } else { CHECKPOINT };
    let replaces_measured = has_measured(out, settings.kind, &scene_hash);
    if settings.half_for_measuring {
        make_references(&mut trainer, &held_out, monitor)?;
    }
    let mut run = Run {
        trainer,
        settings,
        out,
        state,
        checkpoint,
        next_snapshot: compute.gpu.as_ref().map(|_| Instant::now()),
        trained,
        uncounted: trained,
        compared: Compared::default(),
        curve,
        samples_before,
        replaces_measured,
        kept,
    };
    run.steps((&training, on_gpu.as_ref()), &held_out, monitor)?;
    // The last figures belong to the last weights, wherever the training was interrupted.
    if settings.half_for_measuring && run.trainer.done() && !run.has_scores() {
        run.trainer.validate(&held_out)?;
    }
    run.save()?;
    if monitor.cancelled() {
        return Err(SessionError::Cancelled);
    }
    let measured = if settings.half_for_measuring {
        let proxy = run.trainer.proxy()?;
        let measured = measure(&proxy, &gather, halves, &held_out, MEASURED_LIGHTS, settings.seed, monitor)?;
        Some(Measured { seconds: settings.seconds, ..measured })
    } else {
        None
    };
    run.publish(measured.as_ref())?;
    Ok(TrainReport {
        proxy: proxy_path(out, settings.kind),
        steps: run.trainer.steps(),
        samples: run.trainer.samples(),
        seconds: run.trained.as_secs_f64(),
        complete: run.trainer.done(),
        curve: run.curve,
        copied: on_gpu.as_ref().map_or(0, GpuTargets::copied_bytes),
        measured,
    })
}

/// Makes the pictures that the proxy is compared with on the way, or as many as there is time for before a cancel.
fn make_references(
    trainer: &mut Trainer,
    held_out: &DumpTargets,
    monitor: &Monitor,
) -> Result<(), SessionError> {
    let stage = monitor.stage(Stage::References, 0, trainer.held_out_lights() as u64);
    while !monitor.cancelled() {
        match trainer.hold_out(held_out, REFERENCES_AT_ONCE)? {
            0 => break,
            made => stage.advance(made as u64, ""),
        }
    }
    Ok(())
}

const NO_ROOM: &str = "the training leaves no room in the GPU's memory for parts of the bake: the CPU gathers for it; raise \
                       --gpu-memory";

/// Says what the CPU does for a training on a GPU whose memory is too small for it.
fn warn_of_little_memory(
    targets: TargetMode,
    gathers_pixels: bool,
    pool_stays_on_cpu: bool,
    monitor: &Monitor,
) {
    if targets == TargetMode::Raw && !gathers_pixels {
        monitor.warn(NO_ROOM);
    }
    if pool_stays_on_cpu {
        monitor.warn(
            "the pictures that the training learns from do not fit into half of the GPU's memory beside it: the CPU keeps them \
             and picks what a step needs; raise --gpu-memory, or train with a smaller pool",
        );
    }
}

/// Whether a folder has a proxy of the scene that was measured.
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
    for name in [crate::files::names::LIGHTS_FILE, crate::files::names::VIEW_FILE] {
        let from = bake.join(name);
        if from.exists() {
            let bytes = std::fs::read(&from).map_err(SessionError::io("read", &from))?;
            write_atomically(&out.join(name), |writer| writer.write_all(&bytes))?;
        }
    }
    Ok(())
}

struct Run<'a> {
    trainer: Trainer,
    settings: &'a TrainSettings,
    out: &'a Path,
    state: PathBuf,
    /// Time between checkpoints.
    checkpoint: Duration,
    /// When a snapshot is due; never on the CPU, which is not lost.
    next_snapshot: Option<Instant>,
    trained: Duration,
    /// The part of `trained` that says nothing about the speed: by a try that failed, or before the first batch, when the pool of
    /// denoised images was filled.
    uncounted: Duration,
    compared: Compared,
    curve: Vec<CurvePoint>,
    /// Samples that an interrupted run had done.
    samples_before: u64,
    /// Whether a proxy of the scene is there that was measured.
    replaces_measured: bool,
    kept: &'a RefCell<Kept>,
}

/// How often the proxy was compared on the way in this try, and how long that took.
#[derive(Default)]
struct Compared {
    times: u32,
    took: Duration,
}

impl Run<'_> {
    fn steps(
        &mut self,
        (training, on_gpu): (&DumpTargets, Option<&GpuTargets>),
        held_out: &DumpTargets,
        monitor: &Monitor,
    ) -> Result<(), SessionError> {
        let no_room = Once::new();
        let stage = monitor.stage(Stage::Train, self.units_done(), TRAIN_UNITS);
        let mut saved = Instant::now();
        let mut next_measure = self.progress() + 1.0 / CURVE_POINTS;
        while !self.trainer.done() && !monitor.cancelled() {
            let (report, took) = self.settings.clock.time(|| self.trainer.step(training));
            let report = report?;
            if let Some(pixel) = report.bad_target {
                monitor.warn(&format!(
                    "the GPU gathered a value for pixel {pixel} that is not finite; targets are gathered on the CPU from \
                     here on"
                ));
            }
            if on_gpu.is_some_and(GpuTargets::lacked_room) {
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
            if self.settings.half_for_measuring && self.progress() >= next_measure {
                next_measure += 1.0 / CURVE_POINTS;
                self.add_curve_point(held_out, &stage)?;
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

    /// With a time limit, the number of samples follows the speed so far, so that the rates are at their end when the
    /// time is.
    fn fit_schedule_to_time(&mut self) {
        let Some(seconds) = self.settings.seconds else { return };
        let (trained, samples) = (self.trained.as_secs_f64(), self.trainer.samples());
        if samples == self.samples_before {
            self.uncounted = self.trained;
            return;
        }
        let rate = (samples - self.samples_before) as f64 / (trained - self.uncounted.as_secs_f64());
        self.trainer.set_samples(samples + ((seconds - trained).max(0.0) * rate) as u64);
    }

    /// What is left of a time limit by the clock, and of comparing, which does not count towards it: that is known from the
    /// first time on. The pace would tell less: the first steps take longer than the rest.
    fn seconds_left(&self) -> Option<f64> {
        let seconds = self.settings.seconds.filter(|_| self.settings.clock == Clock::Wall)?;
        let times_left = ((1.0 - self.progress()) * CURVE_POINTS).ceil().max(0.0);
        let each = self.compared.took.as_secs_f64() / f64::from(self.compared.times.max(1));
        Some((seconds - self.trained.as_secs_f64()).max(0.0) + times_left * each)
    }

    /// Whether the last comparison was of the weights as they are.
    fn has_scores(&self) -> bool {
        self.trainer.scores().is_some_and(|scores| scores.samples == self.trainer.samples())
    }

    fn add_curve_point(&mut self, held_out: &DumpTargets, stage: &StageProgress) -> Result<(), SessionError> {
        let start = Instant::now();
        let scores = self.trainer.validate(held_out)?;
        self.compared.times += 1;
        self.compared.took += start.elapsed();
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

    /// The next is due when the time that this one takes is [`SNAPSHOT_SHARE`] of what has passed.
    fn keep_snapshot(&mut self) -> Result<(), SessionError> {
        let start = Instant::now();
        let snapshot = Some(self.trainer.snapshot()?);
        self.kept.replace(Kept { snapshot, trained: self.trained, curve: self.curve.clone() });
        self.next_snapshot = Some(Instant::now() + start.elapsed().div_f64(SNAPSHOT_SHARE));
        Ok(())
    }

    /// The checkpoint, and the proxy as it is now, unless one that was measured would make way for one that was not.
    fn save(&mut self) -> Result<(), SessionError> {
        if self.trainer.steps() == 0 {
            return Ok(());
        }
        self.trainer.save(&self.state)?;
        if self.replaces_measured { Ok(()) } else { self.publish(None) }
    }

    /// The proxy as it is now, with how it was measured. An older measurement was of other weights and goes first.
    fn publish(&self, measured: Option<&Measured>) -> Result<(), SessionError> {
        let path = measured_path(self.out, self.settings.kind);
        contents::forget(self.out, std::slice::from_ref(&path))?;
        if path.exists() {
            std::fs::remove_file(&path).map_err(SessionError::io("remove", &path))?;
        }
        let proxy = proxy_path(self.out, self.settings.kind);
        self.trainer.proxy()?.save(&proxy)?;
        contents::note(&proxy)?;
        let Some(measured) = measured else { return Ok(()) };
        write_atomically(&path, |writer| Ok(serde_json::to_writer_pretty(writer, measured)?))?;
        contents::note(&path)
    }
}
