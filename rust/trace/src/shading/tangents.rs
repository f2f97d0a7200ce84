//! Tangents of UV maps, after Mikkelsen, as Blender's normal maps are baked for.

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec3, Vec4};
use relume_scene::{Mesh, UvMap};

/// Object-space tangent and handedness of each corner; 0 where the UV map is degenerate.
pub fn corner_tangents(mesh: &Mesh, uv_map: &UvMap) -> Vec<Vec4> {
    let mut corners = Corners { mesh, uv_map, tangents: vec![Vec4::ZERO; 3 * mesh.triangles.len()] };
    match generate_tangents(&mut corners) {
        Ok(()) => corners.tangents,
        Err(_) => vec![Vec4::ZERO; 3 * mesh.triangles.len()],
    }
}

struct Corners<'a> {
    mesh: &'a Mesh,
    uv_map: &'a UvMap,
    tangents: Vec<Vec4>,
}

impl Corners<'_> {
    fn point(&self, face: usize, vert: usize) -> Vec3 {
        self.mesh.positions[self.mesh.triangles[face][vert] as usize]
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        self.point(face, vert).to_array()
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        let smooth = self.mesh.corner_normals.get(3 * face + vert).copied();
        let flat = || {
            let [a, b, c] = [0, 1, 2].map(|vert| self.point(face, vert));
            (b - a).cross(c - a).normalize_or(Vec3::Z)
        };
        smooth.unwrap_or_else(flat).to_array()
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        self.uv_map.coords[3 * face + vert].to_array()
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
    use glam::Vec2;

    #[test]
    fn tangents_follow_u_and_know_mirrored_maps() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let straight = UvMap { name: "a".into(), coords: vec![Vec2::ZERO, Vec2::X, Vec2::Y] };
        let mirrored = UvMap { name: "b".into(), coords: vec![Vec2::ZERO, -Vec2::X, Vec2::Y] };
        for tangent in corner_tangents(&mesh, &straight) {
            assert!((tangent - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-5, "{tangent}");
        }
        for tangent in corner_tangents(&mesh, &mirrored) {
            assert!((tangent - Vec4::new(-1.0, 0.0, 0.0, -1.0)).length() < 1e-5, "{tangent}");
        }
    }
}
