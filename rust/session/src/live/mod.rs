//! Live shot: baked, trained and relit in the background.
//!
//! ```text
//! caller              work thread                         render thread
//! bake(scene)   -->   paths, pass by pass   --dump-->     units: each light's sum over the passes so far
//! relight(request) ------------- newest request -------->  frame = weighted sum of units, denoised
//!                     proxies, kind by kind --proxies-->  stand in while a light is dragged
//! frame(), status()  <------------------------------------ newest frame
//! ```
//!
//! The caller never waits. Work stops while a picture is made for the caller, or while it is paused. A cancel ends it
//! at its next shard or step. A light's unit image grows by one pass at a time: a moved light is seen after the first
//! pass and exact after the last. No pass is gathered twice.
//!
//! The render threads of several shots take turns on a [`Board`], step by step.

mod aov;
mod board;
mod layers;
mod render_thread;
mod request;
mod shared;
mod terms;
mod view;
mod work_thread;
mod world;

use crate::bake::world::forget;
use crate::device::compute::Device;
use crate::error::SessionError;
use crate::progress::Cancel;
use crate::relight::relighter::OpenScenes;
pub use aov::Aov;
pub use board::Board;
use board::Seat;
use relume_scene::Scene;
use relume_trace::TraceSettings;
use render_thread::RenderThread;
pub use request::{LiveRequest, RequestOptions};
use shared::Shared;
pub use shared::{Frame, LiveState, LiveStatus, ProxyStatus, Shown};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use work_thread::LiveTask;
pub use world::OtherWorld;

/// Devices of a live shot.
#[derive(Clone, Debug, Default)]
pub struct LiveOptions {
    /// Device.
    pub device: Device,
    /// Bytes of GPU memory to use; by default what its driver says, less some for others.
    pub gpu_memory: Option<u64>,
    /// Threads of the CPU; 0 for one a core.
    pub threads: usize,
    /// Shots that it takes turns with.
    pub board: Board,
}

/// A live shot. Every method returns at once.
pub struct Live {
    folder: PathBuf,
    options: LiveOptions,
    shared: Arc<Shared>,
    seat: Arc<Seat>,
    threads: Mutex<Threads>,
}

#[derive(Default)]
struct Threads {
    render: Option<JoinHandle<()>>,
    work: Option<(JoinHandle<()>, Cancel)>,
}

impl Live {
    /// A shot with its bake in `folder`. Nothing is read or written yet.
    pub fn new(folder: &Path, options: LiveOptions) -> Self {
        let seat = options.board.seat();
        Self {
            folder: folder.to_path_buf(),
            options,
            shared: Arc::default(),
            seat,
            threads: Mutex::default(),
        }
    }

    /// Bakes a scene into the folder and shows pictures after every pass. Then it trains a proxy for so many seconds
    /// for each kind of light in use. It goes on with a bake of the same scene and settings, and replaces one of
    /// another. `anew` also replaces a whole one whose paths are guided towards other lights than the present ones. The
    /// paths of each pass are guided towards the lights of the newest request. If only the world differs from a whole
    /// bake, it is shown as by [`Live::show_world`].
    ///
    /// # Errors
    /// If work is going on already. Later errors are in [`Live::status`].
    pub fn bake(
        &self,
        scene: Arc<Scene>,
        settings: TraceSettings,
        train_seconds: f64,
        anew: bool,
    ) -> Result<(), SessionError> {
        self.start(LiveTask::Bake { scene, settings, anew }, train_seconds)
    }

    /// Shows what the folder holds, and trains if asked and not trained yet.
    ///
    /// # Errors
    /// Fails like [`Live::bake`].
    pub fn open(&self, train_seconds: f64) -> Result<(), SessionError> {
        self.start(LiveTask::Open, train_seconds)
    }

    /// Trains a proxy for so many seconds for each kind of light in use without one ([`LiveStatus::unlearned`]), on the
    /// whole bake that is shown.
    ///
    /// # Errors
    /// Fails like [`Live::bake`].
    pub fn learn(&self, train_seconds: f64) -> Result<(), SessionError> {
        self.start(LiveTask::Learn, train_seconds)
    }

