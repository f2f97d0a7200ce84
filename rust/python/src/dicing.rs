//! Arguments of adaptive subdivision.

use crate::array::{Array, affine_from_rows};
use crate::error::{NativeError, enter_native, invalid};
use glam::Vec3;
use pyo3::prelude::*;
use relume_scene as scene;
use relume_session::trace::subdivide::{Border, Cage, Dicing, MOST_TRIANGLES, Screen};
use serde::Deserialize;

/// Settings as JSON, vertices of creases, their sharpness, and that of vertices.
#[derive(FromPyObject)]
pub struct DicingArguments<'py>(String, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Settings in their JSON form; see [`Dicing`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    edge: f32,
    levels: u8,
    smooth: Option<Smooth>,
    screen: Option<ScreenSettings>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Smooth {
    border: Border,
    uv_border: Option<Border>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScreenSettings {
    camera: scene::BlenderCamera,
    world_from_object: [[f32; 4]; 4],
    offscreen_scale: f32,
}

impl Settings {
    fn parse(json: &str) -> Result<Dicing, NativeError> {
        let Self { edge, levels, smooth, screen } = serde_json::from_str(json)?;
        if !(edge > 0.0 && edge.is_finite()) {
            return Err(invalid(format!("edges cannot be {edge} long")));
        }
        let screen = match screen {
            Some(ScreenSettings { camera, world_from_object, offscreen_scale }) => {
                let place = affine_from_rows(world_from_object);
                Some(Screen::new(&camera.to_camera()?, place, offscreen_scale))
            }
            None => None,
        };
        Ok(Dicing { edge, levels, smooth: smooth.map(|smooth| (smooth.border, smooth.uv_border)), screen })
    }
}

/// A mesh, and words if it is coarser than asked for.
pub struct DicedMesh {
    pub mesh: scene::Mesh,
    pub warning: Option<String>,
}

impl DicingArguments<'_> {
    /// Dices a mesh where `diced` triangles are there already.
    pub fn dice(
        &self,
        py: Python<'_>,
        polygons: &scene::PolygonMesh<'_>,
        motion: &[Vec3],
        diced: usize,
    ) -> PyResult<DicedMesh> {
        let Self(settings, edges, sharpness, vertices) = self;
        let edges = Array::<i32>::borrow("crease edges", edges)?;
        let sharpness = Array::<f32>::borrow("crease sharpness", sharpness)?;
        let vertices = Array::<f32>::borrow("vertex sharpness", vertices)?;
        let (edges, sharpness, sharp_vertices) =
            (edges.cast::<[u32; 2]>()?, sharpness.values()?, vertices.values()?);
        enter_native(py, || {
            let dicing = Settings::parse(settings)?;
            let creases = edges.iter().copied().zip(sharpness.iter().copied()).collect();
            let cage = Cage { polygons, creases, sharp_vertices, motion };
            let (mesh, edge) = cage.diced(&dicing, MOST_TRIANGLES.saturating_sub(diced))?;
            let unit = if dicing.screen.is_some() { "pixels" } else { "m" };
            let warning = (edge > dicing.edge).then(|| {
                let (asked, millions) = (dicing.edge, MOST_TRIANGLES / 1_000_000);
                format!(
                    "adaptive subdivision to edges of {edge:.2} {unit} in place of {asked:.2}, since a scene takes {millions} million such triangles"
                )
            });
            Ok::<_, NativeError>(DicedMesh { mesh, warning })
        })
    }
}
