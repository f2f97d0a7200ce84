use std::fmt;

use crate::motion::{keys_fault, shape_fault};
use crate::{Input, Instance, Material, Mesh, Node, Projection, Scene, Shutter, Texels, Texture, World};

/// Brightest world, light or glow of a surface: sums over many paths of one that is near the largest number are none any more.
pub const MOST_RADIANCE: f32 = 1e30;

/// Something that makes a scene untraceable: which part, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct SceneFault {
    /// Kind of the part: `"mesh"`, `"curves"`, `"points"`, `"object"`, `"volume"`, `"material"`, `"image"`, `"camera"`, `"world"` or `"scene"`.
    pub part: &'static str,
    /// Name of the part.
    pub name: String,
    /// Fault, with the next step.
    pub reason: String,
}

impl fmt::Display for SceneFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} '{}': {}", self.part, self.name, self.reason)
    }
}

impl Scene {
    /// Checks that the tracer can take the scene: all indices in range, all numbers finite, something to see and a
    /// camera to see it with. Triangles without area are no fault, the tracer leaves them out.
    ///
    /// # Errors
    /// All faults found, at most one for each part.
    pub fn validate(&self) -> Result<(), Vec<SceneFault>> {
        let mut faults = Vec::new();
        let mut check = |part, name: &str, reason: Option<String>| {
            faults.extend(reason.map(|reason| SceneFault { part, name: name.to_owned(), reason }));
        };
        check("camera", &self.camera.name, self.camera_fault());
        let is_empty = self.instances.iter().all(|instance| self.primitive_count(instance.geometry) == 0);
        check(
            "scene",
            &self.camera.name,
            (is_empty && !self.world.shows_alone())
                .then(|| "it has no surfaces; enable objects for rendering".to_owned()),
        );
        for mesh in &self.meshes {
            check("mesh", &mesh.name, mesh_fault(mesh, self));
        }
        for curves in &self.curves {
            check("curves", &curves.name, curves.fault());
        }
        for points in &self.points {
            check("points", &points.name, points.fault());
        }
        for instance in &self.instances {
            check("object", &instance.name, self.instance_fault(instance));
        }
        for set in &self.grids {
            check("volume", &set.name, set.fault());
        }
        for material in &self.materials {
            check("material", &material.name, self.material_fault(material));
        }
        for texture in &self.textures {
            check("image", &texture.name, texture_fault(texture));
        }
        check(
            "world",
            "World",
            world_fault(&self.world, &self.textures).or_else(|| self.world_volume_fault()),
        );
        if faults.is_empty() { Ok(()) } else { Err(faults) }
    }

    /// Object names by receiver number, for light linking.
    pub fn receiver_names(&self) -> Vec<String> {
        let world = self.world.volume.map(|_| (self.world.receiver, "World"));
        let objects = self.instances.iter().map(|instance| (instance.receiver, instance.name.as_str()));
        let mut names = Vec::new();
        for (receiver, name) in world.into_iter().chain(objects) {
            let number = usize::from(receiver);
            names.resize(names.len().max(number + 1), String::new());
            name.clone_into(&mut names[number]);
        }
        names
    }

    fn world_volume_fault(&self) -> Option<String> {
        let material = self.materials.get(self.world.volume?);
        let has_volume = material.is_some_and(|material| material.volume.is_some());
        (!has_volume).then(|| "the material of its volume does not exist or has none".to_owned())
    }

    fn camera_fault(&self) -> Option<String> {
        const SIZE_LIMIT: usize = 1 << 16;
        let camera = &self.camera;
        let in_range = |size: usize| (1..=SIZE_LIMIT).contains(&size);
        let window = camera.window_max - camera.window_min;
        let lens_is_sound = camera.depth_of_field.as_ref().is_none_or(|lens| {
            lens.aperture_radius >= 0.0
                && lens.aperture_radius.is_finite()
                && lens.focus_distance > 0.0
                && lens.ratio > 0.0
        });
        if !in_range(camera.width) || !in_range(camera.height) {
            Some(format!("its picture of {} x {} pixels is empty or too large", camera.width, camera.height))
        } else if !camera.world_from_camera.is_finite()
            || camera.world_from_camera.matrix3.determinant() == 0.0
        {
            Some("its transform is not finite or flat; clear its transform".to_owned())
        } else if !window.is_finite() || window.x == 0.0 || window.y == 0.0 {
            Some("its view is empty; check sensor, focal length and scale".to_owned())
        } else if !(camera.clip_start >= 0.0 && camera.clip_start < camera.clip_end) {
            Some("its clip range is empty; set the end above the start".to_owned())
        } else if matches!(&camera.projection, Projection::Panoramic(panorama) if !panorama.is_sound()) {
            Some("its panorama shows nothing; check its angle of view, lens and sensor".to_owned())
        } else if !lens_is_sound {
            Some("its depth of field has no positive focus distance or aperture".to_owned())
        } else if camera
            .zoom
            .is_some_and(|zoom| !zoom.iter().all(|factor| *factor > 0.0 && factor.is_finite()))
        {
            Some("its zoom is not above zero; check its focal length about the frame".to_owned())
        } else {
            let fault = self.camera.shutter.as_ref().and_then(Shutter::fault);
            fault.or_else(|| keys_fault(camera.motion.len())).map(str::to_owned)
        }
    }

