//! Graphs evaluated at points of small meshes.

use glam::{Affine3A, Vec2, Vec3};
use relume_scene::{
    Alpha, BlendMode, ColorEncoding, Curve, Distribution, Extension, FilmModel, ImageProjection, Input,
    Instance, Interpolation, MappingKind, Material, MathOp, Mesh, MixData, Node, NormalSpace, Output, Scene,
    TexCoord, ThinFilm, UvMap,
};

use super::texture::byte_texture;
use super::{Hit, PreparedMaterials};
use crate::bsdf::{Caustics, Surface};

fn link(node: u32, output: Output) -> Input {
    Input::Link { node, output }
}

/// A unit quad's lower left triangle in the xy plane, uv = xy, with the given nodes; the last one is the surface.
pub(super) fn scene_of(nodes: Vec<Node>) -> Scene {
    let surface = Some(nodes.len() as u32 - 1);
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        triangles: vec![[0, 1, 2]],
        uv_maps: vec![UvMap { name: "UVMap".into(), coords: vec![Vec2::ZERO, Vec2::X, Vec2::Y] }],
        ..Mesh::default()
    };
    Scene {
        meshes: vec![mesh],
        instances: vec![Instance::new("triangle", 0, Affine3A::IDENTITY, vec![0])],
        materials: vec![Material { name: "test".into(), nodes, surface, ..Material::default() }],
        ..Scene::default()
    }
}

/// The surface that a ray straight down at (0.25, 0.5) meets.
pub(super) fn look_down(scene: &Scene) -> Surface {
    look(scene, Vec3::new(0.25, 0.5, 2.0), Vec3::NEG_Z, 2.0)
}

fn look(scene: &Scene, origin: Vec3, direction: Vec3, distance: f32) -> Surface {
    look_for(Caustics::ALL, scene, origin, direction, distance)
}

fn look_for(caustics: Caustics, scene: &Scene, origin: Vec3, direction: Vec3, distance: f32) -> Surface {
    let (prepared, warnings) = PreparedMaterials::new(scene);
    assert!(warnings.is_empty(), "{warnings:?}");
    let hit = Hit::on(scene, [0, 0], [0.25, 0.5], distance);
    let point = prepared.surface_point(scene, &hit, origin, direction, 1e-3);
    let mut surface = Surface::default();
    surface.show(caustics);
    prepared.evaluate(scene, &point, &mut surface);
    surface
}

/// The value of an output, seen as emission.
fn value_of(mut nodes: Vec<Node>, output: Output) -> Vec3 {
    let last = nodes.len() as u32 - 1;
    nodes.push(Node::Emission { color: link(last, output), strength: Input::Float(1.0) });
    look_down(&scene_of(nodes)).emission()
}

pub(super) fn principled() -> Node {
    Node::Principled {
        base_color: Input::Rgb([0.8; 3]),
        metallic: Input::Float(0.0),
        roughness: Input::Float(0.5),
        diffuse_roughness: Input::Float(0.0),
        multiple_scattering: Default::default(),
        ior: Input::Float(1.5),
        alpha: Input::Float(1.0),
        normal: None,
        subsurface_weight: Input::Float(0.0),
        subsurface: None,
        thin_wall: None,
        specular_ior_level: Input::Float(0.5),
        specular_tint: Input::Rgb([1.0; 3]),
        anisotropic: Input::Float(0.0),
        anisotropic_rotation: Input::Float(0.0),
        tangent: None,
        transmission_weight: Input::Float(0.0),
        coat_weight: Input::Float(0.0),
        coat_roughness: Input::Float(0.03),
        coat_ior: Input::Float(1.5),
        coat_tint: Input::Rgb([1.0; 3]),
        coat_normal: None,
        sheen_weight: Input::Float(0.0),
        sheen_roughness: Input::Float(0.5),
        sheen_tint: Input::Rgb([1.0; 3]),
        emission_color: Input::Rgb([1.0; 3]),
        emission_strength: Input::Float(0.0),
        distribution: Distribution::MultiGgx,
        film: None,
        anisotropic_glass: false,
        dispersion: None,
    }
}

