//! Blender's Radial Tiling: the plane around a point in equal segments, as many as a polygon has sides, which may be a broken
//! number: the last segment is narrower then. Lines of equal distance are polygons with rounded corners.
//!
//! Within a segment the position along such a line is measured from its middle: on the straight part of a side by length, on
//! a corner by angle, with a parabola in between.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec4};

/// A polygon of apothem 1 and of as many sides as there are segments.
#[derive(Clone, Copy)]
pub struct Polygon {
    /// At least 2.
    pub sides: f32,
    /// 0 for sharp corners, 1 for a circle.
    pub roundness: f32,
    /// True if positions run from 0 to 1 in each segment, and distances from 0 in the middle; otherwise those from -1.
    pub normalize: bool,
}

/// Half of a segment with the rounding of the corner at its end. Angles are measured from the corner where not said otherwise.
#[derive(Clone, Copy)]
struct Half {
    /// From the corner to the middle of the side.
    width: f32,
    /// Place where the corner ends and the straight part begins.
    bevel: f32,
    /// Roundness of the corner.
    roundness: f32,
    /// Apothem of the side that has this distance.
    scale: f32,
}

impl Half {
    /// Part of the corner on which positions are a parabola.
    fn spline(&self) -> f32 {
        (1.0 - self.roundness) * self.bevel
    }

    /// Position of the corner, where the straight part is `tangent` long and weights of the parabola are `blend`.
    fn end(&self, tangent: f32, blend: f32) -> f32 {
        self.scale * (tangent + self.spline() * blend + self.roundness * self.bevel)
    }

    /// Position of the corner on the polygon of a distance from the middle.
    fn end_at(&self, distance: f32) -> f32 {
        self.end(distance * (self.width - self.bevel).tan(), 0.5 * distance + 0.5)
    }

    /// Position of the corner on the polygon itself.
    fn end_of_unit(&self) -> f32 {
        (self.width - self.bevel).tan()
            + self.scale * (self.spline() * (0.5 / self.scale + 0.5) + self.roundness * self.bevel)
    }

    /// Distance, position and that of the corner of a point on the straight part.
    fn straight(&self, length: f32, angle: f32) -> [f32; 3] {
        let to_middle = (self.width - angle).abs();
        let distance = length * to_middle.cos();
        [self.scale * distance, self.scale * distance * to_middle.tan(), self.end_at(distance)]
    }

    /// Distance, position and that of the corner of a point on the corner; `distance` tells its line of equal distance.
    fn rounded(&self, length: f32, angle: f32, distance: f32) -> [f32; 3] {
        let (sine, cosine) = (self.width - self.bevel).sin_cos();
        let (along, spline) = (length * cosine, self.spline());
        let past = self.bevel - angle;
        let curve = if past < spline {
            along * past + 0.5 * (1.0 - along) * past * past / spline
        } else {
            spline * (0.5 * along - 0.5) + past
        };
        let position = self.scale * (length * sine + curve);
        let by_length = self.end(length * sine, 0.5 * along + 0.5);
        let straight = self.end_at(distance);
        let end = straight + (by_length - straight) * (past / self.bevel);
        [self.scale * distance, position, end]
    }
}

/// A circle that rounds a corner.
struct Circle {
    center: Vec2,
    radius: f32,
}

impl Circle {
    /// Place where a ray from the middle of the polygon leaves it.
    fn reach(&self, angle: f32) -> f32 {
        let along = self.center.dot(Vec2::from_angle(angle));
        let half = along * along + self.radius * self.radius - self.center.length_squared();
        along + half.sqrt()
    }
}

/// Outputs of the node for a point.
struct Found {
    distance: f32,
    position: f32,
    /// Position of the corner.
    end: f32,
    width: f32,
    /// Direction of the middle of the segment.
    rotation: f32,
}

impl Polygon {
    /// Position along its segment, distance, nothing, and number of the segment.
    pub fn coordinates(&self, at: Vec2) -> Vec4 {
        let found = self.locate(at);
        let number = (self.sides * (at.y.atan2(at.x) / TAU + f32::from(at.y < 0.0))).floor();
        let is_middle = at == Vec2::ZERO;
        let position = if is_middle { 0.0 } else { found.position };
        if !self.normalize {
            return Vec4::new(position, found.distance - 1.0, 0.0, number);
        }
        // Two sharp sides have no corner.
        let has_end = !is_middle && (self.sides != 2.0 || self.roundness != 0.0);
        let share = if has_end { position / found.end } else { position };
        Vec4::new(0.5 * share + 0.5, found.distance, 0.0, number)
    }

    /// Width and rotation of the segment.
    pub fn segment(&self, at: Vec2) -> Vec4 {
        let found = self.locate(at);
        let has_width = self.sides != 2.0 || self.roundness != 0.0;
        Vec4::new(if has_width { found.width } else { 0.0 }, found.rotation, 0.0, 0.0)
    }

    fn locate(&self, at: Vec2) -> Found {
        let angle = at.y.atan2(at.x) + if at.y < 0.0 { TAU } else { 0.0 };
        let width = PI / self.sides;
        let number = (angle / (2.0 * width)).floor();
        let within = angle - number * 2.0 * width;
        let side = Half { width, bevel: self.bevel(width), roundness: self.roundness, scale: 1.0 };
        let (half, [distance, position, end]) = if self.sides.fract() == 0.0 {
            (side, self.regular(side, side, at.length(), within))
        } else {
            self.with_last(side, at, angle, within)
        };
        let is_last = half.scale != 1.0;
        Found {
            distance,
            position: if within < half.width { -position } else { position },
            end,
            width: if is_last { half } else { side }.end_of_unit(),
            rotation: number * 2.0 * width + half.width,
        }
    }

