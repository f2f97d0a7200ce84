mod unpacked;

use std::sync::Arc;

use glam::Vec3;
use relume_dump::{ByConnectedLobe, Lobe, decode_rgb9e5, dither, encode_direction, encode_rgb9e5};
use relume_scene::{BumpShadowing, Scene};

pub use self::unpacked::UnpackedVertex;
use super::equiangular::{Equiangular, LightCenter};
use crate::{
    bsdf::{Closure, Lambert, Surface, Viewpoint},
    bvh::Ray,
    media::{MediumSample, VolumeStack},
    path::PathState,
    ray_offset::{offset_for_terminator, offset_origin},
    shading::{PreparedMaterials, RayInfo, SurfacePoint},
};

/// Vertex of a light-free path, on a surface or in a medium, that lights can be connected to, or a whole flight through media. It takes
/// 64 bytes and those of its [`Rare`] parts: millions are kept.
#[derive(Clone, Debug)]
pub struct PathVertex {
    /// World space, metres; of a flight its start.
    position: Vec3,
    /// Weight on the film of what Lambert's closures reflect or a medium scatters, rgb9e5.
    weight: u32,
    /// Octahedral normals: the surface's own, the interpolated one, and the one about which it reflects. Of no meaning in a medium.
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
    /// True if its light passes all objects but shadow catchers.
    catchers_only: bool,
}

/// State in which a path comes to a vertex.
pub(crate) struct PathAtVertex<'p> {
    pub path: &'p PathState,
    /// Weight on the film.
    pub weight: Vec3,
    /// Receiver number, which holds its class.
    pub receiver: u16,
    /// Number of transparent surfaces that may lie before a light.
    pub transparent_left: u32,
    /// Media around the vertex, if those are not the ones outside of all objects.
    pub around: Option<&'p VolumeStack>,
}

/// Parts that some vertices have.
#[derive(Clone, Debug)]
struct Rare {
    /// Numbers of [`PathAtVertex::around`].
    around: Option<Box<[u32]>>,
    scattering: Scattering,
}

/// Scattering that takes more than a weight and a normal.
#[derive(Clone, Debug)]
enum Scattering {
    /// Lambert's law, on a surface.
    Lambert,
    Surface(Box<SurfaceParts>),
    /// Phase functions, and the unit direction in which the path arrived; its flight, if the media are homogeneous.
    Medium {
        medium: Arc<MediumSample>,
        travel: Vec3,
        flight: Option<HomogeneousFlight>,
    },
    /// A flight through homogeneous media, in a unit direction.
    Flight {
        media: Arc<MediumSample>,
        travel: Vec3,
        length: f32,
    },
}

/// A flight through homogeneous media that ended at a collision.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HomogeneousFlight {
    /// Distance to the collision, metres.
    pub distance: f32,
    /// Length up to what stands there, infinite where nothing does.
    pub length: f32,
}

/// Place of a vertex that a light is connected to.
#[derive(Clone, Copy, Debug)]
pub struct VertexPlace {
    /// World space, metres.
    pub position: Vec3,
    /// Factor on its weight, RGB.
    factor: Vec3,
}

#[derive(Clone, Debug)]
struct SurfaceParts {
    viewpoint: Viewpoint,
    /// Closures besides Lambert's; their weights are those on the film.
    closures: Box<[Closure]>,
    /// True if some of them scatter to the other side.
    transmits: bool,
    /// True if all of them reflect about the same normal as Lambert's.
    has_one_normal: bool,
    /// True if the path came from behind the surface.
    backfacing: bool,
    /// Origin of rays between the surface and its shading normal's ([`SampleReach::Lights`]), if the vertex's own primitive can
    /// block them.
    between: Option<Vec3>,
}

const _: () = assert!(size_of::<PathVertex>() == 64);

