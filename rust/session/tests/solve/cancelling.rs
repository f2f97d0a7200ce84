//! A solve can be cancelled at any time.

use crate::common;
use crate::room::{baked, key, light, picture, target_request};
use glam::Vec3;
use relume_session::scene::LightShape;
use relume_session::{
    Cancel, InterimLights, Listener, Monitor, Pictures, Progress, Relighter, SessionError, SolveRequest,
    Stage, solve_lights,
};
use serde_json::json;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// Stops a solver at its n-th report.
pub struct StopAt(pub Mutex<usize>, pub Cancel);

impl Listener for StopAt {
    fn progress(&self, progress: &Progress) {
        let mut left = self.0.lock().unwrap();
        if matches!(progress.stage, Stage::Optimise | Stage::Polish) && progress.done > 0 {
            *left = left.saturating_sub(1);
            if *left == 0 {
                self.1.request();
            }
        }
    }
    fn warning(&self, _: &str) {}
}

/// Counts a solver's steps.
#[derive(Default)]
struct Steps(Mutex<u64>);

impl Listener for Steps {
    fn progress(&self, progress: &Progress) {
        if matches!(progress.stage, Stage::Optimise | Stage::Polish) {
            *self.0.lock().unwrap() += progress.done;
        }
    }
    fn warning(&self, _: &str) {}
}

#[test]
fn cancelling_works_before_the_first_step() {
    let relighter = baked(0.0);
    let request = target_request(json!({"add": {"count": 2}}));
    let request = SolveRequest::parse(&request.to_string()).unwrap();
    let target = picture(&relighter, &[key()]);
    let pictures = Pictures::named(HashMap::from([("target".to_string(), target)]));
    let (steps, cancel) = (Arc::new(Steps::default()), Cancel::default());
    cancel.request();
    let monitor = Monitor::new(steps.clone(), cancel);
    let result = solve_lights(&[&relighter], &request, &pictures, &monitor, &|_| ());
    assert!(matches!(result, Err(SessionError::Cancelled)), "{result:?}");
    assert_eq!(*steps.0.lock().unwrap(), 0, "random starts were looked for all the same");
}

#[test]
fn cancelling_works_at_any_step_and_previews_hold_all_lights() {
    let relighter = baked(0.0);
    let target = picture(&relighter, &[key()]);
    let request =
        target_request(json!({"lights": [key()], "free": {"Key": ["strength"]}, "add": {"count": 1}}));
    let request = SolveRequest::parse(&request.to_string()).unwrap();
    let pictures = Pictures::named(HashMap::from([("target".to_string(), target)]));
    for step in [1, 30, 65] {
        let cancel = Cancel::default();
        let monitor = Monitor::new(Arc::new(StopAt(Mutex::new(step), cancel.clone())), cancel);
        let seen = Mutex::new(0);
        let preview = |found: &InterimLights| {
            assert!(found.lights.lights.len() == 2 && found.lights.lights[0].name == "Key");
            *seen.lock().unwrap() += 1;
        };
        let result = solve_lights(&[&relighter], &request, &pictures, &monitor, &preview);
        assert!(matches!(result, Err(SessionError::Cancelled)), "{step}: {result:?}");
        assert!(*seen.lock().unwrap() > 0);
    }
}

/// Remembers reports, and cancels at one of them.
struct CancelAt {
    number: usize,
    reports: Mutex<Vec<Progress>>,
    cancel: Cancel,
}

impl Listener for CancelAt {
    fn progress(&self, progress: &Progress) {
        let mut reports = self.reports.lock().unwrap();
        if reports.len() == self.number {
            self.cancel.request();
        }
        reports.push(progress.clone());
    }
    fn warning(&self, _: &str) {}
}

#[test]
fn cancelling_works_at_any_report_but_the_last() {
    let folder = tempfile::tempdir().unwrap();
    common::baked(folder.path());
    let relighter = Relighter::open(folder.path()).unwrap();
    let far = LightShape::Sphere { center: Vec3::new(-0.6, 0.3, 0.5), radius: 0.2 };
    let target = picture(&relighter, &[key(), light("Fill", far, [4.0, 6.0, 8.0])]);
    // Behind a wall, so that it is dropped.
    let outside = light("Outside", LightShape::Sphere { center: Vec3::Z * 9.0, radius: 0.2 }, [1.0; 3]);
    let request = target_request(json!({
        "lights": [outside], "free": {"Outside": ["strength"]}, "remove": true, "add": {"count": 2},
        "starts": 2, "steps": 8, "polish": 2, "candidates": 2,
    }));
    let request = SolveRequest::parse(&request.to_string()).unwrap();
    let pictures = Pictures::named(HashMap::from([("target".to_string(), target)]));
    let solve_until = |number: usize| {
        let cancel = Cancel::default();
        let listener = Arc::new(CancelAt { number, reports: Mutex::default(), cancel: cancel.clone() });
        let monitor = Monitor::new(listener.clone(), cancel);
        let result = solve_lights(&[&relighter], &request, &pictures, &monitor, &|_| ());
        (result, std::mem::take(&mut *listener.reports.lock().unwrap()))
    };
    let (whole, reports) = solve_until(usize::MAX);
    assert_eq!(whole.unwrap().removed, ["Outside"]);
    let begins = |stage: Stage| reports.iter().filter(|r| r.stage == stage && r.done == 0).count();
    // Explored, polished, regrouped once at least, which is explored and polished, and polished without what is dropped.
    assert!(begins(Stage::Optimise) >= 2 && begins(Stage::Polish) >= 3, "{reports:?}");
    // After the last one there is nothing left to stop. Each stage has several; all of them would take a minute.
    for (number, report) in reports[..reports.len() - 1].iter().enumerate().step_by(5) {
        let (result, until) = solve_until(number);
        assert!(matches!(result, Err(SessionError::Cancelled)), "{number}, {report:?}: {result:?}");
        assert!(until.len() <= number + 3, "{number}, {report:?}: it went on: {:?}", &until[number..]);
    }
}
