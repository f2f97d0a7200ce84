//! Wires the stages: bake, train, relight, solve; progress and cancel.
//!
//! ```text
//! let monitor = Monitor::new(listener, cancel);                  // progress, warnings, stop
//! bake(&scene, &trace_settings, folder, resume, &monitor)?;      // paths, lights.json
//! train(folder, folder, &train_settings, resume, &Compute::default(), &monitor)?;     // proxy_<kind>.safetensors and how it measured
//! let relighter = Relighter::open(folder)?;                      // a bake, or proxies alone
//! let relit = relighter.relight(&lights, &RelightOptions::default(), &monitor)?;
//! relit.write_exr(path, ExrLayout::Blender, Precision::Half)?;  relit.write_png(path, &relighter.view(&monitor), BitDepth::Eight)?;
//! solve_lights(&[&relighter], &SolveRequest::parse(json)?, &Pictures::in_folder(folder), &monitor, &|_| ())?.lights
//! ```
//!
//! A bake folder holds the dump (`manifest.json`, `tile_*.safetensors`) and small files beside it. Those are the lights
//! of the scene ([`LIGHTS_FILE`]), lights that the paths are guided towards ([`GUIDED_FILE`]), another world
//! ([`WORLD_FILE`]), and the view transform ([`VIEW_FILE`]). A training adds `proxy_<kind>.safetensors` for each kind
//! of light, its errors `proxy_<kind>.json` ([`Measured`]), and its state `training_<kind>.safetensors`. It also writes
//! `base.exr`, which proxies need to relight without the dump. [`CONTENTS_FILE`] lists the files that the folder should
//! hold ([`lost_files`]). Everything is written atomically; long work checks the cancel flag between units and leaves
//! whole files.

mod bake;
mod data_passes;
mod device;
mod error;
mod farm;
mod files;
pub mod live;
mod progress;
mod relight;
mod solve;
#[cfg(test)]
mod test_box;
#[cfg(test)]
mod test_room;
#[cfg(test)]
mod test_warnings;
mod train;

pub use bake::features::pixel_features;
pub use bake::guiding::GuidingRecord;
pub use bake::world::WorldAbout;
pub use bake::{BakeReport, bake, difference};
pub use data_passes::data_passes;
pub use device::compute::{Compute, Device};
pub use device::threads::{in_background, on_threads};
pub use error::SessionError;
pub use farm::{
    CollectedBake, MOST_PARTS, PLAN_FILE, Plan, PlannedBake, Shot, WorkReport, collect, plan, work,
};
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
pub use files::shot_list::{ListedShot, ShotList};
pub use files::validate::validate;
pub use progress::{Cancel, Listener, Monitor, Progress, Stage, StageProgress};
pub use relight::denoise::Denoise;
pub use relight::film::CatcherPlace;
pub use relight::options::{PictureMix, RelightOptions};
pub use relight::relighter::{OpenScenes, Relighter};
pub use relight::relit::{ExrLayout, Relit, RelitLight};
pub use relight::source::{Method, UnitSource};
pub use solve::{
    Answer, Backend, BoundsOptions, FreeParam, GoalKind, GoalRegion, GoalReport, GoalRequest, InterimLights,
    NewLightKind, NewLights, PerLightOptions, Pictures, Preview, ProxyRelight, SolveOptions, SolveRequest,
    Solved, solve_lights,
};
pub use train::measure::{Evaluation, evaluate};
pub use train::settings::{Clock, CurvePoint, TrainReport, TrainSettings};
pub use train::sizes::default_sizes;
pub use train::targets::{DumpTargets, GpuTargets};
pub use train::train;

pub use relume_gather::LobePart;
pub use relume_gpu as gpu;
pub use relume_image as image;
pub use relume_optimise as solver;
pub use relume_proxy as proxy;
pub use relume_scene as scene;
pub use relume_trace as trace;
