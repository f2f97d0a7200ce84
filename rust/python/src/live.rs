//! `Live` and `Frame`: a shot that is baked, trained and relit behind Python's back.

use crate::error::{NativeError, enter_native, invalid};
use crate::scene::{PyScene, PyWorld};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use relume_session::KnownLights;
use relume_session::live::{self, LiveOptions, LiveRequest};
use relume_session::trace::TraceSettings;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// See the stubs.
#[pyclass(name = "Live", module = "relume", frozen)]
pub struct PyLive {
    live: live::Live,
    known: Mutex<KnownLights>,
}

#[pymethods]
impl PyLive {
    #[new]
    #[pyo3(signature = (folder, *, device="auto", gpu_memory=None, threads=0))]
    fn new(folder: PathBuf, device: &str, gpu_memory: Option<u64>, threads: usize) -> Self {
        let Ok(device) = device.parse();
        let live = live::Live::new(&folder, LiveOptions { device, gpu_memory, threads });
        Self { live, known: Mutex::default() }
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
        let json: String = py.import("json")?.call_method1("dumps", (settings,))?.extract()?;
        let settings: TraceSettings = serde_json::from_str(&json).map_err(NativeError::from)?;
        enter_native(py, || self.live.bake(scene.shared(), settings, train_seconds, anew))
    }

    #[pyo3(signature = (*, train_seconds=0.0))]
    fn open(&self, py: Python<'_>, train_seconds: f64) -> PyResult<()> {
        enter_native(py, || self.live.open(train_seconds))
    }

    fn learn(&self, py: Python<'_>, train_seconds: f64) -> PyResult<()> {
        enter_native(py, || self.live.learn(train_seconds))
    }

    fn relight(&self, py: Python<'_>, request: &str) -> PyResult<u64> {
        enter_native(py, || -> Result<u64, NativeError> { Ok(self.live.relight(self.parse(request)?)) })
    }

    fn show_world(&self, py: Python<'_>, world: &PyWorld, request: &str) -> PyResult<u64> {
        enter_native(py, || -> Result<u64, NativeError> {
            let request = self.parse(request)?;
            Ok(self.live.show_world(world.world.clone(), request)?)
        })
    }

    #[pyo3(signature = (newer_than=0))]
    fn frame(&self, newer_than: u64) -> Option<PyFrame> {
        let frame = self.live.frame(newer_than)?;
        Some(PyFrame { frame, image: PyOnceLock::new() })
    }

    fn status(&self, py: Python<'_>) -> PyResult<String> {
        enter_native(py, || serde_json::to_string(&self.live.status()))
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

impl PyLive {
    fn parse(&self, request: &str) -> Result<LiveRequest, NativeError> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        LiveRequest::parse_knowing(request, &mut known).map_err(invalid)
    }
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