    fn instance_fault(&self, instance: &Instance) -> Option<String> {
        if let Some(missing) = self.missing(instance.geometry) {
            Some(missing.to_owned())
        } else if instance.materials.iter().any(|material| *material >= self.materials.len()) {
            Some("its material does not exist".to_owned())
        } else if usize::from(instance.receiver) >= Instance::RECEIVER_LIMIT {
            Some(format!("its receiver number is above {}", Instance::RECEIVER_LIMIT - 1))
        } else if instance.grids.is_some_and(|grids| grids >= self.grids.len()) {
            Some("its grids do not exist".to_owned())
        } else if !instance.world_from_object.is_finite() {
            Some("its transform is not finite; clear its transform".to_owned())
        } else if !(instance.density_factor >= 0.0 && instance.density_factor.is_finite()) {
            Some("the factor on its volume's density is negative or not finite; correct its scale".to_owned())
        } else {
            keys_fault(instance.motion.len()).map(str::to_owned)
        }
    }

    fn material_fault(&self, material: &Material) -> Option<String> {
        let is_missing = |texture: &usize| *texture >= self.textures.len();
        if let Some(texture) = material.nodes.iter().flat_map(Node::textures).find(is_missing) {
            return Some(format!("its image number {texture} does not exist"));
        }
        let is_cut = |(image, count): (usize, usize)| !self.textures[image].height.is_multiple_of(count);
        if material.nodes.iter().filter_map(Node::layers).any(is_cut) {
            return Some("the rows of its 3D image do not make up that many layers".to_owned());
        }
        if material.surface.is_some_and(|surface| surface as usize >= material.nodes.len()) {
            return Some("its surface node does not exist".to_owned());
        }
        if material.volume.is_some_and(|volume| volume as usize >= material.nodes.len()) {
            return Some("its volume node does not exist".to_owned());
        }
        let is_missing =
            |input: Input| matches!(input, Input::Link { node, .. } if node as usize >= material.nodes.len());
        let offset = material.displacement.map(|displacement| displacement.offset);
        for (input, name) in [(offset, "displacement"), (material.bumped_normal, "normal")] {
            if input.is_some_and(is_missing) {
                return Some(format!("its {name} node does not exist"));
            }
        }
        let mut dispersions = material.nodes.iter().filter_map(Node::dispersion);
        if dispersions.any(|dispersion| !dispersion.is_valid()) {
            return Some(
                "its dispersion has no colours, negative ones or ones that are not finite".to_owned(),
            );
        }
        let is_too_bright = material.nodes.iter().any(|node| glow(node) > MOST_RADIANCE);
        is_too_bright
            .then(|| format!("it glows brighter than {MOST_RADIANCE:e}; lower its emission strength"))
    }
}

/// Radiance that a shader emits, as far as it is not linked: what comes over a link counts as 1.
fn glow(node: &Node) -> f32 {
    let brightest = |input: &Input| match input {
        Input::Float(value) => *value,
        Input::Rgb(values) => values.iter().copied().fold(0.0, f32::max),
        Input::Link { .. } => 1.0,
    };
    match node {
        Node::Emission { color, strength } => brightest(color) * brightest(strength),
        Node::Principled { emission_color, emission_strength, .. } => {
            brightest(emission_color) * brightest(emission_strength)
        }
        Node::PrincipledVolume { emission_color, emission_strength, .. } => {
            brightest(emission_color) * brightest(emission_strength)
        }
        Node::VolumeCoefficients { emission, .. } => brightest(emission),
        _ => 0.0,
    }
}

