//! Lights made ready for crossing tests: the exact profiles of Cycles.
//!
//! A segment goes from `origin` along `edge` (not normalised) to the next vertex; an escaped one is about [`FAR`] long. Each
//! crossing counts once, with the conditions of Cycles' ray-light intersection (`intern/cycles/kernel/light`,
//! Blender 4.2 to 5.2): a sphere that the segment starts in counts where the segment leaves it; spots, areas and facing disks are
//! one-sided; a light behind the end of the segment is not hit.

use glam::{Mat3, Vec3};
use relume_dump::{Lobe, RECEIVER_LIMIT};
use relume_scene::{Light, LightShape};

use crate::GatherError;
use crate::balance::CrossedShares;
use crate::emission_map::PreparedMap;
use crate::lobes::factor_of;
use crate::piece::RayPiece;
use crate::sheared::Sheared;

/// Length of escaped segments in metres, up to a factor of 0.57: beyond every light, and harmless in `f32`.
pub const FAR: f32 = 1e8;

/// Narrowest sun and area spread that is gathered, radians: four times the error of stored directions.
const MIN_ANGLE: f32 = 4e-4;

/// A light in the form that the kernels use. Its image is that of radiance 1.
#[derive(Clone, Debug)]
pub struct PreparedLight {
    pub(crate) profile: Profile,
    pub(crate) reach: Reach,
    /// Factors by lobe, the scale of the radius floor included; 0 beyond.
    pub(crate) factors: [f32; 8],
    /// Bit set of receivers that are lit; all if absent.
    pub(crate) receivers: Option<Box<[u64; RECEIVER_LIMIT as usize / 64]>>,
    /// Factors by direction or place.
    pub(crate) map: Option<PreparedMap>,
    /// Shares that count by crossings.
    pub(crate) crossed: CrossedShares,
    /// True area by that of the profile.
    pub(crate) area_scale: f32,
}

/// Geometry and emission profile.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Profile {
    Sphere(Ball),
    FacingDisk(Ball),
    Spot { ball: Ball, axis: Vec3, cos_half_angle: f32, inverse_blend: f32, soft_falloff: bool },
    Area { plane: Plane, spread: Option<Spread> },
    Sheared(Sheared),
    StretchedSpot { ball: Ball, cone: LocalCone, soft_falloff: bool },
    Sun { direction: Vec3, chord2: f32 },
}

/// A region that every crossing segment touches, for the fast test.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Reach {
    Ball(Ball),
    Plane(Plane),
    /// Plane whose segments count as this many metres longer at both ends.
    Slab {
        plane: Plane,
        ends: f32,
    },
    /// Every segment.
    Everywhere,
    /// Escaped segments within a chord (squared) of a direction.
    Cone {
        direction: Vec3,
        chord2: f32,
    },
}

impl Reach {
    /// Centre of the region; the origin if it is everywhere.
    #[cfg(target_arch = "x86_64")]
    pub fn center(&self) -> Vec3 {
        match self {
            Self::Ball(ball) => ball.center,
            Self::Plane(plane) | Self::Slab { plane, .. } => plane.center,
            Self::Cone { .. } | Self::Everywhere => Vec3::ZERO,
        }
    }

    /// A ball that all crossing segments touch; none if the region is everywhere.
    pub fn ball(&self) -> Option<Ball> {
        let around = |plane: &Plane, ends: f32| {
            let half_edge = |inverse: Vec3| 0.5 / inverse.length();
            let half_diagonal = half_edge(plane.inverse_u).hypot(half_edge(plane.inverse_v));
            Ball { center: plane.center, radius: half_diagonal + ends }
        };
        match self {
            Self::Ball(ball) => Some(*ball),
            Self::Plane(plane) => Some(around(plane, 0.0)),
            Self::Slab { plane, ends } => Some(around(plane, *ends)),
            Self::Cone { .. } | Self::Everywhere => None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    pub center: Vec3,
    pub radius: f32,
}

#[cfg(target_arch = "x86_64")]
impl Ball {
    /// A ball that holds some others, not the least one.
    pub fn around(balls: &[Self]) -> Self {
        let low = balls.iter().fold(Vec3::INFINITY, |low, ball| low.min(ball.center));
        let high = balls.iter().fold(Vec3::NEG_INFINITY, |high, ball| high.max(ball.center));
        let center = 0.5 * (low + high);
        let reach = |ball: &Self| ball.center.distance(center) + ball.radius;
        Self { center, radius: balls.iter().map(reach).fold(0.0, f32::max) }
    }
}

/// A rectangle or an ellipse inscribed in it, seen from the side of its normal.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    pub center: Vec3,
    pub normal: Vec3,
    /// Edges divided by their squared length: dot products with them are -1/2..1/2 inside.
    pub inverse_u: Vec3,
    pub inverse_v: Vec3,
    pub is_ellipse: bool,
}

/// The cone of a spot in the space of its object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalCone {
    pub local_from_world: Mat3,
    pub cos_half_angle: f32,
    pub inverse_blend: f32,
}

