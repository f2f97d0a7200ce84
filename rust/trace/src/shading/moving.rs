//! Transforms of instances at the time of a ray, and normals of meshes that change their shape.

use glam::{Affine3A, Mat3A, Vec3};
use relume_scene::{Geometry, Mesh, Pose, Scene, blend, place};

use super::{PreparedMaterials, SurfacePoint};
use crate::displace::{face_normal, vertex_normals};

/// Square of the distance of two unit normals that are taken for the same.
const SAME: f32 = 1e-6;

/// Transforms of one instance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transforms {
    object_from_world: Affine3A,
    /// World-space normals from object-space ones, before normalising.
    world_from_object_normal: Mat3A,
    /// The inverse, likewise.
    object_from_world_normal: Mat3A,
}

impl Transforms {
    pub(super) fn new(world_from_object: Affine3A) -> Self {
        Self {
            object_from_world: world_from_object.inverse(),
            world_from_object_normal: world_from_object.matrix3.inverse().transpose(),
            object_from_world_normal: world_from_object.matrix3.transpose(),
        }
    }
}

impl PreparedMaterials {
    /// World-space matrix's inverse of an instance, or of all space, at a time.
    pub(crate) fn object_from_world(&self, instance: u32, time: f32) -> Affine3A {
        self.at(instance, time, |transforms| transforms.object_from_world)
    }

    /// True if an instance moves.
    pub(crate) fn is_moving(&self, instance: u32) -> bool {
        self.poses.get(instance as usize).is_some_and(|poses| !poses.is_empty())
    }

    /// Something of the transforms of an instance at a time.
    #[inline(always)]
    fn at<T>(&self, instance: u32, time: f32, of: impl FnOnce(&Transforms) -> T) -> T {
        match self.poses.get(instance as usize) {
            Some(poses) if !poses.is_empty() => of(&Transforms::new(Pose::at(poses, time))),
            _ => of(&self.transforms[instance as usize]),
        }
    }

    /// Object-space normals at the corners of a triangle of a smooth mesh at a time, not normalised.
    pub(super) fn corner_normals_at(
        &self,
        geometry: Geometry,
        mesh: &Mesh,
        triangle: u32,
        time: f32,
    ) -> [Vec3; 3] {
        let corner = 3 * triangle as usize;
        let keys = match geometry {
            Geometry::Mesh(index) if !mesh.motion.is_empty() => &self.meshes[index].key_normals[..],
            _ => return [0, 1, 2].map(|next| mesh.corner_normals[corner + next]),
        };
        let count = mesh.corner_normals.len();
        let (key, share) = place(keys.len() / count, time);
        let first = key * count + corner;
        [0, 1, 2].map(|next| blend(keys[first + next], keys[first + count + next], share))
    }

    /// Corners and their unit shading normals of the triangle that `point` is on, in world space; nothing if its mesh is
    /// flat-shaded.
    pub(crate) fn smooth_triangle(
        &self,
        scene: &Scene,
        point: &SurfacePoint,
    ) -> Option<([Vec3; 3], [Vec3; 3])> {
        let mesh = scene.mesh(point.geometry)?;
        if mesh.corner_normals.is_empty() {
            return None;
        }
        let normals = self.corner_normals_at(point.geometry, mesh, point.primitive, point.time);
        let world_from_object = scene.instances[point.instance as usize].world_from_object_at(point.time);
        let corners = mesh.corners_at(point.primitive as usize, point.time);
        Some((
            corners.map(|corner| world_from_object.transform_point3(corner)),
            normals.map(|normal| self.world_normal(point.instance, point.time, normal)),
        ))
    }

    pub(super) fn object_direction(&self, instance: u32, time: f32, world: Vec3) -> Vec3 {
        self.at(instance, time, |transforms| transforms.object_from_world.transform_vector3(world))
    }

    pub(super) fn object_position(&self, instance: u32, time: f32, world: Vec3) -> Vec3 {
        self.at(instance, time, |transforms| transforms.object_from_world.transform_point3(world))
    }

    /// A unit object-space normal from a world-space one.
    pub(super) fn object_normal(&self, instance: u32, time: f32, world: Vec3) -> Vec3 {
        self.at(instance, time, |transforms| transforms.object_from_world_normal * world).normalize_or_zero()
    }

    /// A unit world-space normal from an object-space one.
    pub(super) fn world_normal(&self, instance: u32, time: f32, object: Vec3) -> Vec3 {
        self.turned_normal(instance, time, object).normalize_or_zero()
    }

    /// A world-space normal of any length.
    pub(super) fn turned_normal(&self, instance: u32, time: f32, object: Vec3) -> Vec3 {
        self.at(instance, time, |transforms| transforms.world_from_object_normal * object)
    }
}

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
