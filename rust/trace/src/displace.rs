//! Displacement of meshes before they are traced, vertex by vertex as Cycles does it (`mesh_displace.cpp`).

#[cfg(test)]
mod tests;

use std::collections::HashMap;

use glam::Vec3;
use rayon::prelude::*;
use relume_scene::{Displaceable, Geometry, Mesh, Scene, Undisplaced};

use crate::shading::PreparedMaterials;

/// Moves the vertices of all meshes that are to be displaced ([`Mesh::displaceable`]) as their materials say. Each is
/// displaced once, as the first instance shows it; instances that show it in other materials get a mesh of their own.
pub fn displace(scene: &mut Scene) {
    if scene.meshes.iter().all(|mesh| mesh.displaceable.is_none()) {
        return;
    }
    let users = give_own_meshes(scene);
    // The tracer prepares the scene anew, and warns of its materials.
    let (prepared, _) = PreparedMaterials::new(scene);
    for number in 0..scene.meshes.len() {
        let Some(displaceable) = scene.meshes[number].displaceable.take() else { continue };
        let shape = users.get(&number).and_then(|user| {
            let moves = Moves::new(scene, &prepared, *user, &scene.meshes[number]);
            moves.displaced(scene, &prepared, &scene.meshes[number], &displaceable)
        });
        if let Some((positions, corner_normals)) = shape {
            let mesh = &mut scene.meshes[number];
            let offsets: Vec<Vec3> =
                positions.iter().zip(&mesh.positions).map(|(to, from)| to - from).collect();
            mesh.motion.iter_mut().zip(offsets.iter().cycle()).for_each(|(key, offset)| *key += offset);
            let positions = std::mem::replace(&mut mesh.positions, positions);
            let corner_normals = std::mem::replace(&mut mesh.corner_normals, corner_normals);
            mesh.undisplaced = Some(Undisplaced { positions, corner_normals });
        }
    }
}

/// Numbers of the first instances of meshes that are to be displaced, after copies were made of those that are shown in
/// several sets of materials.
fn give_own_meshes(scene: &mut Scene) -> HashMap<usize, u32> {
    let mut users: HashMap<usize, u32> = HashMap::new();
    let mut meshes: HashMap<(usize, Vec<usize>), usize> = HashMap::new();
    for number in 0..scene.instances.len() {
        let Geometry::Mesh(mesh) = scene.instances[number].geometry else { continue };
        if scene.meshes[mesh].displaceable.is_none() {
            continue;
        }
        let key = (mesh, scene.instances[number].materials.clone());
        let own = *meshes.entry(key).or_insert_with(|| {
            if users.contains_key(&mesh) {
                scene.meshes.push(scene.meshes[mesh].clone());
                scene.meshes.len() - 1
            } else {
                mesh
            }
        });
        users.entry(own).or_insert(number as u32);
        scene.instances[number].geometry = Geometry::Mesh(own);
    }
    users
}

/// Who moves the vertices of a mesh.
struct Moves {
    /// Instance that shows it.
    instance: u32,
    /// True for each triangle whose material replaces the normals, false where it keeps them, nothing where it moves nothing.
    replaces_normals: Vec<Option<bool>>,
    /// First triangle of each vertex that moves, and which of its corners it is.
    corners: Vec<(u32, u8)>,
}