impl LocalCone {
    /// Share that the cone gives along a segment: in Cycles, by the cosine to the object's own axis in its own space.
    fn share(&self, edge: Vec3) -> f32 {
        let local = self.local_from_world * edge;
        smoothstep((local.z / local.length() - self.cos_half_angle) * self.inverse_blend)
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Spread {
    pub tan_half: f32,
    pub normalisation: f32,
}

impl PreparedLight {
    /// Prepares a light; `floor` is the smallest radius, and half of the smallest edge, that is gathered, in metres.
    /// A smaller light is gathered at that size and scaled by the ratio of areas: the same power with a wider
    /// penumbra.
    ///
    /// # Errors
    /// If a number is not finite, or a size or direction is zero.
    pub fn new(light: &Light, floor: f32) -> Result<Self, GatherError> {
        let fail = |reason| GatherError::Light { name: light.name.clone(), reason };
        let (profile, scale) = profile(&light.shape, floor).map_err(fail)?;
        let mut factors = [0.0; 8];
        for lobe in Lobe::ALL {
            let factor = factor_of(&light.lobes, lobe);
            if !factor.is_finite() {
                return Err(fail("a lobe factor is not finite"));
            }
            factors[lobe as usize] = factor * scale;
        }
        let receivers = light.receivers.as_ref().map(|set| {
            let mut bits = Box::new([0; RECEIVER_LIMIT as usize / 64]);
            for &receiver in set.receivers.iter().filter(|&&receiver| receiver < RECEIVER_LIMIT) {
                bits[usize::from(receiver / 64)] |= 1 << (receiver % 64);
            }
            bits
        });
        let map = light.map.as_ref().map(|placed| PreparedMap::new(placed, &profile)).transpose();
        Ok(Self {
            reach: profile.reach(),
            profile,
            factors,
            receivers,
            map: map.map_err(fail)?,
            crossed: CrossedShares::default(),
            area_scale: scale,
        })
    }

    /// True if a receiver is lit.
    pub(crate) fn lights(&self, receiver: u16) -> bool {
        let is_lit = |bits: &[u64]| bits[usize::from(receiver / 64)] >> (receiver % 64) & 1 != 0;
        self.receivers.as_ref().is_none_or(|bits| is_lit(&bits[..]))
    }

    /// Weight of a segment of this lobe and receiver; 0 if the light leaves it out, or for what is not a segment.
    pub(crate) fn factor(&self, flags: relume_dump::Flags) -> f32 {
        let Some(lobe) = flags.lobe() else { return 0.0 };
        // Camera rays leave no object; light linking does not concern them.
        if lobe == Lobe::Camera || self.lights(flags.receiver()) { self.factors[lobe as usize] } else { 0.0 }
    }
}

type Prepared = Result<(Profile, f32), &'static str>;

fn profile(shape: &LightShape, floor: f32) -> Prepared {
    match *shape {
        LightShape::Sphere { center, radius } => {
            let (ball, scale) = ball(center, radius, floor)?;
            Ok((Profile::Sphere(ball), scale))
        }
        LightShape::FacingDisk { center, radius } => {
            let (ball, scale) = ball(center, radius, floor)?;
            Ok((Profile::FacingDisk(ball), scale))
        }
        LightShape::Spot { center, radius, axis, half_angle, blend, soft_falloff } => {
            let (ball, scale) = ball(center, radius, floor)?;
            let axis = axis.try_normalize().ok_or("its axis is not a direction")?;
            let (cos_half_angle, inverse_blend) = cone_edge(half_angle, blend)?;
            Ok((Profile::Spot { ball, axis, cos_half_angle, inverse_blend, soft_falloff }, scale))
        }
        LightShape::StretchedSpot { center, radius, local_from_world, half_angle, blend, soft_falloff } => {
            let (ball, scale) = ball(center, radius, floor)?;
            let (cos_half_angle, inverse_blend) = cone_edge(half_angle, blend)?;
            if !local_from_world.is_finite() || local_from_world.determinant() == 0.0 {
                return Err("its space is not finite or flat");
            }
            let cone = LocalCone { local_from_world, cos_half_angle, inverse_blend };
            Ok((Profile::StretchedSpot { ball, cone, soft_falloff }, scale))
        }
        LightShape::Sheared { center, edge_u, edge_v, facing, spread, is_ellipse } => {
            let (sheared, scale) = Sheared::new(center, [edge_u, edge_v], facing, spread, is_ellipse, floor)?;
            Ok((Profile::Sheared(sheared), scale))
        }
        LightShape::Quad { center, edge_u, edge_v, spread } => {
            area(center, edge_u, edge_v, spread, false, floor)
        }
        LightShape::Ellipse { center, edge_u, edge_v, spread } => {
            area(center, edge_u, edge_v, spread, true, floor)
        }
        LightShape::Sun { direction, half_angle } => sun(direction, half_angle),
    }
}

/// Cosine of a cone's half angle, and the inverse of how far its soft edge reaches in cosines (Cycles, `scene/light.cpp`:
/// `spot_smooth`).
fn cone_edge(half_angle: f32, blend: f32) -> Result<(f32, f32), &'static str> {
    if !(half_angle.is_finite() && blend.is_finite()) {
        return Err("its cone is not finite");
    }
    let cos_half_angle = half_angle.cos();
    Ok((cos_half_angle, 1.0 / ((1.0 - cos_half_angle) * blend).max(f32::EPSILON)))
}

fn ball(center: Vec3, radius: f32, floor: f32) -> Result<(Ball, f32), &'static str> {
    if !center.is_finite() || !radius.is_finite() || radius <= 0.0 {
        return Err("its position or radius is not finite, or the radius is not above 0");
    }
    let gathered = radius.max(floor);
    Ok((Ball { center, radius: gathered }, (radius / gathered).powi(2)))
}