impl PathVertex {
    /// Vertex where a path met a surface; nothing if that has no closures that lights are connected to.
    pub(crate) fn on_surface(
        (scene, materials): (&Scene, &PreparedMaterials),
        arrival: &PathAtVertex<'_>,
        (point, surface): (&SurfacePoint, &Surface),
    ) -> Option<Self> {
        let part = surface.connected_part()?;
        let mut closures = part.others;
        let Lambert { weight, normal, bumps } = part.lambert.unwrap_or_else(|| Lambert {
            weight: Vec3::ZERO,
            normal: closures[0].normal,
            bumps: BumpShadowing::default(),
        });
        closures.iter_mut().for_each(|closure| closure.weight *= arrival.weight);
        let mut above = Ray::new(point.position, point.geometric_normal);
        offset_origin(&mut above, point);
        let mut below = Ray::new(point.position, -point.geometric_normal);
        offset_for_terminator(&mut below, materials, scene, point);
        let between = below.from.is_none().then_some(below.origin);
        let scattering = if closures.is_empty() && between.is_none() {
            Scattering::Lambert
        } else {
            Scattering::Surface(Box::new(SurfaceParts {
                viewpoint: surface.viewpoint(),
                transmits: closures.iter().any(Closure::transmits),
                has_one_normal: closures.iter().all(|closure| closure.normal == normal),
                backfacing: point.backfacing,
                closures,
                between,
            }))
        };
        Some(Self {
            weight: packed(arrival.weight * weight, point.position),
            geometric: encode_direction(point.horizon_normal()),
            shading: encode_direction(surface.shading_normal()),
            normal: encode_direction(normal),
            offset: above.origin.distance(point.position),
            primitive: (point.instance, point.primitive),
            bumps,
            ..Self::at(point.position, point.time, arrival, scattering)
        })
    }

    /// Vertex where a path collided in some media at a position and time, with the unit direction in which it arrived.
    pub(crate) fn in_medium(
        arrival: &PathAtVertex<'_>,
        (position, time): (Vec3, f32),
        (travel, medium, flight): (Vec3, Arc<MediumSample>, Option<HomogeneousFlight>),
    ) -> Self {
        let scattering = Scattering::Medium { medium, travel, flight };
        Self { weight: packed(arrival.weight, position), ..Self::at(position, time, arrival, scattering) }
    }

    /// The flight of a path from a position at a time through homogeneous media, up to a length that may be infinite.
    pub(crate) fn on_flight(
        arrival: &PathAtVertex<'_>,
        (position, time): (Vec3, f32),
        (travel, media, length): (Vec3, Arc<MediumSample>, f32),
    ) -> Self {
        let scattering = Scattering::Flight { media, travel, length };
        Self { weight: packed(arrival.weight, position), ..Self::at(position, time, arrival, scattering) }
    }

    /// Vertex that scatters nothing yet.
    fn at(position: Vec3, time: f32, arrival: &PathAtVertex<'_>, scattering: Scattering) -> Self {
        let ray = arrival.path.ray_info();
        let depths =
            [ray.depth, ray.diffuse_depth, ray.glossy_depth, ray.transmission_depth, ray.transparent_depth];
        let byte = |count: u32| count.min(u32::from(u8::MAX)) as u8;
        let around = arrival.around.map(|stack| stack.media().into());
        let is_plain = around.is_none() && matches!(scattering, Scattering::Lambert);
        Self {
            position,
            weight: 0,
            geometric: 0,
            shading: 0,
            normal: 0,
            offset: 0.0,
            time,
            primitive: (0, 0),
            rare: (!is_plain).then(|| Arc::new(Rare { around, scattering })),
            receiver: arrival.receiver,
            depths: depths.map(byte),
            transparent_left: byte(arrival.transparent_left),
            bumps: BumpShadowing::default(),
            first_lobe: arrival.path.first_lobe,
            catchers_only: arrival.path.catchers_only,
        }
    }

    /// Number that lights go by ([`relume_dump::Segment::receiver`]).
    pub fn receiver(&self) -> u16 {
        self.receiver
    }

    /// Lobe of the first scattering of its path, [`Lobe::Camera`] if that is still to come.
    pub fn first_lobe(&self) -> Lobe {
        self.first_lobe
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        let rare = self.rare.as_ref().map_or(0, |rare| {
            let scattering = match &rare.scattering {
                Scattering::Lambert => 0,
                Scattering::Surface(parts) => size_of::<SurfaceParts>() + size_of_val(&parts.closures[..]),
                Scattering::Medium { medium, flight: None, .. } => medium.bytes(),
                // Many share the sample of a medium that is the same everywhere.
                Scattering::Medium { .. } | Scattering::Flight { .. } => 0,
            };
            let around = rare.around.as_deref().map_or(0, size_of_val);
            size_of::<Rare>() + 2 * size_of::<usize>() + around + scattering
        });
        size_of::<Self>() + rare
    }

