//! Displaced meshes whose shape is known in closed form.

use glam::{Affine3A, Vec3};
use relume_scene::{
    Displaceable, Displacement, Input, Instance, Material, Mesh, Node, NormalSpace, Output, Scene,
    SurfaceBase, TexCoord, UvMap,
};

use super::displace;
use crate::bsdf::Surface;
use crate::shading::{Hit, PreparedMaterials};

fn link(node: u32, output: Output) -> Input {
    Input::Link { node, output }
}

/// A smooth square of 2 m in the plane of x and y, around the origin, of `count` x `count` quads.
fn grid(count: usize) -> Mesh {
    let side = count + 1;
    let at = |i: usize| 2.0 * i as f32 / count as f32 - 1.0;
    let positions = (0..side * side).map(|i| Vec3::new(at(i % side), at(i / side), 0.0)).collect();
    let quads = (0..count * count).map(|i| (i / count * side + i % count) as u32);
    let up = side as u32;
    let triangles: Vec<[u32; 3]> =
        quads.flat_map(|i| [[i, i + 1, i + up + 1], [i, i + up + 1, i + up]]).collect();
    Mesh {
        corner_normals: vec![Vec3::Z; 3 * triangles.len()],
        displaceable: Some(Displaceable {
            vertex_normals: vec![Vec3::Z; side * side],
            ..Displaceable::default()
        }),
        positions,
        triangles,
        ..Mesh::default()
    }
}

fn material(nodes: Vec<Node>, keeps_normals: bool) -> Material {
    let offset = link(nodes.len() as u32 - 1, Output::Vector);
    Material { nodes, displacement: Some(Displacement { offset, keeps_normals }), ..Material::default() }
}

/// A Displacement node.
fn along_normal(world_space: bool, height: Input, midlevel: f32, scale: f32) -> Node {
    let (midlevel, scale) = (Input::Float(midlevel), Input::Float(scale));
    Node::Displacement { world_space, height, midlevel, scale, normal: None }
}

/// Heights of twice the x coordinate of the object.
fn sloping() -> Vec<Node> {
    vec![
        Node::TextureCoordinate { kind: TexCoord::Object },
        Node::SeparateXyz { vector: link(0, Output::Vector) },
        along_normal(false, link(1, Output::X), 0.0, 2.0),
    ]
}

fn placed(mesh: Mesh, world_from_object: Affine3A, materials: Vec<Material>) -> Scene {
    let numbers = (0..materials.len()).collect();
    Scene {
        meshes: vec![mesh],
        instances: vec![Instance::new("object", 0, world_from_object, numbers)],
        materials,
        ..Scene::default()
    }
}

/// The first mesh of a scene after displacement.
fn displaced(mut scene: Scene) -> Mesh {
    displace(&mut scene);
    scene.meshes.swap_remove(0)
}

fn assert_near(found: Vec3, expected: Vec3) {
    assert!((found - expected).length() < 1e-5, "{found} in place of {expected}");
}

#[test]
fn a_constant_height_above_the_midlevel_moves_a_plane_along_its_normal() {
    let nodes = vec![along_normal(false, Input::Float(0.75), 0.5, 2.0)];
    let before = grid(2);
    let mesh = displaced(placed(before.clone(), Affine3A::IDENTITY, vec![material(nodes, false)]));
    for (found, at) in mesh.positions.iter().zip(&before.positions) {
        assert_near(*found, *at + 0.5 * Vec3::Z);
    }
    assert_eq!(mesh.undisplaced.unwrap().positions, before.positions);
    assert!(mesh.displaceable.is_none());
}

#[test]
fn object_space_scales_with_the_object_and_world_space_does_not() {
    // Half a metre in the world is a quarter in an object of twice the size.
    for (world_space, expected) in [(false, 0.5), (true, 0.25)] {
        let nodes = vec![along_normal(world_space, Input::Float(0.5), 0.0, 1.0)];
        let twice = Affine3A::from_scale(Vec3::splat(2.0));
        let mesh = displaced(placed(grid(1), twice, vec![material(nodes, false)]));
        assert_near(mesh.positions[0], Vec3::new(-1.0, -1.0, expected));
    }
}

#[test]
fn a_slope_has_the_normal_of_its_plane_and_keeps_the_old_one_where_bump_does_the_rest() {
    for (keeps_normals, expected) in [(false, Vec3::new(-2.0, 0.0, 1.0).normalize()), (true, Vec3::Z)] {
        let mesh = displaced(placed(grid(3), Affine3A::IDENTITY, vec![material(sloping(), keeps_normals)]));
        mesh.positions.iter().for_each(|at| assert_near(*at, Vec3::new(at.x, at.y, 2.0 * at.x)));
        mesh.corner_normals.iter().for_each(|normal| assert_near(*normal, expected));
    }
}

