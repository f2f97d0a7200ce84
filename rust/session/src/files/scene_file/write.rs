use super::{
    CurvesParts, DESCRIPTION, FORMAT_VERSION, GridParts, GridSetParts, KEY, MeshParts, PointsParts,
    SceneDescription, SceneHeader, TextureParts, VIEW,
};
use crate::bake::check_scene;
use bytemuck::{NoUninit, cast_slice};
use relume_scene::{
    ColorAttribute, Curves, Grid, GridSet, Material, Mesh, Points, Scene, Texels, Texture, UvMap,
};
use relume_trace::TraceSettings;
use safetensors::tensor::{Dtype, TensorView, serialize};
use std::collections::HashMap;

/// The bytes of a scene's file.
pub(super) fn encode(
    scene: &Scene,
    settings: &TraceSettings,
    view: Option<&[u8]>,
) -> Result<Vec<u8>, String> {
    check_scene(scene)?;
    let description = serde_json::to_vec(&describe(scene, settings)).map_err(|error| error.to_string())?;
    // JSON has null for what is not a finite number, and no reader takes that: better said now than on the farm.
    serde_json::from_slice::<SceneDescription<Material>>(&description)
        .map_err(|error| format!("a value is not a finite number ({error}); correct it in Blender"))?;
    let mut tensors = Tensors::default();
    tensors.add(DESCRIPTION.into(), Dtype::U8, &[], &description)?;
    for (number, mesh) in scene.meshes.iter().enumerate() {
        tensors.add_mesh(&format!("mesh.{number}"), mesh)?;
    }
    for (number, curves) in scene.curves.iter().enumerate() {
        tensors.add_curves(&format!("curves.{number}"), curves)?;
    }
    for (number, points) in scene.points.iter().enumerate() {
        tensors.add_points(&format!("points.{number}"), points)?;
    }
    for (number, texture) in scene.textures.iter().enumerate() {
        let (name, row) = (format!("texture.{number}"), [texture.width, 4]);
        match &texture.texels {
            Texels::Byte(texels) => tensors.add(name, Dtype::U8, &row, texels)?,
            Texels::Float(texels) => tensors.add(name, Dtype::F32, &row, texels)?,
        }
    }
    for (number, set) in scene.grids.iter().enumerate() {
        for (k, grid) in set.grids.iter().enumerate() {
            let name = |part: &str| format!("grid.{number}.{k}.{part}");
            tensors.add(name("slots"), Dtype::U32, &[], &grid.slots)?;
            tensors.add(name("values"), Dtype::F32, &[grid.channels], &grid.values)?;
        }
    }
    if let Some(view) = view {
        tensors.add(VIEW.into(), Dtype::U8, &[], view)?;
    }
    let (scene_hash, world_map) = (scene.hash(), scene.world_map());
    let about = SceneHeader { format_version: FORMAT_VERSION, scene_hash, world_map };
    let about = serde_json::to_string(&about).map_err(|error| error.to_string())?;
    serialize(tensors.0, Some(HashMap::from([(KEY.to_owned(), about)]))).map_err(|error| error.to_string())
}

fn describe(scene: &Scene, settings: &TraceSettings) -> SceneDescription<Material> {
    SceneDescription {
        working_space: scene.working_space.clone(),
        camera: scene.camera.clone(),
        meshes: scene.meshes.iter().map(mesh_parts).collect(),
        curves: scene.curves.iter().map(curves_parts).collect(),
        points: scene.points.iter().map(points_parts).collect(),
        instances: scene.instances.clone(),
        materials: scene.materials.clone(),
        textures: scene.textures.iter().map(texture_parts).collect(),
        grids: scene.grids.iter().map(grid_set_parts).collect(),
        world: scene.world.clone(),
        lights: scene.lights.clone(),
        warnings: scene.warnings.clone(),
        settings: settings.clone(),
    }
}

fn mesh_parts(mesh: &Mesh) -> MeshParts {
    MeshParts {
        name: mesh.name.clone(),
        texture_space: mesh.texture_space,
        is_displaced: mesh.undisplaced.is_some(),
        moves: !mesh.motion.is_empty(),
        uv_maps: map_names(&mesh.uv_maps),
        color_attributes: attribute_names(&mesh.color_attributes),
    }
}

fn curves_parts(curves: &Curves) -> CurvesParts {
    CurvesParts {
        name: curves.name.clone(),
        shape: curves.shape,
        first_number: curves.first_number,
        moves: !curves.motion.is_empty(),
        uv_maps: map_names(&curves.uv_maps),
        key_attributes: attribute_names(&curves.key_attributes),
        curve_attributes: attribute_names(&curves.curve_attributes),
    }
}

fn points_parts(points: &Points) -> PointsParts {
    PointsParts {
        name: points.name.clone(),
        moves: !points.motion.is_empty(),
        uv_maps: map_names(&points.uv_maps),
        attributes: attribute_names(&points.attributes),
    }
}

fn map_names(maps: &[UvMap]) -> Vec<String> {
    maps.iter().map(|map| map.name.clone()).collect()
}

