//! `SceneBuilder`.

use crate::array::{
    Array, affine_from_rows, mat3_from_rows, named_arrays, owned, owned_attributes, owned_uv_maps, regrouped,
};
use crate::dicing::{DicedMesh, DicingArguments};
use crate::error::{NativeError, enter_native, invalid};
use crate::scene::{PyScene, PyWorld};
use glam::{Vec2, Vec3};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use relume_scene as scene;
use relume_session::trace::displace;
use relume_session::trace::shading::{Lamp, constant_emission, emission_map};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Collects a scene; see the stubs for shapes and units.
#[pyclass(name = "SceneBuilder", module = "relume")]
pub struct PySceneBuilder {
    builder: scene::SceneBuilder,
    /// Triangles of the meshes that were diced.
    diced: usize,
}

/// Largest value of an emission map, and the map as JSON.
type StoredMap = (f32, String);

/// Rays, colour, texture and rows of the direction of a [`scene::WorldPart`].
type WorldPartArguments = ([bool; 5], [f32; 3], Option<usize>, [[f32; 3]; 3]);

/// Most texels along a side of an image, and the largest share of them.
type Size = (Option<usize>, f32);

fn texture_size((largest, share): Size) -> scene::TextureSize {
    scene::TextureSize { largest, share }
}

/// Source of the bytes of a texture.
#[derive(FromPyObject)]
enum TextureFile<'py> {
    Packed(Bound<'py, PyBytes>),
    Stored(PathBuf),
}

impl TextureFile<'_> {
    fn bytes(&self) -> Result<&[u8], &Path> {
        match self {
            Self::Packed(bytes) => Ok(bytes.as_bytes()),
            Self::Stored(path) => Err(path),
        }
    }
}

/// A value of an enum by its name; `what` is for messages.
fn known<T: serde::de::DeserializeOwned>(what: &str, name: &str) -> PyResult<T> {
    let value = serde_json::from_value(serde_json::Value::from(name));
    Ok(value.map_err(|_| invalid(format!("{what} '{name}' is not known")))?)
}

#[pymethods]
impl PySceneBuilder {
    #[new]
    #[pyo3(signature = (working_space="Linear Rec.709"))]
    fn new(working_space: &str) -> Self {
        Self { builder: scene::SceneBuilder::new(working_space), diced: 0 }
    }

