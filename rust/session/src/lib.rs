//! Wires the stages: bake, train, relight, solve; progress and cancel.
//!
//! ```text
//! let monitor = Monitor::new(listener, cancel);                  // progress, warnings, stop
//! bake(&scene, &trace_settings, folder, resume, &monitor)?;      // paths, lights.json
//! train(folder, folder, &train_settings, resume, &Compute::default(), &monitor)?;     // proxy_<kind>.safetensors and how it measured
//! let relighter = Relighter::open(folder)?;                      // a bake, or proxies alone
//! let relit = relighter.relight(&lights, &RelightOptions::default(), &monitor)?;
//! relit.write_exr(path, Precision::Half)?;  relit.write_png(path, &relighter.view(&monitor), BitDepth::Eight)?;
//! solve_lights(&[&relighter], &SolveRequest::parse(json)?, &Pictures::in_folder(folder), &monitor, &|_| ())?.lights
//! ```
//!
//! A bake folder holds the dump (`manifest.json`, `tile_*.safetensors`), the scene's lights ([`LIGHTS_FILE`]), those
//! that its paths look for ([`GUIDED_FILE`]), the light of another world that is shown ([`WORLD_FILE`]), its view transform ([`VIEW_FILE`], if it is not the sRGB curve) and, once
//! trained, for each kind of light
//! `proxy_<kind>.safetensors`, `proxy_<kind>.json` ([`Measured`]), `training_<kind>.safetensors` (to resume from) and
//! `base.exr` (what relighting needs when the dump is not at hand). [`CONTENTS_FILE`] says which of these it should hold
//! ([`lost_files`]). Everything is written atomically; long work checks the
//! cancel flag between units and leaves whole files.

mod bake;
mod base_layers;
mod checksum;
mod contents;
mod damage;
mod denoise;
mod device;
mod device_gather;
mod device_image;
mod device_layers;
mod device_proxies;
mod environment;
mod error;
mod features;
mod folder_lock;
mod guided;
mod inspect;
mod light_set;
pub mod live;
mod measure;
mod obj_scene;
mod on_gpu;
mod progress;
mod proxies;
mod relighter;
mod relit;
mod scene_file;
mod shot_files;
mod sizes;
mod solve;
mod sorting;
mod targets;
#[cfg(test)]
mod test_box;
#[cfg(test)]
mod test_room;
mod threads;
mod train;
mod unit_cache;
mod validate;
mod world_layer;

pub use bake::{BakeReport, LIGHTS_FILE, VIEW_FILE, bake, difference};
pub use contents::{CONTENTS_FILE, lost_files};
pub use denoise::Denoise;
pub use device::{Compute, Device};
pub use environment::environment_texture;
pub use error::SessionError;
pub(crate) use features::seen_points;
pub use features::{pixel_features, pixel_ray};
pub use folder_lock::{LOCK_FILE, folder_in_use};
pub use guided::{GUIDED_FILE, Guided};
pub use inspect::{Info, ProxySummary, info};
pub use light_set::{KnownLights, LightSet};
pub use measure::{Evaluation, evaluate};
pub use obj_scene::{ObjView, obj_scene};
pub use progress::{Cancel, Listener, Monitor, Progress, Stage, StageProgress};
pub use proxies::{MeanQuality, Measured, Proxies, TrainedProxy, proxy_path};
pub use relighter::{Maker, RelightOptions, Relighter, With};
pub use relit::{Relit, RelitLight};
pub use scene_file::{SceneFile, write_scene};
pub use sizes::default_sizes;
use sizes::sizes_with;
pub use solve::{
    Add, Answer, BoundsWish, Freedom, GoalKind, GoalReport, GoalWish, NewKind, Own, Pictures, Preview,
    ProxyRelight, RegionWish, SoFar, SolveRequest, Solved, Through, Wish, solve_lights,
};
pub use targets::{DumpTargets, GpuTargets};
use threads::beside_window;
pub use threads::{in_background, on_threads};
pub use train::{Clock, CurvePoint, TrainReport, TrainSettings, train};
pub use validate::validate;
pub use world_layer::{WORLD_FILE, WorldAbout};

pub use relume_gpu as gpu;
pub use relume_image as image;
pub use relume_optimise as solver;
pub use relume_proxy as proxy;
pub use relume_scene as scene;
pub use relume_trace as trace;
