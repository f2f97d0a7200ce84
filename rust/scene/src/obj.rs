//! Wavefront OBJ with MTL materials, for scenes that do not come from Blender.
//!
//! Each object becomes one mesh, placed once. MTL values become a Principled BSDF as in Blender's importer
//! (`io/wavefront_obj/importer/obj_import_mtl.cc`): `Kd`/`map_Kd` base colour, `Ns` roughness, `Ke` emission, `d`
//! alpha, `Ni` IOR, `Pr` and `Pm` roughness and metallic, `Tf` or a transmissive `illum` transmission.

use crate::{
    Alpha, BuildError, Distribution, Extension, FileColors, ImageProjection, Input, Instance, Interpolation,
    Material, Mesh, MultipleScattering, Node, Output, PictureFile, SceneBuilder, UvMap,
};
use glam::{Affine3A, Vec2, Vec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The axis that points up in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// Y, as most programs write it; turned to z.
    #[default]
    Y,
    /// Z, used as it is.
    Z,
}

/// Why an OBJ file was refused.
#[derive(Debug, thiserror::Error)]
pub enum ObjError {
    /// The file could not be read or parsed.
    #[error("cannot load the OBJ file: {reason} ({})", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Fault of the file, in words.
        reason: String,
    },
    /// An object or material cannot be used.
    #[error("{source} ({})", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Part, and reason.
        source: BuildError,
    },
}

/// Loads an OBJ file with its materials and textures. Camera and world are left to the caller. Missing or unread
/// textures and materials are named as warnings.
///
/// # Errors
/// [`ObjError`] names the file, and the object if it is to blame.
pub fn load_obj(path: &Path, up: UpAxis) -> Result<SceneBuilder, ObjError> {
    let file_error = |reason: String| ObjError::File { path: path.to_path_buf(), reason };
    let file = std::fs::File::open(path).map_err(|error| file_error(error.to_string()))?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let load_mtl = |name: &Path| load_mtl(&folder.join(name));
    let (models, materials) = tobj::load_obj_buf(&mut std::io::BufReader::new(file), &options, load_mtl)
        .map_err(|error| file_error(error.to_string()))?;

    let mut builder = SceneBuilder::new("Linear Rec.709");
    let materials = materials.unwrap_or_else(|error| {
        builder.warn(format!("materials of {}: {error}; all surfaces are grey", path.display()));
        Vec::new()
    });
    let content = |source| ObjError::Content { path: path.to_path_buf(), source };
    let grey = add_material(&mut builder, &grey()).map_err(content)?;
    let mut textures = HashMap::new();
    let mut numbers = Vec::new();
    for material in &materials {
        let texture = match &material.diffuse_texture {
            Some(file) => base_texture(&mut builder, &mut textures, folder, file).map_err(content)?,
            None => None,
        };
        numbers.push(add_material(&mut builder, &principled(material, texture)).map_err(content)?);
    }
    let solid = models.iter().filter(|model| !model.mesh.indices.is_empty());
    for (i, model) in solid.enumerate() {
        let material = model.mesh.material_id.and_then(|id| numbers.get(id)).copied().unwrap_or(grey);
        let mesh = builder.add_mesh(mesh(model, up)).map_err(content)?;
        let mut instance = Instance::new(model.name.clone(), mesh, Affine3A::IDENTITY, vec![material]);
        instance.receiver = i.min(Instance::RECEIVER_LIMIT - 1) as u16;
        builder.add_instance(instance).map_err(content)?;
    }
    Ok(builder)
}

fn load_mtl(path: &Path) -> tobj::MTLLoadResult {
    let bytes = std::fs::read(path).map_err(|_| tobj::LoadError::OpenFileFailed)?;
    let text = String::from_utf8_lossy(&bytes);
    // tobj 4.0 panics at a colour of fewer than three numbers.
    let incomplete = |line: &str| {
        let mut words = line.split_whitespace();
        matches!(words.next(), Some("Ka" | "Kd" | "Ks" | "Ke")) && words.take(3).count() < 3
    };
    match text.lines().any(incomplete) {
        true => Err(tobj::LoadError::MaterialParseError),
        false => tobj::load_mtl_buf(&mut text.as_bytes()),
    }
}

