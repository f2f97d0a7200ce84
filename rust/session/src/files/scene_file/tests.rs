use super::*;
use crate::bake::bake;
use crate::files::names::VIEW_FILE;
use crate::progress::Monitor;
use relume_image::{BitDepth, Image, ViewTransform, write_png};
use relume_scene::glam::{Affine3A, Mat3, Vec2, Vec4};
use relume_scene::{
    ColorAttribute, Curves, DenseGrid, DepthOfField, Geometry, GridInterpolation, GridSet, LightRules,
    LightShape, LobeFactors, Mesh, Points, Pose, ReceiverSet, SceneBuilder, Texels, Texture, Undisplaced,
    UvMap,
};

/// A lit scene with something of everything that a scene can have.
fn scene() -> Scene {
    let mut builder = SceneBuilder::new("Linear ACEScg");
    let texture = |name: &str, texels, encoding| Texture {
        name: name.into(),
        width: 3,
        height: 2,
        texels,
        encoding,
        alpha: Alpha::Premultiplied,
    };
    let bytes = Texels::Byte((0..24).collect());
    let floats = Texels::Float((0..24).map(|i| 0.1 * i as f32).collect());
    let image = builder.add_texture(texture("tiles.png", bytes, ColorEncoding::Srgb)).unwrap();
    let sky = builder.add_texture(texture("sky.exr", floats, ColorEncoding::Linear)).unwrap();
    let material = format!(
        r#"{{"name": "Tiles", "surface": 1, "nodes": [{{"type": "image_texture", "texture": {image}, "vector": null,
            "interpolation": "linear", "extension": "repeat"}},
            {{"type": "diffuse", "color": {{"node": 0, "output": "color"}}, "roughness": 0.1, "normal": null}}]}}"#
    );
    let material = builder.add_material_json(&material).unwrap();
    let mesh = builder.add_mesh(wall()).unwrap();
    let flat = builder.add_mesh(Mesh { name: "Flat".into(), ..triangle() }).unwrap();
    let smoke = DenseGrid {
        name: "density",
        size: [3, 2, 2],
        channels: 1,
        values: &[0.25; 12],
        object_from_index: Affine3A::from_scale(Vec3::splat(0.1)),
    };
    let wind = DenseGrid { name: "wind", channels: 3, values: &[0.5; 36], ..smoke };
    let smoke = GridSet {
        name: "Smoke".into(),
        interpolation: GridInterpolation::Cubic,
        grids: vec![smoke.to_grid(0.0).unwrap(), wind.to_grid(0.0).unwrap()],
        advection: Some(Advection { grids: vec!["wind".into()], scale: 2.0, still: 0.5 }),
    };
    let (grids, hull) = builder.add_grids(smoke).unwrap().unwrap();
    let world_from_object = Affine3A::from_rotation_z(0.3) * Affine3A::from_translation(Vec3::Y);
    builder
        .add_instance(Instance {
            receiver: 3,
            color: [0.1, 0.2, 0.3, 1.0],
            pass_index: 7,
            random: 0.7,
            shadow_terminator_offset: 0.2,
            shadow_terminator_shading: 0.4,
            visible_glossy: false,
            motion: Pose::keys(&[Affine3A::IDENTITY, world_from_object, Affine3A::from_rotation_x(0.5)]),
            ..Instance::new("Wall", mesh, world_from_object, vec![material])
        })
        .unwrap();
    builder.add_instance(Instance::new("Flat", flat, Affine3A::IDENTITY, vec![])).unwrap();
    let smoke = Instance::new("Smoke", hull, Affine3A::from_translation(50.0 * Vec3::Y), vec![material]);
    builder.add_instance(Instance { grids: Some(grids), ..smoke }).unwrap();
    let hair = Geometry::Curves(builder.add_curves(fur()).unwrap());
    builder.add_instance(Instance::new("Fur", hair, world_from_object, vec![material])).unwrap();
    let dust = Geometry::Points(builder.add_points(dust()).unwrap());
    builder.add_instance(Instance::new("Dust", dust, world_from_object, vec![])).unwrap();
    let texture_from_world = Mat3::from_rotation_z(0.1);
    let world = World {
        color: [0.3, 0.2, 0.1],
        texture: Some(sky),
        texture_from_world,
        visible_camera: false,
        ..World::default()
    };
    builder.set_world(world).unwrap();
    builder.set_camera(camera());
    builder.add_light(Light {
        name: "Lamp".into(),
        radiance: [3.0, 2.0, 0.1],
        lobes: LobeFactors { glossy: 0.5, ..LobeFactors::default() },
        receivers: Some(ReceiverSet { receivers: vec![3] }),
        rules: LightRules { max_bounces: Some(2), ..LightRules::default() },
        ..Light::unit(LightShape::Sphere { center: Vec3::new(0.1, -1.0, 2.0), radius: 0.3 })
    });
    builder.warn("object 'Fur': hair is not supported");
    builder.build().unwrap()
}

