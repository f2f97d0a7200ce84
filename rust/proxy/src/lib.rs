//! Networks that learn the gather of one light type (paper, sections 3.2, 4.3 and 4.4).
//!
//! A trainer asks a [`TargetSource`] what lights do to pixels; it never sees a dump. Who wires the stages implements
//! that trait and builds [`PixelFeatures`] from the AOVs and the camera:
//!
//! ```
//! # use std::sync::Arc;
//! # use relume_proxy::{LightKind, LightParams, Proxy, ProxyError, SizeRange, TrainConfig, Trainer};
//! # fn main() -> Result<(), ProxyError> {
//! # let source = relume_proxy::synthetic::SyntheticRoom::new(32, 20);
//! # let features = source.features();
//! # let folder = tempfile::tempdir().expect("a folder");
//! # let path = folder.path().join("training.safetensors");
//! # let proxy_path = folder.path().join("proxy.safetensors");
//! let config = TrainConfig { samples: 8192, ..TrainConfig::fast(SizeRange { min: 0.05, max: 0.5 }) };
//! let mut trainer = Trainer::new(Arc::new(features), LightKind::Sphere, config, 1)?;
//! while !trainer.done() {
//!     let report = trainer.step(&source)?; // step, samples, progress, loss; cancel or save in between
//! }
//! let scores = trainer.validate(&source)?; // PSNR and SMAPE on lights that training never sees
//! trainer.save(&path)?;
//! let trainer = Trainer::resume(&path)?; // goes on bit for bit as if it had never stopped
//!
//! let proxy: Proxy = trainer.proxy()?; // usable at any moment; cheap to clone
//! let light = LightParams::round(LightKind::Sphere, glam::Vec3::new(0.0, 0.0, 1.0), 0.2);
//! let image = proxy.unit_image(&light)?; // or forward(&light, &mut rgb), forward_pixels(&pixels, ..)
//! let pixels = [5, 17];
//! let d_light = proxy.backward(&pixels, &light, &[[1.0; 3]; 2])?; // by LightParams::as_slice()
//! proxy.save(&proxy_path)?;
//! let proxy = Proxy::open(&proxy_path)?;
//! # Ok(())
//! # }
//! ```
//!
//! Lengths are metres and unit images are for radiance 1: the caller multiplies by the light's radiance and factors.

mod analytic;
mod checkpoint;
mod config;
mod encoded;
mod encoding;
mod error;
mod evaluate;
mod features;
mod gpu;
mod gradient;
mod grid;
mod head;
mod light;
mod loss;
mod mlp;
mod network;
mod optim;
mod params;
mod pixel_codes;
mod pixels;
mod pool;
mod proxy;
mod replay;
mod rng;
mod sampling;
mod scene_cache;
mod schedule;
mod simd;
mod snapshot;
#[doc(hidden)]
pub mod synthetic;
mod target;
mod trainer;

pub use checkpoint::{fuzz_open, read_info};
pub use config::{GridConfig, LearningRates, LightPlacement, NetworkConfig, TargetMode, TrainConfig};
pub use encoding::OutputScale;
pub use error::ProxyError;
pub use gpu::{GpuProxy, LightGradient, ProxyCompared, compare};
pub use gradient::Batch;
pub use light::{HALF_ANGLES, LightKind, LightParams, MAX_PARAMS, SizeRange, random_light};
pub use pixels::PixelFeatures;
pub use proxy::{Proxy, ProxyInfo, Scores};
pub use rng::Rng;
pub use scene_cache::Normalisation;
pub use simd::Isa;
pub use snapshot::Snapshot;
pub use target::{DeviceTargets, GroupQueries, PixelQueries, TargetSource};
pub use trainer::{StepReport, Trainer};
