//! Soft lights: what is computed once per light.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat3, Vec3};
use relume_scene::{Light, LightShape};

use crate::light::{Ball, LocalCone, Plane, PreparedLight, Profile, Reach, Spread};
use crate::{Gather, GatherError};

/// Smoothing of angles at softness 1, radians.
const WIDEST_ANGLE: f32 = 1.0;
/// Cosine up to which the front of an area light fades in, for softness 1.
const WIDEST_FADE: f32 = 0.5;

/// A light of radiance 1, smoothed.
#[derive(Debug)]
pub struct SoftLight {
    /// The light as it is: factors and receivers.
    pub exact: PreparedLight,
    pub profile: SoftProfile,
    /// Holds all that the smoothed light touches.
    pub reach: Reach,
}

/// Geometry and emission profile.
#[derive(Clone, Copy, Debug)]
pub enum SoftProfile {
    Sphere(SoftBall),
    FacingDisk(SoftBall),
    Spot { ball: SoftBall, cone: SoftCone, soft_falloff: bool },
    Area(SoftPlane),
    Sun(SoftSun),
}

/// Enlargement of a length to `hypot(length, width)`, so that nothing is sharper than the width.
#[derive(Clone, Copy, Debug)]
pub struct Enlarged {
    pub length: f32,
    pub inverse: f32,
    /// `(original / enlarged)^2`.
    pub share: f32,
    /// Half of the width of the soft edge, as a share of the enlarged length.
    pub edge: f32,
    /// False below the radius floor, where the size only scales the light.
    pub is_free: bool,
}

/// A ball or facing disk.
#[derive(Clone, Copy, Debug)]
pub struct SoftBall {
    pub center: Vec3,
    pub radius: f32,
    pub width: f32,
    pub enlarged: Enlarged,
}

/// The cone of a spot, in `y = 1 - cos(angle to the axis)`, which is proportional to the solid angle.
#[derive(Clone, Copy, Debug)]
pub struct SoftCone {
    pub axis: Vec3,
    /// `y` in the middle of the edge, enlarged.
    pub inverse_middle: f32,
    /// Original / enlarged middle.
    pub share: f32,
    /// Half of the edge as a share of the enlarged middle.
    pub edge: f32,
    pub by_angle: ConeSlope,
    pub by_blend: ConeSlope,
}

/// Derivatives of a cone's middle (over the enlarged one), share and edge.
#[derive(Clone, Copy, Debug)]
pub struct ConeSlope {
    pub middle: f32,
    pub share: f32,
    pub edge: f32,
}

/// A rectangle or ellipse.
#[derive(Clone, Copy, Debug)]
pub struct SoftPlane {
    pub center: Vec3,
    pub normal: Vec3,
    /// Directions of the edges; of those that are not perpendicular, the directions across the other one.
    pub along: [Vec3; 2],
    /// Half edges.
    pub half: [Enlarged; 2],
    pub is_ellipse: bool,
    pub width: f32,
    /// Cosine up to which the front fades in.
    pub fade: f32,
    pub spread: Option<SoftSpread>,
}

/// A spread, in `tan_half - tan(angle to the normal)`, which is proportional to its light as far as it is above 0.
#[derive(Clone, Copy, Debug)]
pub struct SoftSpread {
    pub exact: Spread,
    /// Half width of the parabola that stands for the knee at 0.
    pub knee: f32,
}

/// A disk of directions.
#[derive(Clone, Copy, Debug)]
pub struct SoftSun {
    pub direction: Vec3,
    /// Enlarged chord.
    pub enlarged: Enlarged,
    /// Derivative of the logarithm of the chord's square by that of the half angle.
    pub chord2_by_angle: f32,
}

impl SoftLight {
    /// Smooths a light by `width` metres, and by `softness` radians where angles are concerned.
    pub fn new(light: &Light, gather: &Gather, softness: f32, width: f32) -> Result<Self, GatherError> {
        let exact = gather.prepare(light)?;
        let profile = soft_profile(&light.shape, &exact.profile, softness, width, gather.radius_floor());
        Ok(Self { reach: profile.reach(), profile, exact })
    }
}

