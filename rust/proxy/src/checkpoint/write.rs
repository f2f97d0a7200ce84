use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use relume_image::{ImageError, write_atomically};
use safetensors::tensor::{Dtype, TensorView, serialize};

use super::{FORMAT_VERSION, HEADER_KEY, Header, TrainingHeader};
use crate::params::ParamLayout;
use crate::proxy::ProxyInfo;
use crate::trainer::TrainState;
use crate::{PixelFeatures, ProxyError};

/// A tensor by name, shape and values.
pub(super) type NamedTensor = (String, Vec<usize>, Vec<f32>);

pub(super) fn save(
    path: &Path,
    info: &ProxyInfo,
    features: &PixelFeatures,
    layout: &ParamLayout,
    weights: &[f32],
    training: Option<(&TrainingHeader, &TrainState)>,
) -> Result<(), ProxyError> {
    let mut tensors = feature_tensors(features);
    tensors.extend(param_tensors("net.", layout, weights));
    if let Some((_, state)) = training {
        for (prefix, values) in [
            ("train.params.", &state.params),
            ("train.mean.", &state.mean),
            ("train.first.", &state.optimiser.first),
            ("train.second.", &state.optimiser.second),
        ] {
            tensors.extend(param_tensors(prefix, layout, values));
        }
    }
    let mut header = Header {
        format_version: FORMAT_VERSION,
        checksum: String::new(),
        info: info.clone(),
        training: training.map(|(header, _)| header.clone()),
    };
    let plain = to_json(&header).map_err(|reason| format_error(path, reason))?;
    header.checksum = checksum(&plain, tensors.iter().map(|(n, s, v)| (n.as_str(), &s[..], bytes_of(v))));
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
    for (name, shape, values) in tensors {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes_of(values)).map_err(|e| e.to_string())?;
        views.push((name.as_str(), view));
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

fn feature_tensors(features: &PixelFeatures) -> Vec<NamedTensor> {
    let triple = |name: &str, values: &[[f32; 3]]| {
        let shape = vec![features.height, features.width, 3];
        (format!("features.{name}"), shape, bytemuck::cast_slice(values).to_vec())
    };
    vec![
        triple("albedo", &features.albedo),
        triple("normal", &features.normal),
        triple("position", &features.position),
        triple("wo", &features.wo),
        ("features.depth".to_owned(), vec![features.height, features.width], features.depth.clone()),
    ]
}

fn param_tensors<'a>(
    prefix: &'a str,
    layout: &'a ParamLayout,
    values: &'a [f32],
) -> impl Iterator<Item = NamedTensor> + 'a {
    layout.tensors.iter().map(move |tensor| {
        let rows = values[tensor.range()].chunks(tensor.stride);
        let unpadded = rows.flat_map(|row| row[..tensor.cols].iter().copied()).collect();
        (format!("{prefix}{}", tensor.name), vec![tensor.rows, tensor.cols], unpadded)
    })
}

#[cfg(target_endian = "big")]
compile_error!("proxy files hold little-endian values and are written from memory as it is");

fn bytes_of(values: &[f32]) -> &[u8] {
    bytemuck::cast_slice(values)
}

pub(super) fn format_error(path: &Path, reason: String) -> ProxyError {
    ProxyError::Format { path: path.display().to_string(), reason }
}
