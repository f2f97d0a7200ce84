use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Kind of work in progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Preparing the scene: BVH, textures.
    Prepare,
    /// Tracing paths.
    Trace,
    /// Summing lights over the dump.
    Gather,
    /// Making the pictures that a proxy is compared with while it is trained.
    References,
    /// Training a proxy.
    Train,
    /// Measuring a proxy against gathers.
    Measure,
    /// Writing pictures.
    Write,
    /// Solving lights through a proxy.
    Optimise,
    /// Fitting solved lights to gathered pictures.
    Polish,
    /// Checking files.
    Validate,
}

/// One report of a running stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Kind of work.
    pub stage: Stage,
    /// Units done, of `total`.
    pub done: u64,
    /// Units of the whole stage.
    pub total: u64,
    /// Seconds since the stage began, without those for which its listener held it up, as in a pause.
    pub elapsed_s: f64,
    /// Seconds to the end, at the pace so far or of a time limit; none before there is a pace.
    pub remaining_s: Option<f64>,
    /// Message for the user; may be empty.
    pub message: String,
}

/// A request to stop, shared by all who hold a clone. Work ends after its current unit, with all complete units kept.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks to stop.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// True once it was asked.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The flag itself, for signal handlers and other crates.
    pub fn flag(&self) -> &Arc<AtomicBool> {
        &self.0
    }
}

/// Receives reports and warnings; called from worker threads.
pub trait Listener: Send + Sync {
    /// Reports progress of a stage.
    fn progress(&self, progress: &Progress);
    /// Reports that something was left out or replaced, in words for the user.
    fn warning(&self, message: &str);
}

/// Listener that ignores everything.
struct Silence;

impl Listener for Silence {
    fn progress(&self, _: &Progress) {}
    fn warning(&self, _: &str) {}
}

/// Link from work to its caller: reports go to a listener, and a cancel flag is obeyed.
#[derive(Clone)]
pub struct Monitor {
    listener: Arc<dyn Listener>,
    cancel: Cancel,
}

impl Default for Monitor {
    fn default() -> Self {
        Self::new(Arc::new(Silence), Cancel::default())
    }
}

impl Monitor {
    /// Reports to `listener`, stops on `cancel`.
    pub fn new(listener: Arc<dyn Listener>, cancel: Cancel) -> Self {
        Self { listener, cancel }
    }

    /// The cancel flag.
    pub fn cancel(&self) -> &Cancel {
        &self.cancel
    }

    /// True if work should stop.
    pub fn cancelled(&self) -> bool {
        self.cancel.requested()
    }

    /// Passes a warning on.
    pub fn warn(&self, message: &str) {
        self.listener.warning(message);
    }

    /// Starts a stage of `total` units, of which `done` were there before (resumed work does not count for the pace).
    pub fn stage(&self, stage: Stage, done: u64, total: u64) -> StageProgress {
        let progress = StageProgress {
            monitor: self.clone(),
            stage,
            total,
            first: done,
            done: AtomicU64::new(done),
            start: Instant::now(),
            held: AtomicU64::new(0),
        };
        progress.report("", None);
        progress
    }
}

/// A running stage. Shared by worker threads.
pub struct StageProgress {
    monitor: Monitor,
    stage: Stage,
    total: u64,
    first: u64,
    done: AtomicU64,
    start: Instant,
    /// Nanoseconds for which the listener held it up.
    held: AtomicU64,
}

impl StageProgress {
    /// Adds units that are done.
    pub fn advance(&self, units: u64, message: &str) {
        self.done.fetch_add(units, Ordering::Relaxed);
        self.report(message, None);
    }

    /// Sets the units that are done.
    pub fn set(&self, done: u64, message: &str) {
        self.set_until(done, None, message);
    }

    /// Sets the units that are done, and the seconds left, if they are known better than by the pace.
    pub fn set_until(&self, done: u64, remaining_s: Option<f64>, message: &str) {
        self.done.store(done, Ordering::Relaxed);
        self.report(message, remaining_s);
    }

    fn report(&self, message: &str, remaining_s: Option<f64>) {
        let done = self.done.load(Ordering::Relaxed);
        let held = Duration::from_nanos(self.held.load(Ordering::Relaxed));
        let elapsed_s = self.start.elapsed().saturating_sub(held).as_secs_f64();
        let fresh = done.saturating_sub(self.first);
        let left = self.total.saturating_sub(done);
        let by_pace = (fresh > 0).then(|| elapsed_s * left as f64 / fresh as f64);
        let remaining_s = remaining_s.or(by_pace);
        let (stage, total) = (self.stage, self.total);
        let progress = Progress { stage, done, total, elapsed_s, remaining_s, message: message.into() };
        let told = Instant::now();
        self.monitor.listener.progress(&progress);
        self.held.fetch_add(told.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[derive(Default)]
    struct Record(Mutex<Vec<Progress>>);

    impl Listener for Record {
        fn progress(&self, progress: &Progress) {
            self.0.lock().unwrap().push(progress.clone());
        }
        fn warning(&self, _: &str) {}
    }

    #[test]
    fn resumed_units_do_not_make_the_rest_look_quick() {
        let record = Arc::new(Record::default());
        let stage = Monitor::new(record.clone(), Cancel::default()).stage(Stage::Trace, 90, 100);
        std::thread::sleep(std::time::Duration::from_millis(20));
        stage.advance(1, "tile 91");
        let reports = record.0.lock().unwrap();
        assert_eq!((reports[0].done, reports[0].remaining_s), (90, None));
        let remaining = reports[1].remaining_s.unwrap();
        // One unit took the elapsed time, nine are left.
        assert!((remaining / reports[1].elapsed_s - 9.0).abs() < 1e-6 && remaining >= 0.18);
    }

    #[test]
    fn a_time_that_is_known_is_told_in_place_of_the_pace() {
        let record = Arc::new(Record::default());
        let stage = Monitor::new(record.clone(), Cancel::default()).stage(Stage::Train, 0, 100);
        stage.set_until(50, Some(42.0), "");
        stage.set(60, "");
        let reports = record.0.lock().unwrap();
        assert_eq!((reports[1].done, reports[1].remaining_s), (50, Some(42.0)));
        assert!(reports[2].remaining_s.unwrap() < 1.0, "the next report forgets it");
    }

    /// Keeps whoever tells it something waiting, as a pause does.
    struct Pause(Record);

    impl Listener for Pause {
        fn progress(&self, progress: &Progress) {
            self.0.progress(progress);
            std::thread::sleep(Duration::from_millis(200));
        }
        fn warning(&self, _: &str) {}
    }

    #[test]
    fn a_pause_does_not_make_the_rest_look_slow() {
        let pause = Arc::new(Pause(Record::default()));
        let stage = Monitor::new(pause.clone(), Cancel::default()).stage(Stage::Trace, 0, 100);
        stage.advance(1, "");
        stage.advance(1, "");
        let reports = pause.0.0.lock().unwrap();
        assert!(stage.start.elapsed() >= Duration::from_millis(600));
        assert!(reports[2].elapsed_s < 0.1 && reports[2].remaining_s.unwrap() < 5.0, "{:?}", reports[2]);
    }

    #[test]
    fn clones_share_the_cancel_flag() {
        let cancel = Cancel::default();
        let monitor = Monitor::new(Arc::new(Silence), cancel.clone());
        assert!(!monitor.cancelled());
        cancel.request();
        assert!(monitor.cancelled());
    }
}