#[test]
fn a_roof_has_the_mean_of_its_unit_normals_at_the_ridge() {
    // Heights |x|: at the ridge as many triangles lean to either side.
    let nodes = vec![
        Node::TextureCoordinate { kind: TexCoord::Object },
        Node::SeparateXyz { vector: link(0, Output::Vector) },
        serde_json::from_str(
            r#"{"type": "math", "operation": "ABSOLUTE", "clamp": false, "a": {"node": 1, "output": "x"}, "b": 0.0, "c": 0.0}"#,
        )
        .unwrap(),
        along_normal(false, link(2, Output::Value), 0.0, 1.0),
    ];
    let mesh = displaced(placed(grid(2), Affine3A::IDENTITY, vec![material(nodes, false)]));
    // The vertex in the middle has three triangles on each side.
    let middle = 4;
    for (corner, vertex) in mesh.triangles.as_flattened().iter().enumerate() {
        let at = mesh.positions[*vertex as usize];
        if *vertex == middle {
            assert_near(mesh.corner_normals[corner], Vec3::Z);
        } else if at.x != 0.0 {
            assert_near(mesh.corner_normals[corner], Vec3::new(-at.x.signum(), 0.0, 1.0).normalize());
        }
    }
}

#[test]
fn a_flat_mesh_stays_flat_and_so_do_flat_triangles() {
    let flat = Mesh { corner_normals: Vec::new(), ..grid(2) };
    let mesh = displaced(placed(flat, Affine3A::IDENTITY, vec![material(sloping(), false)]));
    assert!(mesh.corner_normals.is_empty());
    assert_near(mesh.positions[0], Vec3::new(-1.0, -1.0, -2.0));

    let mut mixed = grid(1);
    mixed.displaceable.as_mut().unwrap().flat_triangles = vec![true, false];
    let mesh = displaced(placed(mixed, Affine3A::IDENTITY, vec![material(sloping(), true)]));
    let leaning = Vec3::new(-2.0, 0.0, 1.0).normalize();
    mesh.corner_normals[..3].iter().for_each(|normal| assert_near(*normal, leaning));
    mesh.corner_normals[3..].iter().for_each(|normal| assert_near(*normal, Vec3::Z));
}

#[test]
fn vertices_of_two_materials_move_by_the_first_triangle_that_displaces() {
    let rising = |height| material(vec![along_normal(false, Input::Float(height), 0.0, 1.0)], false);
    let heights = |materials: Vec<Material>, slots: [u16; 2]| {
        let mesh = Mesh { material_slots: slots.to_vec(), ..grid(1) };
        let mesh = displaced(placed(mesh, Affine3A::IDENTITY, materials));
        [0, 1, 2, 3].map(|vertex: usize| mesh.positions[vertex].z)
    };
    // Triangles 0 1 3 and 0 3 2.
    assert_eq!(heights(vec![rising(1.0), rising(2.0)], [0, 1]), [1.0, 1.0, 2.0, 1.0]);
    assert_eq!(heights(vec![rising(1.0), rising(2.0)], [1, 0]), [2.0, 2.0, 1.0, 2.0]);
    assert_eq!(heights(vec![Material::default(), rising(2.0)], [0, 1]), [2.0, 0.0, 2.0, 2.0]);
}

#[test]
fn vector_displacement_swaps_axes_by_its_space() {
    let turned = Affine3A::from_rotation_z(std::f32::consts::FRAC_PI_2);
    for (space, expected) in [
        // Along the tangent, the normal, and what is across both.
        (NormalSpace::Tangent, Vec3::new(1.0, 3.0, 2.0)),
        (NormalSpace::Object, Vec3::new(1.0, 2.0, 3.0)),
        (NormalSpace::World, Vec3::new(2.0, -1.0, 3.0)),
    ] {
        let node = Node::VectorDisplacement {
            space,
            vector: Input::Rgb([1.5, 2.5, 3.5]),
            midlevel: Input::Float(0.5),
            scale: Input::Float(1.0),
        };
        let mut mesh = grid(1);
        let coords =
            mesh.triangles.as_flattened().iter().map(|vertex| mesh.positions[*vertex as usize].truncate());
        mesh.uv_maps = vec![UvMap { name: "UVMap".into(), coords: coords.collect() }];
        let mesh = displaced(placed(mesh, turned, vec![material(vec![node], false)]));
        assert_near(mesh.positions[3], Vec3::new(1.0, 1.0, 0.0) + expected);
    }
}

#[test]
fn offsets_that_are_no_numbers_move_nothing() {
    let node = Node::VectorDisplacement {
        space: NormalSpace::Object,
        vector: Input::Rgb([f32::NAN, 1.0, f32::INFINITY]),
        midlevel: Input::Float(0.0),
        scale: Input::Float(1.0),
    };
    let mesh = displaced(placed(grid(1), Affine3A::IDENTITY, vec![material(vec![node], false)]));
    assert_eq!(mesh.positions, grid(1).positions);
}

