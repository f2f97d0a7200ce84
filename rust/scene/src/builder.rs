//! Builds a [`Scene`] piece by piece and refuses what the tracer could trip over.

use crate::damage::can_be_placed;
use crate::motion::{keys_fault, shape_fault};
use crate::validate::world_fault;
use crate::{
    Camera, Curves, Grid, GridSet, Instance, Light, Material, Mesh, Node, Points, Scene, Texels, Texture,
    TextureSize, World,
};
use serde::Deserialize;
use serde_json::Value;

/// Collects a scene. Parts are referred to by the numbers that the `add_` functions return.
#[derive(Clone, Debug, Default)]
pub struct SceneBuilder {
    scene: Scene,
    has_camera: bool,
}

const ONLY_WORLD: &str = "the scene has nothing to render but its world; check that objects are enabled for renders, and Surfaces in the view layer";

/// Why a scene was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BuildError {
    /// No camera was set.
    #[error("the scene has no camera; add one and make it the scene's camera, or name one")]
    NoCamera,
    /// No instance was added, and the world is dark, or a medium without end.
    #[error(
        "the scene has nothing to render; check that objects are enabled for renders, and Surfaces in the view layer"
    )]
    Empty,
    /// A part is damaged.
    #[error("{part} '{name}': {reason}")]
    Part {
        /// Kind of the part.
        part: &'static str,
        /// Name of the part.
        name: String,
        /// Fault of the part, in words.
        reason: String,
    },
}

fn part(part: &'static str, name: &str, reason: impl Into<String>) -> BuildError {
    BuildError::Part { part, name: name.into(), reason: reason.into() }
}

fn unreadable(error: serde_json::Error) -> BuildError {
    part("material", "(JSON)", error.to_string())
}

impl SceneBuilder {
    /// An empty scene whose colours are in `working_space`.
    pub fn new(working_space: impl Into<String>) -> Self {
        let scene = Scene { working_space: working_space.into(), ..Scene::default() };
        Self { scene, has_camera: false }
    }

    /// Sets the camera.
    pub fn set_camera(&mut self, camera: Camera) {
        self.scene.camera = camera;
        self.has_camera = true;
    }

    /// Sets the world; its texture and the material of its volume must have been added before.
    pub fn set_world(&mut self, world: World) -> Result<(), BuildError> {
        if let Some(reason) = world_fault(&world, &self.scene.textures) {
            return Err(part("world", "World", reason));
        }
        let has_volume = |material: &Material| material.volume.is_some();
        if world.volume.is_some_and(|number| !self.scene.materials.get(number).is_some_and(has_volume)) {
            return Err(part("world", "World", "the material of its volume does not exist or has none"));
        }
        self.scene.world = world;
        Ok(())
    }

    /// Adds an image and returns its number. Texels that are not finite become black and are named in a warning
    /// ([`Texture::blacken_infinite`]).
    pub fn add_texture(&mut self, texture: Texture) -> Result<usize, BuildError> {
        self.add_texture_of_size(texture, None)
    }

    /// Adds an image, shrunk to a size, as [`SceneBuilder::add_texture`].
    pub fn add_texture_of_size(
        &mut self,
        mut texture: Texture,
        size: Option<TextureSize>,
    ) -> Result<usize, BuildError> {
        let found = match &texture.texels {
            Texels::Byte(texels) => texels.len(),
            Texels::Float(texels) => texels.len(),
        };
        let expected = texture.width.checked_mul(texture.height).and_then(|n| n.checked_mul(4));
        if expected != Some(found) || found == 0 {
            let size = format!("{} x {}", texture.width, texture.height);
            return Err(part(
                "image",
                &texture.name,
                format!("{found} values do not make {size} RGBA pixels"),
            ));
        }
        if let Some(warning) = texture.blacken_infinite() {
            self.warn(warning);
        }
        if let Some(size) = size {
            texture.shrink(size);
        }
        self.scene.textures.push(texture);
        Ok(self.scene.textures.len() - 1)
    }

