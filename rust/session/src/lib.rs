//! Wires the stages: bake, train, relight, optimise; progress and cancel.

mod bake;
mod error;
mod features;
mod light_set;
mod obj_scene;
mod progress;

pub use bake::{BakeReport, LIGHTS_FILE, VIEW_FILE, bake};
pub use error::SessionError;
pub use features::{pixel_features, pixel_ray};
pub use light_set::LightSet;
pub use obj_scene::{ObjView, obj_scene};
pub use relume_scene as scene;
pub use relume_trace as trace;

pub use progress::{Cancel, Listener, Monitor, Progress, Stage, StageProgress};
