use glam::{Mat3A, Vec3};
use relume_scene::{Curves, Geometry, STILL, Scene, StrandShape};

use crate::strand::Span;

/// Intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index into [`relume_scene::Scene::instances`].
    pub instance: u32,
    /// Triangle of the instance's mesh, first key of the span of its curves, or point.
    pub primitive: u32,
    /// Weights of the triangle's second and third corner. Of a strand, the place along the span, 0..1, and across a
    /// ribbon, -1..1.
    pub barycentrics: [f32; 2],
    /// Distance along the unit ray direction, metres.
    pub distance: f32,
    /// Time of the ray within the shutter's interval, 0..1.
    pub time: f32,
    /// Normal of the front in world space, of any length. Ribbons face the ray.
    pub front: Vec3,
}

impl Hit {
    /// A hit on a triangle that is known without a ray, in the middle of the shutter's interval.
    pub fn on(scene: &Scene, [instance, primitive]: [u32; 2], barycentrics: [f32; 2], distance: f32) -> Self {
        let placed = &scene.instances[instance as usize];
        let cross = scene.mesh(placed.geometry).map_or(Vec3::Z, |mesh| {
            let [a, b, c] = mesh.triangles[primitive as usize].map(|vertex| mesh.positions[vertex as usize]);
            (b - a).cross(c - a)
        });
        let normal_matrix = placed.world_from_object.matrix3.inverse().transpose();
        let front = normal_matrix * cross;
        Self { instance, primitive, barycentrics, distance, time: STILL, front }
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
    /// See [`Hit::time`].
    pub time: f32,
    /// The ray that passes it.
    pub ray: RayInfo,
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
            geometry: instance.map_or(Geometry::Mesh(scene.meshes.len()), |instance| instance.geometry),
            primitive: SurfacePoint::NO_PRIMITIVE,
            barycentrics: [0.0; 2],
            ray_length: 0.0,
            footprint: 0.0,
            strand: None,
            time: self.time,
            // Rays have no length there, as in Cycles.
            ray: RayInfo { origin: self.position, ..self.ray },
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
    /// Unit normal of the surface itself, on the side of `wo`.
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
    /// See [`Hit::time`].
    pub time: f32,
    /// Place on a strand; nothing on other geometry.
    pub strand: Option<StrandPoint>,
    /// The ray that met it.
    pub ray: RayInfo,
}

/// Facts about the ray that met a point, as the node Light Path tells them (Cycles' `kernel/svm/light_path.h`). By default those of
/// no ray at all: light of an emitter is evaluated for every kind alike.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RayInfo {
    /// A ray of the camera, through transparent surfaces or none.
    pub is_camera: bool,
    /// A ray from a vertex straight to a light.
    pub is_shadow: bool,
    /// Left a diffuse closure, on either side.
    pub is_diffuse: bool,
    /// Left a glossy closure, on either side, singular ones included.
    pub is_glossy: bool,
    /// Left a mirror or clear glass.
    pub is_singular: bool,
    /// Was reflected.
    pub is_reflection: bool,
    /// Was transmitted.
    pub is_transmission: bool,
    /// Left a medium.
    pub is_volume_scatter: bool,
    /// Place from which its length counts, world space.
    pub origin: Vec3,
    /// Bounces before the point.
    pub depth: u32,
    /// Diffuse reflections before the point.
    pub diffuse_depth: u32,
    /// Glossy reflections before the point.
    pub glossy_depth: u32,
    /// Transmissions before the point.
    pub transmission_depth: u32,
    /// Transparent surfaces before the point, portals included.
    pub transparent_depth: u32,
    /// Portals before the point.
    pub portal_depth: u32,
    /// Wavelength of the path in nm, where glass disperses light.
    pub wavelength: Option<f32>,
}

