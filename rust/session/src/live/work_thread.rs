use super::board::Seat;
use super::shared::{Gate, LiveState, ProxyStatus, Shared, TrainingPlan};
use super::{LiveOptions, OtherWorld};
use crate::bake::features::camera;
use crate::bake::guiding::{GuideCoverage, GuidingRecord};
use crate::bake::world::WorldLayer;
use crate::bake::{Observer, bake_observed, clear, clear_paths, difference};
use crate::device::compute::Compute;
use crate::device::connections::Connections;
use crate::device::threads::in_background;
use crate::error::SessionError;
use crate::files::base_layers;
use crate::files::contents::{self, lost_files};
use crate::files::damage::{damage_message, reason_of};
use crate::files::light_set::LightSet;
use crate::files::names::{GUIDED_FILE, SCENE_FILE};
use crate::files::proxies::Proxies;
use crate::progress::{Cancel, Monitor};
use crate::relight::film::Film;
use crate::train::settings::{Clock, TrainSettings};
use crate::train::sizes::sizes_with;
use crate::train::{TrainJob, train_by};
use relume_dump::{Dump, DumpError, Manifest};
use relume_proxy::{LightKind, TrainConfig};
use relume_scene::{Light, Scene};
use relume_trace::{TraceSettings, Tracer, guide_targets as scene_guide_targets};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;

/// Paths per pixel that the first training is done on; a sum of whole passes.
const SAMPLES_TO_TRAIN: u32 = 64;

/// First task of the work thread; training follows.
pub(super) enum LiveTask {
    /// Bakes a scene. `anew` also replaces a whole bake that is not guided towards the present lights.
    Bake { scene: Arc<Scene>, settings: TraceSettings, anew: bool },
    /// Opens the bake that the folder holds.
    Open,
    /// Only trains: the bake is there and shown.
    Learn,
}

impl LiveTask {
    /// The state that it begins in.
    pub fn first_state(&self) -> LiveState {
        match self {
            Self::Bake { .. } | Self::Open => LiveState::Preparing,
            Self::Learn => LiveState::Training,
        }
    }
}

/// One run of the work thread.
pub(super) struct WorkRun {
    pub work: LiveTask,
    pub train_seconds: f64,
    pub folder: PathBuf,
    pub options: LiveOptions,
    pub shared: Arc<Shared>,
    pub seat: Arc<Seat>,
    pub cancel: Cancel,
}

impl WorkRun {
    pub fn run(self) {
        let outcome = catch_unwind(AssertUnwindSafe(|| in_background(self.options.threads, || self.work())));
        let (state, error) = match outcome {
            Ok(Ok(())) => (LiveState::Ready, None),
            Ok(Err(SessionError::Cancelled)) => (LiveState::Cancelled, None),
            Ok(Err(error)) => (LiveState::Failed, Some(error.to_string())),
            Err(_) => (LiveState::Failed, Some("internal error while baking; please report it".into())),
        };
        self.shared.change(|shared| {
            shared.status.state = state;
            shared.status.error = error;
            shared.status.stage = None;
            shared.training_plan = TrainingPlan::default();
            // The render thread has the machine now: it makes better pictures, and stores the light of another world.
            shared.deliveries += 1;
        });
    }

    fn work(&self) -> Result<(), SessionError> {
        let gate = Gate {
            shared: self.shared.clone(),
            board: self.options.board.clone(),
            cancel: self.cancel.clone(),
        };
        let monitor = Monitor::new(Arc::new(gate), self.cancel.clone());
        match &self.work {
            LiveTask::Bake { scene, settings, anew } => {
                if *anew && self.should_retrace(scene, settings)? {
                    clear_paths(&self.folder)?;
                }
                self.bake(scene, settings, &monitor)
            }
            LiveTask::Open => {
                let complete = self.open()?;
                if complete { self.learn(&monitor) } else { Ok(()) }
            }
            LiveTask::Learn => self.learn(&monitor),
        }
    }

