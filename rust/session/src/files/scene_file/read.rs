use super::{
    CurvesParts, DESCRIPTION, FORMAT_VERSION, GridParts, GridSetParts, KEY, MeshParts, PointsParts,
    SceneDescription, SceneFile, SceneHeader, TextureParts, VIEW,
};
use crate::bake::check_scene;
use crate::files::light_set;
use bytemuck::{Pod, pod_collect_to_vec};
use relume_image::ViewTransform;
use relume_scene::{
    ColorAttribute, Curves, Grid, GridSet, Light, Mesh, Points, Scene, SceneBuilder, Texels, Texture,
    Undisplaced, UvMap,
};
use relume_trace::TraceSettings;
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// Reads a file's bytes. What they hold takes the same way into a scene as what Blender exports.
pub(super) fn decode(bytes: &[u8]) -> Result<SceneFile, String> {
    let damaged = |error| format!("damaged or no scene file ({error}); export it again");
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
    let about = metadata.metadata().as_ref().and_then(|entries| entries.get(KEY));
    let about = parse_about(about.ok_or("a safetensors file, but no scene file; choose another file")?)?;
    let arrays = Arrays(SafeTensors::deserialize(bytes).map_err(damaged)?);
    let (scene, settings) = read_scene(&arrays).map_err(|reason| format!("{reason}; export it again"))?;
    // A fuzzer never guesses a hash, and would not get past it.
    if (scene.hash(), scene.world_map()) != (about.scene_hash, about.world_map) && !cfg!(fuzzing) {
        return Err(
            "damaged: its content does not match its hash; export it again or restore the file".into()
        );
    }
    let view = arrays.view().map_err(|reason| format!("{reason}; export it again"))?;
    Ok(SceneFile { scene, settings, view })
}

fn parse_about(json: &str) -> Result<SceneHeader, String> {
    #[derive(Deserialize)]
    struct Version {
        format_version: u32,
    }
    let damaged = |error: serde_json::Error| format!("its header is damaged ({error}); export it again");
    let version = serde_json::from_str::<Version>(json).map_err(damaged)?.format_version;
    if version != FORMAT_VERSION {
        return Err(format!(
            "written in format {version}, but this Relume reads format {FORMAT_VERSION}; use the version of Relume \
             that wrote it, or export it again"
        ));
    }
    serde_json::from_str(json).map_err(damaged)
}

fn read_scene(arrays: &Arrays) -> Result<(Scene, TraceSettings), String> {
    let json: Vec<u8> = arrays.rows(DESCRIPTION, Dtype::U8, &[])?;
    let parts: SceneDescription<Value> =
        serde_json::from_slice(&json).map_err(|error| format!("its description is damaged ({error})"))?;
    let mut builder = SceneBuilder::new(parts.working_space);
    let refused = |error: relume_scene::BuildError| error.to_string();
    for (number, texture) in parts.textures.into_iter().enumerate() {
        builder.add_texture(arrays.texture(number, texture)?).map_err(refused)?;
    }
    for material in &parts.materials {
        builder.add_material(material).map_err(refused)?;
    }
    for (number, mesh) in parts.meshes.into_iter().enumerate() {
        builder.add_mesh(arrays.mesh(number, mesh)?).map_err(refused)?;
    }
    for (number, set) in parts.grids.into_iter().enumerate() {
        builder.add_grid_set(arrays.grid_set(number, set)?).map_err(refused)?;
    }
    for (number, curves) in parts.curves.into_iter().enumerate() {
        builder.add_curves(arrays.curves(number, curves)?).map_err(refused)?;
    }
    for (number, points) in parts.points.into_iter().enumerate() {
        builder.add_points(arrays.points(number, points)?).map_err(refused)?;
    }
    for instance in parts.instances {
        builder.add_instance(instance).map_err(refused)?;
    }
    builder.set_world(parts.world).map_err(refused)?;
    builder.set_camera(parts.camera);
    check_lights(&parts.lights)?;
    check_lights(&parts.settings.guide_targets)?;
    parts.lights.into_iter().for_each(|light| builder.add_light(light));
    parts.warnings.into_iter().for_each(|warning| builder.warn(warning));
    let scene = builder.build().map_err(refused)?;
    check_scene(&scene)?;
    Ok((scene, parts.settings))
}

fn check_lights(lights: &[Light]) -> Result<(), String> {
    let fault =
        |light: &Light| light_set::check(light).map_err(|reason| format!("light '{}': {reason}", light.name));
    lights.iter().try_for_each(fault)
}

/// The tensors of a file, whose sizes are those of the file.
struct Arrays<'a>(SafeTensors<'a>);

