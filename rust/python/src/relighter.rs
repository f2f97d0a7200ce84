//! `Relighter`: pictures of a bake as numpy arrays.

use crate::error::{NativeError, enter_native, invalid};
use crate::job::PyJob;
use crate::live::{PyLive, open_scenes};
use crate::scene::PyScene;
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use relume_session::image::Image;
use relume_session::scene::{Light, Scene};
use relume_session::trace::bvh::SceneBvh;
use relume_session::{
    CatcherPlace, Device, LightSet, LobePart, Method, Monitor, PictureMix, RelightOptions, Relighter, Relit,
};
use std::path::PathBuf;
use std::sync::Arc;

/// An open bake folder, or a folder of proxies.
#[pyclass(name = "Relighter", module = "relume", frozen)]
pub struct PyRelighter {
    relighter: Arc<Relighter>,
}

#[pymethods]
impl PyRelighter {
    #[new]
    #[pyo3(signature = (folder, *, world_of=None, shots=Vec::new(), device="auto", gpu_memory=None))]
    fn new(
        py: Python<'_>,
        folder: PathBuf,
        world_of: Option<&PyScene>,
        shots: Vec<PyRef<'_, PyLive>>,
        device: &str,
        gpu_memory: Option<u64>,
    ) -> PyResult<Self> {
        let (scene, open) = (world_of.map(PyScene::shared), open_scenes(&shots));
        let relighter = enter_native(py, || -> Result<Relighter, NativeError> {
            let Ok(device) = device.parse::<Device>();
            let mut relighter = Relighter::open(&folder)?.on(&device.open(gpu_memory)?);
            let monitor = Monitor::default();
            if let Some(scene) = &scene {
                relighter.show_world_of(scene, &monitor)?;
            }
            if !relighter.connect_open(&open) {
                match scene.filter(|scene| relighter.is_of(scene)) {
                    Some(scene) => relighter.connect(scene)?,
                    None => relighter.connect_stored(&monitor),
                }
            }
            Ok(relighter)
        })?;
        Ok(Self { relighter: Arc::new(relighter) })
    }

    #[getter]
    fn resolution(&self) -> (usize, usize) {
        (self.relighter.camera().width, self.relighter.camera().height)
    }

    /// Files of the folder that could not be used, and what follows, in words for the user.
    #[getter]
    fn damaged(&self) -> Vec<String> {
        self.relighter.damaged().to_vec()
    }

    #[getter]
    fn world_color(&self) -> Option<[f32; 3]> {
        self.relighter.world_color()
    }

    /// JSON of the lights that the scene came with.
    fn scene_lights(&self, py: Python<'_>) -> PyResult<String> {
        enter_native(py, || -> Result<String, NativeError> {
            Ok(serde_json::to_string(&self.relighter.scene_lights()?.lights)?)
        })
    }

    /// Names of lights that hardly any path meets, while new paths would.
    #[pyo3(signature = (lights=None))]
    fn rarely_met(&self, py: Python<'_>, lights: Option<&str>) -> PyResult<Vec<String>> {
        enter_native(py, || -> Result<_, NativeError> {
            let lights = self.lights(lights)?;
            Ok(self.relighter.under_sampled(&lights).into_iter().map(|light| light.name.clone()).collect())
        })
    }

    #[pyo3(signature = (lights=None, *, static_light=[1.0; 3], world=[1.0; 3], catcher_apart=false,
        maker="auto", denoise=true, lobes=false))]
    fn relight<'py>(
        &self,
        py: Python<'py>,
        lights: Option<&str>,
        static_light: [f32; 3],
        world: [f32; 3],
        catcher_apart: bool,
        maker: &str,
        denoise: bool,
        lobes: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let options = options(maker, denoise, lobes)?;
        let catcher = if catcher_apart { CatcherPlace::Layer } else { CatcherPlace::Picture };
        let mix = PictureMix { static_light, world, catcher };
        let relit = enter_native(py, || -> Result<Relit, NativeError> {
            Ok(self.relighter.relight_mixed(&self.lights(lights)?, &mix, &options, &Monitor::default())?)
        })?;
        pictures(py, relit)
    }

    /// Starts to make each light's picture, which `relight` then only sums.
    #[pyo3(signature = (lights=None, *, maker="auto", denoise=true, lobes=false))]
    fn prepare(&self, lights: Option<&str>, maker: &str, denoise: bool, lobes: bool) -> PyResult<PyJob> {
        let options = options(maker, denoise, lobes)?;
        let lights = self.lights(lights)?;
        let relighter = self.relighter.clone();
        PyJob::start(move |monitor| -> Result<_, NativeError> {
            relighter.prepare(&lights, &options, monitor)?;
            Ok(serde_json::Value::Null)
        })
    }
}

impl PyRelighter {
    /// Trees of a scene, if lights are connected in that.
    pub fn trees_of(&self, scene: &Scene) -> Option<SceneBvh> {
        self.relighter.trees_of(scene)
    }

    /// The lights of a light set in JSON, or the scene's own.
    fn lights(&self, json: Option<&str>) -> Result<Vec<Light>, NativeError> {
        match json {
            Some(json) => Ok(LightSet::parse(json).map_err(invalid)?.lights),
            None => Ok(self.relighter.scene_lights()?.lights),
        }
    }
}

fn options(maker: &str, denoise: bool, lobes: bool) -> Result<RelightOptions, NativeError> {
    let method = match maker {
        "auto" => Method::Auto,
        "gather" => Method::Gather,
        "proxy" => Method::Proxy,
        _ => return Err(invalid(format!("maker '{maker}' is not auto, gather or proxy"))),
    };
    Ok(RelightOptions { method, denoise, lobes })
}

/// All layers of a relit picture, [height, width, channels], top row first.
fn pictures(py: Python<'_>, relit: Relit) -> PyResult<Bound<'_, PyDict>> {
    let (pictures, lights, lobes) = (PyDict::new(py), PyDict::new(py), PyDict::new(py));
    pictures.set_item("combined", array(py, relit.combined())?)?;
    for light in relit.lights {
        let parts = PyDict::new(py);
        for (part, image) in LobePart::ALL.iter().zip(light.lobes) {
            parts.set_item(part.name(), array(py, image)?)?;
        }
        lights.set_item(&light.name, array(py, light.image)?)?;
        lobes.set_item(light.name, parts)?;
    }
    pictures.set_item("lights", lights)?;
    pictures.set_item("lobes", lobes)?;
    let layers = [
        ("static", relit.static_light),
        ("world", relit.world),
        ("albedo", relit.albedo),
        ("normal", relit.normal),
        ("depth", relit.depth),
        ("alpha", relit.alpha),
    ];
    let catcher = relit.shadow_catcher.map(|image| ("shadow_catcher", image));
    for (name, image) in layers.into_iter().chain(catcher) {
        pictures.set_item(name, array(py, image)?)?;
    }
    Ok(pictures)
}

fn array(py: Python<'_>, image: Image) -> PyResult<Bound<'_, PyArray3<f32>>> {
    PyArray1::from_vec(py, image.data).reshape([image.height, image.width, image.channels])
}
