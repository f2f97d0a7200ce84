//! Round strands: hits of the ray along z from the origin on tubes about a span.

use glam::{Vec3, Vec4};

use crate::strand::{Axis, Span};

/// A straight part of a curved axis may leave it by this share of the radius.
const SAG: f32 = 0.02;
/// Most straight parts of a piece.
const MOST_PARTS: f32 = 8.0;
/// Two parts share what is this much of the radius about the plane between them, so that no ray slips through.
const OVERLAP: f32 = 1e-3;

/// Nearest hit between two heights on the part `from..to` of a curved tube, and where along the span. The tube is open
/// at the ends of a curve, as Embree's, and has no inside: rays that start in it leave it.
pub(super) fn round(span: &Span, from: f32, to: f32, reach: (f32, f32)) -> Option<(f32, f32)> {
    let axis = span.axis();
    let (first, middle, last) = (axis.at(from), axis.at(0.5 * (from + to)), axis.at(to));
    let sag = (middle - 0.5 * (first + last)).truncate().length();
    let radius = first.w.max(middle.w).max(last.w);
    let parts = (sag / (SAG * radius)).sqrt().clamp(1.0, MOST_PARTS).ceil();
    let mut nearest: Option<(f32, f32)> = None;
    let (mut start, mut u) = (first, from);
    for part in 1..=parts as u32 {
        let next = from + (to - from) * part as f32 / parts;
        let end = if next == to { last } else { axis.at(next) };
        if let Some((z, share)) = cone(start, end)
            && is_beyond(z, start, span.tangent_of(axis.derivative(u)))
            && is_beyond(z, end, -span.tangent_of(axis.derivative(next)))
        {
            let hit = polished(&axis, z, u + (next - u) * share);
            let limit = nearest.map_or(reach.1, |nearest| nearest.0);
            if hit.0 > reach.0 && hit.0 < limit {
                nearest = Some(hit);
            }
        }
        (start, u) = (end, next);
    }
    nearest
}

/// Nearest hit between two heights on a straight cone with spheres at its ends, and where along the span.
pub(super) fn linear(span: &Span, reach: (f32, f32)) -> Option<(f32, f32)> {
    let [before, start, end, after] = span.keys;
    let (z, share) = cone(start, end)?;
    let direction = |from: Vec4, to: Vec4| (to - from).truncate().normalize_or_zero();
    let along = direction(start, end);
    // What is beyond the planes halfway to the neighbours is theirs; the ends of the curve are round.
    let is_own = (before == start || is_beyond(z, start, along + direction(before, start)))
        && (after == end || is_beyond(z, end, -along - direction(end, after)));
    (is_own && z > reach.0 && z < reach.1).then_some((z, share.clamp(0.0, 1.0)))
}

/// True if the point at height `z` is on the side of the plane through `at` that the normal `inwards` points to.
fn is_beyond(z: f32, at: Vec4, inwards: Vec3) -> bool {
    (Vec3::Z * z - at.truncate()).dot(inwards) >= -OVERLAP * at.w * inwards.length()
}

/// Height at which the z axis enters a sphere that moves from `a` to `b` and changes its radius to that of `b`, and how far the
/// sphere is there. After Han, Wald, Usher, Wu, Wang, Pascucci, Hansen and Johnson, "Ray Tracing Generalized Tube Primitives"
/// (2019), section 3.1; in coordinates about the place where the ray passes the axis, which keeps the precision.
fn cone(a: Vec4, b: Vec4) -> Option<(f32, f32)> {
    let shift = 0.5 * (a.z + b.z);
    let to_start = Vec3::new(a.x, a.y, a.z - shift);
    let axis = (b - a).truncate();
    let narrowing = a.w - b.w;
    let length_squared = axis.length_squared();
    let side = length_squared - narrowing * narrowing;
    // The ray's start relative to `a` is `-to_start`.
    let along = -axis.dot(to_start);
    if side > 0.0 {
        let square = side - axis.z * axis.z;
        let half = -side * to_start.z - along * axis.z + axis.z * narrowing * a.w;
        let constant = side * to_start.length_squared() - along * along + 2.0 * along * narrowing * a.w
            - length_squared * a.w * a.w;
        let root = half * half - square * constant;
        if root >= 0.0 {
            let z = -(root.sqrt() + half) / square;
            let place = along - a.w * narrowing + z * axis.z;
            if place > 0.0 && place < side {
                return Some((z + shift, place / side));
            }
        }
    }
    let ends = [sphere(a).map(|z| (z, 0.0)), sphere(b).map(|z| (z, 1.0))];
    ends.into_iter().flatten().min_by(|p, q| p.0.total_cmp(&q.0))
}

/// Height at which the z axis enters a sphere.
fn sphere(at: Vec4) -> Option<f32> {
    let inside = at.w * at.w - at.x * at.x - at.y * at.y;
    (inside >= 0.0).then(|| at.z - inside.sqrt())
}

/// A hit on a straight part moved to the curved tube by Newton's method: the circle about the axis at `u` that the point
/// at height `z` is on.
fn polished(spline: &Axis, z: f32, u: f32) -> (f32, f32) {
    let (mut z_now, mut u_now) = (z, u);
    for _ in 0..3 {
        let (axis, along, bend) =
            (spline.at(u_now), spline.derivative(u_now), spline.second_derivative(u_now));
        let from_axis = Vec3::Z * z_now - axis.truncate();
        let tangent = along.truncate();
        let on_plane = from_axis.dot(tangent);
        let on_circle = from_axis.length_squared() - axis.w * axis.w;
        let by_z = [tangent.z, 2.0 * from_axis.z];
        let by_u = [
            from_axis.dot(bend.truncate()) - tangent.length_squared(),
            -2.0 * on_plane - 2.0 * axis.w * along.w,
        ];
        let determinant = by_z[0] * by_u[1] - by_u[0] * by_z[1];
        let dz = (on_circle * by_u[0] - on_plane * by_u[1]) / determinant;
        let du = (on_plane * by_z[1] - on_circle * by_z[0]) / determinant;
        // Rays that graze the tube have no root; the straight part stands for it there.
        if !(dz.abs() < axis.w && du.abs() < 0.25) {
            return (z, u);
        }
        (z_now, u_now) = (z_now + dz, u_now + du);
    }
    if (0.0..=1.0).contains(&u_now) { (z_now, u_now) } else { (z, u.clamp(0.0, 1.0)) }
}
