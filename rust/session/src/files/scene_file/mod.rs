//! Scene files: a scene as Blender sees it, to be traced where there is no Blender. `safetensors`, with
//!
//! | tensor | type | shape | meaning |
//! |---|---|---|---|
//! | `description` | U8 | bytes | JSON: all that is no array, [`SceneDescription`] |
//! | `mesh.N.positions` | F32 | vertices, 3 | of mesh N ([`relume_scene::Mesh`]) |
//! | `mesh.N.triangles` | U32 | triangles, 3 | |
//! | `mesh.N.corner_normals` | F32 | corners, 3 | no corners if every face is flat |
//! | `mesh.N.undisplaced_positions`, `.undisplaced_normals` | F32 | as above | of meshes that are displaced |
//! | `mesh.N.material_slots` | U16 | triangles | none if all are slot 0 |
//! | `mesh.N.uv_map.K` | F32 | corners, 2 | |
//! | `mesh.N.color_attribute.K` | F32 | corners, 4 | |
//! | `curves.N.keys`, `.normals` | F32 | keys, 3 | of curves N ([`relume_scene::Curves`]); of normals none if there are none |
//! | `curves.N.radii` | F32 | keys | |
//! | `curves.N.first_keys` | U32 | curves + 1 | |
//! | `curves.N.generated` | F32 | curves, 3 | none if there are none |
//! | `curves.N.uv_map.K` | F32 | curves, 2 | |
//! | `curves.N.key_attribute.K`, `.curve_attribute.K` | F32 | keys or curves, 4 | |
//! | `points.N.positions` | F32 | points, 3 | of points N ([`relume_scene::Points`]) |
//! | `points.N.radii` | F32 | points | |
//! | `points.N.uv_map.K`, `.attribute.K` | F32 | points, 2 or 4 | |
//! | `texture.N` | U8 or F32 | height, width, 4 | RGBA, bottom row first |
//! | `grid.N.K.slots` | U32 | bricks | of grid K of volume N ([`relume_scene::Grid`]) |
//! | `grid.N.K.values` | F32 | voxels, channels | |
//! | `view` | U8 | bytes | [`crate::files::names::VIEW_FILE`], if there is one |
//!
//! The metadata key `relume_scene` holds the format and scene ([`SceneHeader`]). The description is a tensor of its own
//! because headers end at 100 MB, which a forest of instances exceeds.

mod read;
mod write;

use crate::error::SessionError;
use crate::files::names::VIEW_FILE;
use relume_image::write_atomically;
use relume_scene::glam::{Affine3A, IVec3, Vec3};
use relume_scene::{
    Advection, Alpha, Bricks, Camera, ColorEncoding, GridInterpolation, Instance, Light, Scene, StrandShape,
    World,
};
use relume_trace::TraceSettings;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// Metadata key of [`SceneHeader`].
const KEY: &str = "relume_scene";
/// Version of the format. Raise it when a reader of the old one would misread a new file.
const FORMAT_VERSION: u32 = 1;
const DESCRIPTION: &str = "description";
const VIEW: &str = "view";

/// A scene with what it is traced with.
#[derive(Clone, Debug, Default)]
pub struct SceneFile {
    /// The scene.
    pub scene: Scene,
    /// Render settings.
    pub settings: TraceSettings,
    /// View transform: the bytes of [`VIEW_FILE`]; none for the sRGB curve.
    pub view: Option<Vec<u8>>,
}

/// Header of a scene file.
#[derive(Debug, Serialize, Deserialize)]
struct SceneHeader {
    format_version: u32,
    /// [`Scene::hash`].
    scene_hash: String,
    /// [`Scene::world_map`].
    world_map: String,
}

/// Everything but arrays. Materials are [`relume_scene::Material`], or JSON until they are checked.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneDescription<M> {
    working_space: String,
    camera: Camera,
    meshes: Vec<MeshParts>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    curves: Vec<CurvesParts>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    points: Vec<PointsParts>,
    instances: Vec<Instance>,
    materials: Vec<M>,
    textures: Vec<TextureParts>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    grids: Vec<GridSetParts>,
    world: World,
    lights: Vec<Light>,
    warnings: Vec<String>,
    settings: TraceSettings,
}

/// A [`relume_scene::Mesh`] without its arrays.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshParts {
    name: String,
    texture_space: Option<[Vec3; 2]>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    is_displaced: bool,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    moves: bool,
    uv_maps: Vec<String>,
    color_attributes: Vec<String>,
}

/// [`relume_scene::Curves`] without their arrays.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CurvesParts {
    name: String,
    shape: StrandShape,
    first_number: u32,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    moves: bool,
    uv_maps: Vec<String>,
    key_attributes: Vec<String>,
    curve_attributes: Vec<String>,
}

/// [`relume_scene::Points`] without their arrays.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointsParts {
    name: String,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    moves: bool,
    uv_maps: Vec<String>,
    attributes: Vec<String>,
}

/// A [`relume_scene::Texture`] without its texels.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TextureParts {
    name: String,
    width: usize,
    height: usize,
    is_float: bool,
    encoding: ColorEncoding,
    alpha: Alpha,
}

/// A [`relume_scene::GridSet`] without its arrays.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GridSetParts {
    name: String,
    interpolation: GridInterpolation,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    advection: Option<Advection>,
    grids: Vec<GridParts>,
}

/// A [`relume_scene::Grid`] without its arrays.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GridParts {
    name: String,
    channels: usize,
    object_from_index: Affine3A,
    bricks: Bricks,
    active: Option<[IVec3; 2]>,
}

/// Writes a scene with its render settings and view ([`VIEW_FILE`]'s bytes, unless that is the sRGB curve), atomically.
///
/// # Errors
/// If the scene cannot be traced or the file cannot be written; an older file at `path` stays.
pub fn write_scene(
    path: &Path,
    scene: &Scene,
    settings: &TraceSettings,
    view: Option<&[u8]>,
) -> Result<(), SessionError> {
    let bytes = write::encode(scene, settings, view).map_err(|reason| error(path, reason))?;
    Ok(write_atomically(path, |writer| writer.write_all(&bytes))?)
}

impl SceneFile {
    /// Reads a file that nobody vouches for.
    ///
    /// # Errors
    /// [`SessionError::SceneFile`] names the file, what is wrong, and the part that it is wrong with.
    pub fn read(path: &Path) -> Result<Self, SessionError> {
        let bytes = std::fs::read(path).map_err(SessionError::io("read the scene file", path))?;
        Self::from_bytes(path, &bytes)
    }

    /// Reads the bytes of a scene file; `name` stands in messages.
    ///
    /// # Errors
    /// Fails like [`SceneFile::read`].
    pub fn from_bytes(name: &Path, bytes: &[u8]) -> Result<Self, SessionError> {
        read::decode(bytes).map_err(|reason| error(name, reason))
    }

    /// Puts the view into a bake folder.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_view(&self, folder: &Path) -> Result<(), SessionError> {
        let Some(view) = &self.view else { return Ok(()) };
        Ok(write_atomically(&folder.join(VIEW_FILE), |writer| writer.write_all(view))?)
    }
}

fn error(path: &Path, reason: String) -> SessionError {
    SessionError::SceneFile { path: path.to_path_buf(), reason }
}

#[cfg(test)]
mod tests;
