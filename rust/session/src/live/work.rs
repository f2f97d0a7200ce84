use super::shared::{Gate, Learning, LiveState, ProxyStatus, Shared, kinds_of};
use super::{LiveOptions, OtherWorld};
use crate::bake::features::camera;
use crate::bake::guiding::{Guided, Sight};
use crate::bake::world::WorldLayer;
use crate::bake::{Observer, bake_observed, clear, clear_paths, difference};
use crate::device::compute::Compute;
use crate::device::threads::in_background;
use crate::error::SessionError;
use crate::files::base_layers;
use crate::files::contents::{self, lost_files};
use crate::files::damage::{reason_of, words};
use crate::files::light_set::LightSet;
use crate::files::names::GUIDED_FILE;
use crate::files::proxies::Proxies;
use crate::progress::{Cancel, Monitor};
use crate::train::sizes::sizes_with;
use crate::train::{Clock, TrainSettings, train};
use relume_dump::{Dump, DumpError, Manifest};
use relume_proxy::{LightKind, TrainConfig};
use relume_scene::{Light, Scene};
use relume_trace::{TraceSettings, guide_targets};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;

/// Paths per pixel that the first training is done on; a sum of whole passes.
const SAMPLES_TO_TRAIN: u32 = 64;

/// What the work thread does first; training follows.
pub(super) enum Work {
    /// Bakes a scene; `anew` where a whole bake of it is there whose paths do not look for the present lights.
    Bake { scene: Arc<Scene>, settings: TraceSettings, anew: bool },
    /// Takes what the folder holds.
    Open,
    /// Nothing: the bake is there and shown.
    Learn,
}

impl Work {
    /// The state that it begins in.
    pub fn first_state(&self) -> LiveState {
        match self {
            Self::Bake { .. } | Self::Open => LiveState::Preparing,
            Self::Learn => LiveState::Training,
        }
    }
}

/// One run of the work thread.
pub(super) struct Job {
    pub work: Work,
    pub train_seconds: f64,
    pub folder: PathBuf,
    pub options: LiveOptions,
    pub shared: Arc<Shared>,
    pub cancel: Cancel,
}

