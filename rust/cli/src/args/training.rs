//! Arguments of trainings and of what measures them.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

#[derive(Args, Debug)]
pub struct TrainArgs {
    /// Bake folder.
    pub bake: PathBuf,
    /// Type of light.
    #[arg(long = "type", value_enum, default_value = "sphere")]
    pub kind: LightKindArg,
    /// Network.
    #[arg(long, value_enum, default_value = "fast")]
    pub network: NetworkArg,
    /// Folder for the proxy; default is the bake folder.
    #[arg(long, short)]
    pub out: Option<PathBuf>,
    /// Go on with an interrupted training.
    #[arg(long)]
    pub resume: bool,
    /// Millions of samples (pixel and light) to train on.
    #[arg(long, default_value_t = 32.0)]
    pub million_samples: f64,
    /// Train for so many seconds instead; the schedule is stretched to end with them.
    #[arg(long)]
    pub seconds: Option<f64>,
    /// Let --seconds count processor time per thread, so that other load on the machine does not change the result much.
    #[arg(long, requires = "seconds")]
    pub processor_time: bool,
    /// Smallest radius or edge to learn, metres; default is 1/200 (edges 1/50) of the visible scene, or less for its
    /// own lights.
    #[arg(long)]
    pub size_min: Option<f32>,
    /// Largest radius or edge to learn, metres; default is 1/10 (edges 1/5) of the visible scene, or more for its own
    /// lights.
    #[arg(long)]
    pub size_max: Option<f32>,
    /// Placement of training lights.
    #[arg(long, value_enum, default_value = "segments")]
    pub placement: PlacementArg,
    /// Draw targets from a pool of so many denoised pictures (300 in the paper) instead of gathering each by itself.
    #[arg(long)]
    pub pool: Option<usize>,
    /// Neurons of a hidden layer; default is the network's own.
    #[arg(long)]
    pub neurons: Option<usize>,
    /// Hidden layers; default is the network's own.
    #[arg(long)]
    pub layers: Option<usize>,
    /// Use all paths as targets, and leave none to measure the error on: relighting then gathers unless told otherwise.
    #[arg(long)]
    pub all_paths: bool,
}

#[derive(Args, Debug)]
pub struct EvaluateArgs {
    /// Proxy files of one type of light and range of sizes.
    #[arg(required = true)]
    pub proxies: Vec<PathBuf>,
    /// Bake folder of the same camera, of another seed and with many more samples. Lights are connected where it holds its
    /// scene, and denoised.
    #[arg(long)]
    pub reference: PathBuf,
    /// Bake folder whose gather, raw and denoised, is measured on the same lights.
    #[arg(long)]
    pub gather: Option<PathBuf>,
    /// Folder for PNGs of a few lights: reference, gather (raw, denoised), proxies, side by side.
    #[arg(long)]
    pub pictures: Option<PathBuf>,
    /// Held-out lights.
    #[arg(long, default_value_t = 100)]
    pub lights: usize,
}

/// Light types that a proxy can learn.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum LightKindArg {
    /// Point light without soft falloff.
    Sphere,
    /// Point light with soft falloff, Blender's default.
    FacingDisk,
    /// Square or rectangular area light.
    Quad,
    /// Disk or elliptical area light.
    Ellipse,
    /// Spot light with soft falloff, Blender's default.
    Spot,
    /// Spot light without soft falloff.
    SphereSpot,
}

/// Networks.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum NetworkArg {
    /// Factorised, with analytic features.
    Fast,
    /// The paper's.
    Reference,
}

/// Placement of training lights.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PlacementArg {
    /// Random path segments.
    Segments,
    /// Box of all visible positions.
    Bounds,
}
