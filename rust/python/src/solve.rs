//! `solve`: lights found for what the picture should do.

use crate::array::Array;
use crate::error::{NativeError, invalid};
use crate::job::PyJob;
use crate::live::{PyLive, open_scenes};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use relume_session::image::Image;
use relume_session::{Device, InterimLights, Pictures, Relighter, SolveRequest, in_background, solve_lights};
use std::collections::HashMap;
use std::path::PathBuf;

/// See the stubs.
#[pyfunction]
#[pyo3(signature = (folders, request, images, *, shots=Vec::new(), device="auto", gpu_memory=None, threads=0))]
pub fn solve(
    folders: Vec<PathBuf>,
    request: &str,
    images: &Bound<'_, PyDict>,
    shots: Vec<PyRef<'_, PyLive>>,
    device: &str,
    gpu_memory: Option<u64>,
    threads: usize,
) -> PyResult<PyJob> {
    let request = SolveRequest::parse(request).map_err(invalid)?;
    let pictures = Pictures::named(named(images)?);
    let Ok(device) = device.parse::<Device>();
    let open = open_scenes(&shots);
    PyJob::start_with_preview(move |monitor, show| -> Result<_, NativeError> {
        in_background(threads, || {
            let compute = device.open(gpu_memory)?;
            compute.warn(monitor);
            let relighter = |folder: &PathBuf| {
                let mut relighter = Relighter::open(folder)?.on(&compute);
                if !relighter.connect_open(&open) {
                    relighter.connect_stored(monitor);
                }
                Ok(relighter)
            };
            let relighters = folders.iter().map(relighter).collect::<Result<Vec<_>, NativeError>>()?;
            let views: Vec<&Relighter> = relighters.iter().collect();
            let preview = |found: &InterimLights| show(serde_json::to_string(found).unwrap_or_default());
            Ok(serde_json::to_value(solve_lights(&views, &request, &pictures, monitor, &preview)?)?)
        })
    })
}

fn named(images: &Bound<'_, PyDict>) -> PyResult<HashMap<String, Image>> {
    let mut named = HashMap::new();
    for (name, array) in images {
        let name: String = name.extract()?;
        let array = Array::<f32>::borrow("a picture", &array)?;
        let (height, width, channels) = (array.size(0), array.size(1), array.size(2));
        let data = array.values()?.to_vec();
        if !matches!(channels, 1 | 3 | 4) || data.len() != width * height * channels {
            let reason = format!("picture '{name}' must have the shape [height, width, 1, 3 or 4]");
            return Err(invalid(reason).into());
        }
        named.insert(name, Image { width, height, channels, data });
    }
    Ok(named)
}
