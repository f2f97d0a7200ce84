//! Diced meshes whose shape is known in closed form.

use std::collections::HashMap;

use glam::{Affine3A, Vec2, Vec3};
use relume_scene::{Camera, Mesh, PolygonMesh, PolygonNormals, Projection};

use super::{Border, Cage, Dicing, Screen};

const CUBE: [i32; 24] = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5];
const QUADS: [i32; 6] = [0, 4, 8, 12, 16, 20];

fn cube_points() -> Vec<Vec3> {
    let side = |bit: bool| if bit { 1.0 } else { -1.0 };
    (0..8).map(|i| Vec3::new(side(i & 1 > 0), side(i & 2 > 0), side(i & 4 > 0))).collect()
}

fn polygons<'a>(positions: &'a [Vec3], corners: &'a [i32], starts: &'a [i32]) -> PolygonMesh<'a> {
    PolygonMesh {
        name: "Test",
        positions,
        corner_verts: corners,
        face_starts: starts,
        normals: PolygonNormals::Flat,
        sharp_faces: &[],
        uv_maps: Vec::new(),
        color_attributes: Vec::new(),
        material_slots: &[],
        displacement_normals: None,
        turns_corner_normals: false,
    }
}

fn cage<'a>(polygons: &'a PolygonMesh<'a>) -> Cage<'a> {
    Cage { polygons, creases: Vec::new(), sharp_vertices: &[], motion: &[] }
}

fn in_object(edge: f32, smooth: Option<Border>) -> Dicing {
    Dicing { edge, levels: 12, smooth: smooth.map(|border| (border, None)), screen: None }
}

fn diced(cage: &Cage<'_>, dicing: &Dicing) -> Mesh {
    cage.diced(dicing, 1 << 20).unwrap().0
}

fn assert_near(found: Vec3, expected: Vec3) {
    assert!((found - expected).length() < 1e-5, "{found} in place of {expected}");
}

/// Triangles on each side of all edges.
fn sides(mesh: &Mesh) -> HashMap<[u32; 2], [u32; 2]> {
    let mut found: HashMap<[u32; 2], [u32; 2]> = HashMap::new();
    for [a, b, c] in &mesh.triangles {
        for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
            found.entry([from.min(to), from.max(to)]).or_default()[usize::from(from < to)] += 1;
        }
    }
    found
}

fn area(mesh: &Mesh) -> f32 {
    let corners = |triangle: &[u32; 3]| triangle.map(|vertex| mesh.positions[vertex as usize]);
    let areas = mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = corners(triangle);
        0.5 * (b - a).cross(c - a).length()
    });
    areas.sum()
}

#[test]
fn corners_and_middles_of_a_smooth_cube_are_those_of_its_limit_surface() {
    let points = cube_points();
    let polygons = polygons(&points, &CUBE, &QUADS);
    for edge in [0.2, 10.0] {
        let mesh = diced(&cage(&polygons), &in_object(edge, Some(Border::Smooth)));
        // (9 P + 4 sum of neighbours + sum of opposite corners) / 24, and 272 / 324 in the middle of a face.
        for expected in [Vec3::splat(0.5), Vec3::Z * (272.0 / 324.0)] {
            let at = mesh.positions.iter().position(|point| point.distance(expected) < 1e-5);
            let at = at.unwrap_or_else(|| panic!("no vertex at {expected} for edges of {edge}"));
            let corner = mesh.triangles.as_flattened().iter().position(|vertex| *vertex as usize == at);
            assert_near(mesh.corner_normals[corner.unwrap()], expected.normalize());
        }
    }
}

