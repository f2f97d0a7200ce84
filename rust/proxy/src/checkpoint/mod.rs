//! Files of proxies and of trainings: `safetensors`, with one JSON header under the metadata key `relume_proxy`.
//!
//! | tensor | shape | meaning |
//! |---|---|---|
//! | `features.albedo`, `.normal`, `.depth` | bytes | [`PixelFeatures`], each a PNG of codes (`src/pixel_codes.rs`); positions follow from the header's camera |
//! | `net.<name>` | rows, cols | weights that the proxy is made of, 16 bits |
//! | `train.params.<name>`, `.mean`, `.first`, `.second` | rows, cols | state of a training, 32 bits; only in its files |
//!
//! A training's file is a proxy's file with more in it. A checksum over header and tensors finds every damage.

mod read;
mod write;

use std::path::Path;
use std::sync::Arc;

use relume_scene::Camera;
use serde::{Deserialize, Serialize};

use crate::proxy::ProxyInfo;
use crate::trainer::TrainState;
use crate::{LightParams, PixelFeatures, Proxy, ProxyError, TrainConfig, Trainer};

/// Metadata key of the header.
const HEADER_KEY: &str = "relume_proxy";
/// Version of the format. Raise it when a reader of the old one would misread a new file.
const FORMAT_VERSION: u32 = 3;

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Header {
    format_version: u32,
    /// BLAKE3 of the header without this field and of all tensors, hexadecimal.
    checksum: String,
    info: ProxyInfo,
    camera: Camera,
    #[serde(skip_serializing_if = "Option::is_none")]
    training: Option<TrainingHeader>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct TrainingHeader {
    config: TrainConfig,
    seed: u64,
    calibrated: bool,
}

/// Contents of a file.
struct CheckpointContents {
    info: ProxyInfo,
    features: PixelFeatures,
    weights: Vec<f32>,
    training: Option<(TrainingHeader, TrainState)>,
}

impl Proxy {
    /// Writes the proxy, with the pixels that it needs, so that the file is complete in itself. A reader never sees half
    /// of it.
    ///
    /// # Errors
    /// [`ProxyError::Io`]; an older file at `path` is then still there.
    pub fn save(&self, path: &Path) -> Result<(), ProxyError> {
        write::save(path, self.info(), self.features(), self.layout(), self.params(), None)
    }

    /// Reads a proxy, or the proxy in a training's file.
    ///
    /// # Errors
    /// [`ProxyError::Io`] or [`ProxyError::Format`], which says what is wrong.
    pub fn open(path: &Path) -> Result<Self, ProxyError> {
        let contents = read::open(path)?;
        Ok(Self::new(contents.info, Arc::new(contents.features), contents.weights))
    }
}

impl Trainer {
    /// Writes the whole state of the training, and the proxy as it stands.
    ///
    /// # Errors
    /// [`ProxyError::Io`], or [`ProxyError::Gpu`] if the training was on a device that was lost; an older file at `path` is then still there.
    pub fn save(&self, path: &Path) -> Result<(), ProxyError> {
        let header = TrainingHeader {
            config: self.config.clone(),
            seed: self.seed,
            calibrated: self.state.output_scale.is_some(),
        };
        let state = self.whole_state()?;
        let (weights, training) = (self.proxy_params(&state), Some((&header, &*state)));
        write::save(path, &self.info(), &self.features, self.layout(), weights, training)
    }

    /// Goes on with a saved training. With the same source and seed the weights come out as if it had never stopped.
    ///
    /// # Errors
    /// [`ProxyError::Io`] or [`ProxyError::Format`]; also if the file holds a proxy only.
    pub fn resume(path: &Path) -> Result<Self, ProxyError> {
        let contents = read::open(path)?;
        Self::from_contents(contents)?.ok_or_else(|| {
            let reason = "a finished proxy, not a training; train a new one or open it as a proxy".to_owned();
            ProxyError::Format { path: path.display().to_string(), reason }
        })
    }

    /// `None` without a training.
    fn from_contents(contents: CheckpointContents) -> Result<Option<Self>, ProxyError> {
        let Some((header, state)) = contents.training else { return Ok(None) };
        let mut trainer =
            Self::new(Arc::new(contents.features), contents.info.kind, header.config, header.seed)?;
        trainer.set_scene_hash(contents.info.scene_hash);
        trainer.restore(state);
        Ok(Some(trainer))
    }
}

/// Reads what a file says of itself, without its weights and pixels being used.
///
/// # Errors
/// [`ProxyError::Io`] or [`ProxyError::Format`].
pub fn read_info(path: &Path) -> Result<ProxyInfo, ProxyError> {
    read::open(path).map(|contents| contents.info)
}

/// Entry point for fuzzing: reads bytes as a file, uses the proxy and starts the training that are in it, and must neither
/// panic nor allocate without measure.
pub fn fuzz_open(bytes: &[u8]) -> bool {
    let Ok(contents) = read::decode(bytes) else { return false };
    let CheckpointContents { info, features, weights, .. } = &contents;
    let proxy = Proxy::new(info.clone(), Arc::new(features.clone()), weights.clone());
    let params = [0.5; crate::MAX_PARAMS];
    if let Some(light) = LightParams::from_slice(info.kind, &params[..info.kind.param_count()]) {
        let _ = proxy.unit_image(&light);
    }
    Trainer::from_contents(contents).is_ok()
}

#[cfg(test)]
mod tests;
