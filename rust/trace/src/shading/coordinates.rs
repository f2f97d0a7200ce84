//! Texture coordinates, their mapping, and the points about a hit where bump heights are taken.

use glam::{Mat3, Vec2, Vec3};
use relume_scene::{MappingKind, Projection, SurfaceBase, TangentKind, TexCoord};

use super::evaluate::ShadingContext;
use super::math::safe_divide_vector;
use super::{SurfacePoint, strands};

/// The outputs of the Texture Coordinate node.
pub fn coordinate(context: &ShadingContext, kind: TexCoord) -> Vec3 {
    let point = context.point;
    match kind {
        TexCoord::Uv => context.active_uv(),
        TexCoord::Object => context.prepared.object_position(point.instance, point.time, point.position),
        TexCoord::Generated => generated(context),
        TexCoord::Normal => context.prepared.object_normal(point.instance, point.time, point.shading_normal),
        TexCoord::Camera => {
            let camera = &context.scene.camera;
            let position = camera.world_from_camera.inverse().transform_point3(point.position);
            match camera.projection {
                Projection::Panoramic(panorama) => panorama.cycles_from_blender(position),
                // Cycles' camera looks along +z.
                _ => position * Vec3::new(1.0, 1.0, -1.0),
            }
        }
        TexCoord::Window => window(context),
        TexCoord::Reflection => point.shading_normal * (2.0 * point.shading_normal.dot(point.wo)) - point.wo,
    }
}

/// Position in 0..1 of the mesh's bounding box; the middle along flat directions. Of strands where their root is, if
/// that is known; in object space of all else.
pub fn generated(context: &ShadingContext) -> Vec3 {
    if let Some(root) = strands::generated(context) {
        return root;
    }
    let point = context.point;
    let position = context
        .rest_position()
        .unwrap_or_else(|| context.prepared.object_position(point.instance, point.time, point.position));
    within_bounds(context, position)
}

/// A place of the world in 0..1 of the bounding box of the mesh that is shaded, wherever on it.
pub fn generated_at(context: &ShadingContext, position: Vec3) -> Vec3 {
    let point = context.point;
    within_bounds(context, context.prepared.object_position(point.instance, point.time, position))
}

/// A place of object space in 0..1 of the mesh's bounding box, as it is without a mesh.
fn within_bounds(context: &ShadingContext, position: Vec3) -> Vec3 {
    let Some((min, size)) = context.prepared.bounds(context.point.geometry) else { return position };
    let relative = position - min;
    Vec3::select(size.cmpgt(Vec3::ZERO), relative / size, Vec3::splat(0.5))
}

/// Position on the film, 0..1 from the lower left corner.
fn window(context: &ShadingContext) -> Vec3 {
    let camera = &context.scene.camera;
    let position = camera.world_from_camera.inverse().transform_point3(context.point.position);
    let film = match camera.projection {
        Projection::Perspective => position.truncate() / -position.z,
        Projection::Orthographic => position.truncate(),
        // Cycles leaves the shift of panoramas out.
        Projection::Panoramic(panorama) => {
            return panorama.film(position.normalize_or_zero()).extend(0.0);
        }
    };
    let size: Vec2 = camera.window_max - camera.window_min;
    ((film - camera.window_min) / size).extend(0.0)
}

/// The Mapping node.
pub fn mapping(kind: MappingKind, vector: Vec3, location: Vec3, rotation: Mat3, scale: Vec3) -> Vec3 {
    match kind {
        MappingKind::Point => rotation * (vector * scale) + location,
        MappingKind::Texture => safe_divide_vector(rotation.transpose() * (vector - location), scale),
        MappingKind::Vector => rotation * (vector * scale),
        MappingKind::Normal => (rotation * safe_divide_vector(vector, scale)).normalize_or_zero(),
    }
}

/// The two directions along which Cycles shifts points to take differences.
pub fn footprint_axes(normal: Vec3) -> (Vec3, Vec3) {
    let x = Vec3::ONE.cross(normal).try_normalize();
    let x = x.unwrap_or_else(|| Vec3::new(-1.0, 1.0, 1.0).cross(normal).normalize_or(Vec3::X));
    (x, normal.cross(x))
}

/// The point moved by a vector in the plane of its triangle, or along its strand.
pub fn shifted(context: &ShadingContext, offset: Vec3) -> SurfacePoint {
    let point = context.point;
    let Some(mesh) = context.mesh() else {
        let [u, v] = point.barycentrics;
        let along = point.strand.map_or(0.0, |strand| {
            offset.dot(strand.tangent) / strand.tangent.length_squared().max(f32::MIN_POSITIVE)
        });
        let barycentrics = [(u + along).clamp(0.0, 1.0), v];
        return SurfacePoint { position: point.position + offset, barycentrics, ..*point };
    };
    let matrix = context.world_from_object().matrix3;
    let [a, b, c] = mesh.corners_at(point.primitive as usize, point.time);
    let (along_u, along_v) = (matrix * (b - a), matrix * (c - a));
    let normal = along_u.cross(along_v);
    let scale = normal.length_squared().recip();
    let scale = if scale.is_finite() { scale } else { 0.0 };
    let u = point.barycentrics[0] + offset.cross(along_v).dot(normal) * scale;
    let v = point.barycentrics[1] + along_u.cross(offset).dot(normal) * scale;
    SurfacePoint { position: point.position + offset, barycentrics: [u, v], ..*point }
}

impl ShadingContext<'_> {
    /// World-space tangent of a Tangent node; 0 along a UV map that the mesh lacks.
    pub(super) fn chosen_tangent(&self, kind: TangentKind, uv_map: usize) -> Vec3 {
        let from_middle = || generated(self) - 0.5;
        let tangent = match kind {
            TangentKind::X => Vec3::new(0.0, -from_middle().z, from_middle().y),
            TangentKind::Y => Vec3::new(-from_middle().z, 0.0, from_middle().x),
            TangentKind::Z => Vec3::new(-from_middle().y, from_middle().x, 0.0),
            TangentKind::UvMap => {
                let tangents = self.prepared.tangents(self.point.geometry, uv_map, SurfaceBase::Shaded);
                let Some(tangents) = tangents.filter(|_| self.mesh().is_some()) else { return Vec3::ZERO };
                self.interpolate(|corner| tangents[corner].truncate())
            }
        };
        let (normal, tangent) = (
            self.point.shading_normal,
            self.prepared.world_normal(self.point.instance, self.point.time, tangent),
        );
        normal.cross(tangent.cross(normal).normalize_or_zero())
    }

    /// True within half of `size` of an edge of the triangle, in metres or pixels (Cycles' `svm/wireframe.h`).
    pub(super) fn is_near_edge(&self, in_pixels: bool, size: f32) -> bool {
        let Some(mesh) = self.mesh() else { return false };
        let point = self.point;
        let pixel = || {
            let (x, y) = footprint_axes(point.geometric_normal);
            let across = |axis: Vec3| (axis - point.wo * axis.dot(point.wo)).length();
            point.footprint * (across(x) + across(y)) * 0.5
        };
        let reach = 0.5 * size * if in_pixels { pixel() } else { 1.0 };
        let world_from_object = self.world_from_object();
        let corners = mesh
            .corners_at(point.primitive as usize, point.time)
            .map(|corner| world_from_object.transform_point3(corner));
        (0..3).any(|corner| {
            let edge = corners[corner] - corners[(corner + 2) % 3];
            let area = edge.cross(point.position - corners[corner]);
            area.length_squared() < edge.length_squared() * reach * reach
        })
    }
}
