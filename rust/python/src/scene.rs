//! `Scene` and `World`.

use crate::array::Array;
use crate::error::{NativeError, enter_native, invalid};
use crate::job::PyJob;
use glam::Vec3;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use relume_scene as scene;
use relume_session::trace::TraceSettings;
use std::path::PathBuf;
use std::sync::Arc;

/// A world apart from any scene, to be shown along the paths of a bake.
#[pyclass(name = "World", module = "relume", frozen)]
pub struct PyWorld {
    /// Shared with the shots that show it.
    pub world: Arc<relume_session::live::OtherWorld>,
    /// Parts of it that could not be represented, in words.
    pub warnings: Vec<String>,
}

#[pymethods]
impl PyWorld {
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    #[getter]
    fn map(&self) -> &str {
        &self.world.about().map
    }

    #[getter]
    fn color(&self) -> [f32; 3] {
        self.world.about().color
    }
}

/// A finished scene.
#[pyclass(name = "Scene", module = "relume", frozen)]
pub struct PyScene {
    /// Shared with running work.
    pub scene: Arc<scene::Scene>,
}

impl PyScene {
    /// The scene itself.
    pub fn shared(&self) -> Arc<scene::Scene> {
        self.scene.clone()
    }
}

#[pymethods]
impl PyScene {
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.scene.warnings.clone()
    }

    #[getter]
    fn working_space(&self) -> &str {
        &self.scene.working_space
    }

    #[getter]
    fn resolution(&self) -> (usize, usize) {
        (self.scene.camera.width, self.scene.camera.height)
    }

    /// Radiance of the world, or the factor on its texture; RGB.
    #[getter]
    fn world_color(&self) -> [f32; 3] {
        self.scene.world.color
    }

    /// Hash of the world's texture and how it is turned.
    #[getter]
    fn world_map(&self, py: Python<'_>) -> PyResult<String> {
        enter_native(py, || Ok::<_, NativeError>(self.scene.world_map()))
    }

    /// Hash of all that decides the paths, as a bake's manifest carries it.
    #[getter]
    fn hash(&self, py: Python<'_>) -> PyResult<String> {
        enter_native(py, || Ok::<_, NativeError>(self.scene.hash()))
    }

    fn seen_by(&self, py: Python<'_>, camera: &str) -> PyResult<Self> {
        enter_native(py, || {
            let camera = serde_json::from_str::<scene::BlenderCamera>(camera)?.to_camera()?;
            Ok::<_, NativeError>(Self { scene: Arc::new(scene::Scene { camera, ..(*self.scene).clone() }) })
        })
    }

    #[pyo3(signature = (folder, settings="{}"))]
    fn difference(&self, py: Python<'_>, folder: PathBuf, settings: &str) -> PyResult<Option<&'static str>> {
        let settings: TraceSettings = serde_json::from_str(settings).map_err(NativeError::from)?;
        enter_native(py, || {
            relume_session::difference(&self.scene, &settings, &folder).map_err(NativeError::from)
        })
    }

    #[pyo3(signature = (folder, settings="{}", *, resume=false))]
    fn bake(&self, folder: PathBuf, settings: &str, resume: bool) -> PyResult<PyJob> {
        let settings: TraceSettings = serde_json::from_str(settings).map_err(NativeError::from)?;
        let scene = self.scene.clone();
        PyJob::start(move |monitor| -> Result<_, NativeError> {
            let report = relume_session::bake(&scene, &settings, &folder, resume, monitor)?;
            Ok(serde_json::to_value(report)?)
        })
    }

    #[pyo3(signature = (file, settings="{}", *, view=None))]
    fn write(&self, py: Python<'_>, file: PathBuf, settings: &str, view: Option<&[u8]>) -> PyResult<()> {
        let settings: TraceSettings = serde_json::from_str(settings).map_err(NativeError::from)?;
        enter_native(py, || relume_session::write_scene(&file, &self.scene, &settings, view))
    }

    /// The scene's lights as JSON, a light set.
    fn lights(&self, py: Python<'_>) -> PyResult<String> {
        enter_native(py, || serde_json::to_string(&self.scene.lights))
    }

    /// The texels of a texture as rendering sees them.
    fn texels<'py>(&self, py: Python<'py>, texture: usize) -> PyResult<Bound<'py, PyAny>> {
        let texture = self.scene.textures.get(texture);
        let texture = texture.ok_or_else(|| invalid("there is no texture of that number"))?;
        let shape = [texture.height, texture.width, 4];
        Ok(match &texture.texels {
            scene::Texels::Byte(texels) => PyArray1::from_slice(py, texels).reshape(shape)?.into_any(),
            scene::Texels::Float(texels) => PyArray1::from_slice(py, texels).reshape(shape)?.into_any(),
        })
    }

    /// Values of a grid at positions in object space [N, 3], as [N, 3].
    fn grid_values<'py>(
        &self,
        py: Python<'py>,
        grids: usize,
        name: &str,
        positions: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let grid = self.scene.grids.get(grids).and_then(|set| set.get(name));
        let grid = grid.ok_or_else(|| invalid("there is no grid of that number and name"))?;
        let interpolation = self.scene.grids[grids].interpolation;
        let index_from_object = grid.object_from_index.inverse();
        let value = |position: &Vec3| {
            let position = index_from_object.transform_point3(*position);
            grid.value(position, interpolation)
        };
        let positions = Array::<f32>::borrow("positions", positions)?;
        let values: Vec<Vec3> = positions.cast::<Vec3>()?.iter().map(value).collect();
        let array = PyArray1::from_slice(py, bytemuck::cast_slice::<Vec3, f32>(&values));
        Ok(array.reshape([values.len(), 3])?.into_any())
    }

    /// Counts and parts as JSON, for tests and `info`.
    fn summary(&self, py: Python<'_>) -> PyResult<String> {
        enter_native(py, || serde_json::to_string(&summary(&self.scene)))
    }
}