fn mesh(model: &tobj::Model, up: UpAxis) -> Mesh {
    let turn = |v: &[f32]| match up {
        UpAxis::Y => Vec3::new(v[0], -v[2], v[1]),
        UpAxis::Z => Vec3::new(v[0], v[1], v[2]),
    };
    let source = &model.mesh;
    let normals: Vec<Vec3> = source.normals.chunks_exact(3).map(turn).collect();
    // tobj checks indices against the whole file; a group without any of an attribute has an empty list.
    let corner_normals =
        source.normal_indices.iter().filter_map(|i| normals.get(*i as usize).copied()).collect();
    let coords: Vec<Vec2> = source.texcoords.chunks_exact(2).map(Vec2::from_slice).collect();
    let coords: Vec<Vec2> =
        source.texcoord_indices.iter().filter_map(|i| coords.get(*i as usize).copied()).collect();
    let whole = |len: usize| len == source.indices.len();
    Mesh {
        name: model.name.clone(),
        positions: source.positions.chunks_exact(3).map(turn).collect(),
        triangles: source.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        corner_normals: usable_normals(corner_normals, source.indices.len()),
        uv_maps: if whole(coords.len()) && !coords.is_empty() {
            vec![UvMap { name: "UVMap".into(), coords }]
        } else {
            Vec::new()
        },
        ..Mesh::default()
    }
}

/// Unit normals, or none if some corner has none.
fn usable_normals(normals: Vec<Vec3>, corners: usize) -> Vec<Vec3> {
    let units: Vec<Vec3> = normals.iter().filter_map(|n| n.try_normalize()).collect();
    if units.len() == corners { units } else { Vec::new() }
}

fn add_material(builder: &mut SceneBuilder, material: &Material) -> Result<usize, BuildError> {
    let json = serde_json::to_string(material).map_err(|error| BuildError::Part {
        part: "material",
        name: material.name.clone(),
        reason: error.to_string(),
    })?;
    builder.add_material_json(&json)
}

fn grey() -> Material {
    principled(&tobj::Material { name: "(none)".into(), ..Default::default() }, None)
}

fn principled(mtl: &tobj::Material, texture: Option<usize>) -> Material {
    let number = |name: &str| mtl.unknown_param.get(name).and_then(|v| v.trim().parse::<f32>().ok());
    let mut nodes = Vec::new();
    let base_color = match texture {
        Some(texture) => {
            nodes.push(Node::ImageTexture {
                texture,
                tiles: Vec::new(),
                vector: None,
                interpolation: Interpolation::Linear,
                extension: Extension::Repeat,
                projection: ImageProjection::Flat,
            });
            Input::Link { node: 0, output: Output::Color }
        }
        None => Input::Rgb(finite(mtl.diffuse.unwrap_or([0.8; 3]))),
    };
    let transmissive = matches!(mtl.illumination_model, Some(4 | 6 | 7 | 9));
    let metallic = number("Pm").unwrap_or(if mtl.illumination_model == Some(3) { 1.0 } else { 0.0 });
    // Blender's importer maps the Phong exponent 0..1000 so.
    let from_exponent = |ns: f32| 1.0 - (ns.clamp(0.0, 1000.0) / 1000.0).sqrt();
    let roughness = number("Pr").or(mtl.shininess.map(from_exponent)).unwrap_or(0.5);
    let emissive = finite(mtl.emissive.unwrap_or([0.0; 3]));
    nodes.push(Node::Principled {
        base_color,
        metallic: Input::Float(metallic.clamp(0.0, 1.0)),
        roughness: Input::Float(roughness.clamp(0.0, 1.0)),
        diffuse_roughness: Input::Float(0.0),
        multiple_scattering: MultipleScattering::default(),
        ior: Input::Float(mtl.optical_density.filter(|ior| *ior >= 1.0).unwrap_or(1.5)),
        alpha: Input::Float(if transmissive { 1.0 } else { mtl.dissolve.unwrap_or(1.0).clamp(0.0, 1.0) }),
        normal: None,
        subsurface_weight: Input::Float(0.0),
        subsurface: None,
        thin_wall: None,
        specular_ior_level: Input::Float(0.5),
        specular_tint: Input::Rgb([1.0; 3]),
        anisotropic: Input::Float(0.0),
        anisotropic_rotation: Input::Float(0.0),
        tangent: None,
        transmission_weight: Input::Float(if transmissive { 1.0 } else { 0.0 }),
        coat_weight: Input::Float(0.0),
        coat_roughness: Input::Float(0.03),
        coat_ior: Input::Float(1.5),
        coat_tint: Input::Rgb([1.0; 3]),
        coat_normal: None,
        sheen_weight: Input::Float(0.0),
        sheen_roughness: Input::Float(0.5),
        sheen_tint: Input::Rgb([1.0; 3]),
        emission_color: Input::Rgb(emissive),
        emission_strength: Input::Float(if emissive == [0.0; 3] { 0.0 } else { 1.0 }),
        distribution: Distribution::MultiGgx,
        film: None,
        anisotropic_glass: false,
        dispersion: None,
    });
    let surface = Some(nodes.len() as u32 - 1);
    Material { name: mtl.name.clone(), nodes, surface, ..Material::default() }
}

