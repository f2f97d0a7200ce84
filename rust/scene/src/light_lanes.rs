//! Lanes that a light's shape can move along: one list for all shapes, so that derivatives by them need not know the
//! shape. Turns are rotation vectors (Sola, Deray, Atchuthan 2018, "A micro Lie theory"), sizes change by their
//! logarithm.

use crate::LightShape;
use glam::{Quat, Vec3};
use std::f32::consts::PI;

/// Number of [`lane`]s.
pub const LANES: usize = 10;

/// The lanes. A shape that lacks a lane does not move along it.
pub mod lane {
    use std::ops::Range;

    /// Centre, metres, world axes.
    pub const CENTER: Range<usize> = 0..3;
    /// Rotation vector about the centre, radians, world axes.
    pub const TURN: Range<usize> = 3..6;
    /// Natural logarithm of the sizes: radius; width and height; a sun's half angle.
    pub const SIZE: Range<usize> = 6..8;
    /// Half angle of a spot's cone, radians.
    pub const CONE: usize = 8;
    /// Blend of a spot's cone.
    pub const BLEND: usize = 9;
}

impl LightShape {
    /// True if the shape has a lane.
    pub fn has_lane(&self, number: usize) -> bool {
        let is_sun = matches!(self, Self::Sun { .. });
        let is_ball = matches!(self, Self::Sphere { .. } | Self::FacingDisk { .. });
        let is_flat = matches!(self, Self::Quad { .. } | Self::Ellipse { .. } | Self::Sheared { .. });
        // Turned, it would be sheared otherwise than its object can be.
        let is_stiff = matches!(self, Self::Sheared { .. } | Self::StretchedSpot { .. });
        match number {
            0..3 => !is_sun,
            3..6 => !(is_ball || is_stiff),
            6 => true,
            7 => is_flat,
            _ => number < LANES && matches!(self, Self::Spot { .. }),
        }
    }

    /// The shape after a step along the lanes, the turn by the rotation whose vector is given.
    pub fn moved(&self, step: &[f32; LANES]) -> Self {
        let by = Vec3::from_slice(&step[lane::CENTER]);
        let turn = Quat::from_scaled_axis(Vec3::from_slice(&step[lane::TURN]));
        let [wider, higher] = [step[6].exp(), step[7].exp()];
        match *self {
            Self::Sphere { center, radius } => Self::Sphere { center: center + by, radius: radius * wider },
            Self::FacingDisk { center, radius } => {
                Self::FacingDisk { center: center + by, radius: radius * wider }
            }
            Self::Spot { center, radius, axis, half_angle, blend, soft_falloff } => Self::Spot {
                center: center + by,
                radius: radius * wider,
                axis: turn * axis,
                half_angle: half_angle + step[lane::CONE],
                blend: blend + step[lane::BLEND],
                soft_falloff,
            },
            Self::Quad { center, edge_u, edge_v, spread } => Self::Quad {
                center: center + by,
                edge_u: turn * edge_u * wider,
                edge_v: turn * edge_v * higher,
                spread,
            },
            Self::Ellipse { center, edge_u, edge_v, spread } => Self::Ellipse {
                center: center + by,
                edge_u: turn * edge_u * wider,
                edge_v: turn * edge_v * higher,
                spread,
            },
            Self::Sheared { center, edge_u, edge_v, facing, spread, is_ellipse } => Self::Sheared {
                center: center + by,
                edge_u: edge_u * wider,
                edge_v: edge_v * higher,
                facing,
                spread,
                is_ellipse,
            },
            Self::StretchedSpot { center, radius, local_from_world, half_angle, blend, soft_falloff } => {
                Self::StretchedSpot {
                    center: center + by,
                    radius: radius * wider,
                    local_from_world,
                    half_angle,
                    blend,
                    soft_falloff,
                }
            }
            Self::Sun { direction, half_angle } => {
                Self::Sun { direction: turn * direction, half_angle: half_angle * wider }
            }
        }
    }

    /// The centre; none for suns.
    pub fn center(&self) -> Option<Vec3> {
        match *self {
            Self::Sphere { center, .. }
            | Self::FacingDisk { center, .. }
            | Self::Spot { center, .. }
            | Self::StretchedSpot { center, .. }
            | Self::Quad { center, .. }
            | Self::Ellipse { center, .. }
            | Self::Sheared { center, .. } => Some(center),
            Self::Sun { .. } => None,
        }
    }

    /// Direction that it points to, of unit length: along the axis of a spot, off the lit side of an area light,
    /// towards a sun.
    pub fn axis(&self) -> Option<Vec3> {
        match *self {
            Self::Spot { axis, .. } => axis.try_normalize(),
            Self::StretchedSpot { local_from_world, .. } => {
                (-local_from_world.inverse().z_axis).try_normalize()
            }
            Self::Sheared { facing, .. } => facing.try_normalize(),
            Self::Quad { edge_u, edge_v, .. } | Self::Ellipse { edge_u, edge_v, .. } => {
                edge_u.cross(edge_v).try_normalize()
            }
            Self::Sun { direction, .. } => direction.try_normalize(),
            Self::Sphere { .. } | Self::FacingDisk { .. } => None,
        }
    }