/// Mean of what comes back out of a white surrounding, over a grid of numbers.
fn furnace(surface: &Surface) -> Vec3 {
    const STEPS: usize = 40;
    let mut sum = Vec3::ZERO;
    for i in 0..STEPS.pow(3) {
        let u = [i % STEPS, i / STEPS % STEPS, i / STEPS / STEPS].map(|i| (i as f32 + 0.5) / STEPS as f32);
        sum += surface.sample(u).map_or(Vec3::ZERO, |sample| sample.weight);
    }
    sum / STEPS.pow(3) as f32
}

fn tilted_ray() -> (Vec3, Vec3, f32) {
    let target = Vec3::new(0.25, 0.5, 0.0);
    let origin = target + Vec3::new(1.0, 0.5, 1.0);
    let distance = origin.distance(target);
    (origin, (target - origin) / distance, distance)
}

#[test]
fn white_principled_keeps_all_energy() {
    type Change = fn(&mut Node);
    let changes: [(&str, Change); 8] = [
        ("dielectric", |_| {}),
        ("smooth", |node| set(node, |p| *p.roughness = Input::Float(0.1))),
        ("metal", |node| set(node, |p| *p.metallic = Input::Float(1.0))),
        ("half metal", |node| set(node, |p| *p.metallic = Input::Float(0.5))),
        ("coat", |node| set(node, |p| *p.coat_weight = Input::Float(1.0))),
        ("glass", |node| set(node, |p| *p.transmission_weight = Input::Float(1.0))),
        ("pane", |node| {
            set(node, |p| {
                *p.transmission_weight = Input::Float(1.0);
                *p.thin_wall = Some(Input::Float(1.0));
            });
        }),
        ("glass with a film", |node| {
            set(node, |p| {
                *p.transmission_weight = Input::Float(1.0);
                let (thickness, ior) = (Input::Float(420.0), Input::Float(1.33));
                *p.film = Some(ThinFilm { thickness, ior, model: FilmModel::Tabulated, on_metal: true });
            });
        }),
    ];
    for (name, change) in changes {
        let mut node = principled();
        set(&mut node, |p| *p.base_color = Input::Rgb([1.0; 3]));
        change(&mut node);
        let (origin, direction, distance) = tilted_ray();
        let returned = furnace(&look(&scene_of(vec![node]), origin, direction, distance)).x;
        // Layering by albedo estimates is Cycles', and its tables are coarse.
        assert!((returned - 1.0).abs() < 0.03, "{name}: {returned}");
    }
}

struct PrincipledInputs<'a> {
    base_color: &'a mut Input,
    metallic: &'a mut Input,
    roughness: &'a mut Input,
    alpha: &'a mut Input,
    coat_weight: &'a mut Input,
    transmission_weight: &'a mut Input,
    emission_strength: &'a mut Input,
    thin_wall: &'a mut Option<Input>,
    film: &'a mut Option<ThinFilm>,
}

fn set(node: &mut Node, change: impl FnOnce(PrincipledInputs)) {
    if let Node::Principled {
        base_color,
        metallic,
        roughness,
        alpha,
        coat_weight,
        transmission_weight,
        emission_strength,
        thin_wall,
        film,
        ..
    } = node
    {
        change(PrincipledInputs {
            base_color,
            metallic,
            roughness,
            alpha,
            coat_weight,
            transmission_weight,
            emission_strength,
            thin_wall,
            film,
        });
    }
}

#[test]
fn principled_alpha_and_emission_scale_together() {
    let mut node = principled();
    set(&mut node, |p| {
        *p.alpha = Input::Float(0.25);
        *p.emission_strength = Input::Float(2.0);
    });
    let surface = look_down(&scene_of(vec![node]));
    assert!((surface.transparency() - Vec3::splat(0.75)).length() < 1e-6);
    assert!((surface.emission() - Vec3::splat(0.5)).length() < 1e-6);
}

