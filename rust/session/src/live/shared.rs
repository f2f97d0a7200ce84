use super::{Board, LiveRequest, OtherWorld};
use crate::bake::guiding::GuidingRecord;
use crate::bake::world::own_world;
use crate::device::connections::Connections;
use crate::files::proxies::{Measured, Proxies};
use crate::progress::{Cancel, Listener, Progress};
use crate::relight::source::UnitSource;
use relume_dump::Dump;
use relume_image::Image;
use relume_proxy::LightKind;
use relume_scene::Light;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Activity of a live shot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LiveState {
    /// Initial state.
    #[default]
    Empty,
    /// Preparing the scene, or opening files.
    Preparing,
    /// Tracing paths.
    Baking,
    /// Training a proxy.
    Training,
    /// Work is complete.
    Ready,
    /// Work was cancelled.
    Cancelled,
    /// Work ended with [`LiveStatus::error`].
    Failed,
}

impl LiveState {
    /// True if paths are traced or a proxy is trained, or soon will be.
    pub(super) fn is_working(self) -> bool {
        matches!(self, Self::Preparing | Self::Baking | Self::Training)
    }
}

/// Status of a live shot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LiveStatus {
    /// Present activity.
    pub state: LiveState,
    /// True while baking and training are paused.
    pub paused: bool,
    /// Progress of the present stage.
    pub stage: Option<Progress>,
    /// Paths per pixel so far.
    pub samples: u32,
    /// Paths per pixel at the end.
    pub samples_total: u32,
    /// Radiance of the world that is shown, or the factor on its texture. Factors of requests on its light are relative
    /// to this. None without paths. For the paths' own world it is the value at the start of the bake.
    pub world_color: Option<[f32; 3]>,
    /// The world that is shown ([`relume_scene::Scene::world_map`]). None without paths.
    pub world_map: Option<String>,
    /// True if that world is shown when the folder is opened again.
    pub world_is_stored: bool,
    /// Trained proxies by kind of light.
    pub proxies: BTreeMap<String, ProxyStatus>,
    /// Kinds of light in the newest request that have no such proxy, although there are proxies of them. None while something is
    /// being dragged.
    pub unlearned: Vec<String>,
    /// Paths per pixel of each training that the present work has not ended, in turn. Kinds of light are those of the
    /// newest request.
    pub to_learn: Vec<u32>,
    /// Device that pictures are made on, in words.
    pub device: String,
    /// Warnings about things that are left out, or less exact, for the user.
    pub warnings: Vec<String>,
    /// Lights of the newest request that hardly any path meets where they are now, while new paths would.
    pub rarely_met: Vec<String>,
    /// Reason why work or rendering ended.
    pub error: Option<String>,
    /// The newest frame.
    pub shown: Option<Shown>,
}

/// Errors of a proxy, on lights that it never saw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProxyStatus {
    /// dB, tonemapped.
    pub psnr: f64,
    /// SMAPE of the proxy.
    pub smape: f64,
    /// SMAPE of gathering and denoising as many samples.
    pub gather_smape: f64,
}

/// Description of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// Number of the frame, from 1.
    pub serial: u64,
    /// Number of the request.
    pub request: u64,
    /// 1 for the full size, 2 for half.
    pub scale: usize,
    /// Fewest paths per pixel behind a gathered light.
    pub samples: u32,
    /// Source of each light's picture, by its name.
    #[serde(rename = "makers")]
    pub sources: BTreeMap<String, UnitSource>,
    /// True if the sums over paths are denoised.
    pub denoised: bool,
    /// True if nothing better will come for this request from the present delivery.
    pub settled: bool,
    /// Noise of all sums over paths in a settled picture, before denoising, as SMAPE
    /// ([`relume_image::metrics::smape`]), like the errors of proxies. Estimated from the newest pass beside those
    /// before it. None if a light has a single pass, or no light is summed.
    pub noise: Option<f32>,
    /// Deliveries of the work that are in it.
    #[serde(skip)]
    pub(super) deliveries: u64,
}

/// A finished picture.
#[derive(Debug)]
pub struct Frame {
    /// Scene-linear RGBA with the film's alpha; **bottom row first**, as Blender's textures are.
    pub image: Image,
    /// Description of the picture.
    pub shown: Shown,
}

/// State that caller, work thread and render thread share.
#[derive(Default)]
pub(super) struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

/// State behind the lock.
#[derive(Default)]
pub(super) struct State {
    pub request: Option<Arc<LiveRequest>>,
    /// Number of the newest request.
    pub requests: u64,
    /// Whole passes of the bake so far.
    pub dump: Option<Dump>,
    /// Scene of the bake in which lights are connected.
    pub connections: Option<Arc<Connections>>,
    /// Number of threads that prepare connections, so that better pictures are to be expected.
    pub preparing: u32,
    /// World that is shown in place of the one that the paths were traced with.
    pub world: Option<Arc<OtherWorld>>,
    /// Lights that its paths are guided towards.
    pub guiding_record: GuidingRecord,
    /// Folder of proxies alone, for a shot without paths.
    pub base: Option<Arc<crate::files::base_layers::BaseLayers>>,
    /// Proxies that the render thread has not taken yet.
    pub proxies: Option<Proxies>,
    /// Measured errors of all proxies.
    pub measured: Vec<(LightKind, Measured)>,
    /// Trainings of the work under way.
    pub training_plan: TrainingPlan,
    /// Number of deliveries of the work.
    pub deliveries: u64,
    pub frame: Option<Arc<Frame>>,
    pub status: LiveStatus,
    /// Warnings about the newest request alone.
    pub light_warnings: Vec<String>,
    /// Reason why there is no picture of it.
    pub picture_error: Option<String>,
    /// True while a picture is made that the caller waits for.
    pub rendering: bool,
    pub closed: bool,
    /// True if the film has shadow catchers.
    pub catches: bool,
}

