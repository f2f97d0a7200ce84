use std::sync::Arc;

use glam::Vec3;
use relume_dump::{Lobe, decode_direction, decode_rgb9e5, dither, encode_direction, encode_rgb9e5};
use relume_scene::{BumpShadowing, Scene};

use crate::{
    bsdf::{Closure, DiffusePart, Microfacet, SampleReach, SideNormals, Surface, Viewpoint, lambert},
    bvh::{Ray, RayKind},
    path::PathState,
    ray_offset::{offset_for_terminator, offset_origin},
    settings::BounceLimits,
    shading::{PreparedMaterials, RayInfo, SurfacePoint},
};

/// Vertex of a light-free path on a surface that lights can be connected to, in 64 bytes and those of its [`Rare`] parts: millions
/// are kept.
#[derive(Clone, Debug)]
pub struct PathVertex {
    /// World space, metres.
    pub position: Vec3,
    /// Weight on the film of what is reflected diffusely, rgb9e5. The sum of Lambert's closures is part of it.
    weight: u32,
    /// Octahedral normals: the surface's own, the interpolated one, and the one about which it reflects.
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
    first_lobe: Lobe,
}

/// Parts that some vertices have.
#[derive(Clone, Debug)]
struct Rare {
    viewpoint: Viewpoint,
    /// Diffuse closures, if they are not Lambert's.
    diffuse: Option<Box<[Closure]>>,
    /// Rough gloss.
    gloss: Box<[Gloss]>,
    /// Origin of rays between the surface and its shading normal's ([`SampleReach::Lights`]), if the vertex's own primitive can
    /// block them.
    between: Option<Vec3>,
}

#[derive(Clone, Debug)]
struct Gloss {
    /// Weight on the film, rgb9e5.
    weight: u32,
    facets: Microfacet,
}

const _: () = assert!(size_of::<PathVertex>() == 64);