    /// Adds a material from the text of its JSON form, as [`SceneBuilder::add_material`].
    pub fn add_material_json(&mut self, json: &str) -> Result<usize, BuildError> {
        self.add_material(&serde_json::from_str(json).map_err(unreadable)?)
    }

    /// Adds a material from its JSON form and returns its number; its textures must have been added before.
    pub fn add_material(&mut self, json: &Value) -> Result<usize, BuildError> {
        let material = Material::deserialize(json).map_err(unreadable)?;
        check_links(json).map_err(|reason| part("material", &material.name, reason))?;
        let is_missing = |texture: &usize| *texture >= self.scene.textures.len();
        if let Some(texture) = material.nodes.iter().flat_map(Node::textures).find(is_missing) {
            return Err(part("material", &material.name, format!("image {texture} does not exist")));
        }
        self.scene.materials.push(material);
        Ok(self.scene.materials.len() - 1)
    }

    /// The scene as far as it was added.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Adds a mesh and returns its number.
    pub fn add_mesh(&mut self, mesh: Mesh) -> Result<usize, BuildError> {
        let (corners, vertices) = (3 * mesh.triangles.len(), mesh.positions.len());
        let bad_index = mesh.triangles.iter().flatten().any(|vertex| *vertex as usize >= vertices);
        let wrong = |len: usize, expected: usize| len != 0 && len != expected;
        let reason = if bad_index {
            "a triangle refers to a vertex that does not exist"
        } else if wrong(mesh.corner_normals.len(), corners)
            || wrong(mesh.material_slots.len(), mesh.triangles.len())
            || mesh.uv_maps.iter().any(|map| map.coords.len() != corners)
            || mesh.color_attributes.iter().any(|attribute| attribute.colors.len() != corners)
            || !mesh.has_sound_displacement()
        {
            "its arrays differ in length"
        } else if !mesh.positions.iter().all(|p| p.is_finite()) {
            "a vertex is not a finite number"
        } else if let Some(reason) = shape_fault(&mesh.motion, vertices, |position| position.is_finite()) {
            reason
        } else {
            self.scene.meshes.push(mesh);
            return Ok(self.scene.meshes.len() - 1);
        };
        Err(part("mesh", &mesh.name, reason))
    }

    /// Adds the grids of a volume and the mesh of a box around their active voxels, and returns the numbers of both; none if no voxel
    /// is active, since nothing is to be seen then. Values that no volume has become 0, and are named in a warning: those that are not
    /// finite, and densities below 0.
    pub fn add_grids(&mut self, mut set: GridSet) -> Result<Option<(usize, usize)>, BuildError> {
        for damage in set.grids.iter_mut().filter_map(Grid::heal) {
            self.warn(format!("object '{}': {damage}", set.name));
        }
        let Some(hull) = set.hull() else { return Ok(None) };
        let mesh = Mesh::cuboid(&set.name, hull);
        let grids = self.add_grid_set(set)?;
        Ok(Some((grids, self.add_mesh(mesh)?)))
    }

    /// Adds sound grids whose mesh is there already, and returns their number.
    pub fn add_grid_set(&mut self, set: GridSet) -> Result<usize, BuildError> {
        if let Some(fault) = set.fault() {
            return Err(part("volume", &set.name, fault));
        }
        self.scene.grids.push(set);
        Ok(self.scene.grids.len() - 1)
    }

    /// Adds curves and returns their number.
    pub fn add_curves(&mut self, curves: Curves) -> Result<usize, BuildError> {
        if let Some(reason) = curves.fault() {
            return Err(part("curves", &curves.name, reason));
        }
        curves.memory_warning().into_iter().for_each(|warning| self.warn(warning));
        self.scene.curves.push(curves);
        Ok(self.scene.curves.len() - 1)
    }

    /// Adds points and returns their number.
    pub fn add_points(&mut self, points: Points) -> Result<usize, BuildError> {
        if let Some(reason) = points.fault() {
            return Err(part("points", &points.name, reason));
        }
        self.scene.points.push(points);
        Ok(self.scene.points.len() - 1)
    }

