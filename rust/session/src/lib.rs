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
pub mod bench;
mod device;
mod error;
mod files;
pub mod live;
mod progress;
mod relight;
mod solve;
#[cfg(test)]
mod test_room;
mod train;

pub use bake::features::{pixel_features, pixel_ray};
pub use bake::guiding::GuidingRecord;
pub use bake::world::WorldAbout;
pub use bake::{BakeReport, bake, difference};
pub use device::compute::{Compute, Device};
pub use device::threads::{in_background, on_threads};
pub use error::SessionError;
pub use files::contents::lost_files;
pub use files::environment::environment_texture;
pub use files::folder_lock::folder_in_use;
pub use files::inspect::{Info, ProxySummary, info};
pub use files::light_set::{LightSet, ParsedLight};
pub use files::names::{
    CONTENTS_FILE, GUIDED_FILE, LIGHTS_FILE, LOCK_FILE, VIEW_FILE, WORLD_FILE, proxy_path,
};
pub use files::obj_scene::{ObjView, obj_scene};
pub use files::proxies::{MeanQuality, Measured, Proxies, TrainedProxy};
pub use files::scene_file::{SceneFile, write_scene};
pub use files::validate::validate;
pub use progress::{Cancel, Listener, Monitor, Progress, Stage, StageProgress};
pub use relight::denoise::Denoise;
pub use relight::relighter::{RelightOptions, Relighter};
pub use relight::relit::{Relit, RelitLight};
pub use relight::source::{Method, UnitSource};
pub use solve::{
    Add, Answer, BoundsWish, Freedom, GoalKind, GoalReport, GoalWish, NewKind, Own, Pictures, Preview,
    RegionWish, SoFar, SolveRequest, Solved, Through, Wish, solve_lights,
};
pub use train::measure::{Evaluation, evaluate};
pub use train::sizes::default_sizes;
pub use train::targets::{DumpTargets, GpuTargets};
pub use train::{Clock, CurvePoint, TrainReport, TrainSettings, train};

pub use relume_gpu as gpu;
pub use relume_image as image;
pub use relume_optimise as solver;
pub use relume_proxy as proxy;
pub use relume_scene as scene;
pub use relume_trace as trace;
