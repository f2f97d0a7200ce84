//! Solving by the first passes of a live shot while later ones are traced.

use crate::cancelling::StopAt;
use crate::room::{Bakes, inside, key, picture, room};
use relume_session::live::{Live, LiveOptions, LiveState};
use relume_session::scene::Light;
use relume_session::trace::TraceSettings;
use relume_session::{
    Cancel, Device, Listener, Monitor, Pictures, Progress, Relighter, SessionError, SolveRequest, Solved,
    Stage, solve_lights,
};
use serde_json::json;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// More paths than are traced in minutes.
const ENDLESS: u32 = 1 << 20;
/// Samples that solving begins with.
const FIRST: u32 = 16;

/// A bake of the room that goes on, once there are the first paths of each pixel.
fn growing(folder: &Path) -> Live {
    let live = Live::new(folder, LiveOptions { device: Device::Cpu, threads: 1, ..LiveOptions::default() });
    let settings = TraceSettings { samples: ENDLESS, ..TraceSettings::default() };
    live.bake(Arc::new(room(0.0, [0.0; 3])), settings, 0.0, false).unwrap();
    more_than(&live, FIRST - 1);
    live
}

/// Waits for more paths per pixel than that.
fn more_than(live: &Live, samples: u32) {
    let begin = Instant::now();
    while live.status().samples <= samples {
        assert!(begin.elapsed() < Duration::from_secs(60), "no more passes: {:?}", live.status());
        sleep(Duration::from_millis(2));
    }
}

/// Looks for a hidden light in the paths that are there.
fn solved(folder: &Path, monitor: &Monitor) -> Result<Solved, SessionError> {
    let target = picture(&Bakes::open().other, &[key()]);
    let away = Light { shape: key().shape.moved(&[-0.5, 0.3, -0.3, 0., 0., 0., 0., 0., 0., 0.]), ..key() };
    let request = json!({
        "lights": [away], "free": {"Key": ["position", "color", "strength"]}, "bounds": inside(),
        "goals": [{"goal": "target", "image": "target"}], "starts": 2,
    });
    let request = SolveRequest::parse(&request.to_string()).unwrap();
    let pictures = Pictures::named(HashMap::from([("target".to_string(), target)]));
    solve_lights(&[&Relighter::open(folder)?], &request, &pictures, monitor, &|_| ())
}

fn assert_found(solved: &Solved) {
    let found = &solved.lights.lights[0];
    let miss = found.shape.center().unwrap().distance(key().shape.center().unwrap());
    let factor = found.radiance[0] / key().radiance[0];
    assert!(miss < 0.15 && (0.85..1.15).contains(&factor), "{miss} m, {factor}: {found:?}");
}

#[test]
fn a_light_is_found_by_the_first_passes_while_later_ones_arrive() {
    let folder = tempfile::tempdir().unwrap();
    let live = growing(folder.path());
    let before = live.status().samples;
    assert_found(&solved(folder.path(), &Monitor::default()).unwrap());
    more_than(&live, before);
    assert_eq!(live.status().state, LiveState::Baking);
}

#[test]
fn a_cancelled_solve_does_not_end_the_bake() {
    let folder = tempfile::tempdir().unwrap();
    let live = growing(folder.path());
    let cancel = Cancel::default();
    let monitor = Monitor::new(Arc::new(StopAt(Mutex::new(3), cancel.clone())), cancel);
    let result = solved(folder.path(), &monitor);
    assert!(matches!(result, Err(SessionError::Cancelled)), "{result:?}");
    more_than(&live, live.status().samples);
    assert_eq!(live.status().state, LiveState::Baking);
}

/// Ends a bake at the first step of a solve.
struct EndsBake(Arc<Live>);

impl Listener for EndsBake {
    fn progress(&self, progress: &Progress) {
        if progress.stage == Stage::Optimise && progress.done > 0 {
            self.0.cancel();
        }
    }
    fn warning(&self, _: &str) {}
}

#[test]
fn a_cancelled_bake_does_not_end_the_solve() {
    let folder = tempfile::tempdir().unwrap();
    let live = Arc::new(growing(folder.path()));
    let monitor = Monitor::new(Arc::new(EndsBake(live.clone())), Cancel::default());
    assert_found(&solved(folder.path(), &monitor).unwrap());
    let begin = Instant::now();
    while live.status().state == LiveState::Baking && begin.elapsed() < Duration::from_secs(60) {
        sleep(Duration::from_millis(2));
    }
    assert_eq!(live.status().state, LiveState::Cancelled);
}