/// Fault of a world, in words.
pub(crate) fn world_fault(world: &World, textures: &[Texture]) -> Option<String> {
    let mut maps = world.parts.iter().map(|part| part.texture).chain([world.texture]).flatten();
    if maps.any(|texture| texture >= textures.len()) {
        return Some("its image does not exist".to_owned());
    }
    let colors = || world.parts.iter().map(|part| part.color).chain([world.color]).flatten();
    let is_finite = colors().all(f32::is_finite)
        && world.texture_from_world.is_finite()
        && world.parts.iter().all(|part| part.texture_from_world.is_finite());
    if !is_finite {
        return Some("a value is not a finite number; correct its colour, strength or mapping".to_owned());
    }
    let is_too_bright = colors().any(|value| value > MOST_RADIANCE);
    is_too_bright.then(|| format!("it is brighter than {MOST_RADIANCE:e}; lower its strength"))
}

/// The first vertex that is no number is named with the objects that use the mesh, since those are what the user sees.
fn mesh_fault(mesh: &Mesh, scene: &Scene) -> Option<String> {
    let (corners, vertices) = (3 * mesh.triangles.len(), mesh.positions.len());
    let differs = |length: usize, expected: usize| length != 0 && length != expected;
    if let Some(vertex) = mesh.positions.iter().position(|position| !position.is_finite()) {
        let users: Vec<&str> = scene
            .instances
            .iter()
            .filter(|instance| scene.mesh(instance.geometry).is_some_and(|used| std::ptr::eq(used, mesh)))
            .map(|instance| instance.name.as_str())
            .take(3)
            .collect();
        Some(format!(
            "vertex {vertex} is not a finite number (used by {}); remove it or the modifier that made it",
            if users.is_empty() { "no object".to_owned() } else { users.join(", ") }
        ))
    } else if mesh.triangles.iter().flatten().any(|vertex| *vertex as usize >= vertices) {
        Some("a triangle refers to a vertex that does not exist; validate the mesh".to_owned())
    } else if differs(mesh.corner_normals.len(), corners)
        || differs(mesh.material_slots.len(), mesh.triangles.len())
        || mesh.uv_maps.iter().any(|map| map.coords.len() != corners)
        || mesh.color_attributes.iter().any(|attribute| attribute.colors.len() != corners)
        || !mesh.has_sound_displacement()
    {
        Some("its arrays differ in length; validate the mesh".to_owned())
    } else {
        shape_fault(&mesh.motion, vertices, |position| position.is_finite()).map(str::to_owned)
    }
}

