//! A small bake and its proxies.

#![allow(dead_code, reason = "each test file uses a part of it")]

#[path = "../../src/test_room.rs"]
mod test_room;

use std::path::Path;
use std::sync::Mutex;

use glam::Vec3;
use relume_session::proxy::{LightKind, SizeRange, TrainConfig};
use relume_session::scene::{Light, LightShape, Scene};
use relume_session::trace::TraceSettings;
use relume_session::{
    Clock, Compute, Listener, Method, Monitor, ObjView, Progress, RelightOptions, TrainReport, TrainSettings,
    bake, obj_scene, train,
};

pub use test_room::room;

/// A small lit bake in a folder.
pub fn baked(folder: &Path) {
    baked_with(folder, |_| ());
}

/// Room before a camera of few pixels, as its file has it.
pub fn room_scene() -> Scene {
    let view = ObjView {
        up: relume_session::scene::UpAxis::Z,
        eye: Some(Vec3::new(0.0, -4.2, 1.0)),
        target: Some(Vec3::Z),
        width: 20,
        height: 16,
        ..ObjView::default()
    };
    obj_scene(&room(), &view).unwrap()
}

/// [`baked`] of a changed scene.
pub fn baked_with(folder: &Path, change: impl FnOnce(&mut Scene)) {
    let mut scene = room_scene();
    scene.lights = vec![sphere("Own", 0.2)];
    change(&mut scene);
    let settings = TraceSettings { samples: 16, ..TraceSettings::default() };
    bake(&scene, &settings, folder, false, &Monitor::default()).unwrap();
}

/// A light in the room.
pub fn sphere(name: &str, radius: f32) -> Light {
    Light {
        name: name.into(),
        radiance: [2.0, 1.0, 0.5],
        ..Light::unit(LightShape::Sphere { center: Vec3::new(0.2, 0.1, 1.3), radius })
    }
}

/// A short training.
pub fn training(kind: LightKind) -> TrainSettings {
    let mut config = TrainConfig::fast(SizeRange { min: 0.1, max: 0.3 });
    config.samples = 8192;
    config.held_out = 2;
    TrainSettings { kind, config, seed: 1, seconds: None, clock: Clock::Wall, half_for_measuring: true }
}

/// Trains on the CPU, from the start.
pub fn trained(bake: &Path, out: &Path, kind: LightKind) -> TrainReport {
    train(bake, out, &training(kind), false, &Compute::default(), &Monitor::default()).unwrap()
}

/// Options without a denoiser.
pub const RAW: RelightOptions = RelightOptions { method: Method::Auto, denoise: false, lobes: false };

/// Remembers warnings that matter.
#[derive(Debug, Default)]
pub struct Warnings(pub Mutex<Vec<String>>);

/// True if a warning is about the subject of a test. Builds for bare machines (`scripts/gpu-check`) warn of a missing
/// denoiser.
pub fn matters(warning: &str) -> bool {
    !warning.contains("has no denoiser")
}

impl Listener for Warnings {
    fn progress(&self, _: &Progress) {}
    fn warning(&self, message: &str) {
        if matters(message) {
            self.0.lock().unwrap().push(message.into());
        }
    }
}
