use std::collections::BTreeSet;

use blake3::Hasher;
use bytemuck::cast_slice;
use serde::Serialize;

use crate::{
    Camera, ColorAttribute, Curves, Geometry, Grid, Instance, Material, Mesh, Node, Points, Scene, Texels,
    Texture, UvMap, World,
};

impl Scene {
    /// Hash of all that decides the paths of a dump, hex: the same scene gives the same hash on every machine. Lights, the world but for its volume, and
    /// warnings do not count, since paths serve any lights and any world, nor do textures that no material shows, nor the names of the
    /// camera and of materials, nor these's pass indices.
    pub fn hash(&self) -> String {
        let mut hasher = Hasher::new();
        let name = String::new;
        let camera = Camera { name: name(), ..self.camera.clone() };
        let unnamed = |material: &Material| Material { name: name(), pass_index: 0, ..material.clone() };
        let materials: Vec<Material> = self.materials.iter().map(unnamed).collect();
        json(&mut hasher, &(camera, materials, &self.working_space));
        self.meshes.iter().for_each(|mesh| hash_mesh(&mut hasher, mesh));
        self.curves.iter().for_each(|curves| hash_curves(&mut hasher, curves));
        self.points.iter().for_each(|points| hash_points(&mut hasher, points));
        self.instances.iter().for_each(|instance| hash_instance(&mut hasher, instance));
        for set in &self.grids {
            json(&mut hasher, &(set.interpolation, set.grids.len()));
            set.advection.iter().for_each(|advection| json(&mut hasher, advection));
            set.grids.iter().for_each(|grid| hash_grid(&mut hasher, grid));
        }
        if let Some(volume) = self.world.volume {
            json(&mut hasher, &(volume, self.world.receiver));
        }
        for number in self.material_textures() {
            json(&mut hasher, &number);
            self.textures.get(number).into_iter().for_each(|texture| hash_texture(&mut hasher, texture));
        }
        hasher.finalize().to_hex().to_string()
    }

    /// Hash of the scene's world map; see [`World::map`]. Of a world with parts everything counts: a strength is that of one
    /// part.
    pub fn world_map(&self) -> String {
        let digest = |texture: &Texture| texture.digest();
        let map = self.world.map(self.world_texture().map(digest).as_deref());
        if self.world.parts.is_empty() {
            return map;
        }
        let mut hasher = Hasher::new();
        json(&mut hasher, &(map, self.world.color));
        for part in &self.world.parts {
            let texture = part.texture.and_then(|number| self.textures.get(number)).map(digest);
            json(&mut hasher, &(part.rays, part.color, part.texture_from_world, texture));
        }
        hasher.finalize().to_hex().to_string()
    }

    /// The texture of the world.
    pub fn world_texture(&self) -> Option<&Texture> {
        self.world.texture.and_then(|number| self.textures.get(number))
    }

    /// Numbers of the textures that materials show, each once and in order.
    fn material_textures(&self) -> BTreeSet<usize> {
        self.materials.iter().flat_map(|material| material.nodes.iter().flat_map(Node::textures)).collect()
    }
}

impl World {
    /// Hash of all that its light depends on besides the paths, hex: its texture ([`Texture::digest`]) and how that is turned,
    /// channels in which it is black, and whether the camera sees it. Strength and tint do not count: its light has only to be
    /// multiplied by them.
    pub fn map(&self, texture: Option<&str>) -> String {
        let mut hasher = Hasher::new();
        json(&mut hasher, &(self.color.map(|channel| channel != 0.0), self.visible_camera));
        if let Some(texture) = texture {
            json(&mut hasher, &(self.texture_from_world, texture));
        }
        hasher.finalize().to_hex().to_string()
    }
}

impl Texture {
    /// Hash of all but its name, hex.
    pub fn digest(&self) -> String {
        let mut hasher = Hasher::new();
        hash_texture(&mut hasher, self);
        hasher.finalize().to_hex().to_string()
    }
}

/// Lengths go first, so that no two contents have the same bytes.
fn bytes(hasher: &mut Hasher, bytes: &[u8]) {
    hasher.update(&(bytes.len() as u64).to_le_bytes());
    hasher.update(bytes);
}

fn json(hasher: &mut Hasher, value: &impl Serialize) {
    // These types hold nothing that JSON cannot; NaN becomes null.
    bytes(hasher, &serde_json::to_vec(value).unwrap_or_default());
}