    /// The sizes of which [`lane::SIZE`] are the logarithms; the second is 1 where there is one only.
    pub fn sizes(&self) -> [f32; 2] {
        match *self {
            Self::Sphere { radius, .. }
            | Self::FacingDisk { radius, .. }
            | Self::Spot { radius, .. }
            | Self::StretchedSpot { radius, .. } => [radius, 1.0],
            Self::Quad { edge_u, edge_v, .. }
            | Self::Ellipse { edge_u, edge_v, .. }
            | Self::Sheared { edge_u, edge_v, .. } => [edge_u.length(), edge_v.length()],
            Self::Sun { half_angle, .. } => [half_angle, 1.0],
        }
    }

    /// Extent of a light of this shape, up to a constant of its kind: the area that is seen of it, a sun's projected
    /// solid angle. Radiance times this is Blender's power and strength, up to that constant.
    pub fn extent(&self) -> f32 {
        let [a, b] = self.sizes();
        match self {
            Self::Sphere { .. }
            | Self::FacingDisk { .. }
            | Self::Spot { .. }
            | Self::StretchedSpot { .. } => PI * a * a,
            Self::Quad { .. } | Self::Sheared { is_ellipse: false, .. } => a * b,
            Self::Ellipse { .. } | Self::Sheared { .. } => 0.25 * PI * a * b,
            Self::Sun { .. } => PI * a.sin().powi(2),
        }
    }

    /// Derivative of the logarithm of [`Self::extent`] by the two lanes of [`lane::SIZE`].
    pub fn extent_slopes(&self) -> [f32; 2] {
        match self {
            Self::Sphere { .. }
            | Self::FacingDisk { .. }
            | Self::Spot { .. }
            | Self::StretchedSpot { .. } => [2.0, 0.0],
            Self::Quad { .. } | Self::Ellipse { .. } | Self::Sheared { .. } => [1.0, 1.0],
            Self::Sun { half_angle, .. } => [2.0 * half_angle / half_angle.tan(), 0.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat3;

    use super::*;

    const SHAPES: [LightShape; 8] = [
        LightShape::Sphere { center: Vec3::X, radius: 0.3 },
        LightShape::FacingDisk { center: Vec3::X, radius: 0.3 },
        LightShape::Spot {
            center: Vec3::X,
            radius: 0.3,
            axis: Vec3::Y,
            half_angle: 0.6,
            blend: 0.2,
            soft_falloff: true,
        },
        LightShape::Quad { center: Vec3::X, edge_u: Vec3::X, edge_v: Vec3::new(0.0, 0.5, 0.0), spread: 1.0 },
        LightShape::Ellipse { center: Vec3::X, edge_u: Vec3::X, edge_v: Vec3::Z, spread: PI },
        LightShape::Sun { direction: Vec3::Z, half_angle: 0.2 },
        LightShape::Sheared {
            center: Vec3::X,
            edge_u: Vec3::X,
            edge_v: Vec3::new(0.4, 0.5, 0.0),
            facing: Vec3::Z,
            spread: 1.0,
            is_ellipse: true,
        },
        LightShape::StretchedSpot {
            center: Vec3::X,
            radius: 0.3,
            local_from_world: Mat3::from_diagonal(Vec3::new(1.0, 2.0, 1.0)),
            half_angle: 0.6,
            blend: 0.2,
            soft_falloff: true,
        },
    ];

    #[test]
    fn only_lanes_of_the_shape_move_it() {
        for shape in SHAPES {
            for number in 0..LANES {
                let mut step = [0.0; LANES];
                step[number] = 0.05;
                let mut there = shape.moved(&step);
                // A turn about its own axis leaves an axis alone, so turns are tried about both others as well.
                if lane::TURN.contains(&number) && there == shape {
                    step[lane::TURN].fill(0.05);
                    there = shape.moved(&step);
                }
                assert_eq!(there != shape, shape.has_lane(number), "{shape:?}, lane {number}");
            }
        }
    }

    #[test]
    fn steps_are_undone_by_their_opposite() {
        for shape in SHAPES {
            let step = [0.1, -0.2, 0.3, 0.4, -0.3, 0.2, 0.5, -0.5, 0.1, 0.1];
            let back = shape.moved(&step).moved(&step.map(|v| -v));
            let close = shape.center().zip(back.center()).is_none_or(|(a, b)| a.distance(b) < 1e-6);
            let [a, b] = [shape.sizes(), back.sizes()];
            assert!(close && (0..2).all(|i| (a[i] - b[i]).abs() < 1e-6), "{shape:?}: {back:?}");
        }
    }

    #[test]
    fn slopes_of_the_extent_are_its_differences() {
        for shape in SHAPES {
            for (number, slope) in lane::SIZE.zip(shape.extent_slopes()) {
                let at = |delta: f32| {
                    let mut step = [0.0; LANES];
                    step[number] = delta;
                    shape.moved(&step).extent().ln()
                };
                let difference = (at(0.01) - at(-0.01)) / 0.02;
                assert!((difference - slope).abs() < 2e-3, "{shape:?}: {difference} for {slope}");
            }
        }
    }
}
