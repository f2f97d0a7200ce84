//! Networks that learn the gather of one light type (paper, sections 3.2, 4.3 and 4.4).
//!
//! A trainer asks a [`TargetSource`] what lights do to pixels; it never sees a dump. Who wires the stages implements
//! that trait and builds [`PixelFeatures`] from the AOVs and the camera:
//!
//! ```text
//! let config = TrainConfig::fast(SizeRange { min: 0.05, max: 0.5 });
//! let mut trainer = Trainer::new(Arc::new(features), LightKind::Sphere, config, seed)?;   // checks everything
//! while !trainer.done() {                                                                 // cancel between steps
//!     let report = trainer.step(&source)?;           // StepReport { step, samples, loss, learning-rate share }
//! }
//! let scores = trainer.validate(&source)?;           // Scores { psnr, smape } on held-out lights
//! let proxy: Proxy = trainer.proxy();                // usable at any moment
//! proxy.forward(&light, &mut rgb)?;                  // rgb: &mut [[f32; 3]], a whole unit image
//! proxy.forward_pixels(&pixels, &light, &mut rgb)?;  // or some pixels
//! let d_light = proxy.backward(&pixels, &light, &d_rgb)?;   // Vec<f32>, d loss / d LightParams::as_slice()
//! trainer.save(&path)?;   Trainer::resume(&path, features)?;   // bit-identical to never having stopped
//! proxy.save(&path)?;     Proxy::open(&path)?;
//! ```
//!
//! Units are metres and radiance 1: the caller multiplies a unit image by the light's radiance and factors.

mod analytic;
mod config;
mod encoding;
mod error;
mod features;
mod gradient;
mod grid;
mod head;
mod light;
mod loss;
mod mlp;
mod network;
mod params;
mod pixels;
mod rng;
mod scene_cache;
mod simd;
pub mod synthetic;
mod target;

pub use config::{GridConfig, LearningRates, LightPlacement, NetworkConfig, TargetMode, TrainConfig};
pub use error::ProxyError;
pub use light::{LightKind, LightParams, MAX_PARAMS, SizeRange};
pub use pixels::PixelFeatures;
pub use rng::Rng;
pub use target::{PixelQueries, TargetSource};