fn finite(color: [f32; 3]) -> [f32; 3] {
    color.map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 })
}

fn base_texture(
    builder: &mut SceneBuilder,
    loaded: &mut HashMap<String, Option<usize>>,
    folder: &Path,
    file: &str,
) -> Result<Option<usize>, BuildError> {
    if let Some(number) = loaded.get(file) {
        return Ok(*number);
    }
    let path = folder.join(file.replace('\\', "/"));
    let number = match PictureFile::read(&path) {
        Ok(picture) => {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Some(builder.add_texture(picture.into_texture(name, FileColors::Srgb, Alpha::Straight, None))?)
        }
        Err(reason) => {
            builder.warn(format!("texture {}: {reason}; the plain colour is used", path.display()));
            None
        }
    };
    loaded.insert(file.to_string(), number);
    Ok(number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Camera;

    const QUAD: &str = "mtllib a.mtl\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                        o floor\nusemtl red\nf 1/1 2/2 3/3 4/4\n";

    fn folder(obj: &str, mtl: &str) -> (std::path::PathBuf, impl Drop) {
        struct Remove(std::path::PathBuf);
        impl Drop for Remove {
            fn drop(&mut self) {
                let _ = std::fs::remove_dir_all(&self.0);
            }
        }
        static NUMBER: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
        let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let dir = std::env::temp_dir().join(format!("relume-obj-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        std::fs::write(dir.join("a.obj"), obj).unwrap();
        std::fs::write(dir.join("a.mtl"), mtl).unwrap();
        (dir.join("a.obj"), Remove(dir))
    }

    fn scene(obj: &str, mtl: &str) -> crate::Scene {
        let (path, _guard) = folder(obj, mtl);
        let mut builder = load_obj(&path, UpAxis::Y).unwrap();
        builder.set_camera(Camera::default());
        builder.build().unwrap()
    }

    #[test]
    fn y_up_is_turned_to_z_up_and_quads_become_triangles() {
        let scene = scene(QUAD, "newmtl red\nKd 0.6 0.1 0.1\nKe 0 2 0\nNs 250\n");
        let mesh = &scene.meshes[0];
        assert_eq!((mesh.name.as_str(), mesh.triangles.len()), ("floor", 2));
        assert!(mesh.positions.iter().all(|p| p.z == 0.0));
        assert_eq!(mesh.positions[0], Vec3::new(-1.0, 1.0, 0.0));
        assert_eq!(mesh.uv_maps[0].coords.len(), 6);
        let material = &scene.materials[scene.instances[0].materials[0]];
        let Node::Principled { base_color, roughness, emission_color, emission_strength, .. } =
            &material.nodes[0]
        else {
            panic!("{material:?}");
        };
        assert_eq!(*base_color, Input::Rgb([0.6, 0.1, 0.1]));
        assert_eq!((*roughness, *emission_strength), (Input::Float(0.5), Input::Float(1.0)));
        assert_eq!(*emission_color, Input::Rgb([0.0, 2.0, 0.0]));
    }

    #[test]
    fn missing_texture_and_materials_are_warnings() {
        let warned = scene(QUAD, "newmtl red\nKd 0.6 0.1 0.1\nmap_Kd nothing.png\n");
        assert!(warned.warnings.iter().any(|w| w.contains("nothing.png")), "{:?}", warned.warnings);
        let warned = scene(QUAD, "newmtl red\nKd 0.6 0.1\n");
        assert!(warned.warnings.iter().any(|w| w.contains("all surfaces are grey")), "{:?}", warned.warnings);
        let warned = scene(&QUAD.replace("a.mtl", "b.mtl"), "");
        assert!(!warned.warnings.is_empty());
    }

    #[test]
    fn nan_vertex_and_broken_lines_are_named() {
        for (obj, word) in [
            (QUAD.replace("v 1 0 -1", "v nan 0 -1"), "floor"),
            (QUAD.replace("v 1 0 -1", "v one 0 -1"), "position"),
            (QUAD.replace("f 1/1", "f 9/9"), "out of bounds"),
        ] {
            let (path, _guard) = folder(&obj, "newmtl red\n");
            let message = load_obj(&path, UpAxis::Y).unwrap_err().to_string();
            assert!(message.contains(word) && message.contains("a.obj"), "{message}");
        }
        assert!(
            load_obj(Path::new("nothing.obj"), UpAxis::Y).unwrap_err().to_string().contains("nothing.obj")
        );
    }

    #[test]
    fn empty_file_is_an_empty_scene() {
        let (path, _guard) = folder("# nothing\n", "");
        let mut builder = load_obj(&path, UpAxis::Y).unwrap();
        builder.set_camera(Camera::default());
        assert_eq!(builder.build().unwrap_err(), BuildError::Empty);
    }
}
