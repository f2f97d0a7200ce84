//! `Live`, `Request`, `LiveStatus` and `Frame`: a shot that is baked, trained and relit behind Python's back.

use crate::error::{NativeError, enter_native, invalid};
use crate::scene::{PyScene, PyWorld};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use relume_session::live::{self, Board, LiveOptions, LiveRequest, LiveStatus, RequestOptions};
use relume_session::proxy::LightKind;
use relume_session::trace::TraceSettings;
use relume_session::{LightSet, OpenScenes, ParsedLight};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// See the stubs.
#[pyclass(name = "Board", module = "relume", frozen)]
pub struct PyBoard {
    board: Board,
}

#[pymethods]
impl PyBoard {
    #[new]
    fn new() -> Self {
        Self { board: Board::default() }
    }
}

/// Scenes that some shots have in memory.
pub fn open_scenes(shots: &[PyRef<'_, PyLive>]) -> OpenScenes {
    OpenScenes::of(shots.iter().map(|shot| &shot.live))
}

/// See the stubs.
#[pyclass(name = "Live", module = "relume", frozen)]
pub struct PyLive {
    live: live::Live,
}

#[pymethods]
impl PyLive {
    #[new]
    #[pyo3(signature = (folder, *, device="auto", gpu_memory=None, threads=0, board=None))]
    fn new(
        folder: PathBuf,
        device: &str,
        gpu_memory: Option<u64>,
        threads: usize,
        board: Option<&PyBoard>,
    ) -> Self {
        let Ok(device) = device.parse();
        let board = board.map(|board| board.board.clone()).unwrap_or_default();
        Self { live: live::Live::new(&folder, LiveOptions { device, gpu_memory, threads, board }) }
    }

    #[pyo3(signature = (scene, settings, *, train_seconds=60.0, anew=false))]
    fn bake(
        &self,
        py: Python<'_>,
        scene: &PyScene,
        settings: &Bound<'_, PyDict>,
        train_seconds: f64,
        anew: bool,
    ) -> PyResult<()> {
        let settings: TraceSettings = from_python(settings)?;
        enter_native(py, || self.live.bake(scene.shared(), settings, train_seconds, anew))
    }

    #[pyo3(signature = (*, train_seconds=0.0))]
    fn open(&self, py: Python<'_>, train_seconds: f64) -> PyResult<()> {
        enter_native(py, || self.live.open(train_seconds))
    }

    fn learn(&self, py: Python<'_>, train_seconds: f64) -> PyResult<()> {
        enter_native(py, || self.live.learn(train_seconds))
    }

    fn relight(&self, request: &PyRequest) -> u64 {
        self.live.relight(request.request.clone())
    }

    fn show_world(&self, py: Python<'_>, world: &PyWorld, request: &PyRequest) -> PyResult<u64> {
        enter_native(py, || self.live.show_world(world.world.clone(), request.request.clone()))
    }

    fn attend(&self) {
        self.live.attend();
    }

    #[pyo3(signature = (newer_than=0))]
    fn frame(&self, newer_than: u64) -> Option<PyFrame> {
        let frame = self.live.frame(newer_than)?;
        Some(PyFrame { frame, image: PyOnceLock::new() })
    }

    fn status(&self) -> PyLiveStatus {
        PyLiveStatus { status: self.live.status(), fields: PyOnceLock::new() }
    }

    fn pause(&self, paused: bool) {
        self.live.pause(paused);
    }

    fn cancel(&self) {
        self.live.cancel();
    }

    #[pyo3(signature = (*, wait_seconds=0.0))]
    fn close(&self, py: Python<'_>, wait_seconds: f64) -> PyResult<()> {
        let wait = Duration::try_from_secs_f64(wait_seconds)
            .map_err(|error| invalid(format!("wait_seconds: {error}")))?;
        py.detach(|| self.live.close(wait));
        Ok(())
    }
}

/// See the stubs.
#[pyclass(name = "Light", module = "relume", frozen)]
pub struct PyLight {
    parsed: ParsedLight,
}

#[pymethods]
impl PyLight {
    #[new]
    fn new(description: &Bound<'_, PyDict>) -> PyResult<Self> {
        Ok(Self { parsed: ParsedLight::parse(&json_of(description)?).map_err(invalid)? })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.parsed.light.name
    }

    #[getter]
    fn kind(&self) -> Option<String> {
        LightKind::answering(&self.parsed.light).map(|kind| kind.to_string())
    }
}

/// See the stubs.
#[pyclass(name = "Request", module = "relume", frozen)]
pub struct PyRequest {
    request: LiveRequest,
}

#[pymethods]
impl PyRequest {
    #[new]
    #[pyo3(signature = (lights, **options))]
    fn new(lights: Vec<PyRef<'_, PyLight>>, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut set = LightSet::default();
        for light in &lights {
            set.push(light.parsed.clone());
        }
        let options = options.map(from_python::<RequestOptions>).transpose()?.unwrap_or_default();
        Ok(Self { request: LiveRequest::new(set, options).map_err(invalid)? })
    }

    #[staticmethod]
    fn parse(text: &str) -> PyResult<Self> {
        Ok(Self { request: LiveRequest::parse(text).map_err(invalid)? })
    }
}

/// See the stubs.
#[pyclass(name = "LiveStatus", module = "relume", frozen)]
pub struct PyLiveStatus {
    status: LiveStatus,
    /// Python's values of all fields, made when one is first asked for.
    fields: PyOnceLock<Py<PyDict>>,
}

#[pymethods]
impl PyLiveStatus {
    #[new]
    #[pyo3(signature = (**fields))]
    fn new(fields: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let status = fields.map(from_python::<LiveStatus>).transpose()?.unwrap_or_default();
        Ok(Self { status, fields: PyOnceLock::new() })
    }

    fn with_picture_of(&self, other: &Self) -> Self {
        let LiveStatus { shown, rarely_met, warnings, .. } = other.status.clone();
        let status = LiveStatus { shown, rarely_met, warnings, ..self.status.clone() };
        Self { status, fields: PyOnceLock::new() }
    }

    fn __getattr__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        let value = self.fields(py)?.get_item(name)?;
        let missing = || PyAttributeError::new_err(format!("LiveStatus has no field '{name}'"));
        value.map(Bound::unbind).ok_or_else(missing)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.status == other.status
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("LiveStatus(**{})", self.fields(py)?.repr()?))
    }
}

