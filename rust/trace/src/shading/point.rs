use glam::Vec3;
use relume_scene::{Geometry, Scene};

/// Intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index into [`relume_scene::Scene::instances`].
    pub instance: u32,
    /// Triangle of the instance's mesh.
    pub primitive: u32,
    /// Weights of the triangle's second and third corner.
    pub barycentrics: [f32; 2],
    /// Distance along the unit ray direction, metres.
    pub distance: f32,
    /// Normal of the triangle's front in world space, of any length.
    pub front: Vec3,
}

impl Hit {
    /// A hit on a triangle that is known without a ray.
    pub fn on(scene: &Scene, [instance, primitive]: [u32; 2], barycentrics: [f32; 2], distance: f32) -> Self {
        let placed = &scene.instances[instance as usize];
        let cross = scene.mesh(placed.geometry).map_or(Vec3::Z, |mesh| {
            let [a, b, c] = mesh.triangles[primitive as usize].map(|vertex| mesh.positions[vertex as usize]);
            (b - a).cross(c - a)
        });
        let normal_matrix = placed.world_from_object.matrix3.inverse().transpose();
        let front = normal_matrix * cross;
        Self { instance, primitive, barycentrics, distance, front }
    }
}

/// A point within a medium.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MediumPoint {
    /// World space.
    pub position: Vec3,
    /// Unit direction back along the ray.
    pub wo: Vec3,
    /// Index into [`relume_scene::Scene::instances`], their number for the medium of the world.
    pub instance: u32,
}

impl MediumPoint {
    /// The point as graphs see it: without surface, and facing the ray.
    pub(super) fn without_surface(&self, scene: &Scene) -> SurfacePoint {
        let instance = scene.instances.get(self.instance as usize);
        SurfacePoint {
            position: self.position,
            geometric_normal: self.wo,
            shading_normal: self.wo,
            wo: self.wo,
            backfacing: false,
            instance: self.instance,
            geometry: instance.map_or(scene.meshes.len().into(), |instance| instance.geometry),
            primitive: SurfacePoint::NO_PRIMITIVE,
            barycentrics: [0.0; 2],
            ray_length: 0.0,
            footprint: 0.0,
        }
    }
}

impl SurfacePoint {
    /// In place of the primitive of a point within a medium.
    const NO_PRIMITIVE: u32 = u32::MAX;

    /// True if the point is within a medium, where nothing of a mesh is but its box.
    pub(super) fn is_in_medium(&self) -> bool {
        self.primitive == Self::NO_PRIMITIVE
    }
}

/// A point on a surface, in world space, as the shader graphs see it.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position of the hit.
    pub position: Vec3,
    /// Unit normal of the triangle, on the side of `wo`.
    pub geometric_normal: Vec3,
    /// Interpolated unit normal, flipped together with `geometric_normal`.
    pub shading_normal: Vec3,
    /// Unit direction back along the ray.
    pub wo: Vec3,
    /// True if the ray hit the back of the triangle, so that both normals were flipped.
    pub backfacing: bool,
    /// See [`Hit::instance`].
    pub instance: u32,
    /// Geometry of the instance.
    pub geometry: Geometry,
    /// See [`Hit::primitive`].
    pub primitive: u32,
    /// See [`Hit::barycentrics`].
    pub barycentrics: [f32; 2],
    /// Length of the ray, metres.
    pub ray_length: f32,
    /// Radius of the ray's footprint on the surface, metres (Cycles' compact differential `dP`).
    pub footprint: f32,
}
