use std::path::Path;

use half::f16;
use relume_scene::Camera;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};

use super::write::{checksum, format_error};
use super::{CheckpointContents, FORMAT_VERSION, HEADER_KEY, Header};
use crate::encoding::LightEncoding;
use crate::network::{FastNetwork, Network, ReferenceNetwork};
use crate::optim::Optimiser;
use crate::params::ParamLayout;
use crate::pixel_codes::{ALBEDO, CodeKind, CodedImage, DEPTH, NORMAL};
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
    if (header.camera.width, header.camera.height) != (width, height) {
        return Err("its camera sees another picture; train it again".into());
    }
    let features = read_features(&tensors, &header.camera)?;
    let layout = layout_of(&header.info);
    let weights = read_params(&tensors, "net.", &layout, Dtype::F16)?;
    let training = match header.training {
        None => None,
        Some(training) => {
            training.config.validate(header.info.kind).map_err(|error| error.to_string())?;
            if training.config.network != header.info.network || training.config.size != header.info.size {
                return Err("the training's configuration does not fit its network; train it again".into());
            }
            let mut optimiser = Optimiser::new(&layout, training.config.muon);
            optimiser.first = read_params(&tensors, "train.first.", &layout, Dtype::F32)?;
            optimiser.second = read_params(&tensors, "train.second.", &layout, Dtype::F32)?;
            let state = TrainState {
                params: read_params(&tensors, "train.params.", &layout, Dtype::F32)?,
                mean: read_params(&tensors, "train.mean.", &layout, Dtype::F32)?,
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

fn read_features(tensors: &SafeTensors<'_>, camera: &Camera) -> Result<PixelFeatures, String> {
    let image = |name: &str, kind: CodeKind| {
        let name = format!("features.{name}");
        let view = find_tensor(tensors, &name, Dtype::U8)?;
        let read = CodedImage::from_png(view.data(), kind, (camera.width, camera.height));
        read.map_err(|reason| format!("tensor {name} is damaged ({reason}); train it again"))
    };
    let (albedo, normal, depth) =
        (image("albedo", ALBEDO)?, image("normal", NORMAL)?, image("depth", DEPTH)?);
    let features = PixelFeatures::of_codes(camera, &albedo, &normal, &depth);
    features.validate().map_err(|error| error.to_string())?;
    Ok(features)
}

/// Reads all parameters with a prefix into the layout. Sizes are checked tensor by tensor before anything as large as
/// the layout is allocated.
fn read_params(
    tensors: &SafeTensors<'_>,
    prefix: &str,
    layout: &ParamLayout,
    dtype: Dtype,
) -> Result<Vec<f32>, String> {
    let mut parts = Vec::with_capacity(layout.tensors.len());
    for tensor in &layout.tensors {
        let name = format!("{prefix}{}", tensor.name);
        parts.push(read_numbers(tensors, &name, &[tensor.rows, tensor.cols], dtype)?);
    }
    let mut params = vec![0.0; layout.len];
    for (tensor, part) in layout.tensors.iter().zip(parts) {
        for (row, values) in params[tensor.range()].chunks_mut(tensor.stride).zip(part.chunks(tensor.cols)) {
            row[..tensor.cols].copy_from_slice(values);
        }
    }
    Ok(params)
}

/// Reads numbers of 16 or 32 bits.
fn read_numbers(
    tensors: &SafeTensors<'_>,
    name: &str,
    shape: &[usize],
    dtype: Dtype,
) -> Result<Vec<f32>, String> {
    let view = find_tensor(tensors, name, dtype)?;
    if view.shape() != shape {
        return Err(format!("tensor {name} is {:?} instead of {shape:?}; train it again", view.shape()));
    }
    let values: Vec<f32> = match dtype {
        Dtype::F16 => view.data().as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).to_f32()).collect(),
        _ => view.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
    };
    if let Some(index) = values.iter().position(|v| !v.is_finite()) {
        return Err(format!("value {index} of tensor {name} is not finite; train it again"));
    }
    Ok(values)
}

fn find_tensor<'a>(tensors: &SafeTensors<'a>, name: &str, dtype: Dtype) -> Result<TensorView<'a>, String> {
    let view = tensors.tensor(name).map_err(|_| format!("tensor {name} is missing; train it again"))?;
    match view.dtype() {
        found if found == dtype => Ok(view),
        found => Err(format!("tensor {name} is {found:?} instead of {dtype:?}; train it again")),
    }
}