    /// Places geometry.
    pub fn add_instance(&mut self, instance: Instance) -> Result<(), BuildError> {
        let reason = if let Some(missing) = self.scene.missing(instance.geometry) {
            missing
        } else if instance.materials.iter().any(|material| *material >= self.scene.materials.len()) {
            "its material does not exist"
        } else if usize::from(instance.receiver) >= Instance::RECEIVER_LIMIT {
            "its receiver number is above 2047"
        } else if instance.grids.is_some_and(|grids| grids >= self.scene.grids.len()) {
            "its grids do not exist"
        } else if let Some(reason) = keys_fault(instance.motion.len()) {
            reason
        } else {
            self.place(instance);
            return Ok(());
        };
        Err(part("object", &instance.name, reason))
    }

    /// Keeps an instance that rays can meet: they are taken into its space by the inverse of its transform.
    fn place(&mut self, instance: Instance) {
        let reason = if !can_be_placed(&instance.world_from_object) {
            "its transform is not a finite number or too large; left out (clear its transform)"
        } else if instance.world_from_object.matrix3.determinant() == 0.0 {
            "scaled to zero; left out (apply its scale if it is only flat)"
        } else {
            if self.scene.primitive_count(instance.geometry) > 0 {
                self.scene.instances.push(instance);
            }
            return;
        };
        self.warn(format!("object '{}': {reason}", instance.name));
    }

    /// Adds a light of the file.
    pub fn add_light(&mut self, light: Light) {
        self.scene.lights.push(light);
    }

    /// Keeps a message for the user, once.
    pub fn warn(&mut self, warning: impl Into<String>) {
        let warning = warning.into();
        if !self.scene.warnings.contains(&warning) {
            self.scene.warnings.push(warning);
        }
    }

    /// A scene of nothing but the light of the world, for who needs only that.
    pub fn build_world(self) -> Scene {
        let Scene { world, textures, working_space, warnings, .. } = self.scene;
        let world = World { volume: None, ..world };
        Scene { world, textures, working_space, warnings, ..Scene::default() }
    }

    /// The finished scene.
    pub fn build(mut self) -> Result<Scene, BuildError> {
        if !self.has_camera {
            return Err(BuildError::NoCamera);
        }
        let Scene { instances, world, warnings, .. } = &mut self.scene;
        if instances.is_empty() {
            if !world.shows_alone() {
                return Err(BuildError::Empty);
            }
            warnings.push(ONLY_WORLD.into());
        }
        Ok(self.scene)
    }
}