    /// True if a whole bake of the scene exists but retracing, guided towards the present lights and world, would cut
    /// noise enough. Also true if its guiding record is lost.
    fn should_retrace(&self, scene: &Scene, settings: &TraceSettings) -> Result<bool, SessionError> {
        let is_there = self.folder.join(Manifest::FILE).exists();
        let Some(dump) = is_there.then(|| Dump::open(&self.folder)).transpose()? else { return Ok(false) };
        let manifest = dump.manifest();
        let is_same = manifest.scene_hash == scene.hash() && manifest.samples() >= settings.samples;
        if !is_same || !dump.missing().is_empty() {
            return Ok(false);
        }
        if manifest.world_map != scene.world_map() || contents::is_lost(&self.folder.join(GUIDED_FILE)) {
            return Ok(true);
        }
        let guiding_record = GuidingRecord::of_bake(&self.folder).unwrap_or_default();
        let (camera, aovs) = (camera(manifest)?, dump.aovs());
        let features = Film::of(manifest, &camera)?.features(&aovs).into_owned();
        let coverage = GuideCoverage::new(&guiding_record, manifest, &features, &camera);
        Ok(coverage.would_gain(&self.guide_targets(scene, settings), settings.guiding))
    }

    /// Bakes and trains, then bakes the rest and trains again if that is much more: a proxy is ready long before a
    /// large bake ends. Existing samples stay, even if fewer are asked for.
    fn bake(
        &self,
        scene: &Arc<Scene>,
        settings: &TraceSettings,
        monitor: &Monitor,
    ) -> Result<(), SessionError> {
        if matches!(difference(scene, settings, &self.folder), Ok(Some(Manifest::WORLD_MAP))) {
            clear_paths(&self.folder)?;
        }
        let there = self.whole_samples(scene, settings);
        let world = Arc::new(OtherWorld::new(scene)?);
        self.shared.show_world(world);
        let total = settings.samples.max(there);
        self.shared.change(|state| {
            state.status.samples_total = total;
            state.catches = scene.has_shadow_catchers();
        });
        let early = Some(SAMPLES_TO_TRAIN).filter(|early| (there + 1..total).contains(early));
        let rounds: Vec<u32> =
            early.filter(|_| self.train_seconds > 0.0).into_iter().chain([total]).collect();
        self.plan(&rounds);
        for samples in rounds {
            self.enter(LiveState::Baking);
            let settings = TraceSettings { samples, threads: 0, ..settings.clone() };
            self.bake_samples(scene, &settings, monitor)?;
            self.deliver_proxies();
            self.train(monitor)?;
            self.shared.change(|state| {
                state.training_plan.rounds.pop_front();
            });
        }
        Ok(())
    }

    /// Makes the scene ready for connections beside the bake that a tracer begins.
    fn connect(&self, scene: &Arc<Scene>, tracer: &Tracer<'_>) {
        let (manifest, bvh) = (tracer.manifest(), tracer.bvh().clone());
        if self.shared.lock().connections.as_ref().is_some_and(|known| known.is_of(&manifest)) {
            return;
        }
        let (preparing, scene) = (Preparing::new(&self.shared), Arc::clone(scene));
        let seat = self.seat.clone();
        let connect = move || {
            let Preparing(shared) = &preparing;
            match Connections::new(scene, &manifest, Some(bvh), seat.members()) {
                Ok(connections) => {
                    deliver_levels(shared, &seat, &Arc::new(connections), &|| shared.lock().closed);
                }
                Err(error) => shared.warn(&error.to_string()),
            }
        };
        let threads = self.options.threads;
        let thread = thread::Builder::new().name("relume-connect".into());
        let spawned =
            thread.spawn(move || drop(catch_unwind(AssertUnwindSafe(|| in_background(threads, connect)))));
        if let Err(error) = spawned {
            self.shared.warn(&format!("lights have more noise, since a thread cannot be started: {error}"));
        }
    }

    /// Makes the scene ready that the folder holds, if it does.
    fn connect_stored(&self, manifest: &Manifest) {
        if !self.folder.join(SCENE_FILE).exists() {
            return;
        }
        let _preparing = Preparing::new(&self.shared);
        let stop = || self.cancel.requested() || self.shared.lock().closed;
        let Some(preparation) = self.seat.wait_to_prepare(&stop) else { return };
        let connections = Connections::stored(&self.folder, manifest, self.seat.members());
        drop(preparation);
        match connections {
            Ok(Some(connections)) => {
                deliver_levels(&self.shared, &self.seat, &Arc::new(connections), &stop);
            }
            Ok(None) => {}
            Err(warning) => self.shared.warn(&warning),
        }
    }

    /// Enters a state without any progress yet.
    fn enter(&self, state: LiveState) {
        self.shared.change(|shared| {
            shared.status.state = state;
            shared.status.stage = None;
        });
    }