    #[pyo3(signature = (name, positions, corner_verts, face_starts, *, vertex_normals=None, corner_normals=None,
        sharp_faces=None, uv_maps=None, color_attributes=None, material_slots=None, texture_space=None,
        displacement_normals=None, turns_corner_normals=false, shown_by=None, motion=None, dicing=None))]
    fn add_mesh(
        &mut self,
        py: Python<'_>,
        name: &str,
        positions: &Bound<'_, PyAny>,
        corner_verts: &Bound<'_, PyAny>,
        face_starts: &Bound<'_, PyAny>,
        vertex_normals: Option<&Bound<'_, PyAny>>,
        corner_normals: Option<&Bound<'_, PyAny>>,
        sharp_faces: Option<&Bound<'_, PyAny>>,
        uv_maps: Option<&Bound<'_, PyDict>>,
        color_attributes: Option<&Bound<'_, PyDict>>,
        material_slots: Option<&Bound<'_, PyAny>>,
        texture_space: Option<[[f32; 3]; 2]>,
        displacement_normals: Option<&Bound<'_, PyAny>>,
        turns_corner_normals: bool,
        shown_by: Option<&str>,
        motion: Option<&Bound<'_, PyAny>>,
        dicing: Option<DicingArguments<'_>>,
    ) -> PyResult<usize> {
        let positions = Array::<f32>::borrow("positions", positions)?;
        let corner_verts = Array::<i32>::borrow("corner_verts", corner_verts)?;
        let face_starts = Array::<i32>::borrow("face_starts", face_starts)?;
        let optional = |name, object: Option<_>| object.map(|o| Array::<f32>::borrow(name, o)).transpose();
        let vertex_normals = optional("vertex_normals", vertex_normals)?;
        let corner_normals = optional("corner_normals", corner_normals)?;
        let displacement_normals = optional("displacement_normals", displacement_normals)?;
        let sharp_faces = sharp_faces.map(|o| Array::<bool>::borrow("sharp_faces", o)).transpose()?;
        let material_slots = material_slots.map(|o| Array::<i32>::borrow("material_slots", o)).transpose()?;
        let coords = named_arrays("uv_maps", uv_maps)?;
        let colors = named_arrays("color_attributes", color_attributes)?;
        let polygons = scene::PolygonMesh {
            name,
            positions: positions.cast::<Vec3>()?,
            corner_verts: corner_verts.cast()?,
            face_starts: face_starts.cast()?,
            normals: match (&corner_normals, &vertex_normals) {
                (Some(normals), _) => scene::PolygonNormals::Corner(normals.cast()?),
                (None, Some(normals)) => scene::PolygonNormals::Vertex(normals.cast()?),
                (None, None) => scene::PolygonNormals::Flat,
            },
            sharp_faces: sharp_faces.as_ref().map_or(Ok(&[][..]), Array::values)?,
            uv_maps: regrouped::<Vec2>(&coords)?,
            color_attributes: regrouped::<[f32; 4]>(&colors)?,
            material_slots: material_slots.as_ref().map_or(Ok(&[][..]), Array::cast)?,
            displacement_normals: displacement_normals.as_ref().map(Array::cast).transpose()?,
            turns_corner_normals,
        };
        let motion: Vec<Vec3> = owned("motion", motion)?;
        let damaged = shown_by.map_or(format!("mesh '{name}'"), |object| format!("object '{object}'"));
        let mut mesh = if let Some(dicing) = dicing {
            let DicedMesh { mesh, warning } = dicing.dice(py, &polygons, &motion, self.diced)?;
            self.diced += mesh.triangles.len();
            warning.into_iter().for_each(|what| self.builder.warn(format!("{damaged}: {what}")));
            mesh
        } else {
            scene::Mesh { motion, ..enter_native(py, || polygons.triangulate())? }
        };
        mesh.texture_space = texture_space
            .map(|space| space.map(Vec3::from))
            .filter(|space| space.iter().all(|v| v.is_finite()));
        for what in polygons.damage() {
            self.builder.warn(format!("{damaged}: {what}"));
        }
        enter_native(py, || self.builder.add_mesh(mesh))
    }

    #[pyo3(signature = (name, keys, radii, first_keys, *, shape="ribbon", subdivisions=2, first_number=0,
        uv_maps=None,        key_attributes=None, curve_attributes=None, generated=None, normals=None, motion=None))]
    fn add_curves(
        &mut self,
        py: Python<'_>,
        name: &str,
        keys: &Bound<'_, PyAny>,
        radii: &Bound<'_, PyAny>,
        first_keys: &Bound<'_, PyAny>,
        shape: &str,
        subdivisions: u8,
        first_number: u32,
        uv_maps: Option<&Bound<'_, PyDict>>,
        key_attributes: Option<&Bound<'_, PyDict>>,
        curve_attributes: Option<&Bound<'_, PyDict>>,
        generated: Option<&Bound<'_, PyAny>>,
        normals: Option<&Bound<'_, PyAny>>,
        motion: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<usize> {
        let curves = scene::Curves {
            name: name.into(),
            shape: strand_shape(shape, subdivisions)?,
            first_number,
            keys: Array::<f32>::borrow("keys", keys)?.cast()?.to_vec(),
            radii: Array::<f32>::borrow("radii", radii)?.cast()?.to_vec(),
            first_keys: Array::<i32>::borrow("first_keys", first_keys)?.cast()?.to_vec(),
            uv_maps: owned_uv_maps(uv_maps)?,
            key_attributes: owned_attributes("key_attributes", key_attributes)?,
            curve_attributes: owned_attributes("curve_attributes", curve_attributes)?,
            generated: owned("generated", generated)?,
            normals: owned("normals", normals)?,
            motion: owned("motion", motion)?,
        };
        enter_native(py, || self.builder.add_curves(curves))
    }

    #[pyo3(signature = (name, positions, radii, *, uv_maps=None, attributes=None, motion=None))]
    fn add_points(
        &mut self,
        py: Python<'_>,
        name: &str,
        positions: &Bound<'_, PyAny>,
        radii: &Bound<'_, PyAny>,
        uv_maps: Option<&Bound<'_, PyDict>>,
        attributes: Option<&Bound<'_, PyDict>>,
        motion: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<usize> {
        let points = scene::Points {
            name: name.into(),
            positions: Array::<f32>::borrow("positions", positions)?.cast()?.to_vec(),
            radii: Array::<f32>::borrow("radii", radii)?.cast()?.to_vec(),
            uv_maps: owned_uv_maps(uv_maps)?,
            attributes: owned_attributes("attributes", attributes)?,
            motion: owned("motion", motion)?,
        };
        enter_native(py, || self.builder.add_points(points))
    }

    #[pyo3(signature = (name, geometry, world_from_object, materials, *, kind="mesh", receiver=0, color=[1.0; 4], pass_index=0,
        random=0.0, shadow_terminator_offset=0.1, shadow_terminator_shading=0.0, visibility=[true; 4],
        visible_volume_scatter=true, visible_shadow=true, visible_raycast=true, is_holdout=false, is_shadow_catcher=false, links=None, occlusion_distance=0.0, density_factor=1.0, grids=None, attributes=Vec::new(), motion=Vec::new()))]
    fn add_instance(
        &mut self,
        py: Python<'_>,
        name: &str,
        geometry: usize,
        world_from_object: [[f32; 4]; 4],
        materials: Vec<usize>,
        kind: &str,
        receiver: u16,
        color: [f32; 4],
        pass_index: u32,
        random: f32,
        shadow_terminator_offset: f32,
        shadow_terminator_shading: f32,
        visibility: [bool; 4],
        visible_volume_scatter: bool,
        visible_shadow: bool,
        visible_raycast: bool,
        is_holdout: bool,
        is_shadow_catcher: bool,
        links: Option<Links>,
        occlusion_distance: f32,
        density_factor: f32,
        grids: Option<usize>,
        attributes: Vec<(String, [f32; 4])>,
        motion: Vec<[[f32; 4]; 4]>,
    ) -> PyResult<()> {
        let geometry = match kind {
            "mesh" => scene::Geometry::Mesh(geometry),
            "curves" => scene::Geometry::Curves(geometry),
            "points" => scene::Geometry::Points(geometry),
            _ => return Err(invalid(format!("kind '{kind}' is not known")).into()),
        };
        let [visible_camera, visible_diffuse, visible_glossy, visible_transmission] = visibility;
        let instance = scene::Instance {
            receiver,
            color,
            pass_index,
            random,
            shadow_terminator_offset,
            shadow_terminator_shading,
            visible_camera,
            visible_diffuse,
            visible_glossy,
            visible_transmission,
            visible_volume_scatter,
            visible_shadow,
            visible_raycast,
            is_holdout,
            is_shadow_catcher,
            links: links.map(emitter_links),
            occlusion_distance,
            density_factor,
            grids,
            attributes,
            motion: scene::Pose::keys(&motion.into_iter().map(affine_from_rows).collect::<Vec<_>>()),
            ..scene::Instance::new(name, geometry, affine_from_rows(world_from_object), materials)
        };
        enter_native(py, || self.builder.add_instance(instance))
    }

    fn add_material(&mut self, py: Python<'_>, json: &str) -> PyResult<usize> {
        enter_native(py, || self.builder.add_material_json(json))
    }

    fn empty(&self) -> Self {
        Self { builder: scene::SceneBuilder::new(&self.builder.scene().working_space), diced: 0 }
    }

    #[staticmethod]
    fn constant_emission(json: &str) -> PyResult<(Option<[f32; 3]>, Option<u32>)> {
        let material =
            serde_json::from_str(json).map_err(|error| invalid(format!("shader (JSON): {error}")))?;
        Ok(match constant_emission(&material) {
            Ok(color) => (Some(color.to_array()), None),
            Err(node) => (None, Some(node)),
        })
    }

    fn emission_map(
        &self,
        py: Python<'_>,
        material: usize,
        lamp: &str,
    ) -> PyResult<(Option<StoredMap>, Vec<String>)> {
        let lamp: Lamp =
            serde_json::from_str(lamp).map_err(|error| invalid(format!("lamp (JSON): {error}")))?;
        let scene = self.builder.scene();
        let material =
            scene.materials.get(material).ok_or_else(|| invalid("there is no material of that number"))?;
        enter_native(py, || {
            let (map, notes) = emission_map(material, &scene.textures, &lamp);
            let stored = |(largest, map)| serde_json::to_string(&map).map(|map| (largest, map));
            let map = map.map(stored).transpose().map_err(|error| invalid(error.to_string()))?;
            Ok::<_, NativeError>((map, notes))
        })
    }

    #[pyo3(signature = (name, texels, *, encoding="srgb", alpha="straight", size=None))]
    fn add_texture(
        &mut self,
        py: Python<'_>,
        name: &str,
        texels: &Bound<'_, PyAny>,
        encoding: &str,
        alpha: &str,
        size: Option<Size>,
    ) -> PyResult<usize> {
        let (shape, texels) = if let Ok(bytes) = Array::<u8>::borrow("texels", texels) {
            ([bytes.size(0), bytes.size(1)], scene::Texels::Byte(bytes.cast()?.to_vec()))
        } else {
            let floats = Array::<f32>::borrow("texels (uint8 or float32)", texels)?;
            ([floats.size(0), floats.size(1)], scene::Texels::Float(floats.cast()?.to_vec()))
        };
        let (encoding, alpha) = (known("encoding", encoding)?, known("alpha", alpha)?);
        let [height, width] = shape;
        let texture = scene::Texture { name: name.into(), width, height, texels, encoding, alpha };
        enter_native(py, || self.builder.add_texture_of_size(texture, size.map(texture_size)))
    }

    #[pyo3(signature = (
        name, file, *, colors="srgb", alpha="straight", scene_from_rec709=None, size=None
    ))]
    fn add_texture_file(
        &mut self,
        py: Python<'_>,
        name: &str,
        file: TextureFile<'_>,
        colors: &str,
        alpha: &str,
        scene_from_rec709: Option<[[f32; 3]; 3]>,
        size: Option<Size>,
    ) -> PyResult<Option<usize>> {
        let turn = scene_from_rec709.map(mat3_from_rows);
        let (colors, alpha) = (known("colors", colors)?, known("alpha", alpha)?);
        let bytes = file.bytes();
        enter_native(py, || -> Result<_, NativeError> {
            let picture = match bytes {
                Ok(bytes) => scene::PictureFile::decode(bytes),
                Err(path) => scene::PictureFile::read(path),
            };
            let texture = picture.ok().map(|picture| picture.into_texture(name.into(), colors, alpha, turn));
            let size = size.map(texture_size);
            Ok(texture.map(|texture| self.builder.add_texture_of_size(texture, size)).transpose()?)
        })
    }

    #[pyo3(signature = (name, path, wanted, *, clipping=0.0, interpolation="linear", shift=0.0, velocities=None))]
    fn add_grid_file(
        &mut self,
        py: Python<'_>,
        name: &str,
        path: PathBuf,
        wanted: Vec<String>,
        clipping: f32,
        interpolation: &str,
        shift: f32,
        velocities: Option<(Vec<String>, f32, f32)>,
    ) -> PyResult<Option<(usize, usize)>> {
        let interpolation = known("interpolation", interpolation)?;
        enter_native(py, || -> Result<_, NativeError> {
            let bytes = std::fs::read(&path).map_err(|error| invalid(error.to_string()))?;
            let read = scene::GridSet::from_vdb(name, &bytes, &wanted, clipping, interpolation);
            let (mut set, mut refused) = read.map_err(invalid)?;
            if let Some((grids, scale, still)) = velocities {
                let advection = scene::Advection { grids, scale, still };
                refused.extend(set.advect(&bytes, advection).map_err(invalid)?);
            }
            for grid in &mut set.grids {
                grid.shift(Vec3::splat(shift));
            }
            for reason in refused {
                self.builder.warn(format!("object '{name}': {reason}; left out"));
            }
            Ok(self.builder.add_grids(set)?)
        })
    }

    #[pyo3(signature = (name, grids, low, high, *, clipping=0.0, interpolation="linear"))]
    fn add_grid_arrays(
        &mut self,
        py: Python<'_>,
        name: &str,
        grids: &Bound<'_, PyDict>,
        low: [f32; 3],
        high: [f32; 3],
        clipping: f32,
        interpolation: &str,
    ) -> PyResult<Option<(usize, usize)>> {
        let interpolation = known("interpolation", interpolation)?;
        let arrays = named_arrays("grids", Some(grids))?;
        let corners = [low, high].map(Vec3::from);
        let mut dense = Vec::with_capacity(arrays.len());
        for (grid, array) in &arrays {
            let size = [array.size(2), array.size(1), array.size(0)];
            let (channels, values) = (array.size(3).max(1), array.values()?);
            let object_from_index = scene::DenseGrid::place(size, corners);
            dense.push(scene::DenseGrid { name: grid, size, channels, values, object_from_index });
        }
        enter_native(py, || -> Result<_, NativeError> {
            let grids = dense.iter().map(|grid| grid.to_grid(clipping).map_err(invalid));
            let grids = grids.collect::<Result<_, _>>()?;
            let set = scene::GridSet { name: name.to_owned(), interpolation, grids, advection: None };
            Ok(self.builder.add_grids(set)?)
        })
    }

    fn set_camera(&mut self, py: Python<'_>, json: &str) -> PyResult<()> {
        enter_native(py, || -> Result<(), NativeError> {
            let camera: scene::BlenderCamera = serde_json::from_str(json)?;
            self.builder.set_camera(camera.to_camera()?);
            Ok(())
        })
    }

    #[pyo3(signature = (color, *, texture=None, texture_from_world=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        visible_camera=true, parts=Vec::new(), volume=None, receiver=0))]
    fn set_world(
        &mut self,
        py: Python<'_>,
        color: [f32; 3],
        texture: Option<usize>,
        texture_from_world: [[f32; 3]; 3],
        visible_camera: bool,
        parts: Vec<WorldPartArguments>,
        volume: Option<usize>,
        receiver: u16,
    ) -> PyResult<()> {
        let texture_from_world = mat3_from_rows(texture_from_world);
        let part = |(rays, color, texture, rows)| {
            let texture_from_world = mat3_from_rows(rows);
            scene::WorldPart { rays, color, texture, texture_from_world }
        };
        let parts = parts.into_iter().map(part).collect();
        let world =
            scene::World { color, texture, texture_from_world, visible_camera, parts, volume, receiver };
        enter_native(py, || self.builder.set_world(world))
    }

    fn add_light(&mut self, py: Python<'_>, json: &str) -> PyResult<()> {
        enter_native(py, || -> Result<(), NativeError> {
            let light: scene::BlenderLight = serde_json::from_str(json)?;
            let (light, notes) = light.to_light()?;
            self.builder.add_light(light);
            notes.into_iter().for_each(|note| self.builder.warn(note));
            Ok(())
        })
    }

    fn warn(&mut self, message: &str) {
        self.builder.warn(message);
    }

    #[pyo3(signature = (texture_of=None))]
    fn build_world(&mut self, py: Python<'_>, texture_of: Option<&PyWorld>) -> PyResult<PyWorld> {
        let scene = std::mem::take(&mut self.builder).build_world();
        let same = texture_of.and_then(|world| world.world.with_texture_for(&scene.world));
        let world = match same {
            Some(world) => world,
            None => enter_native(py, || relume_session::live::OtherWorld::new(&scene))?,
        };
        Ok(PyWorld { world: Arc::new(world), warnings: scene.warnings })
    }

    fn build(&mut self, py: Python<'_>) -> PyResult<PyScene> {
        let builder = std::mem::take(&mut self.builder);
        let scene = enter_native(py, || {
            let mut scene = builder.build()?;
            displace(&mut scene);
            Ok::<_, scene::BuildError>(scene)
        })?;
        Ok(PyScene { scene: Arc::new(scene) })
    }
}

/// Receivers and blockers of what shines on an object; None for everything.
type Links = (Option<Vec<u16>>, Option<Vec<u16>>);

fn emitter_links((receivers, blockers): Links) -> Box<scene::EmitterLinks> {
    let [receivers, blockers] = [receivers, blockers].map(|numbers| {
        numbers.map(|mut receivers| {
            receivers.sort_unstable();
            scene::ReceiverSet { receivers }
        })
    });
    Box::new(scene::EmitterLinks { receivers, blockers })
}

fn strand_shape(shape: &str, subdivisions: u8) -> PyResult<scene::StrandShape> {
    match shape {
        "ribbon" => Ok(scene::StrandShape::Ribbon { subdivisions }),
        "round" => Ok(scene::StrandShape::Round),
        "linear" => Ok(scene::StrandShape::Linear),
        _ => Err(invalid(format!("shape '{shape}' is not known")).into()),
    }
}