fn summary(scene: &scene::Scene) -> serde_json::Value {
    let triangles =
        |instance: &scene::Instance| scene.mesh(instance.geometry).map_or(0, |mesh| mesh.triangles.len());
    serde_json::json!({
        "camera": scene.camera,
        "lights": scene.lights,
        "materials": scene.materials,
        "meshes": scene.meshes.iter().map(|m| serde_json::json!({
            "name": m.name, "triangles": m.triangles.len(), "smooth": !m.corner_normals.is_empty(),
            "displaced": m.undisplaced.is_some(), "motion_keys": m.motion.len() / m.positions.len().max(1),
            "color_attributes": m.color_attributes.iter().map(|a| &a.name).collect::<Vec<_>>(),
            "uv_maps": m.uv_maps.iter().map(|map| &map.name).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "instances": scene.instances.iter().map(|i| serde_json::json!({
            "name": i.name, "mesh": match i.geometry { scene::Geometry::Mesh(index) => Some(index), _ => None }, "geometry": i.geometry, "materials": i.materials, "receiver": i.receiver,
            "world_from_object": i.world_from_object, "color": i.color, "pass_index": i.pass_index, "grids": i.grids,
            "random": i.random, "shadow_terminator_offset": i.shadow_terminator_offset,
            "shadow_terminator_shading": i.shadow_terminator_shading,
            "visibility": [i.visible_camera, i.visible_diffuse, i.visible_glossy, i.visible_transmission],
            "visible_volume_scatter": i.visible_volume_scatter, "visible_shadow": i.visible_shadow, "is_holdout": i.is_holdout, "is_shadow_catcher": i.is_shadow_catcher, "links": i.links,
            "density_factor": i.density_factor, "occlusion_distance": i.occlusion_distance,
            "motion_keys": i.motion.len(),
        })).collect::<Vec<_>>(),
        "curves": scene.curves.iter().map(|c| serde_json::json!({
            "name": c.name, "shape": c.shape, "curves": c.curve_count(), "keys": c.keys.len(),
            "motion_keys": c.motion.len() / c.keys.len().max(1),
            "radii": [c.radii.iter().copied().fold(f32::INFINITY, f32::min), c.radii.iter().copied().fold(0.0, f32::max)],
            "uv_maps": c.uv_maps.iter().map(|map| &map.name).collect::<Vec<_>>(),
            "key_attributes": c.key_attributes.iter().map(|a| &a.name).collect::<Vec<_>>(),
            "curve_attributes": c.curve_attributes.iter().map(|a| &a.name).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "points": scene.points.iter().map(|p| serde_json::json!({
            "name": p.name, "points": p.positions.len(), "motion_keys": p.motion.len() / p.positions.len().max(1),
            "attributes": p.attributes.iter().map(|a| &a.name).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "textures": scene.textures.iter().map(|t| serde_json::json!({
            "name": t.name, "width": t.width, "height": t.height, "encoding": t.encoding, "alpha": t.alpha,
            "float": matches!(t.texels, scene::Texels::Float(_)),
        })).collect::<Vec<_>>(),
        "grids": scene.grids.iter().map(|set| serde_json::json!({
            "name": set.name, "interpolation": set.interpolation,
            "grids": set.grids.iter().map(|grid| serde_json::json!({"name": grid.name, "channels": grid.channels,
                "object_from_index": grid.object_from_index, "active": grid.active,
            })).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "world": {"color": scene.world.color, "texture": scene.world.texture,
            "texture_from_world": scene.world.texture_from_world, "visible_camera": scene.world.visible_camera, "parts": scene.world.parts,
            "volume": scene.world.volume, "receiver": scene.world.receiver},
        "instanced_triangles": scene.instances.iter().map(triangles).sum::<usize>(),
        "warnings": scene.warnings,
    })
}