fn hash_mesh(hasher: &mut Hasher, mesh: &Mesh) {
    bytes(hasher, cast_slice(&mesh.positions));
    bytes(hasher, cast_slice(&mesh.triangles));
    bytes(hasher, cast_slice(&mesh.corner_normals));
    bytes(hasher, cast_slice(&mesh.material_slots));
    bytes(hasher, cast_slice(mesh.texture_space.as_slice()));
    hash_motion(hasher, &mesh.motion);
    hash_uv_maps(hasher, &mesh.uv_maps);
    hash_attributes(hasher, &mesh.color_attributes);
    if let Some(before) = &mesh.undisplaced {
        bytes(hasher, cast_slice(&before.positions));
        bytes(hasher, cast_slice(&before.corner_normals));
    }
}

fn hash_motion<T: bytemuck::NoUninit>(hasher: &mut Hasher, keys: &[T]) {
    if !keys.is_empty() {
        bytes(hasher, b"motion");
        bytes(hasher, cast_slice(keys));
    }
}

fn hash_uv_maps(hasher: &mut Hasher, maps: &[UvMap]) {
    for map in maps {
        bytes(hasher, map.name.as_bytes());
        bytes(hasher, cast_slice(&map.coords));
    }
}

fn hash_attributes(hasher: &mut Hasher, attributes: &[ColorAttribute]) {
    for attribute in attributes {
        bytes(hasher, attribute.name.as_bytes());
        bytes(hasher, cast_slice(&attribute.colors));
    }
}

fn hash_curves(hasher: &mut Hasher, curves: &Curves) {
    json(hasher, &(curves.shape, curves.first_number));
    bytes(hasher, cast_slice(&curves.keys));
    bytes(hasher, cast_slice(&curves.radii));
    bytes(hasher, cast_slice(&curves.first_keys));
    bytes(hasher, cast_slice(&curves.generated));
    bytes(hasher, cast_slice(&curves.normals));
    hash_motion(hasher, &curves.motion);
    hash_uv_maps(hasher, &curves.uv_maps);
    hash_attributes(hasher, &curves.key_attributes);
    hash_attributes(hasher, &curves.curve_attributes);
}

fn hash_points(hasher: &mut Hasher, points: &Points) {
    bytes(hasher, cast_slice(&points.positions));
    bytes(hasher, cast_slice(&points.radii));
    hash_motion(hasher, &points.motion);
    hash_uv_maps(hasher, &points.uv_maps);
    hash_attributes(hasher, &points.attributes);
}

fn hash_instance(hasher: &mut Hasher, instance: &Instance) {
    let visibility = [
        instance.visible_camera,
        instance.visible_diffuse,
        instance.visible_glossy,
        instance.visible_transmission,
    ];
    let (Geometry::Mesh(index) | Geometry::Curves(index) | Geometry::Points(index)) = instance.geometry;
    json(
        hasher,
        &(
            (&instance.name, index, &instance.materials, instance.world_from_object),
            (instance.receiver, instance.color, instance.pass_index, instance.random, visibility),
            instance.shadow_terminator_offset,
        ),
    );
    if !matches!(instance.geometry, Geometry::Mesh(_)) {
        json(hasher, &instance.geometry);
    }
    if instance.shadow_terminator_shading != 0.0 {
        json(hasher, &instance.shadow_terminator_shading);
    }
    if (instance.visible_volume_scatter, instance.density_factor) != (true, 1.0) {
        json(hasher, &(instance.visible_volume_scatter, instance.density_factor));
    }
    if !instance.attributes.is_empty() {
        json(hasher, &("attributes", &instance.attributes));
    }
    if let Some(grids) = instance.grids {
        json(hasher, &("grids", grids));
    }
    if !instance.motion.is_empty() {
        json(hasher, &("motion", &instance.motion));
    }
    if !instance.visible_shadow {
        json(hasher, &"no shadow");
    }
    if !instance.visible_raycast {
        json(hasher, &"no raycast");
    }
    if instance.is_holdout {
        json(hasher, &"holdout");
    }
    if instance.is_shadow_catcher {
        json(hasher, &"shadow catcher");
    }
    if instance.occlusion_distance != 0.0 {
        json(hasher, &("occlusion distance", instance.occlusion_distance));
    }
    if let Some(links) = &instance.links {
        json(hasher, &("links", links));
    }
}

fn hash_grid(hasher: &mut Hasher, grid: &Grid) {
    json(hasher, &(&grid.name, grid.channels, grid.object_from_index, grid.bricks, grid.active));
    bytes(hasher, cast_slice(&grid.slots));
    bytes(hasher, cast_slice(&grid.values));
}