/// Trainings that are to come in a run of the work thread.
#[derive(Default)]
pub(super) struct TrainingPlan {
    /// Seconds for each kind of light.
    pub seconds: f64,
    /// Paths per pixel after which all kinds are learned that were not from half as many, in turn.
    pub rounds: VecDeque<u32>,
}

impl Shared {
    pub fn lock(&self) -> MutexGuard<'_, State> {
        // What is behind the lock is whole between statements.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    /// Notes that work begins, in a state; false if some is going on or all is closed.
    pub fn begin_work(&self, first: LiveState) -> bool {
        let mut state = self.lock();
        let status = &mut state.status;
        if status.state.is_working() {
            return false;
        }
        status.state = first;
        status.error = None;
        status.warnings.clear();
        !state.closed
    }

    /// Sets the world that is shown. True if it is the one that the paths were traced with.
    pub fn show_world(&self, world: Arc<OtherWorld>) -> bool {
        let mut state = self.lock();
        state.world = Some(world);
        state.note_world();
        state.world.is_none()
    }

    pub fn ask(&self, request: LiveRequest) -> u64 {
        let mut state = self.lock();
        state.requests += 1;
        state.request = Some(Arc::new(request));
        let number = state.requests;
        drop(state);
        self.changed.notify_all();
        number
    }

    pub fn status(&self) -> LiveStatus {
        let state = self.lock();
        let mut status = state.status.clone();
        status.unlearned = state.unlearned().map(|kind| kind.to_string()).collect();
        status.to_learn = state.to_learn();
        status.warnings.extend(state.light_warnings.iter().cloned());
        if let Some(shown) = &mut status.shown {
            shown.settled &= shown.deliveries == state.deliveries && state.preparing == 0;
        }
        status.error = status.error.or_else(|| state.picture_error.clone());
        status
    }

    pub fn warn(&self, message: &str) {
        let mut state = self.lock();
        if !state.status.warnings.iter().any(|known| known == message) {
            state.status.warnings.push(message.into());
        }
    }

    /// Waits while `condition` holds and nothing is closed.
    pub fn wait_while(&self, condition: impl Fn(&State) -> bool) -> MutexGuard<'_, State> {
        let mut state = self.lock();
        while !state.closed && condition(&state) {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state
    }
}

/// The kinds whose proxies answer for some of these lights, in the order in which they are learned.
fn kinds_of(lights: &[Light]) -> Vec<LightKind> {
    let used = |kind: &LightKind| lights.iter().any(|light| LightKind::answering(light) == Some(*kind));
    LightKind::ALL.into_iter().filter(used).collect()
}

impl State {
    /// [`kinds_of`] some lights, as far as they are learned in this shot: none with shadow catchers.
    pub fn kinds_of(&self, lights: &[Light]) -> Vec<LightKind> {
        if self.catches { Vec::new() } else { kinds_of(lights) }
    }

    /// See [`LiveStatus::unlearned`].
    fn unlearned(&self) -> impl Iterator<Item = LightKind> {
        let request = self.request.as_ref().filter(|request| !request.interactive);
        let kinds = request.map_or_else(Vec::new, |request| self.kinds_of(&request.lights));
        kinds.into_iter().filter(|kind| self.measured.iter().all(|(known, _)| known != kind))
    }

    /// See [`LiveStatus::to_learn`].
    fn to_learn(&self) -> Vec<u32> {
        let kinds = self.request.as_ref().map_or_else(Vec::new, |request| self.kinds_of(&request.lights));
        let mut list = Vec::new();
        for kind in kinds {
            let mut learned_from = self.learned_from(kind);
            for samples in self.training_plan.rounds.iter().copied() {
                if !is_enough(learned_from, samples) {
                    learned_from = Some(samples / 2);
                    list.push(samples);
                }
            }
        }
        list.sort_unstable();
        list
    }

    /// True if a proxy learned for the time asked for, from at least half of the present paths.
    pub fn is_trained(&self, kind: LightKind) -> bool {
        let samples = self.dump.as_ref().map_or(0, |dump| dump.manifest().samples());
        is_enough(self.learned_from(kind), samples)
    }

    /// Paths per pixel that a kind of light was learned from, for the time asked for. That is the half that it was not
    /// measured on.
    fn learned_from(&self, kind: LightKind) -> Option<u32> {
        let long_enough = |measured: &Measured| {
            measured.seconds.is_none_or(|seconds| seconds >= self.training_plan.seconds)
        };
        let found = self.measured.iter().filter(|(of, measured)| *of == kind && long_enough(measured));
        found.map(|(_, measured)| measured.samples).max()
    }