    /// Angle from a corner to where the straight part of a side begins, half of which is so wide.
    fn bevel(&self, width: f32) -> f32 {
        if self.roundness == 0.0 { 0.0 } else { width - ((1.0 - self.roundness) * width.tan()).atan() }
    }

    /// A point of a segment between corners that are all the same; positions end as those of `ending`.
    fn regular(&self, side: Half, ending: Half, length: f32, within: f32) -> [f32; 3] {
        if within >= side.bevel && within < 2.0 * side.width - side.bevel {
            let [distance, position, _] = side.straight(length, within);
            return [distance, position, ending.end_at(distance)];
        }
        let angle = if within > side.width { 2.0 * side.width - within } else { within };
        let center = Vec2::new((1.0 - self.roundness) / side.width.cos(), 0.0);
        let distance = length / Circle { center, radius: self.roundness }.reach(angle);
        side.rounded(length, angle, distance)
    }

    /// A point of a polygon whose last segment is narrower, and the half of a segment that it is in.
    fn with_last(&self, side: Half, at: Vec2, angle: f32, within: f32) -> (Half, [f32; 3]) {
        let (width, length) = (side.width, at.length());
        let last = PI - self.sides.floor() * width;
        let inner = Half {
            width: last,
            bevel: self.bevel(last),
            roundness: self.roundness,
            scale: width.cos() / last.cos(),
        };
        let radius = self.roundness * last.tan() / (0.5 * (width + last)).tan();
        let start = Vec2::from_angle(inner.bevel) / (last - inner.bevel).cos();
        let center = Vec2::new(start.x - radius * last.cos(), radius * last.sin() - start.y);
        let outer_start = center + radius * Vec2::from_angle(width);
        let bevel = (outer_start.y / outer_start.x).atan();
        let roundness = 1.0 - (width - bevel).tan() / width.tan();
        let outer = Half { width, bevel, roundness, scale: 1.0 };
        let last_start = TAU - 2.0 * last;
        if angle >= bevel && angle < last_start - bevel {
            let is_beside = angle >= last_start - width || angle < width;
            let is_straight = angle >= last_start - side.bevel || angle < side.bevel;
            if is_straight {
                return (outer, outer.straight(length, within));
            }
            return (side, self.regular(side, if is_beside { outer } else { side }, length, within));
        }
        if angle >= last_start + inner.bevel && angle < TAU - inner.bevel {
            return (inner, inner.straight(length, within));
        }
        // Mirrored about the middle of the last segment, so that both of its corners are the one at 0.
        let from_axis = at.y.atan2(at.x);
        let is_first = !(angle >= last_start - bevel && angle < TAU - last);
        let mirrored = if is_first { from_axis } else { -(from_axis + 2.0 * last) };
        let distance = length / Circle { center, radius }.reach(mirrored);
        if mirrored < 0.0 {
            (inner, inner.rounded(length, -mirrored, distance))
        } else {
            (outer, outer.rounded(length, mirrored, inner.scale * distance))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(sides: f32, roundness: f32, normalize: bool) -> Polygon {
        Polygon { sides, roundness, normalize }
    }

    #[test]
    fn distances_are_those_of_polygons_and_circles() {
        let square = polygon(4.0, 0.0, false);
        // The first side is seen from the middle at 45 degrees.
        let found = square.coordinates(Vec2::from_angle(PI / 4.0) * 1.5);
        assert!((found - Vec4::new(0.0, 0.5, 0.0, 0.0)).length() < 1e-5, "{found}");
        let corner = square.coordinates(Vec2::new(0.0, 2.0_f32.sqrt()) * 0.999);
        assert!((corner.y + 0.001).abs() < 1e-4, "{corner}");
        // Two sharp sides are the halves of the plane.
        let half = polygon(2.0, 0.0, false).coordinates(Vec2::new(0.3, -1.5));
        assert!((half - Vec4::new(0.3, 0.5, 0.0, 1.0)).length() < 1e-5, "{half}");
        for turn in 0..50 {
            let at = Vec2::from_angle(turn as f32) * 1.3;
            assert!((polygon(5.0, 1.0, false).coordinates(at).y - 0.3).abs() < 1e-5);
        }
    }

    #[test]
    fn nothing_jumps_within_a_segment() {
        for sides in [2.5, 3.0, 4.0, 5.3, 6.9] {
            for roundness in [0.0, 0.3, 0.8, 1.0] {
                for normalize in [false, true] {
                    let polygon = polygon(sides, roundness, normalize);
                    let of =
                        |step: i32| polygon.coordinates(Vec2::from_angle(step as f32 * TAU / 20_000.0) * 0.7);
                    let jumps = (1..20_000).filter(|&step| {
                        let (before, after) = (of(step - 1), of(step));
                        before.w == after.w && (before - after).length() > 0.01
                    });
                    assert_eq!(jumps.count(), 0, "{sides} {roundness} {normalize}");
                }
            }
        }
    }
}