fn hash_texture(hasher: &mut Hasher, texture: &Texture) {
    json(hasher, &(texture.width, texture.height, texture.encoding, texture.alpha));
    match &texture.texels {
        Texels::Byte(texels) => bytes(hasher, texels),
        Texels::Float(texels) => bytes(hasher, cast_slice(texels)),
    }
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3, Vec4};

    use super::*;
    use crate::{
        DenseGrid, GridInterpolation, GridSet, Light, LightShape, Pose, Shutter, Undisplaced, WorldPart,
    };

    fn scene() -> Scene {
        Scene {
            meshes: vec![Mesh { positions: vec![Vec3::ONE], ..Mesh::default() }],
            instances: vec![Instance::new("a", 0, Affine3A::IDENTITY, vec![0])],
            grids: vec![GridSet { name: "Smoke".into(), grids: vec![grid()], ..GridSet::default() }],
            ..Scene::default()
        }
    }

    fn poses() -> Vec<Pose> {
        Pose::keys(&[Vec3::X, Vec3::ZERO, Vec3::Y].map(Affine3A::from_translation))
    }

    fn grid() -> Grid {
        let (name, object_from_index) = ("density", Affine3A::IDENTITY);
        DenseGrid { name, size: [2; 3], channels: 1, values: &[1.0; 8], object_from_index }
            .to_grid(0.0)
            .unwrap()
    }

    #[test]
    fn everything_that_changes_paths_changes_the_hash() {
        let changes: [fn(&mut Scene); 28] = [
            |scene| scene.meshes[0].undisplaced = Some(Undisplaced::default()),
            |scene| scene.instances[0].visible_volume_scatter = false,
            |scene| scene.instances[0].visible_shadow = false,
            |scene| scene.instances[0].visible_raycast = false,
            |scene| scene.instances[0].is_holdout = true,
            |scene| scene.instances[0].is_shadow_catcher = true,
            |scene| scene.instances[0].links = Some(Box::default()),
            |scene| scene.instances[0].density_factor = 0.5,
            |scene| scene.instances[0].occlusion_distance = 0.5,
            |scene| scene.meshes[0].motion = vec![Vec3::ONE; 3],
            |scene| scene.instances[0].motion = poses(),
            |scene| scene.camera.motion = poses(),
            |scene| scene.camera.zoom = Some([1.0, 2.0]),
            |scene| scene.camera.shutter = Some(Shutter { curve: vec![1.0], rolling: None }),
            |scene| scene.world.volume = Some(0),
            |scene| scene.meshes[0].positions[0].x = 1.000_001,
            |scene| scene.instances[0].world_from_object.translation.y = 1e-6,
            |scene| scene.instances[0].visible_glossy = false,
            |scene| scene.instances[0].shadow_terminator_shading = 0.5,
            |scene| scene.camera.width += 1,
            |scene| scene.materials.push(Material::default()),
            |scene| scene.meshes[0].corner_normals.push(Vec3::ONE),
            |scene| scene.meshes[0].texture_space = Some([Vec3::ZERO, Vec3::ONE]),
            |scene| scene.instances[0].grids = Some(0),
            |scene| scene.grids[0].grids[0].values[7] = 0.5,
            |scene| scene.grids[0].grids[0].name = "heat".into(),
            |scene| scene.grids[0].interpolation = GridInterpolation::Cubic,
            |scene| {
                scene.grids[0].advection = Some(crate::Advection { grids: vec![], scale: 1.0, still: 0.5 })
            },
        ];
        let mut hashes: Vec<String> = vec![scene().hash()];
        for change in changes {
            let mut changed = scene();
            change(&mut changed);
            hashes.push(changed.hash());
        }
        let count = hashes.len();
        hashes.sort();
        hashes.dedup();
        assert_eq!(hashes.len(), count);
        assert_eq!(scene().hash(), scene().hash());
    }

    #[test]
    fn strands_and_points_change_the_hash_and_are_told_apart() {
        let haired = || Scene {
            curves: vec![Curves { keys: vec![Vec3::ZERO, Vec3::Z], ..Curves::default() }],
            points: vec![Points { positions: vec![Vec3::ZERO], ..Points::default() }],
            ..scene()
        };
        let changes: [fn(&mut Scene); 9] = [
            |scene| scene.curves[0].motion = vec![Vec4::ZERO; 6],
            |scene| scene.points[0].motion = vec![Vec4::ONE; 3],
            |scene| scene.curves[0].keys[1].z = 2.0,
            |scene| scene.curves[0].radii.push(0.1),
            |scene| scene.curves[0].shape = crate::StrandShape::Linear,
            |scene| scene.curves[0].first_number = 1,
            |scene| scene.points[0].radii.push(0.1),
            |scene| scene.instances[0].geometry = Geometry::Curves(0),
            |scene| scene.instances[0].geometry = Geometry::Points(0),
        ];
        let mut hashes = vec![scene().hash(), haired().hash()];
        for change in changes {
            let mut changed = haired();
            change(&mut changed);
            hashes.push(changed.hash());
        }
        let count = hashes.len();
        hashes.sort();
        hashes.dedup();
        assert_eq!(hashes.len(), count);
    }

    fn texture(value: u8) -> Texture {
        let (encoding, alpha) = (crate::ColorEncoding::Linear, crate::Alpha::None);
        Texture {
            name: "map".into(),
            width: 1,
            height: 1,
            texels: Texels::Byte(vec![value; 4]),
            encoding,
            alpha,
        }
    }

    #[test]
    fn a_texture_counts_where_a_material_shows_it() {
        let json = r#"{"name": "wall", "surface": null, "nodes": [
            {"type": "image_texture", "texture": 0, "vector": null, "interpolation": "linear", "extension": "repeat"}]}"#;
        let material = |shows: bool| {
            let mut material: Material = serde_json::from_str(json).unwrap();
            material.nodes.truncate(usize::from(shows));
            material
        };
        let hash = |shows: bool, value: u8| {
            Scene { materials: vec![material(shows)], textures: vec![texture(value)], ..scene() }.hash()
        };
        assert_ne!(hash(true, 1), hash(true, 2));
        assert_eq!(hash(false, 1), hash(false, 2));
    }

    #[test]
    fn another_map_of_the_world_is_no_other_scene() {
        let mapped = |value| {
            let world = World { color: [1.0; 3], texture: Some(0), ..World::default() };
            Scene { world, textures: vec![texture(value)], ..scene() }
        };
        let changes: [fn(&mut Scene); 5] = [
            |scene| scene.textures[0] = texture(8),
            |scene| scene.world.texture_from_world = glam::Mat3::from_rotation_z(0.1),
            |scene| scene.world.texture = None,
            |scene| scene.world.color[2] = 0.0,
            |scene| scene.world.visible_camera = false,
        ];
        let mut maps = vec![mapped(7).world_map()];
        for change in changes {
            let mut changed = mapped(7);
            change(&mut changed);
            assert_eq!(changed.hash(), mapped(7).hash());
            maps.push(changed.world_map());
        }
        let count = maps.len();
        maps.sort();
        maps.dedup();
        assert_eq!(maps.len(), count);
        let brighter = Scene { world: World { color: [3.0, 1.0, 0.5], ..mapped(7).world }, ..mapped(7) };
        assert_eq!(brighter.world_map(), mapped(7).world_map());
    }

    #[test]
    fn all_of_a_world_with_parts_counts() {
        let part = WorldPart {
            rays: [true, false, false, false, false],
            color: [1.0; 3],
            texture: Some(0),
            texture_from_world: glam::Mat3::IDENTITY,
        };
        let with_part = || Scene {
            world: World { color: [1.0; 3], parts: vec![part.clone()], ..World::default() },
            textures: vec![texture(7)],
            ..scene()
        };
        let changes: [fn(&mut Scene); 6] = [
            |scene| scene.world.parts.clear(),
            |scene| scene.world.color = [2.0; 3],
            |scene| scene.world.parts[0].color = [2.0; 3],
            |scene| scene.world.parts[0].rays[2] = true,
            |scene| scene.world.parts[0].texture = None,
            |scene| scene.textures[0] = texture(8),
        ];
        let mut maps = vec![with_part().world_map()];
        for change in changes {
            let mut changed = with_part();
            change(&mut changed);
            maps.push(changed.world_map());
        }
        let count = maps.len();
        maps.sort();
        maps.dedup();
        assert_eq!(maps.len(), count);
    }

    #[test]
    fn lights_do_not_change_the_hash() {
        let mut lit = scene();
        lit.lights.push(Light {
            name: "Point".into(),
            ..Light::unit(LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 })
        });
        assert_eq!(lit.hash(), scene().hash());
    }

    #[test]
    fn names_of_camera_and_materials_do_not_change_the_hash() {
        let named = |name: &str| {
            let camera = Camera { name: name.into(), ..scene().camera };
            let materials = vec![Material { name: name.into(), ..Material::default() }];
            Scene { camera, materials, ..scene() }
        };
        assert_eq!(named("a").hash(), named("b").hash());
    }
}
