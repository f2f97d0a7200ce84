use blake3::Hasher;
use bytemuck::cast_slice;
use serde::Serialize;

use crate::{Instance, Mesh, Scene, Texels, Texture};

impl Scene {
    /// Hash of all that decides the path dump, hex: the same scene gives the same hash on every machine. Lights and
    /// warnings do not count, since a dump serves any lights, nor how bright the world is and of which tint, which its
    /// light only has to be multiplied with; but channels in which it is black do.
    pub fn hash(&self) -> String {
        let mut hasher = Hasher::new();
        json(&mut hasher, &(&self.camera, &self.materials, &self.working_space));
        json(
            &mut hasher,
            &(
                &self.world.color.map(|channel| channel != 0.0),
                self.world.texture,
                self.world.texture_from_world,
                self.world.visible_camera,
            ),
        );
        self.meshes.iter().for_each(|mesh| hash_mesh(&mut hasher, mesh));
        self.instances.iter().for_each(|instance| hash_instance(&mut hasher, instance));
        self.textures.iter().for_each(|texture| hash_texture(&mut hasher, texture));
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
    for map in &mesh.uv_maps {
        bytes(hasher, map.name.as_bytes());
        bytes(hasher, cast_slice(&map.coords));
    }
    for attribute in &mesh.color_attributes {
        bytes(hasher, attribute.name.as_bytes());
        bytes(hasher, cast_slice(&attribute.colors));
    }
}

fn hash_instance(hasher: &mut Hasher, instance: &Instance) {
    let visibility = [
        instance.visible_camera,
        instance.visible_diffuse,
        instance.visible_glossy,
        instance.visible_transmission,
    ];
    json(
        hasher,
        &(
            (&instance.name, instance.mesh, &instance.materials, instance.world_from_object),
            (instance.receiver, instance.color, instance.pass_index, instance.random, visibility),
            instance.shadow_terminator_offset,
        ),
    );
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
    use glam::{Affine3A, Vec3};

    use super::*;
    use crate::{Light, LightShape, LobeFactors};

    fn scene() -> Scene {
        Scene {
            meshes: vec![Mesh { positions: vec![Vec3::ONE], ..Mesh::default() }],
            instances: vec![Instance::new("a", 0, Affine3A::IDENTITY, vec![0])],
            ..Scene::default()
        }
    }

    #[test]
    fn everything_that_changes_paths_changes_the_hash() {
        let changes: [fn(&mut Scene); 8] = [
            |scene| scene.meshes[0].positions[0].x = 1.000_001,
            |scene| scene.instances[0].world_from_object.translation.y = 1e-6,
            |scene| scene.instances[0].visible_glossy = false,
            |scene| scene.camera.width += 1,
            |scene| scene.world.color[2] = 0.5,
            |scene| scene.materials.push(crate::Material::default()),
            |scene| scene.meshes[0].corner_normals.push(Vec3::ONE),
            |scene| scene.meshes[0].texture_space = Some([Vec3::ZERO, Vec3::ONE]),
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
    fn lights_and_the_brightness_of_the_world_do_not_change_the_hash() {
        let world = |color| crate::World { color, ..crate::World::default() };
        let [dark, bright] =
            [[0.1, 0.0, 0.3], [3.0, 0.0, 0.3]].map(|color| Scene { world: world(color), ..scene() }.hash());
        assert_eq!(dark, bright);
        let mut lit = scene();
        lit.lights.push(Light {
            name: "Point".into(),
            shape: LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 },
            radiance: [1.0; 3],
            lobes: LobeFactors::default(),
            receivers: None,
        });
        assert_eq!(lit.hash(), scene().hash());
    }
}
