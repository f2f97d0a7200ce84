//! Normals of meshes that change their shape.

use glam::Vec3;
use relume_scene::Mesh;

use crate::displace::{face_normal, vertex_normals};

/// Square of the distance of two unit normals that are taken for the same.
const SAME: f32 = 1e-6;

/// Corner normals at each key of a mesh's motion, key after key: those of the mesh, turned as far as the normals of its
/// vertices turn. Corners of flat faces stay flat. Empty if the mesh keeps its shape or is flat all over.
pub fn key_normals(mesh: &Mesh) -> Vec<Vec3> {
    if mesh.motion.is_empty() || mesh.corner_normals.is_empty() {
        return Vec::new();
    }
    let before = vertex_normals(mesh, &mesh.positions, |_| true);
    let is_same = |a: Vec3, b: Vec3| a.distance_squared(b) < SAME;
    let mut normals =
        Vec::with_capacity(mesh.motion.len() / mesh.positions.len() * mesh.corner_normals.len());
    for positions in mesh.motion.chunks_exact(mesh.positions.len()) {
        let after = vertex_normals(mesh, positions, |_| true);
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            let flat = face_normal(*triangle, &mesh.positions);
            for (corner, vertex) in triangle.iter().enumerate() {
                let normal = mesh.corner_normals[3 * number + corner];
                let [before, after] =
                    [&before, &after].map(|normals| normals[*vertex as usize].unwrap_or(normal));
                normals.push(if is_same(normal, flat) && !is_same(normal, before) {
                    face_normal(*triangle, positions)
                } else {
                    (normal + after - before).normalize_or(normal)
                });
            }
        }
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_turn_with_the_shape() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let tipped = [Vec3::ZERO, Vec3::X, Vec3::Z];
        let mesh = Mesh {
            motion: [&tipped[..], &positions, &tipped].concat(),
            positions,
            triangles: vec![[0, 1, 2]],
            corner_normals: vec![Vec3::Z; 3],
            ..Mesh::default()
        };
        let normals = key_normals(&mesh);
        assert_eq!(normals.len(), 9);
        for (number, normal) in normals.into_iter().enumerate() {
            let expected = if (3..6).contains(&number) { Vec3::Z } else { Vec3::NEG_Y };
            assert!(normal.distance(expected) < 1e-6, "corner {number}: {normal}");
        }
        assert!(key_normals(&Mesh { motion: Vec::new(), ..mesh }).is_empty());
    }
}