impl Moves {
    fn new(scene: &Scene, prepared: &PreparedMaterials, instance: u32, mesh: &Mesh) -> Self {
        let placed = &scene.instances[instance as usize];
        let replaces_normals: Vec<Option<bool>> = (0..mesh.triangles.len())
            .map(|triangle| {
                let offset = prepared.offset(placed.material_of(scene, triangle)?)?;
                Some(!offset.keeps_normals)
            })
            .collect();
        let mut is_known = vec![false; mesh.positions.len()];
        let mut corners = Vec::new();
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            if replaces_normals[number].is_none() {
                continue;
            }
            for (corner, vertex) in triangle.iter().enumerate() {
                if !std::mem::replace(&mut is_known[*vertex as usize], true) {
                    corners.push((number as u32, corner as u8));
                }
            }
        }
        Self { instance, replaces_normals, corners }
    }

    /// Positions and corner normals afterwards; nothing if no vertex moves.
    fn displaced(
        &self,
        scene: &Scene,
        prepared: &PreparedMaterials,
        mesh: &Mesh,
        displaceable: &Displaceable,
    ) -> Option<(Vec<Vec3>, Vec<Vec3>)> {
        if self.corners.is_empty() {
            return None;
        }
        let offsets: Vec<Vec3> = self
            .corners
            .par_iter()
            .map_init(Vec::new, |values, (triangle, corner)| {
                let corner = usize::from(*corner);
                let at = 3 * *triangle as usize + corner;
                let of_corner = mesh.corner_normals.get(at).filter(|_| displaceable.turns_corner_normals);
                let vertex = mesh.triangles.as_flattened()[at] as usize;
                let normal = of_corner.unwrap_or(&displaceable.vertex_normals[vertex]);
                prepared.displacement(scene, [self.instance, *triangle], corner, *normal, values)
            })
            .collect();
        let mut positions = mesh.positions.clone();
        for ((triangle, corner), offset) in self.corners.iter().zip(offsets) {
            let position = &mut positions[mesh.triangles[*triangle as usize][usize::from(*corner)] as usize];
            let moved = *position + offset;
            if moved.is_finite() {
                *position = moved;
            }
        }
        let corner_normals = self.corner_normals(mesh, displaceable, &positions);
        Some((positions, corner_normals))
    }

    /// Normals of corners after their vertices moved to `positions`; none on a mesh that is flat all over.
    fn corner_normals(&self, mesh: &Mesh, displaceable: &Displaceable, positions: &[Vec3]) -> Vec<Vec3> {
        if mesh.corner_normals.is_empty() {
            return Vec::new();
        }
        let turns = displaceable.turns_corner_normals;
        let counts = |triangle: usize| turns || self.replaces_normals[triangle] == Some(true);
        let after = vertex_normals(mesh, positions, counts);
        let before = if turns { vertex_normals(mesh, &mesh.positions, counts) } else { Vec::new() };
        let mut normals = mesh.corner_normals.clone();
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            let is_flat = displaceable.flat_triangles.get(number).is_some_and(|flat| *flat);
            for (corner, vertex) in triangle.iter().enumerate() {
                let (vertex, normal) = (*vertex as usize, &mut normals[3 * number + corner]);
                *normal = match after[vertex] {
                    _ if is_flat => face_normal(*triangle, positions),
                    Some(after) if turns => {
                        (*normal + after - before[vertex].unwrap_or(after)).normalize_or(*normal)
                    }
                    Some(after) if after != Vec3::ZERO => after,
                    _ => *normal,
                };
            }
        }
        normals
    }
}

/// Normalised sums of the unit normals of triangles that count; nothing at vertices of no such triangle.
pub(crate) fn vertex_normals(
    mesh: &Mesh,
    positions: &[Vec3],
    counts: impl Fn(usize) -> bool,
) -> Vec<Option<Vec3>> {
    let mut normals = vec![None; positions.len()];
    for (_, triangle) in mesh.triangles.iter().enumerate().filter(|(number, _)| counts(*number)) {
        let normal = face_normal(*triangle, positions);
        for vertex in triangle {
            *normals[*vertex as usize].get_or_insert(Vec3::ZERO) += normal;
        }
    }
    normals.iter_mut().flatten().for_each(|normal| *normal = normal.normalize_or_zero());
    normals
}

/// Unit normal of a triangle, Cycles' x axis where it has no area.
pub(crate) fn face_normal(triangle: [u32; 3], positions: &[Vec3]) -> Vec3 {
    let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
    (b - a).cross(c - a).normalize_or(Vec3::X)
}