    /// Samples of the whole passes that the folder holds of this bake.
    fn whole_samples(&self, scene: &Scene, settings: &TraceSettings) -> u32 {
        if !matches!(difference(scene, settings, &self.folder), Ok(None)) {
            return 0;
        }
        let whole = |dump: Dump| dump.passes(0..dump.complete_passes()).manifest().samples();
        Dump::open(&self.folder).map_or(0, whole)
    }

    fn bake_samples(
        &self,
        scene: &Arc<Scene>,
        settings: &TraceSettings,
        monitor: &Monitor,
    ) -> Result<(), SessionError> {
        let lights = || self.guide_targets(scene, settings);
        let samples = self.shared.lock().status.samples_total;
        let observer = Observer {
            samples,
            lights: &lights,
            prepared: Some(&|tracer| self.connect(scene, tracer)),
            passes: &|dump| self.deliver(dump),
        };
        let bake = || bake_observed(scene, settings, &self.folder, true, monitor, &observer);
        match bake() {
            Err(SessionError::Dump(DumpError::OtherBake { difference: Manifest::WORLD_MAP, .. })) => {
                clear_paths(&self.folder)?;
                bake().map(drop)
            }
            Err(SessionError::Dump(DumpError::OtherBake { .. })) => {
                clear(&self.folder)?;
                self.shared.change(|state| {
                    state.proxies = None;
                    state.measured.clear();
                });
                bake().map(drop)
            }
            done => done.map(drop),
        }
    }

    /// Lights of the scene, and of the newest request where they are elsewhere: they may have moved since it was read.
    fn guide_targets(&self, scene: &Scene, settings: &TraceSettings) -> Vec<Light> {
        let mut lights = scene_guide_targets(scene, settings);
        if let Some(request) = &self.shared.lock().request {
            let is_elsewhere = |light: &&Light| lights.iter().all(|known| known.shape != light.shape);
            let shown: Vec<Light> = request.lights.iter().filter(is_elsewhere).cloned().collect();
            lights.extend(shown);
        }
        lights
    }

    /// Opens the folder; true if it holds a whole bake.
    fn open(&self) -> Result<bool, SessionError> {
        lost_files(&self.folder).iter().for_each(|text| self.shared.warn(text));
        if !self.folder.join(Manifest::FILE).exists() {
            let base = Arc::new(base_layers::read(&self.folder)?);
            self.shared.change(|state| {
                state.base = Some(base);
                state.deliveries += 1;
            });
            self.deliver_proxies();
            return Ok(false);
        }
        let dump = Dump::open(&self.folder)?;
        let complete = dump.complete_passes();
        if let Some((tile, pass)) = dump.lost() {
            let path = Manifest::shard_path(&self.folder, tile, pass);
            self.shared.warn(&format!(
                "{} is missing: the samples from there on are not shown; go on with the bake to trace it again",
                path.display()
            ));
        }
        if complete == 0 {
            let reason = format!("{} holds the start of a bake only; bake again", self.folder.display());
            return Err(SessionError::Settings(reason));
        }
        let stored = WorldLayer::of_bake(&self.folder, dump.manifest()).unwrap_or_else(|error| {
            self.shared.warn(&error.to_string());
            None
        });
        if let Err(error) = GuidingRecord::of_bake(&self.folder) {
            self.shared.warn(&damage_message(&self.folder.join(GUIDED_FILE), &reason_of(error)));
        }
        self.shared.change(|state| {
            state.status.samples_total = dump.manifest().samples();
            // One that was asked for meanwhile is newer.
            state.world = state.world.take().or(stored.map(|layer| Arc::new(OtherWorld::stored(layer))));
        });
        self.deliver(dump.passes(0..complete));
        self.deliver_proxies();
        self.connect_stored(dump.manifest());
        Ok(dump.missing().is_empty())
    }

    fn deliver(&self, dump: Dump) {
        // Without the record nothing is lost but what it has to say about rare lights.
        let guiding_record = GuidingRecord::of_bake(&self.folder).unwrap_or_default();
        let manifest = dump.manifest();
        let film = camera(manifest).and_then(|camera| Film::of(manifest, &camera));
        self.shared.change(|state| {
            state.catches = film.is_ok_and(Film::catches);
            state.guiding_record = guiding_record;
            state.status.samples = dump.manifest().samples();
            state.dump = Some(dump);
            state.note_world();
            state.deliveries += 1;
        });
    }

