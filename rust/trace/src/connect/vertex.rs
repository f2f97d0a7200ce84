use std::sync::Arc;

use glam::Vec3;
use relume_dump::{decode_direction, decode_rgb9e5, dither, encode_direction, encode_rgb9e5};
use relume_scene::{BumpShadowing, Scene};

use crate::{
    bsdf::{DiffuseClosures, DiffusePart, SampleReach, SideNormals, Surface, lambert},
    bvh::{Ray, RayKind},
    path::PathState,
    ray_offset::{offset_for_terminator, offset_origin},
    settings::BounceLimits,
    shading::{PreparedMaterials, RayInfo, SurfacePoint},
};

/// Vertex of a light-free path on a surface that reflects diffusely, in 64 bytes: millions are kept.
#[derive(Clone, Debug)]
pub struct DiffuseVertex {
    /// World space, metres.
    pub position: Vec3,
    /// Weight on the film of what is reflected, rgb9e5. The sum of Lambert's closures is part of it.
    weight: u32,
    /// Octahedral normals: the surface's own, the interpolated one, and that of the closures.
    geometric: u32,
    shading: u32,
    normal: u32,
    /// Distance of the origin of shadow rays from the surface, metres.
    offset: f32,
    time: f32,
    /// Instance and primitive.
    primitive: (u32, u32),
    rare: Option<Arc<Rare>>,
    receiver: u16,
    /// Bounces of the path in all, by diffuse, glossy and transmitted ones, and transparent surfaces on the way.
    depths: [u8; 5],
    /// Number of transparent surfaces that may lie before a light.
    transparent_left: u8,
    /// Dimming of Lambert's closures about a bent normal.
    bumps: BumpShadowing,
}

/// Parts that few vertices have.
#[derive(Clone, Debug)]
struct Rare {
    /// The closures, if they are not Lambert's.
    closures: Option<DiffuseClosures>,
    /// Origin of rays between the surface and its shading normal's ([`SampleReach::Lights`]), if the vertex's own primitive can
    /// block them.
    between: Option<Vec3>,
}

const _: () = assert!(size_of::<DiffuseVertex>() == 64);

impl DiffuseVertex {
    /// Vertex where a path met a surface, with its weight on the film and its receiver number, which holds its class; nothing if the
    /// surface reflects nothing diffusely.
    pub(crate) fn new(
        (scene, materials): (&Scene, &PreparedMaterials),
        limits: &BounceLimits,
        path: &PathState,
        (weight, receiver): (Vec3, u16),
        (point, surface): (&SurfacePoint, &Surface),
    ) -> Option<Self> {
        let (reflectance, normal, closures, bumps) = match surface.diffuse_part()? {
            DiffusePart::Lambert { weight, normal, bumps } => (weight, normal, None, bumps),
            DiffusePart::Closures(closures) => {
                (Vec3::ONE, closures.normal(), Some(closures), BumpShadowing::default())
            }
        };
        let mut above = Ray::new(point.position, point.geometric_normal);
        offset_origin(&mut above, point);
        let mut below = Ray::new(point.position, -point.geometric_normal);
        offset_for_terminator(&mut below, materials, scene, point);
        let between = below.from.is_none().then_some(below.origin);
        let ray = path.ray_info();
        let depths =
            [ray.depth, ray.diffuse_depth, ray.glossy_depth, ray.transmission_depth, ray.transparent_depth];
        let byte = |count: u32| count.min(u32::from(u8::MAX)) as u8;
        Some(Self {
            position: point.position,
            weight: packed(weight * reflectance, point.position),
            geometric: encode_direction(point.horizon_normal()),
            shading: encode_direction(surface.shading_normal()),
            normal: encode_direction(normal),
            offset: above.origin.distance(point.position),
            time: point.time,
            primitive: (point.instance, point.primitive),
            rare: (closures.is_some() || between.is_some()).then(|| Arc::new(Rare { closures, between })),
            receiver,
            depths: depths.map(byte),
            transparent_left: byte(path.transparent_left(limits)),
            bumps,
        })
    }

    /// Number that lights go by ([`relume_dump::Segment::receiver`]).
    pub fn receiver(&self) -> u16 {
        self.receiver
    }

    /// Unit normal about which it reflects.
    pub fn normal(&self) -> Vec3 {
        decode_direction(self.normal)
    }

    /// True if nothing scattered the path before: light here is direct.
    pub(super) fn is_first(&self) -> bool {
        self.depths[0] == 0
    }

    /// Bound of what it adds to the pixel of light that comes from everywhere, for the choice between vertices.
    pub(super) fn importance(&self) -> f32 {
        let closures = self.rare.as_ref().and_then(|rare| rare.closures.as_ref());
        let albedo = closures.map_or(Vec3::ONE, DiffuseClosures::weight);
        (decode_rgb9e5(self.weight) * albedo).max_element()
    }

    /// The vertex with so many times its weight.
    pub(super) fn scaled(&self, factor: f32) -> Self {
        let weight = packed(decode_rgb9e5(self.weight) * factor, self.position);
        Self { weight, ..self.clone() }
    }

    /// Contribution to the pixel of light from the unit direction `wi`, of radiance 1 per steradian, if nothing is in between, and
    /// the ray that tells whether something is; nothing where none is reflected.
    pub(super) fn reflect(&self, wi: Vec3) -> Option<(Vec3, Ray)> {
        let (geometric, shading) = (decode_direction(self.geometric), decode_direction(self.shading));
        let rare = self.rare.as_ref();
        let reflectance = match rare.and_then(|rare| rare.closures.as_ref()) {
            None => Vec3::splat(lambert(self.bumps, shading, self.normal(), wi)),
            Some(closures) => closures.eval(wi),
        };
        let reflected = decode_rgb9e5(self.weight) * reflectance;
        if !(reflected.max_element() > 0.0 && reflected.is_finite()) {
            return None;
        }
        let reach = SideNormals { geometric, shading }.reach(wi, false)?;
        let lifted = rare.and_then(|rare| rare.between).filter(|_| reach == SampleReach::Lights);
        let side = if reach == SampleReach::Lights { -geometric } else { geometric };
        let origin = lifted.unwrap_or(self.position + side * self.offset);
        let from = lifted.is_none().then_some(self.primitive);
        Some((reflected, Ray { kind: RayKind::Shadow, from, ..Ray::new(origin, wi).at(self.time) }))
    }

    /// The path's ray that met it, as far as its shadow rays tell shaders of it.
    pub(super) fn ray_info(&self) -> RayInfo {
        let [depth, diffuse_depth, glossy_depth, transmission_depth, transparent_depth] =
            self.depths.map(u32::from);
        RayInfo {
            depth,
            diffuse_depth,
            glossy_depth,
            transmission_depth,
            transparent_depth,
            ..RayInfo::default()
        }
    }

    /// See [`ShadowTracer::transparent_left`](crate::static_light::ShadowTracer).
    pub(super) fn transparent_left(&self) -> u32 {
        self.transparent_left.into()
    }
}

/// A weight as rgb9e5, right on average: rounded by the bits of a position.
fn packed(weight: Vec3, position: Vec3) -> u32 {
    let [x, y, z] = position.to_array().map(f32::to_bits);
    encode_rgb9e5(weight, dither(x ^ z.rotate_left(16), y))
}