#[test]
fn mix_shader_takes_the_first_at_zero_and_skips_dead_branches() {
    let nodes = |factor| {
        vec![
            Node::Emission { color: Input::Rgb([1.0, 0.0, 0.0]), strength: Input::Float(1.0) },
            Node::Emission { color: Input::Rgb([0.0, 1.0, 0.0]), strength: Input::Float(1.0) },
            Node::MixShader { factor: Input::Float(factor), a: Some(0), b: Some(1) },
        ]
    };
    assert_eq!(look_down(&scene_of(nodes(0.0))).emission(), Vec3::X);
    assert_eq!(look_down(&scene_of(nodes(1.0))).emission(), Vec3::Y);
    assert_eq!(look_down(&scene_of(nodes(0.25))).emission(), Vec3::new(0.75, 0.25, 0.0));
}

#[test]
fn values_used_by_both_branches_and_by_one_are_all_evaluated() {
    let nodes = vec![
        Node::UvMap { name: String::new() },
        Node::SeparateXyz { vector: link(0, Output::Vector) },
        Node::Math {
            operation: MathOp::Add,
            clamp: false,
            a: link(1, Output::X),
            b: Input::Float(1.0),
            c: Input::Float(0.0),
        },
        Node::Emission { color: link(2, Output::Value), strength: link(1, Output::Y) },
        Node::Emission { color: link(1, Output::Y), strength: Input::Float(1.0) },
        Node::MixShader { factor: link(1, Output::X), a: Some(3), b: Some(4) },
    ];
    let emission = look_down(&scene_of(nodes)).emission();
    assert!((emission - Vec3::splat(0.75 * 1.25 * 0.5 + 0.25 * 0.5)).length() < 1e-6, "{emission}");
}

#[test]
fn constant_graphs_fold_to_the_same_value() {
    let math = |a, b| Node::Math { operation: MathOp::Multiply, clamp: false, a, b, c: Input::Float(0.0) };
    let nodes = vec![
        math(Input::Float(3.0), Input::Float(0.5)),
        math(link(0, Output::Value), Input::Rgb([0.5, 0.5, 0.5])),
        Node::Mix {
            data: MixData::Color,
            blend: BlendMode::Multiply,
            clamp_factor: true,
            clamp_result: false,
            factor: Input::Float(1.0),
            a: Input::Rgb([0.2, 0.4, 0.6]),
            b: link(1, Output::Value),
        },
    ];
    let expected = Vec3::new(0.2, 0.4, 0.6) * 0.75;
    assert!((value_of(nodes, Output::Color) - expected).length() < 1e-6);
}

#[test]
fn colours_convert_by_luminance_and_vectors_by_mean() {
    let combine = Node::CombineXyz { x: Input::Float(0.9), y: link(0, Output::X), z: Input::Float(0.0) };
    let nodes = vec![
        Node::SeparateXyz { vector: Input::Rgb([0.0; 3]) },
        combine,
        Node::Math {
            operation: MathOp::Add,
            clamp: false,
            a: link(1, Output::Vector),
            b: Input::Rgb([1.0, 0.0, 0.0]),
            c: Input::Float(0.0),
        },
    ];
    assert!((value_of(nodes, Output::Value).x - (0.3 + 0.212_672_9)).abs() < 1e-5);
}

#[test]
fn textures_are_read_at_the_mapped_uv() {
    let mut scene = scene_of(vec![
        Node::TextureCoordinate { kind: TexCoord::Uv },
        Node::Mapping {
            kind: MappingKind::Point,
            vector: link(0, Output::Vector),
            location: Input::Rgb([0.5, 0.0, 0.0]),
            rotation: Input::Rgb([0.0; 3]),
            scale: Input::Rgb([1.0; 3]),
        },
        Node::ImageTexture {
            texture: 0,
            tiles: Vec::new(),
            vector: Some(link(1, Output::Vector)),
            interpolation: Interpolation::Closest,
            extension: Extension::Repeat,
            projection: ImageProjection::Flat,
        },
        Node::Emission { color: link(2, Output::Color), strength: link(2, Output::Alpha) },
    ]);
    let texels = vec![255, 0, 0, 255, 0, 255, 0, 255];
    scene.textures = vec![byte_texture(2, 1, texels, ColorEncoding::Linear, Alpha::Straight)];
    assert_eq!(look_down(&scene).emission(), Vec3::Y);
}