fn soft_profile(shape: &LightShape, exact: &Profile, softness: f32, width: f32, floor: f32) -> SoftProfile {
    let angle = softness * WIDEST_ANGLE;
    let soft_ball = |ball: Ball| {
        let enlarged = Enlarged::new(ball.radius, width, ball.radius > floor);
        SoftBall { center: ball.center, radius: ball.radius, width, enlarged }
    };
    match *exact {
        Profile::Sphere(ball) => SoftProfile::Sphere(soft_ball(ball)),
        Profile::FacingDisk(ball) => SoftProfile::FacingDisk(soft_ball(ball)),
        Profile::Spot { ball, axis, soft_falloff, .. } => {
            let (half_angle, blend) = match *shape {
                LightShape::Spot { half_angle, blend, .. } => (half_angle, blend),
                _ => (FRAC_PI_2, 0.0),
            };
            let cone = SoftCone::new(axis, half_angle, blend, angle);
            SoftProfile::Spot { ball: soft_ball(ball), cone, soft_falloff }
        }
        Profile::Area { plane, .. } => SoftProfile::Area(soft_plane(shape, &plane, softness, width, floor)),
        // Where its edges span it: how Cycles moves and brightens it shows less than the smoothing.
        Profile::Sheared(sheared) => {
            SoftProfile::Area(soft_plane(shape, &sheared.plane(), softness, width, floor))
        }
        // As a round one of the same mean width.
        Profile::StretchedSpot { ball, cone, soft_falloff } => {
            let (axis, half_angle, blend) = round_cone(shape, &cone);
            let cone = SoftCone::new(axis, half_angle, blend, angle);
            SoftProfile::Spot { ball: soft_ball(ball), cone, soft_falloff }
        }
        Profile::Sun { direction, chord2 } => {
            let half_angle = match *shape {
                LightShape::Sun { half_angle, .. } => half_angle,
                _ => 0.0,
            };
            let is_free = chord2 == crate::light::chord2(half_angle);
            SoftProfile::Sun(SoftSun {
                direction,
                enlarged: Enlarged::new(chord2.sqrt(), angle, is_free),
                chord2_by_angle: 2.0 * half_angle * half_angle.sin() / crate::light::chord2(half_angle),
            })
        }
    }
}

fn soft_plane(shape: &LightShape, plane: &Plane, softness: f32, width: f32, floor: f32) -> SoftPlane {
    let spread = match *shape {
        LightShape::Quad { spread, .. }
        | LightShape::Ellipse { spread, .. }
        | LightShape::Sheared { spread, .. } => spread,
        _ => std::f32::consts::PI,
    };
    SoftPlane {
        spread: SoftSpread::new(spread, softness * WIDEST_ANGLE),
        fade: softness * WIDEST_FADE,
        ..SoftPlane::new(plane, width, floor)
    }
}

/// Axis, half angle and blend of a round cone that is about as wide as that of a stretched spot.
fn round_cone(shape: &LightShape, cone: &LocalCone) -> (Vec3, f32, f32) {
    let (half_angle, blend) = match *shape {
        LightShape::StretchedSpot { half_angle, blend, .. } => (half_angle, blend),
        _ => (FRAC_PI_2, 0.0),
    };
    let Mat3 { x_axis, y_axis, z_axis } = cone.local_from_world.inverse();
    let axis = -z_axis.normalize();
    let widening = (x_axis.cross(y_axis).dot(axis).abs().sqrt() / z_axis.length()).max(f32::MIN_POSITIVE);
    let is_narrow = half_angle < 0.499 * std::f32::consts::PI;
    (axis, if is_narrow { (half_angle.tan() * widening).atan() } else { half_angle }, blend)
}

impl Enlarged {
    fn new(length: f32, width: f32, is_free: bool) -> Self {
        let enlarged = length.hypot(width);
        Self {
            length: enlarged,
            inverse: 1.0 / enlarged,
            share: (length / enlarged).powi(2),
            edge: width / enlarged,
            is_free,
        }
    }
}

