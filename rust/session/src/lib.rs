//! Wires the stages: bake, train, relight, optimise; progress and cancel.

mod bake;
mod base_layers;
pub mod bench;
mod denoise;
mod environment;
mod error;
mod features;
mod inspect;
mod light_set;
mod measure;
mod obj_scene;
mod progress;
mod proxies;
mod relighter;
mod relit;
mod solve_lights;
mod targets;
mod train;
mod unit_cache;

pub use bake::{BakeReport, LIGHTS_FILE, VIEW_FILE, bake};
pub use denoise::Denoise;
pub use environment::environment_texture;
pub use error::SessionError;
pub use features::{pixel_features, pixel_ray};
pub use inspect::{Info, ProxySummary, info, validate};
pub use light_set::LightSet;
pub use measure::evaluate;
pub use obj_scene::{ObjView, obj_scene};
pub use progress::{Cancel, Listener, Monitor, Progress, Stage, StageProgress};
pub use proxies::{MeanQuality, Measured, Proxies, TrainedProxy, proxy_path};
pub use relighter::{Maker, RelightOptions, Relighter, With};
pub use relit::{Relit, RelitLight};
pub use solve_lights::{OptimiseOptions, Optimised, ProxyRelight, optimise};
pub use targets::DumpTargets;
pub use train::{CurvePoint, TrainReport, TrainSettings, train};

pub use relume_image as image;
pub use relume_optimise as solver;
pub use relume_proxy as proxy;
pub use relume_scene as scene;
pub use relume_trace as trace;