impl PathVertex {
    /// Vertex where a path met a surface, with its weight on the film and its receiver number, which holds its class; nothing if the
    /// surface has no closures that lights are connected to.
    pub(crate) fn new(
        (scene, materials): (&Scene, &PreparedMaterials),
        limits: &BounceLimits,
        path: &PathState,
        (weight, receiver): (Vec3, u16),
        (point, surface): (&SurfacePoint, &Surface),
    ) -> Option<Self> {
        let packed = |weight| packed(weight, point.position);
        let gloss: Box<[Gloss]> = surface
            .rough_gloss()
            .map(|(own, facets)| Gloss { weight: packed(weight * own), facets: *facets })
            .collect();
        let (reflectance, normal, diffuse, bumps) = match surface.diffuse_part() {
            Some(DiffusePart::Lambert { weight, normal, bumps }) => (weight, normal, None, bumps),
            Some(DiffusePart::Closures(closures)) => {
                (Vec3::ONE, closures[0].normal, Some(closures), BumpShadowing::default())
            }
            None => (Vec3::ZERO, gloss.first()?.facets.frame.normal(), None, BumpShadowing::default()),
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
        let is_plain = diffuse.is_none() && gloss.is_empty() && between.is_none();
        let rare = || Arc::new(Rare { viewpoint: surface.viewpoint(), diffuse, gloss, between });
        Some(Self {
            position: point.position,
            weight: packed(weight * reflectance),
            geometric: encode_direction(point.horizon_normal()),
            shading: encode_direction(surface.shading_normal()),
            normal: encode_direction(normal),
            offset: above.origin.distance(point.position),
            time: point.time,
            primitive: (point.instance, point.primitive),
            rare: (!is_plain).then(rare),
            receiver,
            depths: depths.map(byte),
            transparent_left: byte(path.transparent_left(limits)),
            bumps,
            first_lobe: path.first_lobe,
        })
    }

    /// Number that lights go by ([`relume_dump::Segment::receiver`]).
    pub fn receiver(&self) -> u16 {
        self.receiver
    }

    /// Lobe of the first scattering of its path, [`Lobe::Camera`] if that is still to come.
    pub fn first_lobe(&self) -> Lobe {
        self.first_lobe
    }

    /// Unit normal about which it reflects.
    pub fn normal(&self) -> Vec3 {
        decode_direction(self.normal)
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        let rare = self.rare.as_ref().map_or(0, |rare| {
            let diffuse = rare.diffuse.as_deref().map_or(0, size_of_val);
            size_of::<Rare>() + 2 * size_of::<usize>() + size_of_val(&rare.gloss[..]) + diffuse
        });
        size_of::<Self>() + rare
    }

    /// True for each of [`relume_dump::Lobe::CONNECTED`] by which it reflects.
    pub fn lobes(&self) -> [bool; 2] {
        [self.weight != 0, !self.gloss().is_empty()]
    }

    /// True if nothing scattered the path before: light here is direct.
    pub fn is_first(&self) -> bool {
        self.depths[0] == 0
    }

    /// Bound of what it adds to the pixel of light that comes from everywhere, for the choice between vertices.
    pub(super) fn importance(&self) -> f32 {
        let mut sum = decode_rgb9e5(self.weight);
        if let Some(rare) = &self.rare {
            if let Some(closures) = &rare.diffuse {
                sum *= closures.iter().map(|closure| closure.weight).sum::<Vec3>();
            }
            let albedo = |gloss: &Gloss| {
                let (reflected, _) = gloss.facets.albedo(gloss.facets.frame.normal().dot(rare.viewpoint.wo));
                decode_rgb9e5(gloss.weight) * reflected
            };
            sum += rare.gloss.iter().map(albedo).sum::<Vec3>();
        }
        sum.max_element()
    }

    /// The vertex with so many times its weight.
    pub(super) fn scaled(mut self, factor: f32) -> Self {
        let scaled = |weight| packed(decode_rgb9e5(weight) * factor, self.position);
        self.weight = scaled(self.weight);
        if let Some(rare) = &mut self.rare {
            for gloss in &mut Arc::make_mut(rare).gloss {
                gloss.weight = scaled(gloss.weight);
            }
        }
        self
    }

    /// Contribution to the pixel of light from the unit direction `wi`, of radiance `factors` per steradian for each of
    /// [`relume_dump::Lobe::CONNECTED`], if nothing is in between, and the ray that tells whether something is; nothing where
    /// none is reflected.
    pub(super) fn reflect(&self, wi: Vec3, factors: [f32; 2]) -> Option<(Vec3, Ray)> {
        let (geometric, shading) = (decode_direction(self.geometric), decode_direction(self.shading));
        let rare = self.rare.as_deref();
        let mut reflected = Vec3::ZERO;
        if factors[0] != 0.0 {
            let reflectance = match rare.and_then(|rare| Some((rare, rare.diffuse.as_ref()?))) {
                None => Vec3::splat(lambert(self.bumps, shading, self.normal(), wi)),
                Some((rare, closures)) => {
                    closures.iter().map(|closure| rare.viewpoint.eval(closure, shading, wi)).sum()
                }
            };
            reflected += factors[0] * decode_rgb9e5(self.weight) * reflectance;
        }
        if let Some(rare) = rare.filter(|_| factors[1] != 0.0) {
            let of =
                |gloss: &Gloss| decode_rgb9e5(gloss.weight) * rare.viewpoint.eval_facets(&gloss.facets, wi);
            reflected += factors[1] * rare.gloss.iter().map(of).sum::<Vec3>();
        }
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

    fn gloss(&self) -> &[Gloss] {
        self.rare.as_ref().map_or(&[], |rare| &rare.gloss)
    }
}

/// A weight as rgb9e5, right on average: rounded by the bits of a position.
fn packed(weight: Vec3, position: Vec3) -> u32 {
    let [x, y, z] = position.to_array().map(f32::to_bits);
    encode_rgb9e5(weight, dither(x ^ z.rotate_left(16), y))
}