/// Node numbers must point backwards, and `surface` and `volume` must exist.
fn check_links(material: &Value) -> Result<(), String> {
    let nodes = material["nodes"].as_array().map(Vec::as_slice).unwrap_or_default();
    for (number, node) in nodes.iter().enumerate() {
        let shader = matches!(node["type"].as_str(), Some("mix_shader" | "add_shader"));
        for (socket, value) in node.as_object().into_iter().flatten() {
            let targets: Vec<&Value> = match value {
                // A link, or a phase function with links of its own.
                Value::Object(fields) => {
                    let own = fields.get("node");
                    own.into_iter().chain(fields.values().filter_map(|field| field.get("node"))).collect()
                }
                Value::Number(_) if shader && (socket == "a" || socket == "b") => vec![value],
                _ => Vec::new(),
            };
            if targets.iter().any(|target| target.as_u64().is_none_or(|target| target >= number as u64)) {
                return Err(format!("node {number} has a link at '{socket}' that does not point backwards"));
            }
        }
    }
    for (root, node) in [
        ("surface", &material["surface"]),
        ("volume", &material["volume"]),
        ("displacement", &material["displacement"]["offset"]["node"]),
        ("normal", &material["bumped_normal"]["node"]),
    ] {
        if !node.is_null() && node.as_u64().is_none_or(|node| node >= nodes.len() as u64) {
            return Err(format!("its {root} node does not exist"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Affine3A, Mat3A, Vec3};

    fn triangle() -> Mesh {
        Mesh {
            name: "Tri".into(),
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        }
    }

    #[test]
    fn scene_without_camera_or_mesh_is_refused() {
        let mut builder = SceneBuilder::new("Linear Rec.709");
        assert_eq!(builder.clone().build().unwrap_err(), BuildError::NoCamera);
        builder.set_camera(Camera::default());
        assert_eq!(builder.clone().build().unwrap_err(), BuildError::Empty);
        let mut lit = builder.clone();
        lit.set_world(World { color: [0.5; 3], ..World::default() }).unwrap();
        assert!(lit.build().unwrap().warnings[0].contains("nothing to render but its world"));
        let mesh = builder.add_mesh(triangle()).unwrap();
        builder.add_instance(Instance::new("Object", mesh, Affine3A::IDENTITY, vec![])).unwrap();
        assert_eq!(builder.build().unwrap().instances.len(), 1);
    }

    #[test]
    fn links_must_point_backwards() {
        let mut builder = SceneBuilder::default();
        let material = |color: &str, surface: &str| {
            format!(
                r#"{{"name": "M", "nodes": [{{"type": "geometry"}}, {{"type": "diffuse", "color": {color},
                    "roughness": 0.0, "normal": null}}], "surface": {surface}}}"#
            )
        };
        assert!(builder.add_material_json(&material(r#"{"node": 0, "output": "normal"}"#, "1")).is_ok());
        for (color, surface) in [(r#"{"node": 1, "output": "normal"}"#, "1"), ("[1, 1, 1]", "2")] {
            let error = builder.add_material_json(&material(color, surface)).unwrap_err();
            assert!(error.to_string().contains("'M'"), "{error}");
        }
        let fog = |anisotropy: u32, volume: u32| {
            format!(
                r#"{{"name": "M", "nodes": [{{"type": "geometry"}}, {{"type": "volume_scatter", "color": 1.0,
                    "density": 1.0, "phase": {{"type": "henyey_greenstein", "anisotropy":
                    {{"node": {anisotropy}, "output": "position"}}}}}}], "surface": null, "volume": {volume}}}"#
            )
        };
        assert!(builder.add_material_json(&fog(0, 1)).is_ok());
        for (anisotropy, volume) in [(1, 1), (0, 2)] {
            assert!(builder.add_material_json(&fog(anisotropy, volume)).is_err());
        }
        let mix = r#"{"name": "M", "nodes": [{"type": "add_shader", "a": 0, "b": null}], "surface": 0}"#;
        assert!(builder.add_material_json(mix).is_err());
    }

    #[test]
    fn wrong_sizes_are_refused_by_name() {
        let mut builder = SceneBuilder::default();
        let texture = Texture {
            name: "Brick".into(),
            width: 2,
            height: 2,
            texels: Texels::Byte(vec![0; 15]),
            encoding: crate::ColorEncoding::Srgb,
            alpha: crate::Alpha::Straight,
        };
        assert!(builder.add_texture(texture).unwrap_err().to_string().contains("'Brick'"));
        let mesh = Mesh { triangles: vec![[0, 1, 3]], ..triangle() };
        assert!(builder.add_mesh(mesh).unwrap_err().to_string().contains("'Tri'"));
        let nowhere = Instance::new("Object", 4, Affine3A::IDENTITY, vec![]);
        assert!(builder.add_instance(nowhere).unwrap_err().to_string().contains("'Object'"));
        let mesh = builder.add_mesh(triangle()).unwrap();
        let hollow = Instance { grids: Some(0), ..Instance::new("Fog", mesh, Affine3A::IDENTITY, vec![]) };
        assert!(
            builder.add_instance(hollow).unwrap_err().to_string().contains("'Fog': its grids do not exist")
        );
    }

    #[test]
    fn texels_that_are_not_finite_are_black_and_named_once() {
        let mut builder = SceneBuilder::default();
        let mut texels = vec![0.5; 16];
        (texels[1], texels[7], texels[9]) = (f32::INFINITY, f32::NAN, 65504.0);
        let sky = Texture {
            name: "sky.hdr".into(),
            width: 4,
            height: 1,
            texels: Texels::Float(texels),
            encoding: crate::ColorEncoding::Linear,
            alpha: crate::Alpha::Premultiplied,
        };
        builder.add_texture(sky).unwrap();
        let Texels::Float(found) = &builder.scene.textures[0].texels else { panic!("bytes") };
        assert_eq!(found[..8], [0.0; 8]);
        assert_eq!(found[8..], [0.5, 65504.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]);
        assert_eq!(builder.scene.warnings.len(), 1);
        assert!(builder.scene.warnings[0].starts_with("image 'sky.hdr': 2 "), "{:?}", builder.scene.warnings);
    }

    #[test]
    fn objects_scaled_to_nothing_are_left_out_and_named() {
        let mut builder = SceneBuilder::default();
        let mesh = builder.add_mesh(triangle()).unwrap();
        let flat = Affine3A { matrix3: Mat3A::ZERO, ..Affine3A::IDENTITY };
        builder.add_instance(Instance::new("Object", mesh, flat, vec![])).unwrap();
        assert!(
            builder.scene.warnings[0].contains("'Object': scaled to zero"),
            "{:?}",
            builder.scene.warnings
        );
        builder.set_camera(Camera::default());
        assert_eq!(builder.build().unwrap_err(), BuildError::Empty);
    }

    /// Voxels of a row along x, 0.5 m apart.
    fn row(name: &str, values: &[f32]) -> crate::Grid {
        let object_from_index = Affine3A::from_scale(Vec3::splat(0.5));
        let size = [values.len(), 1, 1];
        crate::DenseGrid { name, size, channels: 1, values, object_from_index }.to_grid(0.0).unwrap()
    }

    #[test]
    fn a_volume_is_a_box_around_its_active_voxels() {
        let mut builder = SceneBuilder::default();
        let grids = vec![row("density", &[0.0, 0.0, 1.0, 2.0]), row("heat", &[0.0, 0.0, 0.0, 0.0, 3.0])];
        let set = |grids| GridSet { name: "Smoke".into(), grids, ..GridSet::default() };
        let (number, mesh) = builder.add_grids(set(grids)).unwrap().unwrap();
        let Mesh { positions, triangles, .. } = &builder.scene.meshes[mesh];
        let low = positions.iter().copied().reduce(Vec3::min).unwrap();
        let high = positions.iter().copied().reduce(Vec3::max).unwrap();
        assert_eq!((low, high), (Vec3::new(0.5, -0.5, -0.5), Vec3::new(2.5, 0.5, 0.5)));
        // By the divergence theorem, faces that all look outwards enclose the volume of the box.
        let corner = |corner: u32| positions[corner as usize];
        let sixth = |t: &[u32; 3]| corner(t[0]).dot(corner(t[1]).cross(corner(t[2])));
        assert!((triangles.iter().map(sixth).sum::<f32>() / 6.0 - 2.0).abs() < 1e-6);
        let inside =
            Instance { grids: Some(number), ..Instance::new("Smoke", mesh, Affine3A::IDENTITY, vec![]) };
        assert_eq!(builder.add_instance(inside), Ok(()));
        assert_eq!(builder.add_grids(set(vec![row("density", &[0.0; 4])])), Ok(None));
    }

    #[test]
    fn densities_that_no_volume_has_are_0_and_named_once() {
        let mut builder = SceneBuilder::default();
        let grids = vec![row("density", &[f32::NAN, -2.0, 3.0]), row("distance", &[-1.0, 2.0])];
        builder.add_grids(GridSet { name: "Smoke".into(), grids, ..GridSet::default() }).unwrap();
        assert_eq!(builder.scene.grids[0].grids[0].value(Vec3::X, Default::default()), Vec3::ZERO);
        assert_eq!(builder.scene.grids[0].grids[1].value(Vec3::ZERO, Default::default()), Vec3::NEG_ONE);
        let warning =
            "object 'Smoke': 2 values of grid 'density' are below 0 or not finite numbers; taken as 0";
        assert_eq!(builder.scene.warnings, [warning]);
    }
}