    /// True for each of [`relume_dump::Lobe::CONNECTED`] by which it scatters.
    fn lobes(&self) -> ByConnectedLobe<bool> {
        if self.medium().is_some() {
            return Lobe::CONNECTED.map(|lobe| lobe == Lobe::Volume);
        }
        let closures = self.surface().map_or(&[][..], |parts| &parts.closures);
        let has = |lobe| closures.iter().any(|closure| closure.is_connected_by(lobe));
        Lobe::CONNECTED.map(|lobe| has(lobe) || (lobe == Lobe::Diffuse && self.weight != 0))
    }

    /// True if nothing scattered the path before: light here is direct.
    pub fn is_first(&self) -> bool {
        self.depths[0] == 0
    }

    /// Bound of what it adds to the pixel of light that comes from everywhere, for the choice between vertices.
    pub(super) fn importance(&self) -> f32 {
        let mut sum = decode_rgb9e5(self.weight);
        if let Some(parts) = self.surface() {
            sum += parts.closures.iter().map(|closure| closure.albedo(parts.viewpoint.wo)).sum::<Vec3>();
        }
        if let Some(Scattering::Flight { media, length, .. }) = self.scattering() {
            sum *= media.scattered_within(*length);
        }
        sum.max_element()
    }

    /// The vertex with so many times its weight.
    pub(super) fn scaled(mut self, factor: f32) -> Self {
        self.weight = packed(decode_rgb9e5(self.weight) * factor, self.position);
        if let Some(rare) = self.rare.as_mut().map(Arc::make_mut)
            && let Scattering::Surface(parts) = &mut rare.scattering
        {
            parts.closures.iter_mut().for_each(|closure| closure.weight *= factor);
        }
        self
    }

    /// Place that a light with this middle is connected to, by a number in 0..1; nothing if there is none. Light that homogeneous
    /// media scatter counts in part at a place that the light decides, in part at the path's own collision (multiple importance
    /// sampling, balance heuristic).
    pub fn place(&self, center: Option<LightCenter>, u: f32) -> Option<VertexPlace> {
        let here = VertexPlace { position: self.position, factor: Vec3::ONE };
        let Some(center) = center else {
            let is_flight = matches!(self.scattering(), Some(Scattering::Flight { .. }));
            return (!is_flight).then_some(here);
        };
        match self.scattering() {
            Some(Scattering::Medium {
                medium,
                travel,
                flight: Some(HomogeneousFlight { distance, length }),
            }) => {
                let start = self.position - *distance * *travel;
                let lit = Equiangular::new(start, *travel, *length, center).density(*distance);
                let collided = medium.collision_density(*distance);
                Some(VertexPlace { factor: Vec3::splat(collided / (lit + collided)), ..here })
            }
            Some(Scattering::Flight { media, travel, length }) => {
                let angles = Equiangular::new(self.position, *travel, *length, center);
                let distance = angles.sample(u).clamp(0.0, *length);
                let chance = angles.density(distance) + media.collision_density(distance);
                let factor = media.scattering * media.transmittance(distance) / chance;
                let position = self.position + distance * *travel;
                (position.is_finite() && factor.is_finite()).then_some(VertexPlace { position, factor })
            }
            _ => Some(here),
        }
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

    /// Numbers of the media around it; nothing if those are the ones outside of all objects.
    pub(super) fn around(&self) -> Option<&[u32]> {
        self.rare.as_ref()?.around.as_deref()
    }

    /// Time within the shutter's interval.
    pub(super) fn time(&self) -> f32 {
        self.time
    }

    fn scattering(&self) -> Option<&Scattering> {
        self.rare.as_ref().map(|rare| &rare.scattering)
    }

    fn surface(&self) -> Option<&SurfaceParts> {
        match self.scattering()? {
            Scattering::Surface(parts) => Some(parts),
            _ => None,
        }
    }

    /// Media that it is in, and the unit direction of the path there.
    fn medium(&self) -> Option<(&MediumSample, Vec3)> {
        match self.scattering()? {
            Scattering::Medium { medium: media, travel, .. } | Scattering::Flight { media, travel, .. } => {
                Some((media, *travel))
            }
            _ => None,
        }
    }
}

/// A weight as rgb9e5, right on average: rounded by the bits of a position.
fn packed(weight: Vec3, position: Vec3) -> u32 {
    let [x, y, z] = position.to_array().map(f32::to_bits);
    encode_rgb9e5(weight, dither(x ^ z.rotate_left(16), y))
}