fn attribute_names(attributes: &[ColorAttribute]) -> Vec<String> {
    attributes.iter().map(|attribute| attribute.name.clone()).collect()
}

fn texture_parts(texture: &Texture) -> TextureParts {
    let Texture { width, height, encoding, alpha, .. } = *texture;
    let is_float = matches!(texture.texels, Texels::Float(_));
    TextureParts { name: texture.name.clone(), width, height, is_float, encoding, alpha }
}

fn grid_set_parts(set: &GridSet) -> GridSetParts {
    let parts = |grid: &Grid| {
        let Grid { channels, object_from_index, bricks, active, .. } = *grid;
        GridParts { name: grid.name.clone(), channels, object_from_index, bricks, active }
    };
    GridSetParts {
        name: set.name.clone(),
        interpolation: set.interpolation,
        advection: set.advection.clone(),
        grids: set.grids.iter().map(parts).collect(),
    }
}

/// Arrays that lie in the scene, by the names of their tensors.
#[derive(Default)]
struct Tensors<'a>(Vec<(String, TensorView<'a>)>);

impl<'a> Tensors<'a> {
    fn add_mesh(&mut self, name: &str, mesh: &'a Mesh) -> Result<(), String> {
        self.add(format!("{name}.positions"), Dtype::F32, &[3], &mesh.positions)?;
        self.add(format!("{name}.triangles"), Dtype::U32, &[3], &mesh.triangles)?;
        self.add(format!("{name}.corner_normals"), Dtype::F32, &[3], &mesh.corner_normals)?;
        self.add(format!("{name}.material_slots"), Dtype::U16, &[], &mesh.material_slots)?;
        self.add_motion(name, &[3], &mesh.motion)?;
        if let Some(before) = &mesh.undisplaced {
            self.add(format!("{name}.undisplaced_positions"), Dtype::F32, &[3], &before.positions)?;
            self.add(format!("{name}.undisplaced_normals"), Dtype::F32, &[3], &before.corner_normals)?;
        }
        self.add_uv_maps(name, &mesh.uv_maps)?;
        self.add_attributes(&format!("{name}.color_attribute"), &mesh.color_attributes)
    }

    fn add_curves(&mut self, name: &str, curves: &'a Curves) -> Result<(), String> {
        self.add(format!("{name}.keys"), Dtype::F32, &[3], &curves.keys)?;
        self.add(format!("{name}.radii"), Dtype::F32, &[], &curves.radii)?;
        self.add(format!("{name}.first_keys"), Dtype::U32, &[], &curves.first_keys)?;
        self.add(format!("{name}.generated"), Dtype::F32, &[3], &curves.generated)?;
        self.add(format!("{name}.normals"), Dtype::F32, &[3], &curves.normals)?;
        self.add_motion(name, &[4], &curves.motion)?;
        self.add_uv_maps(name, &curves.uv_maps)?;
        self.add_attributes(&format!("{name}.key_attribute"), &curves.key_attributes)?;
        self.add_attributes(&format!("{name}.curve_attribute"), &curves.curve_attributes)
    }

    fn add_points(&mut self, name: &str, points: &'a Points) -> Result<(), String> {
        self.add(format!("{name}.positions"), Dtype::F32, &[3], &points.positions)?;
        self.add(format!("{name}.radii"), Dtype::F32, &[], &points.radii)?;
        self.add_motion(name, &[4], &points.motion)?;
        self.add_uv_maps(name, &points.uv_maps)?;
        self.add_attributes(&format!("{name}.attribute"), &points.attributes)
    }

    fn add_motion<T: NoUninit>(&mut self, name: &str, row: &[usize], keys: &'a [T]) -> Result<(), String> {
        if keys.is_empty() { Ok(()) } else { self.add(format!("{name}.motion"), Dtype::F32, row, keys) }
    }

    fn add_uv_maps(&mut self, name: &str, maps: &'a [UvMap]) -> Result<(), String> {
        let mut maps = maps.iter().enumerate();
        maps.try_for_each(|(k, map)| self.add(format!("{name}.uv_map.{k}"), Dtype::F32, &[2], &map.coords))
    }

    fn add_attributes(&mut self, name: &str, attributes: &'a [ColorAttribute]) -> Result<(), String> {
        let mut attributes = attributes.iter().enumerate();
        attributes.try_for_each(|(k, attribute)| {
            self.add(format!("{name}.{k}"), Dtype::F32, &[4], &attribute.colors)
        })
    }

    /// Adds a tensor with as many rows of this shape as there are values for.
    fn add<T: NoUninit>(
        &mut self,
        name: String,
        dtype: Dtype,
        row: &[usize],
        values: &'a [T],
    ) -> Result<(), String> {
        let bytes: &[u8] = cast_slice(values);
        let row_bytes = row.iter().product::<usize>() * dtype.bitsize() / 8;
        let shape = [&[bytes.len() / row_bytes], row].concat();
        let view = TensorView::new(dtype, shape, bytes).map_err(|error| format!("{name}: {error}"))?;
        self.0.push((name, view));
        Ok(())
    }
}