impl Job {
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
            shared.learning = Learning::default();
            // The machine: the painter makes better pictures with it now, and stores the light of another world.
            shared.deliveries += 1;
        });
    }

    fn work(&self) -> Result<(), SessionError> {
        let gate = Gate { shared: self.shared.clone(), cancel: self.cancel.clone() };
        let monitor = Monitor::new(Arc::new(gate), self.cancel.clone());
        match &self.work {
            Work::Bake { scene, settings, anew } => {
                if *anew && self.looks_elsewhere(scene, settings)? {
                    clear_paths(&self.folder)?;
                }
                self.bake(scene, settings, &monitor)
            }
            Work::Open => {
                let complete = self.open()?;
                if complete { self.learn(&monitor) } else { Ok(()) }
            }
            Work::Learn => self.learn(&monitor),
        }
    }

    /// Whether the folder holds a whole bake of the scene, and its world or the lights that are shown now would have much less noise
    /// from paths that look for them, or nobody knows any more what its paths look for.
    fn looks_elsewhere(&self, scene: &Scene, settings: &TraceSettings) -> Result<bool, SessionError> {
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
        let guided = Guided::of_bake(&self.folder).unwrap_or_default();
        let sight = Sight::new(&guided, manifest, &dump.aovs(), &camera(manifest)?);
        Ok(sight.would_gain(&self.lights_to_look_for(scene, settings), settings.guiding))
    }

    /// Bakes and trains, then bakes the rest and trains anew if that is much more: a proxy is at hand long before a bake of
    /// many samples ends. What is there already stays, even if fewer samples are asked for.
    fn bake(&self, scene: &Scene, settings: &TraceSettings, monitor: &Monitor) -> Result<(), SessionError> {
        if matches!(difference(scene, settings, &self.folder), Ok(Some(Manifest::WORLD_MAP))) {
            clear_paths(&self.folder)?;
        }
        let there = self.whole_samples(scene, settings);
        let world = Arc::new(OtherWorld::new(scene)?);
        self.shared.show_world(world);
        let wanted = settings.samples.max(there);
        self.shared.change(|state| state.status.samples_total = wanted);
        let early = Some(SAMPLES_TO_TRAIN).filter(|early| (there + 1..wanted).contains(early));
        let rounds: Vec<u32> =
            early.filter(|_| self.train_seconds > 0.0).into_iter().chain([wanted]).collect();
        self.plan(&rounds);
        for samples in rounds {
            self.enter(LiveState::Baking);
            let settings = TraceSettings { samples, threads: 0, ..settings.clone() };
            self.bake_samples(scene, &settings, monitor)?;
            self.deliver_proxies();
            self.train(monitor)?;
            self.shared.change(|state| {
                state.learning.rounds.pop_front();
            });
        }
        Ok(())
    }

    /// Begins with something else, of which there is no progress to tell yet.
    fn enter(&self, state: LiveState) {
        self.shared.change(|shared| {
            shared.status.state = state;
            shared.status.stage = None;
        });
    }

    /// Samples of the whole passes that the folder holds of this very bake.
    fn whole_samples(&self, scene: &Scene, settings: &TraceSettings) -> u32 {
        if !matches!(difference(scene, settings, &self.folder), Ok(None)) {
            return 0;
        }
        let whole = |dump: Dump| dump.passes(0..dump.complete_passes()).manifest().samples();
        Dump::open(&self.folder).map_or(0, whole)
    }

    fn bake_samples(
        &self,
        scene: &Scene,
        settings: &TraceSettings,
        monitor: &Monitor,
    ) -> Result<(), SessionError> {
        let lights = || self.lights_to_look_for(scene, settings);
        let samples = self.shared.lock().status.samples_total;
        let observer = Observer { samples, lights: &lights, passes: &|dump| self.deliver(dump) };
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

    /// The scene's, and those that are shown now where they are other than the scene's: they may have moved since it was read.
    fn lights_to_look_for(&self, scene: &Scene, settings: &TraceSettings) -> Vec<Light> {
        let mut lights = guide_targets(scene, settings);
        if let Some(request) = &self.shared.lock().request {
            let is_elsewhere = |light: &&Light| lights.iter().all(|known| known.shape != light.shape);
            let shown: Vec<Light> = request.lights.iter().filter(is_elsewhere).cloned().collect();
            lights.extend(shown);
        }
        lights
    }

    /// Whether the folder holds a whole bake.
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
        if let Err(error) = Guided::of_bake(&self.folder) {
            self.shared.warn(&words(&self.folder.join(GUIDED_FILE), &reason_of(error)));
        }
        self.shared.change(|state| {
            state.status.samples_total = dump.manifest().samples();
            // One that was asked for meanwhile is newer.
            state.world = state.world.take().or(stored.map(|layer| Arc::new(OtherWorld::stored(layer))));
        });
        self.deliver(dump.passes(0..complete));
        self.deliver_proxies();
        Ok(dump.missing().is_empty())
    }

    fn deliver(&self, dump: Dump) {
        // Without the record nothing is lost but what it has to say about rare lights.
        let guided = Guided::of_bake(&self.folder).unwrap_or_default();
        self.shared.change(|state| {
            state.guided = guided;
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

    /// Says after how many paths per pixel lights will be learned.
    fn plan(&self, rounds: &[u32]) {
        let rounds = rounds.iter().copied().filter(|_| self.train_seconds > 0.0).collect();
        self.shared.change(|state| state.learning = Learning { seconds: self.train_seconds, rounds });
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
        while let Some(kind) = kinds_of(&self.lights_in_use()?).into_iter().find(|kind| !seen.contains(kind))
        {
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
        train(&self.folder, &self.folder, &settings, false, compute, monitor).map(drop)
    }

    /// The lights that are asked for, and those that the scene came with.
    fn lights_in_use(&self) -> Result<Vec<Light>, SessionError> {
        let mut lights: Vec<Light> = LightSet::of_bake(&self.folder)?.lights;
        if let Some(request) = &self.shared.lock().request {
            lights.extend(request.lights.iter().cloned());
        }
        Ok(lights)
    }
}