    /// Notes which world is shown. The paths' own is shown without another in its place.
    pub fn note_world(&mut self) {
        let Some(dump) = &self.dump else { return };
        let own = own_world(dump.manifest());
        let world = self.world.take().filter(|world| world.about().map != own.map);
        let shown = world.as_ref().map_or(&own, |world| world.about());
        let is_same = self.status.world_map.as_ref() == Some(&shown.map);
        let status = &mut self.status;
        status.world_is_stored = match &world {
            Some(world) => world.is_stored() || is_same && status.world_is_stored,
            None => true,
        };
        (status.world_map, status.world_color) = (Some(shown.map.clone()), Some(shown.color));
        self.world = world;
    }
}

/// True if learning from so many paths per pixel, with as many left to measure on, is enough for so many.
fn is_enough(learned_from: Option<u32>, samples: u32) -> bool {
    learned_from.is_some_and(|half| 4 * half >= samples)
}

/// Listener that passes progress on, and blocks work while it is paused or a render thread needs the machine.
pub(super) struct Gate {
    pub shared: Arc<Shared>,
    pub board: Board,
    pub cancel: Cancel,
}

impl Listener for Gate {
    fn progress(&self, progress: &Progress) {
        let mut state = self.shared.lock();
        state.status.stage = Some(progress.clone());
        let is_held = |state: &State| state.status.paused || state.rendering || self.board.is_urgent();
        while is_held(&state) && !state.closed && !self.cancel.requested() {
            // Woken by every change; the time limit is for a cancel that nobody announces.
            let waited = self.shared.changed.wait_timeout(state, Duration::from_millis(100));
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn warning(&self, message: &str) {
        self.shared.warn(message);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::light_set::LightSet;
    use crate::files::proxies::MeanQuality;
    use glam::Vec3;
    use relume_scene::LightShape;

    fn light(shape: LightShape) -> Light {
        Light::unit(shape)
    }

    fn request(lights: Vec<Light>) -> Arc<LiveRequest> {
        let json = serde_json::json!({ "lights": LightSet { lights, ..LightSet::default() } }).to_string();
        Arc::new(LiveRequest::parse(&json).unwrap())
    }

    fn measured(samples: u32, seconds: f64) -> Measured {
        let none = MeanQuality { psnr: 0.0, smape: 0.0, ssim: 0.0, flip: 0.0 };
        let [proxy, gather, gather_denoised] = [none; 3];
        Measured { lights: 1, samples, seconds: Some(seconds), proxy, gather, gather_denoised }
    }

    #[test]
    fn what_is_to_be_learned_is_told_of_all_kinds_and_rounds() {
        let sphere = light(LightShape::Sphere { center: Vec3::ZERO, radius: 0.3 });
        let point = light(LightShape::FacingDisk { center: Vec3::ZERO, radius: 0.2 });
        let sun = light(LightShape::Sun { direction: Vec3::Z, half_angle: 0.01 });
        let mut state =
            State { request: Some(request(vec![sphere.clone(), sun.clone()])), ..State::default() };
        assert!(state.to_learn().is_empty(), "nothing is going on");
        state.training_plan = TrainingPlan { seconds: 60.0, rounds: [64, 256].into() };
        assert_eq!(state.to_learn(), [64, 256]);
        state.training_plan.rounds = [64, 128].into();
        assert_eq!(state.to_learn(), [64], "twice as many paths are not worth it");
        state.request = Some(request(vec![sphere.clone(), point, sphere]));
        assert_eq!(state.to_learn(), [64, 64]);
        state.training_plan.rounds = [64, 256].into();
        assert_eq!(state.to_learn(), [64, 64, 256, 256]);
        state.measured = vec![(LightKind::Sphere, measured(32, 60.0))];
        assert_eq!(state.to_learn(), [64, 256, 256], "one is learned");
        state.measured = vec![(LightKind::Sphere, measured(32, 59.0))];
        assert_eq!(state.to_learn(), [64, 64, 256, 256], "but not for as long as is asked for now");
        state.request = Some(request(vec![sun]));
        assert!(state.to_learn().is_empty(), "suns are never learned");
        let spot = |size: f32| {
            let (center, radius, axis, half_angle) = (Vec3::ZERO, 0.1, Vec3::NEG_Z, 0.5 * size.to_radians());
            light(LightShape::Spot { center, radius, axis, half_angle, blend: 0.1, soft_falloff: true })
        };
        state.request = Some(request(vec![spot(5.0), spot(2.0)]));
        assert_eq!(state.kinds_of(&[spot(5.0)]), [], "no proxy answers for spots so narrow");
        assert!(state.to_learn().is_empty() && state.unlearned().next().is_none());
        state.request = Some(request(vec![spot(5.0), spot(30.0)]));
        assert_eq!(state.to_learn(), [64, 256]);
        assert_eq!(state.unlearned().collect::<Vec<_>>(), [LightKind::Spot]);
    }
}