impl PyLiveStatus {
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let make = || Ok::<_, PyErr>(to_python(py, &self.status)?.cast_into::<PyDict>()?.unbind());
        self.fields.get_or_try_init(py, make).map(|fields| fields.bind(py).clone())
    }
}

/// JSON text of a Python value.
fn json_of(value: &Bound<'_, PyAny>) -> PyResult<String> {
    value.py().import("json")?.call_method1("dumps", (value,))?.extract()
}

fn from_python<T: DeserializeOwned>(value: &Bound<'_, PyDict>) -> PyResult<T> {
    Ok(serde_json::from_str(&json_of(value)?).map_err(NativeError::from)?)
}

fn to_python<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(NativeError::from)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// See the stubs.
#[pyclass(name = "Frame", module = "relume", frozen)]
pub struct PyFrame {
    frame: Arc<live::Frame>,
    /// Pixels, copied on the first access.
    image: PyOnceLock<Py<PyArray3<f32>>>,
}

#[pymethods]
impl PyFrame {
    #[getter]
    fn serial(&self) -> u64 {
        self.frame.shown.serial
    }

    #[getter]
    fn request(&self) -> u64 {
        self.frame.shown.request
    }

    #[getter]
    fn scale(&self) -> usize {
        self.frame.shown.scale
    }

    #[getter]
    fn image(&self, py: Python<'_>) -> PyResult<Py<PyArray3<f32>>> {
        let image = &self.frame.image;
        let copy = || {
            let array =
                PyArray1::from_slice(py, &image.data).reshape([image.height, image.width, image.channels]);
            array.map(Bound::unbind)
        };
        self.image.get_or_try_init(py, copy).map(|array| array.clone_ref(py))
    }

    #[getter]
    fn summary(&self, py: Python<'_>) -> PyResult<String> {
        enter_native(py, || serde_json::to_string(&self.frame.shown))
    }
}