fn fur() -> Curves {
    let tint =
        |count| vec![ColorAttribute { name: "Tint".into(), colors: vec![[0.1, 0.2, 0.3, 1.0]; count] }];
    Curves {
        name: "Fur".into(),
        shape: StrandShape::Ribbon { subdivisions: 1 },
        first_number: 3,
        keys: vec![Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::ONE],
        radii: vec![0.1, 0.2, 0.1, 0.0],
        first_keys: vec![0, 2, 4],
        uv_maps: vec![UvMap { name: "Root".into(), coords: vec![Vec2::X, Vec2::Y] }],
        key_attributes: tint(4),
        curve_attributes: tint(2),
        generated: vec![Vec3::ONE; 2],
        normals: vec![Vec3::Y; 4],
        motion: vec![Vec4::ONE; 12],
    }
}

fn dust() -> Points {
    Points {
        name: "Dust".into(),
        positions: vec![Vec3::ZERO, Vec3::Z],
        radii: vec![0.1, 0.2],
        motion: vec![Vec4::ONE; 6],
        uv_maps: vec![UvMap { name: "UVMap".into(), coords: vec![Vec2::X, Vec2::Y] }],
        attributes: vec![ColorAttribute { name: "Heat".into(), colors: vec![[0.5; 4]; 2] }],
    }
}

fn triangle() -> Mesh {
    Mesh {
        positions: vec![Vec3::new(-1.0, 0.1, 0.0), Vec3::X, Vec3::Z],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    }
}

fn wall() -> Mesh {
    Mesh {
        name: "Wall".into(),
        corner_normals: vec![Vec3::NEG_Y; 3],
        uv_maps: vec![UvMap { name: "UVMap".into(), coords: vec![Vec2::ZERO, Vec2::X, Vec2::Y] }],
        color_attributes: vec![ColorAttribute { name: "Rust".into(), colors: vec![[0.5, 0.4, 0.3, 1.0]; 3] }],
        material_slots: vec![0],
        texture_space: Some([Vec3::ZERO, Vec3::ONE]),
        motion: vec![Vec3::ONE; 9],
        undisplaced: Some(Undisplaced {
            positions: vec![Vec3::NEG_X, Vec3::X, Vec3::Z],
            corner_normals: vec![Vec3::Y; 3],
        }),
        ..triangle()
    }
}

/// Looks at the wall, as far as it goes.
fn camera() -> Camera {
    let depth_of_field =
        DepthOfField { aperture_radius: 0.01, focus_distance: 3.0, blades: 5, rotation_rad: 0.2, ratio: 1.5 };
    Camera {
        width: 9,
        height: 7,
        world_from_camera: Affine3A::from_translation(Vec3::new(0.0, -3.0, 0.4))
            * Affine3A::from_rotation_x(std::f32::consts::FRAC_PI_2),
        depth_of_field: Some(depth_of_field),
        ..Camera::default()
    }
}

fn settings() -> TraceSettings {
    TraceSettings { samples: 6, seed: 5, guide_targets: scene().lights, ..TraceSettings::default() }
}

/// A view table of two entries an axis.
fn view() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(VIEW_FILE);
    write_png(&path, &Image::new(4, 2, 3), &ViewTransform::Standard, BitDepth::Eight).unwrap();
    std::fs::read(&path).unwrap()
}

fn encoded() -> Vec<u8> {
    write::encode(&scene(), &settings(), Some(&view())).unwrap()
}

fn decoded(bytes: &[u8]) -> Result<SceneFile, String> {
    SceneFile::from_bytes(Path::new("shot.scene"), bytes).map_err(|error| error.to_string())
}

/// Replaces the first occurrence of some bytes by as many others.
fn replaced(mut bytes: Vec<u8>, from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).expect("there");
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    bytes
}

#[test]
fn a_scene_comes_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.scene");
    let (before, view) = (scene(), view());
    write_scene(&path, &before, &settings(), Some(&view)).unwrap();
    let SceneFile { scene: after, settings: read, view: shown } = SceneFile::read(&path).unwrap();
    assert_eq!((after.hash(), after.world_map()), (before.hash(), before.world_map()));
    assert_eq!((&after.camera, &after.instances), (&before.camera, &before.instances));
    assert_eq!((&after.materials, &after.world), (&before.materials, &before.world));
    assert_eq!(&after.grids, &before.grids);
    assert_eq!((&after.lights, &after.warnings), (&before.lights, &before.warnings));
    let names = |scene: &Scene| scene.textures.iter().map(|t| t.name.clone()).collect::<Vec<_>>();
    assert_eq!((names(&after), &after.working_space), (names(&before), &before.working_space));
    assert_eq!((after.meshes[0].name.as_str(), read, shown), ("Wall", settings(), Some(view)));
}