    /// Asks for a picture; the newest request wins. Returns the number that its frames carry.
    pub fn relight(&self, request: LiveRequest) -> u64 {
        self.shared.ask(request)
    }

    /// Shows another world from now on, gathered from the same paths, also while they are traced. Factors of requests
    /// on its light are relative to its own colour. It is stored in the folder for the next time, unless it is the one
    /// that the paths were traced with. Returns the number that the frames of the request carry.
    ///
    /// # Errors
    /// If the light of another world cannot be removed from the folder.
    pub fn show_world(&self, world: Arc<OtherWorld>, request: LiveRequest) -> Result<u64, SessionError> {
        let is_own = self.shared.show_world(world);
        if is_own {
            forget(&self.folder)?;
        }
        Ok(self.shared.ask(request))
    }

    /// Makes this the shot that somebody looks at: its pictures come before those of others on the same board.
    pub fn attend(&self) {
        self.seat.attend();
    }

    /// The newest frame, if it is newer than the one with this serial number.
    pub fn frame(&self, newer_than: u64) -> Option<Arc<Frame>> {
        self.shared.lock().frame.clone().filter(|frame| frame.shown.serial > newer_than)
    }

    /// Present status.
    pub fn status(&self) -> LiveStatus {
        self.shared.status()
    }

    /// Pauses baking and training, or lets them go on. Relighting always goes on.
    pub fn pause(&self, paused: bool) {
        self.shared.change(|state| state.status.paused = paused);
    }

    /// Ends baking and training; what is there stays, and relighting goes on.
    pub fn cancel(&self) {
        if let Some((_, cancel)) = &self.threads().work {
            cancel.request();
        }
        self.shared.change(|state| state.status.paused = false);
    }

    /// Ends everything; files stay whole. Waits at most so long for the threads to end.
    pub fn close(&self, wait: Duration) {
        self.cancel();
        self.shared.change(|state| state.closed = true);
        let mut threads = self.threads();
        let handles = [threads.render.take(), threads.work.take().map(|(handle, _)| handle)];
        let until = Instant::now() + wait;
        for handle in handles.into_iter().flatten() {
            while !handle.is_finished() && Instant::now() < until {
                thread::sleep(Duration::from_millis(5));
            }
        }
    }

    fn start(&self, work: LiveTask, train_seconds: f64) -> Result<(), SessionError> {
        let mut threads = self.threads();
        if !self.shared.begin_work(work.first_state()) {
            let reason = "this shot is being baked or trained already, or is closed; cancel it first";
            return Err(SessionError::Settings(reason.into()));
        }
        let spawn = |name: &str, body: Box<dyn FnOnce() + Send>| {
            let thread = thread::Builder::new().name(name.into()).spawn(body);
            thread.map_err(|source| {
                self.shared.change(|state| state.status.state = LiveState::Failed);
                SessionError::Settings(format!("cannot start a thread: {source}"))
            })
        };
        if threads.render.as_ref().is_none_or(JoinHandle::is_finished) {
            let thread = RenderThread::new(self.shared.clone(), self.options.clone(), self.seat.clone())
                .storing_in(&self.folder);
            threads.render = Some(spawn("relume-render", Box::new(move || thread.run()))?);
        }
        let cancel = Cancel::default();
        let job = work_thread::WorkRun {
            work,
            train_seconds,
            folder: self.folder.clone(),
            options: self.options.clone(),
            shared: self.shared.clone(),
            seat: self.seat.clone(),
            cancel: cancel.clone(),
        };
        threads.work = Some((spawn("relume-work", Box::new(move || job.run()))?, cancel));
        Ok(())
    }

    fn threads(&self) -> MutexGuard<'_, Threads> {
        self.threads.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl OpenScenes {
    /// Scenes of these shots, of those that have made them ready.
    pub fn of<'a>(shots: impl IntoIterator<Item = &'a Live>) -> Self {
        Self(shots.into_iter().filter_map(|shot| shot.shared.lock().connections.clone()).collect())
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.close(Duration::ZERO);
    }
}

#[cfg(test)]
mod gpu_tests;
#[cfg(test)]
mod tests;