impl Arrays<'_> {
    fn mesh(&self, number: usize, parts: MeshParts) -> Result<Mesh, String> {
        let name = |part: &str| format!("mesh.{number}.{part}");
        let undisplaced = if parts.is_displaced {
            Some(Undisplaced {
                positions: self.rows(&name("undisplaced_positions"), Dtype::F32, &[3])?,
                corner_normals: self.rows(&name("undisplaced_normals"), Dtype::F32, &[3])?,
            })
        } else {
            None
        };
        Ok(Mesh {
            name: parts.name,
            positions: self.rows(&name("positions"), Dtype::F32, &[3])?,
            triangles: self.rows(&name("triangles"), Dtype::U32, &[3])?,
            motion: self.motion(parts.moves, &name("motion"), &[3])?,
            corner_normals: self.rows(&name("corner_normals"), Dtype::F32, &[3])?,
            uv_maps: self.uv_maps(&name("uv_map"), parts.uv_maps)?,
            color_attributes: self.attributes(&name("color_attribute"), parts.color_attributes)?,
            material_slots: self.rows(&name("material_slots"), Dtype::U16, &[])?,
            texture_space: parts.texture_space,
            displaceable: None,
            undisplaced,
        })
    }

    fn curves(&self, number: usize, parts: CurvesParts) -> Result<Curves, String> {
        let name = |part: &str| format!("curves.{number}.{part}");
        Ok(Curves {
            name: parts.name,
            shape: parts.shape,
            first_number: parts.first_number,
            keys: self.rows(&name("keys"), Dtype::F32, &[3])?,
            radii: self.rows(&name("radii"), Dtype::F32, &[])?,
            motion: self.motion(parts.moves, &name("motion"), &[4])?,
            first_keys: self.rows(&name("first_keys"), Dtype::U32, &[])?,
            uv_maps: self.uv_maps(&name("uv_map"), parts.uv_maps)?,
            key_attributes: self.attributes(&name("key_attribute"), parts.key_attributes)?,
            curve_attributes: self.attributes(&name("curve_attribute"), parts.curve_attributes)?,
            generated: self.rows(&name("generated"), Dtype::F32, &[3])?,
            normals: self.rows(&name("normals"), Dtype::F32, &[3])?,
        })
    }

    fn points(&self, number: usize, parts: PointsParts) -> Result<Points, String> {
        let name = |part: &str| format!("points.{number}.{part}");
        Ok(Points {
            name: parts.name,
            positions: self.rows(&name("positions"), Dtype::F32, &[3])?,
            radii: self.rows(&name("radii"), Dtype::F32, &[])?,
            motion: self.motion(parts.moves, &name("motion"), &[4])?,
            uv_maps: self.uv_maps(&name("uv_map"), parts.uv_maps)?,
            attributes: self.attributes(&name("attribute"), parts.attributes)?,
        })
    }

    fn motion<T: Pod>(&self, moves: bool, tensor: &str, row: &[usize]) -> Result<Vec<T>, String> {
        if moves { self.rows(tensor, Dtype::F32, row) } else { Ok(Vec::new()) }
    }

    fn uv_maps(&self, tensor: &str, names: Vec<String>) -> Result<Vec<UvMap>, String> {
        let map = |(k, name): (usize, String)| {
            Ok(UvMap { name, coords: self.rows(&format!("{tensor}.{k}"), Dtype::F32, &[2])? })
        };
        names.into_iter().enumerate().map(map).collect()
    }

    fn attributes(&self, tensor: &str, names: Vec<String>) -> Result<Vec<ColorAttribute>, String> {
        let attribute = |(k, name): (usize, String)| {
            Ok(ColorAttribute { name, colors: self.rows(&format!("{tensor}.{k}"), Dtype::F32, &[4])? })
        };
        names.into_iter().enumerate().map(attribute).collect()
    }

    fn texture(&self, number: usize, parts: TextureParts) -> Result<Texture, String> {
        let TextureParts { name, width, height, is_float, encoding, alpha } = parts;
        let (tensor, row) = (format!("texture.{number}"), [width, 4]);
        let texels = match is_float {
            true => Texels::Float(self.rows(&tensor, Dtype::F32, &row)?),
            false => Texels::Byte(self.rows(&tensor, Dtype::U8, &row)?),
        };
        Ok(Texture { name, width, height, texels, encoding, alpha })
    }

    fn grid_set(&self, number: usize, parts: GridSetParts) -> Result<GridSet, String> {
        let grid = |(k, parts): (usize, GridParts)| -> Result<Grid, String> {
            let tensor = |part: &str| format!("grid.{number}.{k}.{part}");
            let GridParts { name, channels, object_from_index, bricks, active } = parts;
            let slots = self.rows(&tensor("slots"), Dtype::U32, &[])?;
            let values = self.rows(&tensor("values"), Dtype::F32, &[channels])?;
            Ok(Grid { name, channels, object_from_index, bricks, active, slots, values })
        };
        let GridSetParts { name, interpolation, advection, grids } = parts;
        let grids = grids.into_iter().enumerate().map(grid).collect::<Result<_, _>>()?;
        Ok(GridSet { name, interpolation, grids, advection })
    }

    fn view(&self) -> Result<Option<Vec<u8>>, String> {
        if self.0.tensor(VIEW).is_err() {
            return Ok(None);
        }
        let png = self.rows(VIEW, Dtype::U8, &[])?;
        ViewTransform::decode_lut(Path::new(VIEW), &png).map_err(|error| error.to_string())?;
        Ok(Some(png))
    }

    /// Values of a tensor of this type whose rows have this shape, regrouped as `T`.
    fn rows<T: Pod>(&self, name: &str, dtype: Dtype, row: &[usize]) -> Result<Vec<T>, String> {
        let view = self.0.tensor(name).map_err(|_| format!("tensor {name} is missing"))?;
        if view.dtype() != dtype || view.shape().get(1..) != Some(row) {
            let (dtype_found, shape) = (view.dtype(), view.shape());
            return Err(format!(
                "tensor {name} is {dtype_found:?} {shape:?} instead of rows of {dtype:?} {row:?}"
            ));
        }
        Ok(pod_collect_to_vec(view.data()))
    }
}