#[test]
fn a_surface_is_the_same_however_far_it_is_refined() {
    let points = cube_points();
    let polygons = polygons(&points, &CUBE, &QUADS);
    let fine = diced(&cage(&polygons), &in_object(0.02, Some(Border::Smooth)));
    let coarse = diced(&cage(&polygons), &in_object(0.05, Some(Border::Smooth)));
    let normals: HashMap<u32, Vec3> =
        fine.triangles.as_flattened().iter().copied().zip(fine.corner_normals.iter().copied()).collect();
    for point in coarse.positions.iter().step_by(7) {
        let distance = |vertex: &u32| fine.positions[*vertex as usize].distance_squared(*point);
        let nearest = normals.keys().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        let off = (*point - fine.positions[*nearest as usize]).dot(normals[nearest]).abs();
        // The surface is bilinear between its points, which are four edges apart: 0.2^2 / 8 on a ball of 0.5.
        assert!(off < 0.01, "{point} is {off} away");
    }
}

#[test]
fn each_inner_edge_has_a_triangle_on_either_side() {
    let points = cube_points();
    let polygons = polygons(&points, &CUBE, &QUADS);
    // Close to a corner, so that sizes differ much.
    let place = Affine3A::from_translation(Vec3::new(-0.7, -0.8, -1.1));
    let camera = Camera { width: 40, height: 40, ..Camera::default() };
    for scale in [1.0, 8.0] {
        let screen = Some(Screen::new(&camera, place, scale));
        for smooth in [None, Some(Border::Smooth)] {
            let dicing = Dicing { screen: screen.clone(), ..in_object(1.0, smooth) };
            let mesh = diced(&cage(&polygons), &dicing);
            assert!(mesh.triangles.len() > 2000, "{}", mesh.triangles.len());
            assert!(sides(&mesh).values().all(|count| *count == [1, 1]));
            assert!(smooth.is_some() || (area(&mesh) - 24.0).abs() < 1e-3);
        }
    }
}

#[test]
fn edges_of_a_plane_are_halved_until_they_are_short() {
    let points = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 4.0, 0.0), 4.0 * Vec3::Y];
    let polygons = polygons(&points, &[0, 1, 2, 3], &[0]);
    // A quarter of a metre is as near to 0.3 as none of 0.5 is.
    for (edge, [across, along]) in [(0.3, [4, 16]), (0.4, [2, 8]), (9.0, [2, 2])] {
        let mesh = diced(&cage(&polygons), &in_object(edge, None));
        assert_eq!(mesh.triangles.len(), 2 * across * along, "{edge}");
        assert_eq!(mesh.positions.len(), (across + 1) * (along + 1), "{edge}");
        assert!((area(&mesh) - 4.0).abs() < 1e-5);
    }
    let flat = Dicing { levels: 2, ..in_object(0.01, None) };
    assert_eq!(diced(&cage(&polygons), &flat).triangles.len(), 2 * 4 * 4);
}

#[test]
fn borders_are_smooth_pinned_at_corners_or_straight() {
    let points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
    let polygons = polygons(&points, &[0, 1, 2, 3], &[0]);
    let lowest = |border, axis: fn(&Vec3) -> f32| {
        let mesh = diced(&cage(&polygons), &in_object(0.1, Some(border)));
        mesh.positions.iter().map(axis).fold(f32::INFINITY, f32::min)
    };
    let diagonal: fn(&Vec3) -> f32 = |point| point.x + point.y;
    // (4 P + both neighbours) / 6 on the border; the middle of a side of a B-spline of the square.
    assert!((lowest(Border::Smooth, diagonal) + 4.0 / 3.0).abs() < 1e-5);
    assert!((lowest(Border::Smooth, |point| point.x) + 11.0 / 12.0).abs() < 1e-5);
    assert!((lowest(Border::Corners, diagonal) + 2.0).abs() < 1e-5);
    assert!((lowest(Border::Straight, diagonal) + 2.0).abs() < 1e-5);
    assert!((lowest(Border::Straight, |point| point.x) + 1.0).abs() < 1e-5);
}

