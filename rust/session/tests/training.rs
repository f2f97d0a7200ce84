//! Progress reports of a training.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod common;

use common::{baked, training};
use relume_session::proxy::LightKind;
use relume_session::{Cancel, Compute, Listener, Monitor, Progress, Stage, TrainSettings, train};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Remembers what was told, and cancels at something.
struct Told {
    reports: Mutex<Vec<Progress>>,
    cancel: Cancel,
    cancels_at: fn(&Progress) -> bool,
}

impl Listener for Told {
    fn progress(&self, progress: &Progress) {
        self.reports.lock().unwrap().push(progress.clone());
        if (self.cancels_at)(progress) {
            self.cancel.request();
        }
    }
    fn warning(&self, _: &str) {}
}

/// Progress reports of a training on a small bake, until it ends or is cancelled.
fn told(settings: &TrainSettings, folder: &Path, cancels_at: fn(&Progress) -> bool) -> Vec<Progress> {
    baked(folder);
    let cancel = Cancel::default();
    let told = Arc::new(Told { reports: Mutex::default(), cancel: cancel.clone(), cancels_at });
    let monitor = Monitor::new(told.clone(), cancel.clone());
    let result = train(folder, folder, settings, false, &Compute::default(), &monitor);
    assert_eq!(result.is_err(), cancel.requested(), "{result:?}");
    drop(monitor);
    Arc::into_inner(told).expect("nobody else listens").reports.into_inner().unwrap()
}

#[test]
fn pictures_to_compare_with_are_made_in_a_stage_of_their_own() {
    let mut settings = training(LightKind::Sphere);
    settings.config.held_out = 5;
    let folder = tempfile::tempdir().unwrap();
    let reports = told(&settings, folder.path(), |_| false);
    let of = |stage| reports.iter().filter(move |report| report.stage == stage);
    assert_eq!(of(Stage::References).map(|report| report.done).collect::<Vec<_>>(), [0, 2, 4, 5]);
    assert!(of(Stage::References).all(|report| report.total == 5));
    assert!(of(Stage::References).skip(1).all(|report| report.remaining_s.is_some()));
    let mut stages: Vec<Stage> = reports.iter().map(|report| report.stage).collect();
    stages.dedup();
    assert_eq!(stages, [Stage::References, Stage::Train, Stage::Measure]);

    let on_all_paths = TrainSettings { half_for_measuring: false, ..settings };
    let reports = told(&on_all_paths, tempfile::tempdir().unwrap().path(), |_| false);
    assert!(reports.iter().all(|report| report.stage == Stage::Train), "nothing is compared");
}

#[test]
fn a_cancel_is_heard_between_pictures_to_compare_with() {
    let folder = tempfile::tempdir().unwrap();
    let mut settings = training(LightKind::Sphere);
    settings.config.held_out = 5;
    let reports = told(&settings, folder.path(), |report| report.done == 2);
    let made = reports.iter().filter(|report| report.stage == Stage::References).map(|report| report.done);
    assert_eq!(made.collect::<Vec<_>>(), [0, 2]);
    assert!(!folder.path().join("proxy_sphere.safetensors").exists(), "nothing was learned");
}

/// Comparing takes none of the time limit, but time.
#[test]
fn what_is_left_of_a_time_limit_includes_comparing() {
    let settings = TrainSettings { seconds: Some(2.0), ..training(LightKind::Sphere) };
    let folder = tempfile::tempdir().unwrap();
    let reports = told(&settings, folder.path(), |_| false);
    let is_first = |report: &Progress| report.message.starts_with("held out");
    let first = reports.iter().position(is_first).expect("a comparison");
    let [before, after] = [first - 1, first].map(|at| reports[at].remaining_s.expect("a time limit"));
    // No step is between them; this one knows how long the other nine will take.
    assert!(after > before, "{before} to {after} seconds");
    let took = reports[first].elapsed_s - reports[first - 1].elapsed_s;
    assert!(after - before < 20.0 * took, "{before} to {after} seconds, where one took {took}");
    let last = reports.iter().rfind(|report| report.stage == Stage::Train).expect("an end");
    assert_eq!(last.remaining_s, Some(0.0), "{last:?}");
}