fn area(center: Vec3, edge_u: Vec3, edge_v: Vec3, spread: f32, is_ellipse: bool, floor: f32) -> Prepared {
    let normal = edge_u.cross(edge_v).try_normalize();
    let (Some(normal), true, true) = (normal, center.is_finite(), spread > 0.0) else {
        return Err("its position or edges are not finite, or an edge or the spread is 0");
    };
    let inverse = |edge: Vec3| {
        let (length, gathered) = (edge.length(), edge.length().max(2.0 * floor));
        (edge / length / gathered, length / gathered)
    };
    let ((inverse_u, scale_u), (inverse_v, scale_v)) = (inverse(edge_u), inverse(edge_v));
    let plane = Plane { center, normal, inverse_u, inverse_v, is_ellipse };
    Ok((Profile::Area { plane, spread: Spread::new(spread) }, scale_u * scale_v))
}

fn sun(direction: Vec3, half_angle: f32) -> Prepared {
    let direction = direction.try_normalize().ok_or("its direction is not a direction")?;
    if !(half_angle > 0.0 && half_angle.is_finite()) {
        return Err("its angle is not above 0");
    }
    let gathered = half_angle.clamp(MIN_ANGLE, std::f32::consts::PI);
    Ok((Profile::Sun { direction, chord2: chord2(gathered) }, chord2(half_angle) / chord2(gathered)))
}

/// Square of the chord 2 sin(a / 2) from its axis that holds a cone of half angle a; its solid angle is pi times that.
pub(crate) fn chord2(half_angle: f32) -> f32 {
    4.0 * (0.5 * half_angle).sin().powi(2)
}

impl Spread {
    /// Spread of a light; none for a Lambertian emitter.
    pub(crate) fn new(spread: f32) -> Option<Self> {
        if spread >= std::f32::consts::PI - 1e-4 {
            return None;
        }
        let half = f64::from(0.5 * spread.max(MIN_ANGLE));
        // tan(x) - x cancels for small x; its series is exact to 1e-8 there.
        let difference =
            if half < 1e-2 { half.powi(3) / 3.0 + half.powi(5) / 7.5 } else { half.tan() - half };
        Some(Self { tan_half: half.tan() as f32, normalisation: (1.0 / difference) as f32 })
    }

    /// The soft-box grid of Blender's D10594: the share of light that passes between slats at this angle.
    pub(crate) fn attenuation(&self, cos: f32) -> f32 {
        let tan = (1.0 - cos * cos).max(0.0).sqrt() / cos;
        ((self.tan_half - tan) * self.normalisation).max(0.0)
    }
}

