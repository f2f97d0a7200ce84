use std::path::Path;

use safetensors::SafeTensors;
use safetensors::tensor::Dtype;

use super::write::{checksum, format_error};
use super::{CheckpointContents, FORMAT_VERSION, HEADER_KEY, Header};
use crate::encoding::LightEncoding;
use crate::network::{FastNetwork, Network, ReferenceNetwork};
use crate::optim::Optimiser;
use crate::params::ParamLayout;
use crate::proxy::ProxyInfo;
use crate::trainer::TrainState;
use crate::{NetworkConfig, PixelFeatures, ProxyError};

pub(super) fn open(path: &Path) -> Result<CheckpointContents, ProxyError> {
    let bytes =
        std::fs::read(path).map_err(|source| ProxyError::Io { path: path.display().to_string(), source })?;
    decode(&bytes).map_err(|reason| format_error(path, reason))
}

/// Reads a file's bytes; every size is checked before it is used.
pub(super) fn decode(bytes: &[u8]) -> Result<CheckpointContents, String> {
    let damaged = |error| format!("damaged or no proxy ({error}); train it again or restore the file");
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
    let json = metadata.metadata().as_ref().and_then(|m| m.get(HEADER_KEY));
    let json = json.ok_or("a safetensors file, but not a Relume proxy; choose another file")?;
    let header = parse_header(json)?;
    let tensors = SafeTensors::deserialize(bytes).map_err(damaged)?;

    let views: Vec<_> = tensors.iter().collect();
    let plain = json.replacen(&header.checksum, "", 1);
    let found = checksum(&plain, views.iter().map(|(name, view)| (*name, view.shape(), view.data())));
    // A fuzzer never guesses a checksum, and would not get past it.
    if found != header.checksum && !cfg!(fuzzing) {
        return Err(
            "damaged: its checksum does not fit its contents; train it again or restore the file".into()
        );
    }
    check_info(&header.info)?;
    let [width, height] = header.info.image;
    let features = read_features(&tensors, width, height)?;
    let layout = layout_of(&header.info);
    let weights = read_params(&tensors, "net.", &layout)?;
    let training = match header.training {
        None => None,
        Some(training) => {
            training.config.validate(header.info.kind).map_err(|error| error.to_string())?;
            if training.config.network != header.info.network || training.config.size != header.info.size {
                return Err("the training's configuration does not fit its network; train it again".into());
            }
            let mut optimiser = Optimiser::new(&layout, training.config.muon);
            optimiser.first = read_params(&tensors, "train.first.", &layout)?;
            optimiser.second = read_params(&tensors, "train.second.", &layout)?;
            let state = TrainState {
                params: read_params(&tensors, "train.params.", &layout)?,
                mean: read_params(&tensors, "train.mean.", &layout)?,
                optimiser,
                step: header.info.steps,
                samples: header.info.samples,
                output_scale: training.calibrated.then_some(header.info.output_scale),
                trained_ranges: header.info.trained_ranges.clone(),
                scores: header.info.held_out,
            };
            Some((training, state))
        }
    };
    Ok(CheckpointContents { info: header.info, features, weights, training })
}

fn parse_header(json: &str) -> Result<Header, String> {
    #[derive(serde::Deserialize)]
    struct Version {
        format_version: u32,
    }
    let damaged = |error: serde_json::Error| format!("its header is damaged ({error}); train it again");
    let version = serde_json::from_str::<Version>(json).map_err(damaged)?.format_version;
    if version != FORMAT_VERSION {
        return Err(format!(
            "written in format {version}, but this Relume reads format {FORMAT_VERSION}; use the version of Relume \
             that wrote it, or train it again"
        ));
    }
    serde_json::from_str(json).map_err(damaged)
}

/// Checks what later sizes and divisions rest on.
fn check_info(info: &ProxyInfo) -> Result<(), String> {
    info.network.validate()?;
    let [width, height] = info.image;
    let n = &info.normalisation;
    let positive = |x: f32| x.is_finite() && x > 0.0;
    let checks = [
        (width.checked_mul(height).is_some_and(|n| n > 0 && n <= u32::MAX as usize), "image size"),
        (positive(info.size.min) && positive(info.size.max) && info.size.min <= info.size.max, "light sizes"),
        (n.center.iter().all(|x| x.is_finite()) && positive(n.scale) && positive(n.depth), "normalisation"),
        (positive(info.output_scale.factor) && info.output_scale.area.is_none_or(positive), "output scale"),
        (
            matches!(info.trained_ranges.len(), 0) || info.trained_ranges.len() == info.kind.param_count(),
            "ranges",
        ),
    ];
    match checks.iter().find(|(ok, _)| !ok) {
        Some((_, what)) => Err(format!("its {what} makes no sense; train it again")),
        None => Ok(()),
    }
}

fn layout_of(info: &ProxyInfo) -> ParamLayout {
    let light = LightEncoding::new(info.kind, info.normalisation, info.size);
    match &info.network {
        NetworkConfig::Reference { width, layers, grid } => {
            ReferenceNetwork::new(*width, *layers, grid, info.image, light).layout().clone()
        }
        NetworkConfig::Fast { width, layers, grid } => {
            FastNetwork::new(*width, *layers, grid, info.image, light).layout().clone()
        }
    }
}

fn read_features(tensors: &SafeTensors<'_>, width: usize, height: usize) -> Result<PixelFeatures, String> {
    let triple = |name: &str| -> Result<Vec<[f32; 3]>, String> {
        let values = read_tensor(tensors, &format!("features.{name}"), &[height, width, 3])?;
        Ok(values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    };
    let features = PixelFeatures {
        width,
        height,
        albedo: triple("albedo")?,
        normal: triple("normal")?,
        depth: read_tensor(tensors, "features.depth", &[height, width])?,
        position: triple("position")?,
        wo: triple("wo")?,
    };
    features.validate().map_err(|error| error.to_string())?;
    Ok(features)
}

/// Reads all parameters with a prefix into the layout. Sizes are checked tensor by tensor before anything as large as
/// the layout is allocated.
fn read_params(tensors: &SafeTensors<'_>, prefix: &str, layout: &ParamLayout) -> Result<Vec<f32>, String> {
    let mut parts = Vec::with_capacity(layout.tensors.len());
    for tensor in &layout.tensors {
        parts.push(read_tensor(tensors, &format!("{prefix}{}", tensor.name), &[tensor.rows, tensor.cols])?);
    }
    let mut params = vec![0.0; layout.len];
    for (tensor, part) in layout.tensors.iter().zip(parts) {
        for (row, values) in params[tensor.range()].chunks_mut(tensor.stride).zip(part.chunks(tensor.cols)) {
            row[..tensor.cols].copy_from_slice(values);
        }
    }
    Ok(params)
}

fn read_tensor(tensors: &SafeTensors<'_>, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
    let view = tensors.tensor(name).map_err(|_| format!("tensor {name} is missing; train it again"))?;
    if view.dtype() != Dtype::F32 || view.shape() != shape {
        let (dtype, found) = (view.dtype(), view.shape());
        return Err(format!("tensor {name} is {dtype:?} {found:?} instead of F32 {shape:?}; train it again"));
    }
    let value = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let values: Vec<f32> = view.data().chunks_exact(4).map(value).collect();
    if let Some(index) = values.iter().position(|v| !v.is_finite()) {
        return Err(format!("value {index} of tensor {name} is not finite; train it again"));
    }
    Ok(values)
}