    fn deliver_proxies(&self) {
        let Some(hash) = self.scene_hash() else { return };
        let (proxies, unusable) = Proxies::open_usable(&self.folder, &hash);
        unusable.iter().for_each(|problem| self.shared.warn(problem));
        let status = proxies.iter().filter_map(|trained| {
            let measured = trained.measured?;
            let status = ProxyStatus {
                psnr: measured.proxy.psnr,
                smape: measured.proxy.smape,
                gather_smape: measured.gather_denoised.smape,
            };
            Some((trained.proxy.info().kind.to_string(), status))
        });
        let status = status.collect();
        let measured =
            proxies.iter().filter_map(|trained| Some((trained.proxy.info().kind, trained.measured?)));
        let measured = measured.collect();
        self.shared.change(|state| {
            state.status.proxies = status;
            state.measured = measured;
            state.proxies = Some(proxies);
            state.deliveries += 1;
        });
    }

    fn scene_hash(&self) -> Option<String> {
        let state = self.shared.lock();
        let of_dump = state.dump.as_ref().map(|dump| dump.manifest().scene_hash.clone());
        of_dump.or_else(|| state.base.as_ref().map(|base| base.scene_hash.clone()))
    }

    /// Plans the numbers of paths per pixel after which lights are learned.
    fn plan(&self, rounds: &[u32]) {
        let rounds = rounds.iter().copied().filter(|_| self.train_seconds > 0.0).collect();
        self.shared
            .change(|state| state.training_plan = TrainingPlan { seconds: self.train_seconds, rounds });
    }

    /// Trains on the whole bake that is shown.
    fn learn(&self, monitor: &Monitor) -> Result<(), SessionError> {
        let samples = self.shared.lock().status.samples;
        self.plan(&[samples]);
        self.train(monitor)
    }

    fn train(&self, monitor: &Monitor) -> Result<(), SessionError> {
        if self.train_seconds == 0.0 {
            return Ok(());
        }
        let compute = self.options.device.open(self.options.gpu_memory)?;
        let mut seen = Vec::new();
        // Asked each time: lights of another kind may have been added while one was learned.
        let next = |lights: &[Light], seen: &[LightKind]| {
            self.shared.lock().kinds_of(lights).into_iter().find(|kind| !seen.contains(kind))
        };
        while let Some(kind) = next(&self.lights_in_use()?, &seen) {
            seen.push(kind);
            if !self.shared.lock().is_trained(kind) {
                self.enter(LiveState::Training);
                self.train_kind(kind, &compute, monitor)?;
                self.deliver_proxies();
            }
        }
        Ok(())
    }

    fn train_kind(&self, kind: LightKind, compute: &Compute, monitor: &Monitor) -> Result<(), SessionError> {
        let settings = TrainSettings {
            kind,
            config: TrainConfig::fast(sizes_with(&self.folder, kind, &self.lights_in_use()?)?),
            seed: 0,
            seconds: Some(self.train_seconds),
            clock: Clock::Wall,
            half_for_measuring: true,
        };
        let connections = || self.shared.lock().connections.clone();
        let (bake, out) = (&*self.folder, &*self.folder);
        let job = TrainJob { bake, out, settings: &settings, resume: false, connections: &connections };
        train_by(&job, compute, monitor).map(drop)
    }

    /// Lights of the newest request and of the scene.
    fn lights_in_use(&self) -> Result<Vec<Light>, SessionError> {
        let mut lights: Vec<Light> = LightSet::of_bake(&self.folder)?.lights;
        if let Some(request) = &self.shared.lock().request {
            lights.extend(request.lights.iter().cloned());
        }
        Ok(lights)
    }
}

/// Note that connections are being prepared, until it is dropped.
struct Preparing(Arc<Shared>);

impl Preparing {
    fn new(shared: &Arc<Shared>) -> Self {
        shared.change(|state| state.preparing += 1);
        Self(shared.clone())
    }
}

impl Drop for Preparing {
    fn drop(&mut self) {
        self.0.change(|state| state.preparing -= 1);
    }
}

/// Traces the vertices of connections level by level, each of which makes better pictures. Stands still while the
/// board has the machine for others.
fn deliver_levels(
    shared: &Shared,
    seat: &Seat,
    connections: &Arc<Connections>,
    stop: &(dyn Fn() -> bool + Sync),
) {
    while !(stop() || connections.is_prepared()) {
        let Some(_preparation) = seat.wait_to_prepare(stop) else { return };
        if connections.prepare_next(&|| stop() || seat.is_held()) {
            shared.change(|state| {
                state.connections = Some(Arc::clone(connections));
                state.deliveries += 1;
            });
        }
    }
}
