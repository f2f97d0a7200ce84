//! Origins of rays that leave a surface.

use glam::Vec3;
use relume_scene::Scene;

use crate::{
    bvh::Ray,
    shading::{PreparedMaterials, SurfacePoint},
};

/// Starts `ray` at `point`: a few roundings of the coordinates off the surface on the side that it goes to, so that
/// neighbours in the same plane are not met.
pub(crate) fn offset_origin(ray: &mut Ray, point: &SurfacePoint) {
    let side = if point.geometric_normal.dot(ray.direction) < 0.0 { -1.0 } else { 1.0 };
    ray.origin = point.position + point.geometric_normal * (side * rounding(point));
    ray.from = Some((point.instance, point.primitive));
}

/// Starts a scattered `ray` at `point` that dips below a smooth-shaded triangle: on the curved surface that the triangle
/// stands for, as far above it as Cycles lifts its shadow rays (`kernel/light/sample.h`, `shadow_ray_offset`; the idea
/// is Hanika's, "Hacking the Shadow Terminator", Ray Tracing Gems II, chapter 4). The triangle itself can block it.
pub(crate) fn offset_for_terminator(
    ray: &mut Ray,
    materials: &PreparedMaterials,
    scene: &Scene,
    point: &SurfacePoint,
) {
    let has_lift = scene.instances[point.instance as usize].shadow_terminator_offset > 0.0;
    let Some((corners, normals)) = materials.smooth_triangle(scene, point).filter(|_| has_lift) else {
        offset_origin(ray, point);
        return;
    };
    let [v, w] = point.barycentrics;
    let dips_in = point.geometric_normal.dot(ray.direction) < 0.0;
    let side = if dips_in { point.geometric_normal } else { -point.geometric_normal };
    let lift = terminator_offset(corners, normals, [1.0 - v - w, v, w], side);
    ray.origin = point.position + side * rounding(point) + lift;
    ray.from = None;
}

fn rounding(point: &SurfacePoint) -> f32 {
    point.position.abs().max_element().max(point.ray_length) * (8.0 * f32::EPSILON)
}

/// Offset from the point with barycentric coordinates `weights` of a triangle to the curved surface that its vertex
/// normals describe, on the side of `side`: half the height of the parabolic patch, or the lower envelope of the
/// vertices' tangent planes if that is higher. Both are zero where the normals are the triangle's own.
fn terminator_offset(corners: [Vec3; 3], normals: [Vec3; 3], weights: [f32; 3], side: Vec3) -> Vec3 {
    let blend = |of: [Vec3; 3]| of[0] * weights[0] + of[1] * weights[1] + of[2] * weights[2];
    let normals = if blend(normals).dot(side) > 0.0 { normals } else { normals.map(|normal| -normal) };
    let position = blend(corners);
    let bend = |i: usize, j: usize| {
        (normals[j] - normals[i]).dot(corners[j] - corners[i]) * (weights[i] * weights[j])
    };
    let parabola = bend(0, 1) + bend(1, 2) + bend(0, 2);
    let envelope = (0..3)
        .map(|i| {
            let height = |of: Vec3| (of - corners[i]).dot(normals[i]);
            let highest = corners.iter().map(|&corner| height(corner)).fold(0.0, f32::max);
            (highest - height(position)).max(0.0)
        })
        .fold(f32::INFINITY, f32::min);
    blend(normals) * envelope.max(0.5 * parabola)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle of the unit sphere's hull about +z.
    fn cap() -> [Vec3; 3] {
        [0.0f32, 2.1, 4.2].map(|angle| Vec3::new(0.4 * angle.cos(), 0.4 * angle.sin(), 0.84f32.sqrt()))
    }

    #[test]
    fn a_flat_triangle_is_not_lifted() {
        let lift = terminator_offset(cap(), [Vec3::Z; 3], [0.2, 0.3, 0.5], Vec3::Z);
        assert!(lift.length() < 1e-6, "{lift}");
    }

    #[test]
    fn a_triangle_in_a_sphere_is_lifted_at_least_to_the_sphere() {
        let center = terminator_offset(cap(), cap(), [1.0 / 3.0; 3], Vec3::Z);
        let sagitta = 1.0 - 0.84f32.sqrt();
        assert!(center.z > sagitta && center.z < 2.0 * sagitta, "{center} {sagitta}");
        assert!(terminator_offset(cap(), cap(), [1.0, 0.0, 0.0], Vec3::Z).length() < 1e-6);
    }

    #[test]
    fn the_inside_of_a_sphere_is_lifted_inwards_to_clear_its_neighbours() {
        let lift = terminator_offset(cap(), cap(), [0.2, 0.3, 0.5], Vec3::NEG_Z);
        assert!(lift.z < 0.0, "{lift}");
    }
}