impl SoftCone {
    fn new(axis: Vec3, half_angle: f32, blend: f32, angle: f32) -> Self {
        let (rim, rim_slope) = (1.0 - half_angle.cos(), half_angle.sin());
        let blend = blend.clamp(0.0, 1.0);
        let middle = (rim * (1.0 - 0.5 * blend)).max(f32::MIN_POSITIVE);
        let enlarged = middle + 0.5 * angle * angle;
        let share = middle / enlarged;
        let edge_before = blend / (2.0 - blend);
        // Of squares, as widths add up: all of it once the smoothing is all of the cone.
        let edge = (edge_before.powi(2) * share + (1.0 - share)).sqrt();
        let slope = |middle_slope: f32, edge_slope: f32| {
            let share_slope = (1.0 - share) * middle_slope / enlarged;
            let edge2_slope =
                2.0 * edge_before * edge_slope * share - (1.0 - edge_before.powi(2)) * share_slope;
            ConeSlope { middle: middle_slope / enlarged, share: share_slope, edge: 0.5 * edge2_slope / edge }
        };
        let by_angle = slope(rim_slope * (1.0 - 0.5 * blend), 0.0);
        let by_blend = slope(-0.5 * rim, 2.0 / (2.0 - blend).powi(2));
        Self { axis, inverse_middle: 1.0 / enlarged, share, edge, by_angle, by_blend }
    }
}

impl SoftSpread {
    fn new(spread: f32, angle: f32) -> Option<Self> {
        let enlarged = spread.hypot(angle);
        let exact = Spread::new(enlarged)?;
        let share = 0.5 * angle / enlarged;
        // The parabola adds this share of the power, as far as the tangent is the angle.
        let normalisation = exact.normalisation / (1.0 + share * share);
        Some(Self { exact: Spread { normalisation, ..exact }, knee: share * exact.tan_half })
    }
}

impl SoftPlane {
    fn is_sheared(&self) -> bool {
        self.along[0].dot(self.along[1]).abs() > 1e-5
    }

    fn new(plane: &Plane, width: f32, floor: f32) -> Self {
        let inverse = [plane.inverse_u, plane.inverse_v];
        let half = inverse.map(|inverse| 0.5 / inverse.length());
        Self {
            center: plane.center,
            normal: plane.normal,
            along: [0, 1].map(|axis| inverse[axis] * (2.0 * half[axis])),
            half: half.map(|half| Enlarged::new(half, width, half > floor * 1.000_01)),
            is_ellipse: plane.is_ellipse,
            width,
            fade: 0.0,
            spread: None,
        }
    }
}

impl SoftProfile {
    fn reach(&self) -> Reach {
        match self {
            Self::Sphere(ball) | Self::FacingDisk(ball) | Self::Spot { ball, .. } => {
                let rim = ball.enlarged.length * (1.0 + ball.enlarged.edge).sqrt();
                Reach::Ball(Ball { center: ball.center, radius: rim.hypot(ball.width + ball.radius) })
            }
            Self::Area(plane) if plane.is_sheared() => {
                let half = plane.half.iter().map(|half| half.length * (1.0 + half.edge)).sum::<f32>();
                let sine = plane.along[0].cross(plane.along[1]).length();
                Reach::Ball(Ball { center: plane.center, radius: half / sine + plane.width })
            }
            Self::Area(plane) => {
                let inverse = |axis: usize| {
                    plane.along[axis] * (0.5 * plane.half[axis].inverse / (1.0 + plane.half[axis].edge))
                };
                let soft = Plane {
                    center: plane.center,
                    normal: plane.normal,
                    inverse_u: inverse(0),
                    inverse_v: inverse(1),
                    is_ellipse: plane.is_ellipse,
                };
                Reach::Slab { plane: soft, ends: plane.width }
            }
            Self::Sun(sun) => Reach::Cone {
                direction: sun.direction,
                chord2: sun.enlarged.length.powi(2) * (1.0 + sun.enlarged.edge),
            },
        }
    }
}