#[test]
fn a_bake_of_the_file_is_that_of_the_scene_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let file = decoded(&encoded()).unwrap();
    let bake_of = |name: &str, scene: &Scene, settings: &TraceSettings| {
        let out = folder.path().join(name);
        bake(scene, settings, &out, false, &Monitor::default()).unwrap();
        let mut files: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
            .iter()
            .map(|path| (path.file_name().unwrap().to_owned(), std::fs::read(path).unwrap()))
            .collect()
    };
    let own: Vec<_> = bake_of("own", &scene(), &settings());
    assert!(own.len() > 3 && own == bake_of("file", &file.scene, &file.settings));
    file.write_view(&folder.path().join("file")).unwrap();
    assert_eq!(std::fs::read(folder.path().join("file").join(VIEW_FILE)).unwrap(), view());
}

#[test]
fn damaged_files_are_refused_without_a_panic() {
    let bytes = encoded();
    let header_end = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for length in (0..bytes.len()).filter(|i| *i < 64 || i % 37 == 0) {
        assert!(decoded(&bytes[..length]).unwrap_err().contains("scene file shot.scene: "), "{length} bytes");
    }
    // A flipped bit may be in a name or a light, which no hash covers; then the file is still one that can be traced.
    for position in (0..bytes.len()).filter(|i| *i < header_end || i % 3 == 0) {
        let mut damaged = bytes.clone();
        damaged[position] ^= 1 << (position % 8);
        if let Ok(file) = decoded(&damaged) {
            assert_eq!((file.scene.hash(), file.scene.validate()), (scene().hash(), Ok(())));
        }
    }
}

#[test]
fn what_is_wrong_is_named() {
    let text = |change: &dyn Fn(Vec<u8>) -> Vec<u8>| decoded(&change(encoded())).unwrap_err();
    let version = text(&|bytes| replaced(bytes, r#"format_version\":1"#, r#"format_version\":8"#));
    assert!(version.contains("format 8") && version.contains("reads format 1"), "{version}");
    let shape = text(&|bytes| replaced(bytes, r#""shape":[2,3,4]"#, r#""shape":[3,2,4]"#));
    assert!(shape.contains("texture.") && shape.contains("[3, 2, 4]"), "{shape}");
    let missing = text(&|bytes| replaced(bytes, "mesh.1.triangles", "mesh.9.triangles"));
    assert!(missing.contains("mesh.1.triangles is missing"), "{missing}");
    let other = text(&|bytes| replaced(bytes, "relume_scene", "relume_proxy"));
    assert!(other.contains("no scene file"), "{other}");
    let node = text(&|bytes| replaced(bytes, r#""node":0"#, r#""node":9"#));
    assert!(node.contains("'Tiles'") && node.contains("backwards"), "{node}");
    let mesh = text(&|bytes| replaced(bytes, r#""mesh":1"#, r#""mesh":5"#));
    assert!(mesh.contains("'Flat'") && mesh.contains("mesh does not exist"), "{mesh}");
    let grid = text(&|bytes| replaced(bytes, r#""counts":[1,1,1]"#, r#""counts":[1,2,1]"#));
    assert!(grid.contains("'Smoke'") && grid.contains("grid 'density' do not fit together"), "{grid}");
    let radius = text(&|bytes| replaced(bytes, r#""radius":0.3"#, r#""radius":0.0"#));
    assert!(radius.contains("'Lamp'") && radius.contains("radius"), "{radius}");
    let moved = text(&|bytes| replaced(bytes, r#""random":0.7"#, r#""random":0.8"#));
    assert!(moved.contains("does not match its hash"), "{moved}");
    let png = text(&|bytes| replaced(bytes, "IHDR", "IHDX"));
    assert!(png.contains("view"), "{png}");
    let gone = SceneFile::read(Path::new("gone.scene")).unwrap_err().to_string();
    assert!(gone.contains("gone.scene"), "{gone}");
}

#[test]
fn what_nobody_could_read_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.scene");
    let refused = |change: fn(&mut Scene)| {
        let mut scene = scene();
        change(&mut scene);
        write_scene(&path, &scene, &settings(), None).unwrap_err().to_string()
    };
    assert!(refused(|scene| scene.instances[0].geometry = 9.into()).contains("'Wall'"));
    assert!(refused(|scene| scene.lights[0].radiance[0] = f32::NAN).contains("not a finite number"));
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none());
}
