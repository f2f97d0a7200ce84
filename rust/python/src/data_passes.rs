//! Data passes of a scene, for Python.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use relume_session::scene::Scene;
use relume_session::trace::{self, DataPassSettings, DataPasses, TraceSettings};

use crate::error::{NativeError, invalid};
use crate::job::PyJob;
use crate::relighter::PyRelighter;
use crate::scene::PyScene;

/// Most ranks of a matte.
const MOST_RANKS: usize = 16;

/// Data passes of a scene's picture, once they are traced.
#[pyclass(name = "DataPasses", module = "relume", frozen)]
pub struct PyDataPasses {
    scene: Arc<Scene>,
    ranks: usize,
    traced: Arc<Mutex<DataPasses>>,
    job: Py<PyJob>,
}

#[pymethods]
impl PyDataPasses {
    #[new]
    #[pyo3(signature = (scene, settings="{}", *, samples=64, ranks=6, alpha_threshold=0.5,
        assets=HashMap::new(), frames=None, relighter=None))]
    fn new(
        py: Python<'_>,
        scene: &PyScene,
        settings: &str,
        samples: u32,
        ranks: usize,
        alpha_threshold: f32,
        assets: HashMap<String, String>,
        frames: Option<(PyRef<'_, PyScene>, PyRef<'_, PyScene>)>,
        relighter: Option<&PyRelighter>,
    ) -> PyResult<Self> {
        let settings: TraceSettings = serde_json::from_str(settings).map_err(NativeError::from)?;
        if samples == 0 || !(1..=MOST_RANKS).contains(&ranks) {
            return Err(invalid(format!("samples must be 1 or more, ranks 1 to {MOST_RANKS}")).into());
        }
        let (scene, wanted) = (scene.shared(), DataPassSettings { samples, ranks, alpha_threshold, assets });
        let trees = relighter.and_then(|relighter| relighter.trees_of(&scene));
        let traced = Arc::new(Mutex::new(DataPasses::default()));
        let result = traced.clone();
        let of_job = scene.clone();
        let frames = frames.map(|(before, after)| [before.shared(), after.shared()]);
        let job = PyJob::start(move |monitor| -> Result<_, NativeError> {
            let frames = frames.as_ref().map(|frames| frames.each_ref().map(|frame| &**frame));
            let passes = relume_session::data_passes(&of_job, &settings, &wanted, frames, trees, monitor)?;
            *result.lock().unwrap_or_else(PoisonError::into_inner) = passes;
            Ok(serde_json::Value::Null)
        })?;
        Ok(Self { scene, ranks, traced, job: Py::new(py, job)? })
    }

    /// The job that traces them.
    #[getter]
    fn job(&self, py: Python<'_>) -> Py<PyJob> {
        self.job.clone_ref(py)
    }

    /// Arrays by the name of the pass, [height, width, channels], top row first, once the job is done.
    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let traced = std::mem::take(&mut *self.traced.lock().unwrap_or_else(PoisonError::into_inner));
        if traced.positions.is_empty() {
            return Err(invalid("the passes were not traced yet, or were taken before").into());
        }
        let (width, height) = (self.scene.camera.width, self.scene.camera.height);
        let pictures = PyDict::new(py);
        let add = |name: &str, values: Vec<f32>, channels: usize| {
            pictures.set_item(name, PyArray1::from_vec(py, values).reshape([height, width, channels])?)
        };
        add("position", traced.positions.into_flattened(), 3)?;
        add("uv", traced.uvs.into_flattened(), 3)?;
        add("vector", traced.vectors.into_flattened(), 4)?;
        add("object_index", traced.object_indices, 1)?;
        add("material_index", traced.material_indices, 1)?;
        add("objects", traced.objects.into_flattened(), 2 * self.ranks)?;
        add("materials", traced.materials.into_flattened(), 2 * self.ranks)?;
        add("assets", traced.assets.into_flattened(), 2 * self.ranks)?;
        Ok(pictures)
    }

    /// Names of the objects and materials of the scene.
    fn names(&self) -> (BTreeSet<&str>, BTreeSet<&str>) {
        let objects = self.scene.instances.iter().map(|instance| instance.name.as_str()).collect();
        (objects, self.scene.materials.iter().map(|material| material.name.as_str()).collect())
    }
}

/// Hash of a name in a Cryptomatte: that of the specification, and as it is stored, the bits of a float.
#[pyfunction]
pub fn matte_hash(name: &str) -> (u32, u32) {
    (trace::murmur3(name.as_bytes()), trace::matte_id(name).to_bits())
}
