use glam::Vec3;
use relume_scene::Scene;

use crate::{
    bsdf::SampleReach,
    bvh::{Ray, RayKind},
    path::PathState,
    ray_offset::{offset_for_terminator, offset_origin},
    settings::BounceLimits,
    shading::{PreparedMaterials, RayInfo, SurfacePoint},
};

/// Start of the shadow rays of a vertex on a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadowStart {
    /// Origin of rays to the side of the normals.
    above: Vec3,
    /// Origin of rays between the surface and its shading normal's ([`SampleReach::Lights`]).
    between: Vec3,
    /// True if these may meet the vertex's own primitive.
    is_lifted: bool,
    primitive: (u32, u32),
    time: f32,
    /// Bounces of the path in all, by diffuse, glossy and transmitted ones, and transparent surfaces and portals on the way.
    depths: [u8; 6],
    /// Number of transparent surfaces that may lie before a light.
    pub transparent_left: u16,
}

impl ShadowStart {
    /// Start at the point that a path met.
    pub fn new(
        scene: &Scene,
        materials: &PreparedMaterials,
        limits: &BounceLimits,
        path: &PathState,
        point: &SurfacePoint,
    ) -> Self {
        let mut above = Ray::new(point.position, point.geometric_normal);
        offset_origin(&mut above, point);
        let mut between = Ray::new(point.position, -point.geometric_normal);
        offset_for_terminator(&mut between, materials, scene, point);
        let RayInfo { depth, diffuse_depth, glossy_depth, transmission_depth, transparent_depth, portal_depth, .. } =
            path.ray_info();
        let depths =
            [depth, diffuse_depth, glossy_depth, transmission_depth, transparent_depth, portal_depth];
        Self {
            above: above.origin,
            between: between.origin,
            is_lifted: between.from.is_none(),
            primitive: (point.instance, point.primitive),
            time: point.time,
            depths: depths.map(|depth| depth.min(u32::from(u8::MAX)) as u8),
            transparent_left: path.transparent_left(limits).min(u32::from(u16::MAX)) as u16,
        }
    }

    /// Shadow ray in a direction of this reach.
    pub fn ray(&self, direction: Vec3, reach: SampleReach) -> Ray {
        let is_between = reach == SampleReach::Lights;
        let origin = if is_between { self.between } else { self.above };
        let from = (!(is_between && self.is_lifted)).then_some(self.primitive);
        Ray { kind: RayKind::Shadow, from, ..Ray::new(origin, direction).at(self.time) }
    }

    /// A shadow ray from the vertex at `position` as shaders see it.
    pub fn ray_info(&self, position: Vec3) -> RayInfo {
        let [depth, diffuse_depth, glossy_depth, transmission_depth, transparent_depth, portal_depth] =
            self.depths.map(u32::from);
        let path = RayInfo {
            depth,
            diffuse_depth,
            glossy_depth,
            transmission_depth,
            transparent_depth,
            portal_depth,
            ..RayInfo::default()
        };
        path.shadow_from(position)
    }
}
