use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use half::f16;
use relume_image::{ImageError, write_atomically};
use safetensors::tensor::{Dtype, TensorView, serialize};

use super::{FORMAT_VERSION, HEADER_KEY, Header, TrainingHeader};
use crate::params::ParamLayout;
use crate::pixel_codes::{CodedImage, encode_albedo, encode_depth, encode_normal};
use crate::proxy::ProxyInfo;
use crate::trainer::TrainState;
use crate::{PixelFeatures, ProxyError};

/// A tensor of a file.
pub(super) struct NamedTensor {
    name: String,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

pub(super) fn save(
    path: &Path,
    info: &ProxyInfo,
    features: &PixelFeatures,
    layout: &ParamLayout,
    weights: &[f32],
    training: Option<(&TrainingHeader, &TrainState)>,
) -> Result<(), ProxyError> {
    let mut tensors = feature_tensors(features).map_err(|reason| format_error(path, reason))?;
    tensors.extend(param_tensors("net.", layout, weights, Dtype::F16));
    if let Some((_, state)) = training {
        for (prefix, values) in [
            ("train.params.", &state.params),
            ("train.mean.", &state.mean),
            ("train.first.", &state.optimiser.first),
            ("train.second.", &state.optimiser.second),
        ] {
            tensors.extend(param_tensors(prefix, layout, values, Dtype::F32));
        }
    }
    let mut header = Header {
        format_version: FORMAT_VERSION,
        checksum: String::new(),
        info: info.clone(),
        camera: features.camera.clone(),
        training: training.map(|(header, _)| header.clone()),
    };
    let plain = to_json(&header).map_err(|reason| format_error(path, reason))?;
    header.checksum = checksum(&plain, tensors.iter().map(|t| (t.name.as_str(), &t.shape[..], &t.bytes[..])));
    let bytes = encode(&header, &tensors).map_err(|reason| format_error(path, reason))?;
    write_atomically(path, |writer| writer.write_all(&bytes)).map_err(|error| match error {
        ImageError::Write { source, .. } | ImageError::Read { source, .. } => {
            ProxyError::Io { path: path.display().to_string(), source }
        }
        ImageError::Format { reason, .. } => format_error(path, reason),
    })
}

pub(super) fn encode(header: &Header, tensors: &[NamedTensor]) -> Result<Vec<u8>, String> {
    let metadata = HashMap::from([(HEADER_KEY.to_owned(), to_json(header)?)]);
    let mut views = Vec::with_capacity(tensors.len());
    for tensor in tensors {
        let view = TensorView::new(tensor.dtype, tensor.shape.clone(), &tensor.bytes);
        views.push((tensor.name.as_str(), view.map_err(|error| error.to_string())?));
    }
    serialize(views, Some(metadata)).map_err(|error| error.to_string())
}

fn to_json(header: &Header) -> Result<String, String> {
    serde_json::to_string(header).map_err(|error| error.to_string())
}

/// Hash of everything that a file says: its header's text with an empty checksum, and its tensors in the order of
/// their names.
pub(super) fn checksum<'a>(
    plain_header: &str,
    tensors: impl Iterator<Item = (&'a str, &'a [usize], &'a [u8])>,
) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(plain_header.as_bytes());
    let mut tensors: Vec<_> = tensors.collect();
    tensors.sort_unstable_by_key(|(name, _, _)| *name);
    for (name, shape, bytes) in tensors {
        hasher.update(name.as_bytes());
        for size in shape {
            hasher.update(&(*size as u64).to_le_bytes());
        }
        hasher.update(bytes);
    }
    hasher.finalize().to_hex().to_string()
}

fn feature_tensors(features: &PixelFeatures) -> Result<Vec<NamedTensor>, String> {
    let images = [
        ("albedo", encode_albedo(&features.albedo)),
        ("normal", encode_normal(&features.normal)),
        ("depth", encode_depth(&features.depth)),
    ];
    let tensor = |(name, image): (&str, CodedImage)| {
        let bytes = image.to_png(features.width, features.height)?;
        Ok(NamedTensor {
            name: format!("features.{name}"),
            dtype: Dtype::U8,
            shape: vec![bytes.len()],
            bytes,
        })
    };
    images.into_iter().map(tensor).collect()
}

fn param_tensors<'a>(
    prefix: &'a str,
    layout: &'a ParamLayout,
    values: &'a [f32],
    dtype: Dtype,
) -> impl Iterator<Item = NamedTensor> + 'a {
    layout.tensors.iter().map(move |tensor| {
        let rows = values[tensor.range()].chunks(tensor.stride);
        let unpadded = rows.flat_map(|row| row[..tensor.cols].iter().copied());
        let bytes = match dtype {
            Dtype::F16 => unpadded.flat_map(|value| f16::from_f32(value).to_le_bytes()).collect(),
            _ => unpadded.flat_map(f32::to_le_bytes).collect(),
        };
        NamedTensor {
            name: format!("{prefix}{}", tensor.name),
            dtype,
            shape: vec![tensor.rows, tensor.cols],
            bytes,
        }
    })
}

pub(super) fn format_error(path: &Path, reason: String) -> ProxyError {
    ProxyError::Format { path: path.display().to_string(), reason }
}