#[test]
fn mapping_kinds_undo_each_other() {
    let mapped = |kind, vector: Input| Node::Mapping {
        kind,
        vector,
        location: Input::Rgb([0.1, 0.2, 0.3]),
        rotation: Input::Rgb([0.4, 0.5, 0.6]),
        scale: Input::Rgb([2.0, 3.0, 4.0]),
    };
    let nodes = vec![
        Node::UvMap { name: "UVMap".into() },
        mapped(MappingKind::Point, link(0, Output::Vector)),
        mapped(MappingKind::Texture, link(1, Output::Vector)),
    ];
    assert!((value_of(nodes, Output::Vector) - Vec3::new(0.25, 0.5, 0.0)).length() < 1e-5);
}

#[test]
fn coordinates_of_a_moved_object() {
    for (kind, expected) in [
        (TexCoord::Object, Vec3::new(0.25, 0.5, 0.0)),
        (TexCoord::Generated, Vec3::new(0.25, 0.5, 0.5)),
        (TexCoord::Normal, Vec3::Z),
        (TexCoord::Reflection, Vec3::Z),
    ] {
        let mut scene = scene_of(vec![
            Node::TextureCoordinate { kind },
            Node::Emission { color: link(0, Output::Vector), strength: Input::Float(1.0) },
        ]);
        scene.instances[0].world_from_object = Affine3A::from_scale_rotation_translation(
            Vec3::splat(2.0),
            glam::Quat::IDENTITY,
            Vec3::splat(3.0),
        );
        let emission = look(&scene, Vec3::new(3.5, 4.0, 5.0), Vec3::NEG_Z, 2.0).emission();
        assert!((emission - expected).length() < 1e-5, "{kind:?}: {emission}");
    }
}

#[test]
fn normal_maps_bend_along_the_tangents() {
    let normal_map = |color: [f32; 3], strength: f32| {
        let nodes = vec![Node::NormalMap {
            space: NormalSpace::Tangent,
            uv_map: String::new(),
            strength: Input::Float(strength),
            color: Input::Rgb(color),
            base: Default::default(),
        }];
        value_of(nodes, Output::Normal)
    };
    assert!((normal_map([0.5, 0.5, 1.0], 1.0) - Vec3::Z).length() < 1e-5);
    assert!((normal_map([1.0, 0.5, 0.5], 1.0) - Vec3::X).length() < 1e-5);
    assert!((normal_map([0.5, 1.0, 0.5], 1.0) - Vec3::Y).length() < 1e-5);
    assert!((normal_map([1.0, 0.5, 0.5], 0.0) - Vec3::Z).length() < 1e-5);
}

#[test]
fn bump_follows_the_slope_of_its_height() {
    // Height = 0.5 x: the normal of the surface z = 0.5 x.
    let nodes = vec![
        Node::UvMap { name: String::new() },
        Node::SeparateXyz { vector: link(0, Output::Vector) },
        Node::Bump {
            invert: false,
            strength: Input::Float(1.0),
            distance: Input::Float(0.5),
            filter_width: Input::Float(0.1),
            height: link(1, Output::X),
            normal: None,
            base: Default::default(),
        },
    ];
    let expected = Vec3::new(-0.5, 0.0, 1.0).normalize();
    let normal = value_of(nodes, Output::Normal);
    assert!((normal - expected).length() < 2e-2, "{normal}");
}

#[test]
fn backfaces_flip_normals_and_say_so() {
    let nodes = vec![
        Node::Geometry,
        Node::Emission { color: link(0, Output::Normal), strength: link(0, Output::Backfacing) },
    ];
    let scene = scene_of(nodes);
    assert_eq!(look_down(&scene).emission(), Vec3::ZERO);
    let from_below = look(&scene, Vec3::new(0.25, 0.5, -2.0), Vec3::Z, 2.0);
    assert_eq!(from_below.emission(), Vec3::NEG_Z);
}

#[test]
fn ramps_read_their_tables() {
    let ramp = Curve {
        min: 0.0,
        max: 1.0,
        table: vec![[0.0, 0.0, 0.0, 1.0], [1.0, 0.5, 0.0, 1.0]],
        interpolate: true,
        extrapolate: false,
    };
    let nodes = vec![
        Node::UvMap { name: String::new() },
        Node::SeparateXyz { vector: link(0, Output::Vector) },
        Node::ColorRamp { factor: link(1, Output::X), ramp },
    ];
    assert!((value_of(nodes, Output::Color) - Vec3::new(0.25, 0.125, 0.0)).length() < 1e-6);
}