#[test]
fn instances_share_a_shape_unless_their_materials_differ() {
    let rising = |height| material(vec![along_normal(false, Input::Float(height), 0.0, 1.0)], false);
    let mut scene = placed(grid(1), Affine3A::IDENTITY, vec![rising(1.0), rising(2.0)]);
    let far = Affine3A::from_scale(Vec3::splat(3.0));
    scene.instances = [(Affine3A::IDENTITY, 0), (far, 0), (far, 1), (far, 1)]
        .map(|(place, material)| Instance::new("object", 0, place, vec![material]))
        .to_vec();
    displace(&mut scene);
    let heights: Vec<f32> = scene
        .instances
        .iter()
        .map(|instance| scene.mesh(instance.geometry).unwrap().positions[0].z)
        .collect();
    assert_eq!(heights, [1.0, 1.0, 2.0, 2.0]);
    assert_eq!(scene.meshes.len(), 2);
}

#[test]
fn corner_normals_of_their_own_turn_with_the_vertices() {
    let mut mesh = grid(1);
    mesh.corner_normals[0] = Vec3::X;
    mesh.displaceable.as_mut().unwrap().turns_corner_normals = true;
    let nodes = vec![Node::VectorDisplacement {
        space: NormalSpace::Object,
        vector: Input::Rgb([0.0, 0.0, 1.0]),
        midlevel: Input::Float(0.0),
        scale: Input::Float(1.0),
    }];
    let moved = displaced(placed(mesh.clone(), Affine3A::IDENTITY, vec![material(nodes, true)]));
    assert_eq!(moved.corner_normals, mesh.corner_normals, "a plane that only rises");

    let slope: Vec<Node> = vec![
        Node::TextureCoordinate { kind: TexCoord::Object },
        Node::SeparateXyz { vector: link(0, Output::Vector) },
        Node::CombineXyz { x: Input::Float(0.0), y: Input::Float(0.0), z: link(1, Output::X) },
    ];
    let moved = displaced(placed(mesh, Affine3A::IDENTITY, vec![material(slope, true)]));
    let turned = Vec3::new(-1.0, 0.0, 1.0).normalize();
    assert_near(moved.corner_normals[1], turned);
    assert_near(moved.corner_normals[0], (Vec3::X + turned - Vec3::Z).normalize());
}

/// Emission of a scene's only triangle pair at the middle of its lower edge, seen from above.
fn emission_of(scene: &Scene) -> Vec3 {
    let (prepared, _) = PreparedMaterials::new(scene);
    let hit = Hit::on(scene, [0, 0], [0.5, 0.0], 1.0);
    let at = scene.meshes[0].triangles[0].map(|vertex| scene.meshes[0].positions[vertex as usize]);
    let origin = (at[0] + at[1]) / 2.0 + Vec3::Z;
    let point = prepared.surface_point(scene, &hit, origin, Vec3::NEG_Z, 1e-3);
    let mut surface = Surface::default();
    prepared.evaluate(scene, &point, &mut surface);
    surface.emission()
}

/// A square that is twice as large as before, with uv = xy before, and shows the output of a node.
fn doubled(node: Node, output: Output) -> Scene {
    let mut mesh = grid(1);
    let coords =
        mesh.triangles.as_flattened().iter().map(|vertex| mesh.positions[*vertex as usize].truncate());
    mesh.uv_maps = vec![UvMap { name: "UVMap".into(), coords: coords.collect() }];
    mesh.texture_space = Some([Vec3::ZERO, Vec3::ONE]);
    let mut material = material(
        vec![
            Node::TextureCoordinate { kind: TexCoord::Uv },
            Node::VectorDisplacement {
                space: NormalSpace::Object,
                vector: link(0, Output::Vector),
                midlevel: Input::Float(0.0),
                scale: Input::Float(1.0),
            },
        ],
        true,
    );
    let uv = Node::SeparateXyz { vector: link(0, Output::Vector) };
    let shown = Node::Emission { color: link(3, output), strength: Input::Float(1.0) };
    material.nodes.extend([uv, node, shown]);
    material.surface = Some(4);
    let mut scene = placed(mesh, Affine3A::IDENTITY, vec![material]);
    displace(&mut scene);
    assert_near(scene.meshes[0].positions[3], Vec3::new(2.0, 2.0, 0.0));
    scene
}

#[test]
fn generated_coordinates_stay_those_of_the_shape_before() {
    let generated = Node::TextureCoordinate { kind: TexCoord::Generated };
    // In the middle of the lower edge, and of the box's height.
    assert_near(emission_of(&doubled(generated, Output::Vector)), Vec3::new(0.5, 0.0, 0.5));
}

#[test]
fn bump_of_what_is_displaced_is_that_of_the_shape_before() {
    for (base, slope) in [(SurfaceBase::Undisplaced, 1.0), (SurfaceBase::Shaded, 0.5)] {
        let bump = Node::Bump {
            invert: false,
            strength: Input::Float(1.0),
            distance: Input::Float(1.0),
            filter_width: Input::Float(0.1),
            height: link(2, Output::X),
            normal: None,
            base,
        };
        let found = emission_of(&doubled(bump, Output::Normal));
        let expected = Vec3::new(-slope, 0.0, 1.0).normalize();
        assert!((found - expected).length() < 1e-2, "{base:?}: {found} in place of {expected}");
    }
}
