//! Motion of what a pixel shows from the frame before it, and to the frame after it (Cycles' `primitive_motion_vector`).

use glam::{Vec2, Vec3, Vec4};
use relume_scene::{Camera, Geometry, Projection, Scene};

use crate::shading::SurfacePoint;

/// A scene at a frame, and at the frames before and after. Instances are the same where they have the same number and name, elements
/// of their shapes where there are as many.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frames<'s> {
    pub now: &'s Scene,
    pub before: &'s Scene,
    pub after: &'s Scene,
}

impl Frames<'_> {
    /// Way in pixels, right and up, of a point since the frame before, as a negative, and to the frame after, as a negative, too:
    /// Cycles' signs. Nothing for cameras that are none with a plane film.
    pub fn vector(&self, point: &SurfacePoint) -> Option<Vec4> {
        let [before, now, after] = [self.before, self.now, self.after]
            .map(|then| raster(&then.camera, self.moved(then, point)))
            .map(|place| place.filter(|place| place.is_finite()));
        let (now, before, after) = (now?, before?, after?);
        Some(Vec4::from(((before - now), (now - after))))
    }

    /// Where a point of the present frame is in another one.
    fn moved(&self, then: &Scene, point: &SurfacePoint) -> Vec3 {
        let number = point.instance as usize;
        let from = &self.now.instances[number];
        let Some(to) = then.instances.get(number).filter(|to| to.name == from.name) else {
            return point.position;
        };
        let mut local = from.world_from_object.inverse().transform_point3(point.position);
        if let (Some((count, here)), Some((other, there))) =
            (on_shape(self.now, from.geometry, point), on_shape(then, to.geometry, point))
            && count == other
        {
            local += there - here;
        }
        let moved = to.world_from_object.transform_point3(local);
        if moved.is_finite() { moved } else { point.position }
    }
}

/// Number of elements of a shape, and the place of a point on it in the object's space.
fn on_shape(scene: &Scene, geometry: Geometry, point: &SurfacePoint) -> Option<([usize; 2], Vec3)> {
    let first = point.primitive as usize;
    let [u, v] = point.barycentrics;
    if let Some(mesh) = scene.mesh(geometry) {
        let corners = mesh.triangles.get(first)?.map(|vertex| mesh.positions[vertex as usize]);
        let place = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
        return Some(([mesh.positions.len(), mesh.triangles.len()], place));
    }
    if let Some(curves) = scene.curves(geometry) {
        let place = curves.keys.get(first)?.lerp(*curves.keys.get(first + 1)?, u);
        return Some(([curves.keys.len(), curves.first_keys.len()], place));
    }
    let points = scene.points(geometry)?;
    Some(([points.positions.len(); 2], *points.positions.get(first)?))
}

/// Place on the film in pixels, right and up, of a point in world space.
fn raster(camera: &Camera, position: Vec3) -> Option<Vec2> {
    let place = camera.world_from_camera.inverse().transform_point3(position);
    let window = match camera.projection {
        Projection::Perspective => place.truncate() / -place.z,
        Projection::Orthographic => place.truncate(),
        Projection::Panoramic(_) => return None,
    };
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    Some((window - camera.window_min) / (camera.window_max - camera.window_min) * size)
}
