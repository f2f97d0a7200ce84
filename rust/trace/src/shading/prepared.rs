use glam::{Mat3A, Vec3};
use relume_scene::{Input, Node, Scene};

use super::{Hit, SurfacePoint};
use crate::bsdf::{Scatter, Surface};

/// Everything about materials that does not depend on the hit.
#[derive(Debug)]
pub struct PreparedMaterials {
    /// For each instance: world-space normals from object-space ones, before normalising.
    normal_transforms: Vec<Mat3A>,
}

impl PreparedMaterials {
    /// Compiles the graphs of `scene`. The second value says in words what could not be represented.
    pub fn new(scene: &Scene) -> (Self, Vec<String>) {
        let normal_transforms = scene
            .instances
            .iter()
            .map(|instance| instance.world_from_object.matrix3.inverse().transpose())
            .collect();
        (Self { normal_transforms }, Vec::new())
    }

    /// The point that a ray from `origin` along the unit `direction` hit. `footprint` is the radius of the ray's
    /// cone there.
    pub fn surface_point(
        &self,
        scene: &Scene,
        hit: &Hit,
        origin: Vec3,
        direction: Vec3,
        footprint: f32,
    ) -> SurfacePoint {
        let instance = &scene.instances[hit.instance as usize];
        let mesh = &scene.meshes[instance.mesh];
        let [a, b, c] = mesh.triangles[hit.triangle as usize].map(|vertex| mesh.positions[vertex as usize]);
        let normal_transform = self.normal_transforms[hit.instance as usize];
        let front = (normal_transform * (b - a).cross(c - a)).normalize_or(-direction);
        let smooth = if mesh.corner_normals.is_empty() {
            front
        } else {
            let corner = 3 * hit.triangle as usize;
            let [u, v] = hit.barycentrics;
            let interpolated = mesh.corner_normals[corner] * (1.0 - u - v)
                + mesh.corner_normals[corner + 1] * u
                + mesh.corner_normals[corner + 2] * v;
            (normal_transform * interpolated).normalize_or(front)
        };
        let backfacing = front.dot(direction) > 0.0;
        let side = if backfacing { -1.0 } else { 1.0 };
        SurfacePoint {
            position: origin + direction * hit.distance,
            geometric_normal: front * side,
            shading_normal: smooth * side,
            wo: -direction,
            backfacing,
            instance: hit.instance,
            mesh: instance.mesh as u32,
            triangle: hit.triangle,
            barycentrics: hit.barycentrics,
            ray_length: hit.distance,
            footprint,
        }
    }

    /// Fills `surface` with the closures and the emission at `point`.
    pub fn evaluate(&self, scene: &Scene, point: &SurfacePoint, surface: &mut Surface) {
        surface.reset(point);
        let instance = &scene.instances[point.instance as usize];
        let slot = scene.meshes[instance.mesh]
            .material_slots
            .get(point.triangle as usize)
            .map_or(0, |slot| usize::from(*slot));
        let Some(material) = instance.materials.get(slot).or(instance.materials.last()) else {
            surface.add(Vec3::splat(0.8), point.shading_normal, Scatter::Diffuse);
            return;
        };
        for node in &scene.materials[*material].nodes {
            match node {
                Node::Principled { base_color: color, .. } | Node::Diffuse { color, .. } => {
                    let weight = match color {
                        Input::Rgb(rgb) => Vec3::from(*rgb),
                        _ => Vec3::splat(0.5),
                    };
                    surface.add(weight, point.shading_normal, Scatter::Diffuse);
                }
                _ => {}
            }
        }
    }
}