#[test]
fn sharp_edges_stay_and_less_sharp_ones_lie_between() {
    let points = cube_points();
    let polygons = polygons(&points, &CUBE, &QUADS);
    let edges: Vec<[u32; 2]> = (0..8_u32)
        .flat_map(|vertex| [1, 2, 4].map(|bit| [vertex, vertex ^ bit]))
        .filter(|[a, b]| a < b)
        .collect();
    let area_of = |sharpness: f32| {
        let creases = edges.iter().map(|edge| (*edge, sharpness)).collect();
        area(&diced(&Cage { creases, ..cage(&polygons) }, &in_object(0.1, Some(Border::Smooth))))
    };
    assert!((area_of(10.0) - 24.0).abs() < 1e-4);
    let areas = [0.0, 0.5, 1.0, 1.5, 3.0, 10.0].map(area_of);
    assert!(areas.is_sorted_by(|a, b| a < b), "{areas:?}");
}

#[test]
fn attributes_lie_between_those_of_corners() {
    // A pentagon and a quad that share an edge.
    let points = [[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [1.0, 2.5], [-1.0, 1.0], [3.0, -2.0], [1.0, -2.0]]
        .map(|[x, y]| Vec3::new(x, y, 0.0));
    let corners = [0, 1, 2, 3, 4, 1, 0, 6, 5];
    let flat = |vertex: i32| points[vertex as usize].truncate();
    let coords = corners.map(flat);
    let colors = coords.map(|at| [at.x, at.y, 1.0, 1.0]);
    let polygons = PolygonMesh {
        uv_maps: vec![("UVMap".into(), &coords)],
        color_attributes: vec![("Tint".into(), &colors)],
        material_slots: &[3, 5],
        sharp_faces: &[false, true],
        displacement_normals: Some(&[Vec3::Z; 7]),
        normals: PolygonNormals::Vertex(&[Vec3::Y; 7]),
        ..polygons(&points, &corners, &[0, 5])
    };
    let mesh = diced(&cage(&polygons), &in_object(0.2, None));
    let near = |a: Vec2, b: Vec2| assert!((a - b).length() < 1e-5, "{a} in place of {b}");
    for (corner, vertex) in mesh.triangles.as_flattened().iter().enumerate() {
        let at = mesh.positions[*vertex as usize].truncate();
        near(mesh.uv_maps[0].coords[corner], at);
        near(Vec2::from_slice(&mesh.color_attributes[0].colors[corner][..2]), at);
        let is_quad = mesh.material_slots[corner / 3] == 5;
        assert_near(mesh.corner_normals[corner], if is_quad { Vec3::Z } else { Vec3::Y });
        let displaceable = mesh.displaceable.as_ref().unwrap();
        assert_eq!(displaceable.flat_triangles[corner / 3], is_quad);
        assert_near(displaceable.vertex_normals[*vertex as usize], Vec3::Z);
    }
}

#[test]
fn smooth_maps_keep_their_seams() {
    // Two quads whose maps meet along the middle, and one whose map lies apart.
    let points: Vec<Vec3> = (0..8).map(|i| Vec3::new((i % 4) as f32, (i / 4) as f32, 0.0)).collect();
    let corners = [0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6];
    let coords: Vec<Vec2> = corners
        .iter()
        .enumerate()
        .map(|(number, vertex)| {
            points[*vertex as usize].truncate() + if number < 8 { Vec2::ZERO } else { 5.0 * Vec2::Y }
        })
        .collect();
    let polygons =
        PolygonMesh { uv_maps: vec![("UVMap".into(), &coords)], ..polygons(&points, &corners, &[0, 4, 8]) };
    for (border, expected) in [(Border::Straight, 0.0), (Border::Smooth, 1.0 / 3.0)] {
        let dicing = Dicing { smooth: Some((Border::Straight, Some(border))), ..in_object(0.1, None) };
        let mesh = diced(&cage(&polygons), &dicing);
        let coords = &mesh.uv_maps[0].coords;
        let lowest = |from: f32| {
            let own = coords.iter().filter(|coord| (coord.y > 3.0) == (from > 3.0));
            own.map(|coord| coord.x + coord.y - from).fold(f32::INFINITY, f32::min)
        };
        assert!((lowest(0.0) - expected).abs() < 1e-5, "{border:?}: {}", lowest(0.0));
        assert!((lowest(7.0) - expected).abs() < 1e-5, "{border:?}: {}", lowest(7.0));
    }
}

#[test]
fn shapes_at_keys_are_diced_alike() {
    let points = cube_points();
    let polygons = polygons(&points, &CUBE, &QUADS);
    let motion: Vec<Vec3> =
        [-1.0, 0.0, 1.0].iter().flat_map(|shift| points.iter().map(move |p| *p + *shift * Vec3::X)).collect();
    let cage = Cage { motion: &motion, ..cage(&polygons) };
    let mesh = diced(&cage, &in_object(0.2, Some(Border::Smooth)));
    let count = mesh.positions.len();
    assert_eq!(mesh.motion.len(), 3 * count);
    for (number, moved) in mesh.motion.iter().enumerate() {
        let shift = (number / count) as f32 - 1.0;
        assert_near(*moved, mesh.positions[number % count] + shift * Vec3::X);
    }
}

#[test]
fn a_limit_of_triangles_makes_edges_longer() {
    let points = cube_points();
    let polygons = polygons(&points, &CUBE, &QUADS);
    let (mesh, edge) = cage(&polygons).diced(&in_object(0.01, Some(Border::Smooth)), 20_000).unwrap();
    assert!(mesh.triangles.len() <= 20_000 + 24 && mesh.triangles.len() > 4_000, "{}", mesh.triangles.len());
    assert!(edge > 0.01);
    let (_, edge) = cage(&polygons).diced(&in_object(0.1, Some(Border::Smooth)), 20_000).unwrap();
    assert_eq!(edge, 0.1);
}

#[test]
fn pixels_grow_with_the_distance_and_outside_of_the_view() {
    // The film is 2 m wide one metre ahead, and has 100 pixels.
    let camera = Camera {
        width: 100,
        height: 100,
        window_min: Vec2::splat(-1.0),
        window_max: Vec2::splat(1.0),
        ..Camera::default()
    };
    let length = |camera: &Camera, scale: f32, at: Vec3| {
        let screen = Screen::new(camera, Affine3A::from_translation(at), scale);
        screen.length(-0.005 * Vec3::X, 0.005 * Vec3::X)
    };
    let close = |found: f32, expected: f32| {
        assert!((found / expected - 1.0).abs() < 2e-3, "{found} in place of {expected}");
    };
    close(length(&camera, 4.0, 2.0 * Vec3::NEG_Z), 0.25);
    close(length(&camera, 4.0, 8.0 * Vec3::NEG_Z), 0.0625);
    // One metre to the right of the right plane, and behind.
    let beside = Vec3::new(1.0 + 2.0_f32.sqrt(), 0.0, -1.0);
    close(length(&camera, 4.0, beside), 0.5 / (beside.length() + 3.0));
    close(length(&camera, 1.0, beside), 0.5 / beside.length());
    close(length(&camera, 4.0, 2.0 * Vec3::Z), 0.5 / (2.0 + 3.0 * 2.0));
    let parallel = Camera { projection: Projection::Orthographic, ..camera };
    close(length(&parallel, 4.0, 7.0 * Vec3::NEG_Z), 0.5);
    close(length(&parallel, 4.0, 3.0 * Vec3::X), 0.5 / (1.0 + 3.0 * 2.0));
}

#[test]
fn damaged_faces_are_left_out() {
    let mut points = cube_points();
    points[7].x = f32::NAN;
    let polygons = polygons(&points, &CUBE, &QUADS);
    let mesh = diced(&cage(&polygons), &in_object(0.5, Some(Border::Smooth)));
    assert!(mesh.positions.iter().all(|point| point.is_finite()));
    assert!(!mesh.triangles.is_empty());
    let wrong = PolygonMesh { corner_verts: &[0, 1, 9], face_starts: &[0], ..polygons };
    assert!(cage(&wrong).diced(&in_object(0.5, None), 100).is_err());
}
