//! Axes of strands: Catmull-Rom splines (Catmull and Rom, "A Class of Local Interpolating Splines", 1974) and straight
//! lines, with the radius as fourth coordinate.

use glam::{Vec3, Vec4};
use relume_scene::StrandShape;

/// A span between two keys of a curve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    /// Position and radius at the keys before, at, after and two after the span.
    pub keys: [Vec4; 4],
    pub is_linear: bool,
}

impl Span {
    pub fn new(keys: [Vec4; 4], shape: StrandShape) -> Self {
        Self { keys, is_linear: shape == StrandShape::Linear }
    }

    /// The axis as a polynomial.
    #[inline]
    pub fn axis(&self) -> Axis {
        let [a, b, c, d] = self.keys;
        let zero = Vec4::ZERO;
        if self.is_linear {
            return Axis { powers: [b, c - b, zero, zero] };
        }
        let square = a - 2.5 * b + 2.0 * c - 0.5 * d;
        Axis { powers: [b, 0.5 * (c - a), square, 0.5 * (d - a) + 1.5 * (b - c)] }
    }

    /// Position and radius at `u` in 0..1.
    pub fn at(&self, u: f32) -> Vec4 {
        self.axis().at(u)
    }

    /// Direction along the axis at `u`, of any length; where keys coincide, that of the whole span.
    pub fn tangent(&self, u: f32) -> Vec3 {
        self.tangent_of(self.axis().derivative(u))
    }

    /// See [`Self::tangent`], from the derivative there.
    #[inline]
    pub fn tangent_of(&self, derivative: Vec4) -> Vec3 {
        let along = derivative.truncate();
        if along.length_squared() > 1e-12 * self.chord().length_squared() { along } else { self.chord() }
    }

    #[inline]
    fn chord(&self) -> Vec3 {
        (self.keys[2] - self.keys[1]).truncate()
    }

    /// Control points in the Bernstein basis of the part from `start` to `end`, whose hull holds the part.
    pub fn hull(&self, start: f32, end: f32) -> [Vec4; 4] {
        let (axis, third) = (self.axis(), (end - start) / 3.0);
        let (first, last) = (axis.at(start), axis.at(end));
        [first, first + axis.derivative(start) * third, last - axis.derivative(end) * third, last]
    }
}

/// Axis of a [`Span`] as a polynomial of the place along it, which is quick where it is asked for several places.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    /// Factors of the powers of `u`, from the constant on.
    powers: [Vec4; 4],
}

impl Axis {
    /// Position and radius at `u` in 0..1. The spline may overshoot, the radius not below 0.
    #[inline]
    pub fn at(&self, u: f32) -> Vec4 {
        let [a, b, c, d] = self.powers;
        let mut at = ((d * u + c) * u + b) * u + a;
        at.w = at.w.max(0.0);
        at
    }

    /// First derivative at `u`.
    #[inline]
    pub fn derivative(&self, u: f32) -> Vec4 {
        let [_, b, c, d] = self.powers;
        (d * (3.0 * u) + c * 2.0) * u + b
    }

    /// Second derivative at `u`.
    #[inline]
    pub fn second_derivative(&self, u: f32) -> Vec4 {
        let [_, _, c, d] = self.powers;
        d * (6.0 * u) + c * 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bent() -> Span {
        let keys = [
            Vec4::new(0.0, 0.0, 0.0, 0.1),
            Vec4::new(1.0, 0.0, 0.0, 0.2),
            Vec4::new(1.0, 2.0, 0.0, 0.3),
            Vec4::new(3.0, 2.0, 1.0, 0.1),
        ];
        Span::new(keys, StrandShape::Round)
    }

    #[test]
    fn splines_pass_through_their_keys_and_leave_them_along_their_neighbours() {
        let span = bent();
        assert!(
            (span.at(0.0) - span.keys[1]).length() < 1e-6 && (span.at(1.0) - span.keys[2]).length() < 1e-6
        );
        let axis = span.axis();
        assert!((axis.derivative(0.0) - 0.5 * (span.keys[2] - span.keys[0])).length() < 1e-6);
        assert!((axis.derivative(1.0) - 0.5 * (span.keys[3] - span.keys[1])).length() < 1e-6);
    }

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        let (span, step) = (bent().axis(), 1e-2);
        for u in [0.2, 0.5, 0.9] {
            let first = (span.at(u + step) - span.at(u - step)) / (2.0 * step);
            let second = (span.derivative(u + step) - span.derivative(u - step)) / (2.0 * step);
            assert!((first - span.derivative(u)).length() < 1e-3, "{u}");
            assert!((second - span.second_derivative(u)).length() < 1e-3, "{u}");
        }
    }

    #[test]
    fn hulls_hold_their_part() {
        let (span, hull) = (bent(), bent().hull(0.25, 0.75));
        let (min, max) = hull.iter().fold((hull[0], hull[0]), |(min, max), p| (min.min(*p), max.max(*p)));
        for step in 0..=10 {
            let at = span.at(0.25 + 0.05 * step as f32);
            assert!(at.cmpge(min - 1e-6).all() && at.cmple(max + 1e-6).all(), "{step}");
        }
    }
}