impl Profile {
    fn reach(&self) -> Reach {
        match *self {
            Self::Sphere(ball)
            | Self::FacingDisk(ball)
            | Self::Spot { ball, .. }
            | Self::StretchedSpot { ball, .. } => Reach::Ball(ball),
            Self::Area { plane, .. } => Reach::Plane(plane),
            Self::Sheared(sheared) => sheared.reach(),
            Self::Sun { direction, chord2 } => Reach::Cone { direction, chord2 },
        }
    }

    /// Radiance that a piece of a ray collects: nothing of a light that the ray has crossed before.
    pub fn evaluate_piece(&self, piece: &RayPiece, escaped: bool) -> f32 {
        let RayPiece { origin, to_start, to_end } = *piece;
        if self.evaluate(origin, to_start, false) != 0.0 {
            0.0
        } else {
            self.evaluate(origin, to_end, escaped)
        }
    }

    /// Metres from where a ray begins to where it crosses the light; a sun and a sheared area have none that matters.
    pub fn distance(&self, origin: Vec3, edge: Vec3) -> f32 {
        match self {
            Self::Sphere(ball)
            | Self::Spot { ball, soft_falloff: false, .. }
            | Self::StretchedSpot { ball, soft_falloff: false, .. } => ball.sphere_distance(origin, edge),
            Self::FacingDisk(ball) | Self::Spot { ball, .. } | Self::StretchedSpot { ball, .. } => {
                let to_center = ball.center - origin;
                to_center.length_squared() * edge.length() / to_center.dot(edge)
            }
            Self::Area { plane, .. } => {
                edge.length() * (plane.center - origin).dot(plane.normal) / edge.dot(plane.normal)
            }
            Self::Sheared(_) | Self::Sun { .. } => 1.0,
        }
    }

    /// Distance likewise for a smoothed light, the same for all rays from a place.
    pub fn distance_near(&self, origin: Vec3) -> f32 {
        match self {
            Self::Sphere(ball)
            | Self::Spot { ball, soft_falloff: false, .. }
            | Self::StretchedSpot { ball, soft_falloff: false, .. } => {
                (ball.center.distance(origin) - ball.radius).abs()
            }
            Self::FacingDisk(ball) | Self::Spot { ball, .. } | Self::StretchedSpot { ball, .. } => {
                ball.center.distance(origin)
            }
            Self::Area { plane, .. } => plane.center.distance(origin),
            Self::Sheared(_) | Self::Sun { .. } => 1.0,
        }
    }

    /// Radiance that a segment collects from the light; 0 if it does not cross it.
    pub fn evaluate(&self, origin: Vec3, edge: Vec3, escaped: bool) -> f32 {
        let hit = |hit: bool| if hit { 1.0 } else { 0.0 };
        match self {
            Self::Sphere(ball) => hit(ball.sphere_is_crossed(origin, edge)),
            Self::FacingDisk(ball) => hit(ball.facing_disk_is_crossed(origin, edge)),
            Self::Spot { ball, axis, cos_half_angle, inverse_blend, soft_falloff } => {
                // Cycles evaluates the cone for the direction of the segment, not that of the light's centre.
                let cone = || smoothstep((-edge.dot(*axis) / edge.length() - cos_half_angle) * inverse_blend);
                ball.in_cone(origin, edge, *soft_falloff, cone)
            }
            Self::StretchedSpot { ball, cone, soft_falloff } => {
                ball.in_cone(origin, edge, *soft_falloff, || cone.share(edge))
            }
            Self::Sheared(sheared) => sheared.evaluate(origin, edge),
            Self::Area { plane, spread } => match plane.crossing_cosine(origin, edge) {
                Some(cos) => spread.map_or(1.0, |spread| spread.attenuation(cos / edge.length())),
                None => 0.0,
            },
            Self::Sun { direction, chord2 } => {
                hit(escaped && (edge / edge.length() - *direction).length_squared() <= *chord2)
            }
        }
    }
}

impl Ball {
    /// Normal, of any length, where a segment that crosses the sphere does so first: the way back where none does.
    pub(crate) fn normal(&self, origin: Vec3, edge: Vec3) -> Vec3 {
        let to_center = self.center - origin;
        let (radius2, along) = (self.radius * self.radius, to_center.dot(edge) / edge.length_squared());
        let perpendicular = to_center - edge * along;
        let half_chord = ((radius2 - perpendicular.length_squared()) / edge.length_squared()).max(0.0).sqrt();
        let is_outside = to_center.length_squared() > radius2;
        let normal = edge * if is_outside { -half_chord } else { half_chord } - perpendicular;
        if normal.length_squared() > 0.0 { normal } else { -edge }
    }