impl RayInfo {
    /// A ray of all kinds at once.
    pub(crate) const OF_ALL_KINDS: Self = Self {
        is_camera: true,
        is_shadow: true,
        is_diffuse: true,
        is_glossy: true,
        is_singular: true,
        is_reflection: true,
        is_transmission: true,
        is_volume_scatter: true,
        origin: Vec3::ZERO,
        depth: 1,
        diffuse_depth: 1,
        glossy_depth: 1,
        transmission_depth: 1,
        transparent_depth: 1,
        portal_depth: 1,
        wavelength: None,
    };

    /// Rays of each kind after a bounce, and after more: what depends on rays is looked at for all of them to find its bounds.
    pub(crate) fn of_each_kind() -> Vec<Self> {
        const MORE: u32 = 4;
        let after = |bounces: u32| Self {
            depth: bounces,
            diffuse_depth: bounces,
            glossy_depth: bounces,
            transmission_depth: bounces,
            transparent_depth: bounces,
            portal_depth: bounces,
            ..Self::default()
        };
        let (none, once) = (Self::default(), after(1));
        vec![
            none,
            Self { is_camera: true, ..none },
            Self { is_shadow: true, ..once },
            Self { is_volume_scatter: true, ..once },
            Self { is_diffuse: true, is_reflection: true, ..once },
            Self { is_diffuse: true, is_transmission: true, ..once },
            Self { is_glossy: true, is_reflection: true, ..once },
            Self { is_glossy: true, is_transmission: true, ..once },
            Self { is_glossy: true, is_singular: true, is_reflection: true, ..once },
            Self { is_glossy: true, is_singular: true, is_transmission: true, ..once },
            Self { is_shadow: true, ..after(MORE) },
            Self { is_diffuse: true, is_reflection: true, ..after(MORE) },
            Self { is_volume_scatter: true, ..after(MORE) },
        ]
    }

    /// A ray straight to a light from a vertex that this ray met, at `origin`.
    pub fn shadow_from(&self, origin: Vec3) -> Self {
        Self { is_shadow: true, ..self.to_emitter(origin) }
    }

    /// What an emitter sees of a ray to it from a vertex that this ray met, at `origin`.
    pub fn to_emitter(&self, origin: Vec3) -> Self {
        let Self { depth, diffuse_depth, glossy_depth, transmission_depth, .. } = *self;
        let Self { transparent_depth, portal_depth, .. } = *self;
        let depth = depth + 1;
        Self {
            origin,
            depth,
            diffuse_depth,
            glossy_depth,
            transmission_depth,
            transparent_depth,
            portal_depth,
            ..Self::default()
        }
    }
}

impl SurfacePoint {
    /// Unit normal of the horizon that reflection stays above. Strands have no other than their shading normal, as in
    /// Cycles: the flat side of a ribbon is an image of a round hair.
    pub fn horizon_normal(&self) -> Vec3 {
        if self.strand.is_some() { self.shading_normal } else { self.geometric_normal }
    }
}

/// Place on a strand.
#[derive(Clone, Copy, Debug)]
pub struct StrandPoint {
    /// Derivative of the axis by the place along the span, world space (Cycles' `dPdu`).
    pub tangent: Vec3,
    /// Radius, object space, metres.
    pub radius: f32,
    /// Object-space shading normal of a ribbon, of any length; nothing on round strands.
    pub(super) ribbon_normal: Option<Vec3>,
}

impl StrandPoint {
    /// The place of a hit; `direction` is the ray's in object space. A ribbon is shaded as the cylinder that it stands for.
    pub(super) fn new(curves: &Curves, hit: &Hit, world_from_object: Mat3A, direction: Vec3) -> Self {
        let span = Span::new(curves.span_at(hit.primitive as usize, hit.time), curves.shape);
        let [u, v] = hit.barycentrics;
        let tangent = span.tangent(u);
        let ribbon_normal = matches!(curves.shape, StrandShape::Ribbon { .. }).then(|| {
            let across = tangent.cross(-direction).normalize_or_zero();
            across * v - tangent.cross(across).normalize_or_zero() * (1.0 - v * v).max(0.0).sqrt()
        });
        Self { tangent: world_from_object * tangent, radius: span.at(u).w, ribbon_normal }
    }
}
