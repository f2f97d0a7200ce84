//! Tangents of UV maps, after Mikkelsen, as Blender's normal maps are baked for.

use std::f32::consts::{PI, TAU};

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec2, Vec3, Vec4};
use relume_scene::Mesh;

/// Tangent that Cycles takes where texture coordinates do not tell.
const NO_TANGENT: Vec4 = Vec4::new(1.0, 0.0, 0.0, -1.0);

/// Positions of vertices before displacement, from which Cycles knows generated coordinates.
pub fn undisplaced_positions(mesh: &Mesh) -> &[Vec3] {
    mesh.undisplaced.as_ref().map_or(&mesh.positions, |before| &before.positions)
}

/// Object-space tangent and handedness of each corner of triangles, by its texture coordinates. Without normals of corners
/// the triangles are flat.
pub fn corner_tangents(
    triangles: &[[u32; 3]],
    positions: &[Vec3],
    normals: &[Vec3],
    coords: &[Vec2],
) -> Vec<Vec4> {
    let tangents = vec![NO_TANGENT; 3 * triangles.len()];
    let mut corners = Corners { triangles, positions, normals, coords, tangents };
    match generate_tangents(&mut corners) {
        Ok(()) => corners.tangents,
        Err(_) => vec![NO_TANGENT; 3 * triangles.len()],
    }
}

/// Texture coordinates of corners by which Cycles finds the tangents of a mesh without a UV map: longitude and latitude as seen from
/// the middle of its generated coordinates, whose box starts at `min`.
pub fn spherical_coords(mesh: &Mesh, min: Vec3, size: Vec3) -> Vec<Vec2> {
    let positions = undisplaced_positions(mesh);
    let from_middle = |vertex: u32| {
        let relative = (positions[vertex as usize] - min) / size - 0.5;
        Vec3::select(size.cmpgt(Vec3::ZERO), relative, Vec3::ZERO)
    };
    let coords = |vertex: &u32| {
        let at = from_middle(*vertex);
        let length = at.length();
        if length == 0.0 {
            return Vec2::ZERO;
        }
        let is_pole = at.x == 0.0 && at.y == 0.0;
        let longitude = if is_pole { 0.0 } else { 0.5 - at.x.atan2(at.y) / TAU };
        Vec2::new(longitude, 1.0 - (at.z / length).clamp(-1.0, 1.0).acos() / PI)
    };
    mesh.triangles.as_flattened().iter().map(coords).collect()
}

struct Corners<'a> {
    triangles: &'a [[u32; 3]],
    positions: &'a [Vec3],
    normals: &'a [Vec3],
    coords: &'a [Vec2],
    tangents: Vec<Vec4>,
}

impl Corners<'_> {
    fn point(&self, face: usize, vert: usize) -> Vec3 {
        self.positions[self.triangles[face][vert] as usize]
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        self.point(face, vert).to_array()
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        let smooth = self.normals.get(3 * face + vert).copied();
        let flat = || {
            let [a, b, c] = [0, 1, 2].map(|vert| self.point(face, vert));
            (b - a).cross(c - a).normalize_or(Vec3::Z)
        };
        smooth.unwrap_or_else(flat).to_array()
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        self.coords[3 * face + vert].to_array()
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, vert: usize) {
        if let Some(space) = space {
            self.tangents[3 * face + vert] = Vec4::from_array(space.tangent_encoded());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_follow_u_and_know_mirrored_maps() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let straight = [Vec2::ZERO, Vec2::X, Vec2::Y];
        let mirrored = [Vec2::ZERO, -Vec2::X, Vec2::Y];
        for tangent in corner_tangents(&[[0, 1, 2]], &positions, &[], &straight) {
            assert!((tangent - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-5, "{tangent}");
        }
        for tangent in corner_tangents(&[[0, 1, 2]], &positions, &[], &mirrored) {
            assert!((tangent - Vec4::new(-1.0, 0.0, 0.0, -1.0)).length() < 1e-5, "{tangent}");
        }
    }
}