    /// Metres along a ray to where it enters the sphere, or leaves it if it begins inside.
    fn sphere_distance(&self, origin: Vec3, edge: Vec3) -> f32 {
        let to_center = self.center - origin;
        let direction = edge / edge.length();
        let foot = to_center.dot(direction);
        let perpendicular = to_center - direction * foot;
        let half_chord = (self.radius * self.radius - perpendicular.length_squared()).max(0.0).sqrt();
        let is_outside = to_center.length_squared() > self.radius * self.radius;
        (if is_outside { foot - half_chord } else { foot + half_chord }).max(0.0)
    }

    fn sphere_is_crossed(&self, origin: Vec3, edge: Vec3) -> bool {
        let to_center = self.center - origin;
        let (radius2, length2) = (self.radius * self.radius, edge.length_squared());
        let (distance2, along) = (to_center.length_squared(), to_center.dot(edge));
        let outside = distance2 > radius2;
        if outside && along <= 0.0 {
            return false;
        }
        // Distance of the centre from the line as a vector: squares of coordinates would cancel for small spheres.
        let perpendicular2 = (to_center - edge * (along / length2)).length_squared();
        // The NaN of a segment without length is no hit, either.
        if perpendicular2 > radius2 || perpendicular2.is_nan() {
            return false;
        }
        let (length, half_chord) = (length2.sqrt(), (radius2 - perpendicular2).sqrt());
        let foot = along / length;
        let distance = if outside { foot - half_chord } else { foot + half_chord };
        distance > 0.0 && distance < length
    }

    /// Share of a segment that is lit by a spot, whose cone gives `share` along it.
    fn in_cone(&self, origin: Vec3, edge: Vec3, is_disk: bool, share: impl FnOnce() -> f32) -> f32 {
        let crossed = match is_disk {
            true => self.facing_disk_is_crossed(origin, edge),
            // One-sided: not seen by segments that go away from the centre.
            false => edge.dot(self.center - origin) > 0.0 && self.sphere_is_crossed(origin, edge),
        };
        // Cycles leaves the cone out for points inside of a sphere, but not of a facing disk's radius.
        let inside = origin.distance_squared(self.center) <= self.radius * self.radius;
        if !crossed || (inside && !is_disk) {
            return if crossed { 1.0 } else { 0.0 };
        }
        share()
    }

    /// The disk lies through the centre, perpendicular to the line from the origin: with the centre at distance d,
    /// the segment meets its plane at the share `d^2 / (to_center . edge)` of its length.
    fn facing_disk_is_crossed(&self, origin: Vec3, edge: Vec3) -> bool {
        let to_center = self.center - origin;
        let (distance2, along) = (to_center.length_squared(), to_center.dot(edge));
        if !(along > distance2 && distance2 > 0.0) {
            return false;
        }
        (edge * (distance2 / along) - to_center).length_squared() <= self.radius * self.radius
    }
}

impl Plane {
    /// The plane with its second edge along the y axis of a space whose x axis the first edge goes along.
    pub(crate) fn along(self, local_from_world: Mat3) -> Self {
        let turned = if (local_from_world * self.inverse_v).y < 0.0 { -1.0 } else { 1.0 };
        Self { inverse_v: turned * self.inverse_v, ..self }
    }

    /// Place where the line of a segment meets the plane, in shares of the edges from the centre.
    pub(crate) fn place(&self, origin: Vec3, edge: Vec3) -> [f32; 2] {
        let to_center = self.center - origin;
        let slope = edge.dot(self.normal);
        let share = if slope == 0.0 { 0.0 } else { to_center.dot(self.normal) / slope };
        let in_plane = edge * share - to_center;
        [in_plane.dot(self.inverse_u), in_plane.dot(self.inverse_v)]
    }

    /// Cosine between the normal and the way back times the length of `edge`, if the segment crosses from the side of
    /// the normal. The kernels' fast test does these very operations, so that both agree.
    fn crossing_cosine(&self, origin: Vec3, edge: Vec3) -> Option<f32> {
        let to_center = self.center - origin;
        let (height, slope) = (to_center.dot(self.normal), edge.dot(self.normal));
        if !(slope < 0.0 && height < 0.0 && slope < height) {
            return None;
        }
        let in_plane = edge * (height / slope) - to_center;
        let (u, v) = (in_plane.dot(self.inverse_u), in_plane.dot(self.inverse_v));
        let inside = if self.is_ellipse { u * u + v * v <= 0.25 } else { u.abs() <= 0.5 && v.abs() <= 0.5 };
        inside.then_some(-slope)
    }
}

/// 0 below 0, 1 above 1, a cubic between.
fn smoothstep(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
