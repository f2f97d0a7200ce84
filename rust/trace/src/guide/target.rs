use std::f32::consts::PI;

use glam::{Mat3, Vec3};
use relume_scene::{Light, LightShape};

use super::plate::Plate;

/// Narrowest cone, as the squared sine of its half angle: below, single precision would miss it.
const NARROWEST: f32 = 1e-6;

/// Light as the guide sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct GuideTarget {
    pub place: TargetPlace,
    /// See [`brightness`].
    pub brightness: f32,
    pub beam: Beam,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum TargetPlace {
    /// Light in a ball.
    Ball { center: Vec3, radius: f32 },
    /// Light on one side of a plane, in a ball.
    Flat { center: Vec3, radius: f32, plate: Plate },
    /// Plate that is seen at another place: `apparent` takes the way to the centre to the way to where it appears.
    Sheared { center: Vec3, radius: f32, plate: Plate, apparent: Mat3 },
    /// Light in directions around one.
    Sky { direction: Vec3, sine_squared: f32 },
}

/// Directions that a light shines to.
#[derive(Clone, Copy, Debug)]
pub(super) enum Beam {
    Everywhere,
    /// Directions from the cosine to the axis on that it has at the rim of the cone.
    Cone {
        axis: Vec3,
        cos: f32,
    },
    /// To one side.
    Front {
        normal: Vec3,
    },
}

/// Region that directions to a light are drawn from.
#[derive(Clone, Copy, Debug)]
pub(super) enum Narrow {
    /// A cone of this height around the axis.
    Cone(f32),
    /// Points of a plate that is there from here, all alike.
    Plate { to_center: Vec3, plate: Plate },
}

/// A light as a point sees it.
pub(super) struct SeenLight {
    /// Direction to its middle.
    pub axis: Vec3,
    /// Squared sine of the half angle of the cone around it; 1 or more from inside of the ball that holds the light.
    pub sine_squared: f32,
    /// Solid angle over that of a hemisphere.
    pub height: f32,
    pub narrow: Narrow,
}

impl GuideTarget {
    pub fn new(light: &Light) -> Self {
        let flat = |center: Vec3, radius: f32, plate: Plate| {
            (TargetPlace::Flat { center, radius, plate }, Beam::Front { normal: plate.normal })
        };
        let (place, beam) = match light.shape {
            LightShape::Sphere { center, radius } | LightShape::FacingDisk { center, radius } => {
                (TargetPlace::Ball { center, radius }, Beam::Everywhere)
            }
            LightShape::Spot { center, radius, axis, half_angle, .. } => {
                (TargetPlace::Ball { center, radius }, Beam::Cone { axis, cos: half_angle.cos() })
            }
            LightShape::StretchedSpot { center, radius, .. } => {
                (TargetPlace::Ball { center, radius }, Beam::Everywhere)
            }
            LightShape::Sheared { center, edge_u, edge_v, is_ellipse, .. } => {
                let radius = 0.5 * (edge_u.length() + edge_v.length());
                let plate = Plate::sheared(edge_u, edge_v, is_ellipse);
                let apparent = if is_ellipse { Mat3::IDENTITY } else { apparent(edge_u, edge_v) };
                // What it faces is told by its true place.
                (TargetPlace::Sheared { center, radius, plate, apparent }, Beam::Everywhere)
            }
            LightShape::Quad { center, edge_u, edge_v, .. } => {
                let radius = 0.5 * (edge_u.length_squared() + edge_v.length_squared()).sqrt();
                flat(center, radius, Plate::new(edge_u, edge_v, false))
            }
            LightShape::Ellipse { center, edge_u, edge_v, .. } => {
                let radius = 0.5 * edge_u.length().max(edge_v.length());
                flat(center, radius, Plate::new(edge_u, edge_v, true))
            }
            LightShape::Sun { direction, half_angle } => (
                TargetPlace::Sky { direction, sine_squared: half_angle.min(0.5 * PI).sin().powi(2) },
                Beam::Everywhere,
            ),
        };
        Self { place, brightness: brightness(light), beam }
    }

    pub fn seen_from(&self, point: Vec3) -> SeenLight {
        let (to_center, radius, plate) = match self.place {
            TargetPlace::Sky { direction, sine_squared } => {
                return SeenLight::in_cone(direction, sine_squared);
            }
            TargetPlace::Ball { center, radius } => (center - point, radius, None),
            TargetPlace::Flat { center, radius, plate } => (center - point, radius, Some(plate)),
            TargetPlace::Sheared { center, radius, plate, apparent } => {
                (apparent * (center - point), radius, Some(plate))
            }
        };
        let inverse = to_center.length_recip();
        let ball = SeenLight::in_cone(to_center * inverse, (radius * inverse).powi(2));
        let Some(plate) = plate else { return ball };
        let height = plate.height(to_center).min(ball.height);
        // Single precision would miss plates that look smaller.
        let is_large = 2.0 * height > NARROWEST;
        SeenLight {
            height,
            narrow: if is_large { Narrow::Plate { to_center, plate } } else { ball.narrow },
            ..ball
        }
    }
}

impl SeenLight {
    fn in_cone(axis: Vec3, sine_squared: f32) -> Self {
        let narrow = Narrow::Cone(height(sine_squared.clamp(NARROWEST, 1.0)));
        Self { axis, sine_squared, height: height(sine_squared.min(1.0)), narrow }
    }
}

impl Beam {
    /// True if a light shines in a direction away from it.
    pub fn reaches(&self, direction: Vec3) -> bool {
        match self {
            Self::Everywhere => true,
            Self::Cone { axis, cos } => axis.dot(direction) >= *cos,
            Self::Front { normal } => normal.dot(direction) > 0.0,
        }
    }
}

/// Mean of RGB of a light's radiance; absolute for lights that take light away (their power may be negative).
pub(super) fn brightness(light: &Light) -> f32 {
    Vec3::from(light.radiance).abs().element_sum() / 3.0
}

/// Height of the cone that holds a ball, by the squared sine of its half angle: 1 - sqrt(1 - s), to the second order.
pub(super) fn height(sine_squared: f32) -> f32 {
    sine_squared * (0.5 + 0.125 * sine_squared)
}

/// Matrix from the way to the centre of a parallelogram to the way to where Cycles' sampling puts it: `M M^T` with `M =
/// (u, v, u x v)` for the unit directions of its edges, as `relume_gather` tells.
fn apparent(edge_u: Vec3, edge_v: Vec3) -> Mat3 {
    let [u, v] = [edge_u, edge_v].map(Vec3::normalize_or_zero);
    let matrix = Mat3::from_cols(u, v, u.cross(v));
    matrix * matrix.transpose()
}