fn texture_fault(texture: &Texture) -> Option<String> {
    let values = match &texture.texels {
        Texels::Byte(texels) => texels.len(),
        Texels::Float(texels) => texels.len(),
    };
    let expected = texture.width.checked_mul(texture.height).and_then(|count| count.checked_mul(4));
    (expected != Some(values) || values == 0)
        .then(|| format!("{values} values do not make {} x {} pixels", texture.width, texture.height))
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3};

    use super::*;
    use crate::Pose;

    fn scene() -> Scene {
        Scene {
            meshes: vec![Mesh {
                name: "Plane".into(),
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            }],
            instances: vec![Instance::new("Floor", 0, Affine3A::IDENTITY, vec![])],
            ..Scene::default()
        }
    }

    fn reason(change: impl FnOnce(&mut Scene)) -> String {
        let mut scene = scene();
        change(&mut scene);
        scene.validate().unwrap_err().iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    }

    #[test]
    fn a_sound_scene_passes() {
        assert_eq!(scene().validate(), Ok(()));
    }

    #[test]
    fn vertices_that_are_no_numbers_are_named_with_mesh_and_object() {
        let found = reason(|scene| scene.meshes[0].positions[1].y = f32::NAN);
        assert!(found.contains("Plane") && found.contains("vertex 1") && found.contains("Floor"), "{found}");
    }

    #[test]
    fn a_medium_of_all_space_is_a_receiver() {
        let mut scene = scene();
        assert_eq!(scene.receiver_names(), ["Floor"]);
        (scene.world.volume, scene.world.receiver) = (Some(0), 2);
        assert_eq!(scene.receiver_names(), ["Floor", "", "World"]);
    }

    #[test]
    fn bad_references_are_named() {
        assert!(reason(|scene| scene.meshes[0].triangles[0][2] = 3).contains("Plane"));
        assert!(reason(|scene| scene.instances[0].geometry = 1.into()).contains("Floor"));
        assert!(reason(|scene| scene.instances[0].materials = vec![0]).contains("Floor"));
        assert!(
            reason(|scene| scene.instances[0].grids = Some(0)).contains("'Floor': its grids do not exist")
        );
        assert!(reason(|scene| scene.meshes[0].motion = vec![Vec3::ZERO; 4]).contains("Plane"));
        let moved = || Pose::keys(&[Affine3A::IDENTITY, Affine3A::from_translation(Vec3::X)]);
        assert!(reason(|scene| scene.instances[0].motion = moved()).contains("Floor"));
        assert!(reason(|scene| scene.camera.zoom = Some([0.0, 1.0])).contains("zoom"));
        assert!(reason(|scene| scene.world.texture = Some(0)).contains("world"));
        assert!(reason(|scene| scene.world.volume = Some(0)).contains("volume"));
        let hollow = || Material { volume: Some(0), ..Material::default() };
        assert!(reason(|scene| scene.materials.push(hollow())).contains("volume node"));
        assert!(reason(|scene| scene.instances[0].density_factor = -1.0).contains("density"));
        assert!(reason(|scene| scene.world.color[1] = f32::NAN).contains("not a finite number"));
        assert!(reason(|scene| scene.world.color[1] = f32::MAX).contains("lower its strength"));
        assert!(reason(|scene| scene.meshes[0].corner_normals = vec![Vec3::Z]).contains("Plane"));
    }

    #[test]
    fn layers_have_to_make_up_an_image() {
        let layered = |count| {
            let mut scene = scene();
            let (width, height) = (2, 6);
            let texels = Texels::Float(vec![0.0; width * height * 4]);
            let (encoding, alpha) = (crate::ColorEncoding::Linear, crate::Alpha::ChannelPacked);
            scene.textures.push(Texture { name: "Density".into(), width, height, texels, encoding, alpha });
            scene.materials.push(Material {
                name: "Smoke".into(),
                nodes: vec![Node::ImageTexture {
                    texture: 0,
                    tiles: Vec::new(),
                    vector: None,
                    interpolation: crate::Interpolation::Linear,
                    extension: crate::Extension::Clip,
                    projection: crate::ImageProjection::Layers { count, of_object: true },
                }],
                ..Material::default()
            });
            scene.validate()
        };
        assert_eq!(layered(3), Ok(()));
        for count in [0, 4, 12] {
            let [fault] = &layered(count).unwrap_err()[..] else { panic!("one fault") };
            assert_eq!((fault.part, fault.name.as_str()), ("material", "Smoke"));
            assert!(fault.reason.contains("layers"), "{fault}");
        }
    }

    #[test]
    fn materials_that_glow_too_brightly_are_named() {
        let glowing = |color, strength| {
            let nodes = vec![Node::Emission { color, strength: Input::Float(strength) }];
            Scene {
                materials: vec![Material {
                    name: "Neon".into(),
                    nodes,
                    surface: Some(0),
                    ..Material::default()
                }],
                ..scene()
            }
        };
        let linked = || Input::Link { node: 0, output: crate::Output::Color };
        assert_eq!(glowing(Input::Rgb([1.0, 0.5, 0.0]), 1e30).validate(), Ok(()));
        for scene in [glowing(Input::Rgb([0.0, 1e20, 0.0]), 1e20), glowing(linked(), f32::MAX)] {
            let [fault] = &scene.validate().unwrap_err()[..] else { panic!("one fault") };
            assert_eq!((fault.part, fault.name.as_str()), ("material", "Neon"));
            assert!(fault.reason.ends_with("lower its emission strength"), "{fault}");
        }
    }

    #[test]
    fn scenes_with_nothing_to_see_and_broken_cameras_are_refused() {
        assert!(reason(|scene| scene.instances.clear()).contains("no surfaces"));
        let mut only_world = scene();
        only_world.instances.clear();
        only_world.world.color = [0.5; 3];
        assert_eq!(only_world.validate(), Ok(()));
        assert!(reason(|scene| scene.meshes[0].triangles.clear()).contains("no surfaces"));
        assert!(reason(|scene| scene.camera.width = 0).contains("pixels"));
        assert!(reason(|scene| scene.camera.clip_end = 0.0).contains("clip"));
        assert!(reason(|scene| scene.camera.window_max = scene.camera.window_min).contains("view"));
    }

    #[test]
    fn triangles_without_area_pass() {
        let mut scene = scene();
        scene.meshes[0].triangles.push([0, 1, 1]);
        assert_eq!(scene.validate(), Ok(()));
    }
}