#[test]
fn damaged_graphs_are_named_and_do_not_panic() {
    let mut scene = scene_of(vec![
        Node::Emission { color: link(7, Output::Color), strength: Input::Float(1.0) },
        Node::MixShader { factor: Input::Float(0.5), a: Some(0), b: Some(9) },
    ]);
    scene.materials[0].surface = Some(1);
    let (_, warnings) = PreparedMaterials::new(&scene);
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    // Forty mixes of each with itself would be evaluated 2^40 times.
    let mut nodes = vec![Node::Emission { color: Input::Rgb([1.0; 3]), strength: Input::Float(1.0) }];
    nodes.extend((0..40).map(|i| Node::AddShader { a: Some(i), b: Some(i) }));
    let (_, warnings) = PreparedMaterials::new(&scene_of(nodes));
    assert_eq!(warnings.len(), 1);
}

#[test]
fn values_that_are_not_numbers_do_not_reach_the_path() {
    type Change = fn(PrincipledInputs);
    let changes: [Change; 7] = [
        |p| *p.base_color = Input::Rgb([f32::NAN, f32::INFINITY, -1.0]),
        |p| *p.metallic = Input::Float(f32::NAN),
        |p| *p.roughness = Input::Float(f32::NAN),
        |p| *p.alpha = Input::Float(f32::NAN),
        |p| *p.coat_weight = Input::Float(f32::INFINITY),
        |p| *p.transmission_weight = Input::Float(f32::NAN),
        |p| *p.emission_strength = Input::Float(f32::NAN),
    ];
    for (index, change) in changes.into_iter().enumerate() {
        let mut node = principled();
        set(&mut node, change);
        let surface = look_down(&scene_of(vec![node]));
        assert!(surface.emission().is_finite() && surface.transparency().is_finite(), "change {index}");
        assert!(furnace(&surface).is_finite(), "change {index}");
    }
}

#[test]
fn missing_materials_are_grey() {
    let mut scene = scene_of(vec![principled()]);
    scene.instances[0].materials.clear();
    assert_eq!(look_down(&scene).albedo(), Vec3::splat(0.8));
}

#[test]
fn a_world_without_a_map_is_white() {
    let mut scene = scene_of(vec![principled()]);
    let (prepared, _) = PreparedMaterials::new(&scene);
    assert_eq!(prepared.world_texel(&scene, None, Vec3::X), Vec3::ONE);
    scene.textures = vec![byte_texture(1, 1, vec![255, 0, 255, 255], ColorEncoding::Linear, Alpha::Straight)];
    scene.world.texture = Some(0);
    let (prepared, _) = PreparedMaterials::new(&scene);
    assert_eq!(prepared.world_texel(&scene, Some(0), Vec3::Z), Vec3::new(1.0, 0.0, 1.0));
}

#[test]
fn a_layer_that_caustics_leave_out_darkens_none_below_it() {
    let mut varnished = principled();
    let Node::Principled { coat_weight, .. } = &mut varnished else { unreachable!() };
    *coat_weight = Input::Float(1.0);
    let scene = scene_of(vec![varnished]);
    let seen = |reflective| {
        let caustics = Caustics { reflective, refractive: true };
        furnace(&look_for(caustics, &scene, Vec3::new(0.25, 0.5, 2.0), Vec3::NEG_Z, 2.0)).x
    };
    assert!((seen(false) - 0.8).abs() < 1e-3, "{}", seen(false));
    assert!(seen(true) > 0.81, "{}", seen(true));
}

#[test]
fn rough_refraction_goes_on_where_the_mean_normal_reflects_all() {
    let node = Node::Refraction {
        color: Input::Rgb([1.0; 3]),
        roughness: Input::Float(0.7),
        ior: Input::Float(0.5),
        normal: None,
        distribution: Distribution::Ggx,
    };
    let direction = Vec3::new(0.7, 0.0, -0.5).normalize();
    let through =
        furnace(&look(&scene_of(vec![node]), Vec3::new(0.25, 0.5, 0.0) - direction, direction, 1.0));
    assert!(through.x > 0.1, "{through}");
}
