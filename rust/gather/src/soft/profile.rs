//! Soft profiles and their derivatives, eight segments at a time. The derivation is in the documentation of
//! [`crate::soft`].
//!
//! Without closures, which would not be compiled for the instructions of the function that they are in.

use super::light::{ConeSlope, Enlarged, SoftBall, SoftCone, SoftPlane, SoftSpread, SoftSun};
use super::wide::{Wide, Wide3};
use crate::lanes::Lanes;
use crate::light::Spread;

/// Eight pieces of rays: where the rays begin, where they go, and how far along them the pieces start and end.
#[derive(Clone, Copy)]
pub struct Segments<L> {
    origin: Wide3<L>,
    direction: Wide3<L>,
    start: Wide<L>,
    end: Wide<L>,
}

impl<L: Lanes> Segments<L> {
    /// Pieces with these edges, longer than 0, so far from where their rays begin.
    #[inline(always)]
    pub fn new(origin: Wide3<L>, edge: Wide3<L>, start: Wide<L>) -> Self {
        let length = edge.dot(edge).sqrt();
        Self { origin, direction: edge * length.recip(), start, end: start + length }
    }
}

/// A cubic step from 0 to 1 as `k` goes from 0 to 1, and its derivative.
#[inline(always)]
fn step<L: Lanes>(k: Wide<L>) -> (Wide<L>, Wide<L>) {
    let k = k.clamp(0.0, 1.0);
    (k * k * (3.0 - 2.0 * k), 6.0 * k * (1.0 - k))
}

/// A step that falls from 1 to 0 about `x = 1`.
struct Rim<L> {
    value: Wide<L>,
    by_x: Wide<L>,
    by_edge: Wide<L>,
}

/// `edge` is half of the step's width.
#[inline(always)]
fn rim<L: Lanes>(x: Wide<L>, edge: f32) -> Rim<L> {
    let inside = (1.0 - x) * (0.5 / edge);
    let (value, slope) = step(inside + 0.5);
    Rim { value, by_x: slope * (-0.5 / edge), by_edge: slope * inside * (-1.0 / edge) }
}

/// Share of a shifted point that lies in front of another: a step about `distance = 0`, and its derivative.
#[inline(always)]
fn ahead<L: Lanes>(distance: Wide<L>, width: f32) -> (Wide<L>, Wide<L>) {
    let (value, slope) = step(distance * (0.5 / width) + 0.5);
    (value, slope * (0.5 / width))
}

/// Smooth indicator that a point at a distance along the rays lies on the pieces, and its derivative by the distance.
#[inline(always)]
fn between<L: Lanes>(distance: Wide<L>, segments: &Segments<L>, width: f32) -> (Wide<L>, Wide<L>) {
    let (start, end) = (ahead(distance - segments.start, width), ahead(distance - segments.end, width));
    (start.0 - end.0, start.1 - end.1)
}

/// Surface of a ball that counts.
struct Chord<L> {
    value: Wide<L>,
    by_along: Wide<L>,
    by_half: Wide<L>,
}

/// Share of the shifts along the segment by which it crosses a ball's surface: of those that put the centre between `-half`
/// (where segments that start inside leave; 0 for one-sided balls) and `half` beyond the origin, if they do not end before,
/// or between `half` and `length + half`. Of a piece, what the ray does up to its end, less what it does up to its start.
#[inline(always)]
fn crossed<L: Lanes>(
    along: Wide<L>,
    half: Wide<L>,
    segments: &Segments<L>,
    width: f32,
    two_sided: f32,
) -> Chord<L> {
    let low = -two_sided * half;
    let (from, from_by_half) = leaving(half, low, segments.start, two_sided);
    let (to, to_by_half) = leaving(half, low, segments.end, two_sided);
    let (a, a1) = ahead(along - from, width);
    let (b, b1) = ahead(along - to, width);
    let (c, c1) = ahead(along - half - segments.start, width);
    let (d, d1) = ahead(along - half - segments.end, width);
    Chord {
        value: a - b + c - d,
        by_along: a1 - b1 + c1 - d1,
        by_half: b1 * to_by_half - a1 * from_by_half - c1 + d1,
    }
}

/// How far the centre may lie beyond the origin at most so that a ray of this length does not leave the ball, and its derivative by
/// the half chord.
#[inline(always)]
fn leaving<L: Lanes>(half: Wide<L>, low: Wide<L>, length: Wide<L>, two_sided: f32) -> (Wide<L>, Wide<L>) {
    let leaving = (length - half).min(half);
    let by_leaving = (2.0 * half).select_less(length, Wide::from(1.0), Wide::from(-1.0));
    (leaving.max(low), leaving.select_less(low, Wide::from(-two_sided), by_leaving))
}

/// Half of the chord as a share of the radius: `sqrt(1 - x)`, continued beyond the rim so that its slope stays finite.
#[inline(always)]
fn half_chord<L: Lanes>(x: Wide<L>, edge: f32) -> Rim<L> {
    let inside = (1.0 - x).max(Wide::from(1e-12)).sqrt();
    let root = 0.5 / edge.sqrt();
    let outside = (1.0 + edge - x).max(Wide::from(0.0)) * root;
    let limit = Wide::from(1.0 - edge);
    Rim {
        value: x.select_less(limit, inside, outside),
        by_x: x.select_less(limit, -0.5 * inside.recip(), Wide::from(-root)),
        by_edge: x.select_less(limit, Wide::from(0.0), root - outside * (0.5 / edge)),
    }
}

/// A ball's value by the place of its centre relative to the segments.
struct Round<L> {
    /// Way from the origins to the centre.
    to_center: Wide3<L>,
    /// The part of it across the direction.
    across: Wide3<L>,
    value: Wide<L>,
    /// Derivative by the square of the length of `across`.
    by_across2: Wide<L>,
    by_along: Wide<L>,
    by_size: Wide<L>,
}

impl<L: Lanes> Round<L> {
    #[inline(always)]
    fn by_center(&self, segments: &Segments<L>) -> Wide3<L> {
        self.across * (2.0 * self.by_across2) + segments.direction * self.by_along
    }
}

struct BallPlace<L> {
    to_center: Wide3<L>,
    across: Wide3<L>,
    across2: Wide<L>,
    along: Wide<L>,
}

#[inline(always)]
fn place<L: Lanes>(ball: &SoftBall, segments: &Segments<L>) -> BallPlace<L> {
    let to_center = Wide3::from(ball.center) - segments.origin;
    let along = to_center.dot(segments.direction);
    let across = to_center - segments.direction * along;
    BallPlace { to_center, across, across2: across.dot(across), along }
}

/// A sphere; seen only by segments towards the centre if it is not two-sided (1, else 0).
#[inline(always)]
fn sphere<L: Lanes>(ball: &SoftBall, segments: &Segments<L>, two_sided: f32) -> Round<L> {
    let BallPlace { to_center, across, across2, along } = place(ball, segments);
    let Enlarged { inverse, share, edge, .. } = ball.enlarged;
    let inverse2 = inverse * inverse;
    let x = across2 * inverse2;
    let disk = rim(x, edge);
    let chord = half_chord(x, edge);
    let window = crossed(along, chord.value * ball.radius, segments, ball.width, two_sided);
    let by_chord = disk.value * window.by_half * ball.radius;
    let by_x = disk.by_x * window.value + by_chord * chord.by_x;
    let by_edge = disk.by_edge * window.value + by_chord * chord.by_edge;
    let value = share * (disk.value * window.value);
    let by_size = size_slope(&ball.enlarged, value, x * by_x * 2.0 + edge * by_edge)
        + free(&ball.enlarged) * share * (by_chord * chord.value);
    Round {
        to_center,
        across,
        value,
        by_across2: (share * inverse2) * by_x,
        by_along: share * (disk.value * window.by_along),
        by_size,
    }
}

/// A disk that faces the origin; its plane's distance is regularised where the origin is nearer than the width.
#[inline(always)]
fn facing_disk<L: Lanes>(ball: &SoftBall, segments: &Segments<L>) -> Round<L> {
    let BallPlace { to_center, across, across2, along } = place(ball, segments);
    let Enlarged { inverse, share, edge, .. } = ball.enlarged;
    let inverse2 = inverse * inverse;
    let nearness = (along * along + ball.width * ball.width).recip();
    let tilt = across2 * nearness;
    let x = across2 * (1.0 + tilt) * inverse2;
    let disk = rim(x, edge);
    let crossing = along * (1.0 + tilt);
    let (window, by_crossing) = between(crossing, segments, ball.width);
    let by_x = disk.by_x * window;
    let by_crossing = disk.value * by_crossing;
    let value = share * (disk.value * window);
    let twist = 2.0 * along * along * nearness;
    Round {
        to_center,
        across,
        value,
        by_across2: share * (by_x * (1.0 + 2.0 * tilt) * inverse2 + by_crossing * along * nearness),
        by_along: share
            * (by_crossing * (1.0 + tilt * (1.0 - twist))
                - by_x * (2.0 * inverse2) * across2 * tilt * along * nearness),
        by_size: size_slope(&ball.enlarged, value, x * by_x * 2.0 + edge * (disk.by_edge * window)),
    }
}

/// 1, or 0 where the size only scales.
fn free(enlarged: &Enlarged) -> f32 {
    f32::from(u8::from(enlarged.is_free))
}

/// Derivative of a value with the factor `share` by the logarithm of the size. `shrinking` is that of the rest by the
/// logarithm of the enlarged size, sign reversed and without the factor.
#[inline(always)]
fn size_slope<L: Lanes>(enlarged: &Enlarged, value: Wide<L>, shrinking: Wide<L>) -> Wide<L> {
    let share = enlarged.share;
    match enlarged.is_free {
        true => value * (2.0 * (1.0 - share)) - (share * share) * shrinking,
        false => 2.0 * value,
    }
}

/// Value, derivatives by the centre and by the logarithm of the radius.
#[inline(always)]
pub fn sphere_slopes<L: Lanes>(ball: &SoftBall, segments: &Segments<L>) -> [Wide<L>; 5] {
    ball_slopes(&sphere(ball, segments, 1.0), segments)
}

/// Derivatives for a facing disk; see [`sphere_slopes`].
#[inline(always)]
pub fn facing_disk_slopes<L: Lanes>(ball: &SoftBall, segments: &Segments<L>) -> [Wide<L>; 5] {
    ball_slopes(&facing_disk(ball, segments), segments)
}

#[inline(always)]
fn ball_slopes<L: Lanes>(round: &Round<L>, segments: &Segments<L>) -> [Wide<L>; 5] {
    let Wide3 { x, y, z } = round.by_center(segments);
    [round.value, x, y, z, round.by_size]
}

/// Value, derivatives by the centre, the rotation, the logarithm of the radius, the half angle and the blend.
#[inline(always)]
pub fn spot_slopes<L: Lanes>(
    ball: &SoftBall,
    cone: &SoftCone,
    soft_falloff: bool,
    segments: &Segments<L>,
) -> [Wide<L>; 10] {
    let axis = Wide3::from(cone.axis);
    let y = 1.0 + segments.direction.dot(axis);
    let x = y * cone.inverse_middle;
    let disk = rim(x, cone.edge);
    let light = cone.share * disk.value;
    let by_angle = cone_slope(cone, &cone.by_angle, x, &disk);
    let by_blend = cone_slope(cone, &cone.by_blend, x, &disk);
    let by_y = (cone.share * cone.inverse_middle) * disk.by_x;
    let (round, inside) = match soft_falloff {
        true => (facing_disk(ball, segments), None),
        false => {
            let round = sphere(ball, segments, 0.0);
            // No cone for points inside of the sphere.
            let inverse2 = 1.0 / (ball.radius * ball.radius);
            let x = round.to_center.dot(round.to_center) * inverse2;
            (round, Some((rim(x, ball.enlarged.edge), x, inverse2)))
        }
    };
    let mut by_center = round.by_center(segments);
    let mut by_size = round.by_size;
    let (mut cone_value, mut cone_share) = (light, round.value);
    if let Some((inside, x, inverse2)) = inside {
        let lifted = round.value * (1.0 - light);
        cone_value = light + (1.0 - light) * inside.value;
        cone_share = round.value * (1.0 - inside.value);
        by_center = by_center * cone_value + round.to_center * (2.0 * inverse2 * (lifted * inside.by_x));
        let by_size_inside =
            2.0 * (x * inside.by_x) + (ball.enlarged.share * ball.enlarged.edge) * inside.by_edge;
        by_size = by_size * cone_value - free(&ball.enlarged) * (lifted * by_size_inside);
    } else {
        by_center = by_center * cone_value;
        by_size = by_size * cone_value;
    }
    // y grows by the direction times the axis' change.
    let by_rotation = axis.cross(segments.direction) * (cone_share * by_y);
    let Wide3 { x, y, z } = by_center;
    let Wide3 { x: rx, y: ry, z: rz } = by_rotation;
    [round.value * cone_value, x, y, z, rx, ry, rz, by_size, cone_share * by_angle, cone_share * by_blend]
}

/// Derivative of a cone's light by what gives its slopes.
#[inline(always)]
fn cone_slope<L: Lanes>(cone: &SoftCone, by: &ConeSlope, x: Wide<L>, disk: &Rim<L>) -> Wide<L> {
    by.share * disk.value + cone.share * (by.edge * disk.by_edge - by.middle * (x * disk.by_x))
}

/// Smallest cosine that is divided by.
const GRAZING: f32 = 1e-4;

/// Value, derivatives by the centre, the rotation and the logarithms of width and height.
#[inline(always)]
pub fn area_slopes<L: Lanes>(plane: &SoftPlane, segments: &Segments<L>) -> [Wide<L>; 9] {
    let normal = Wide3::from(plane.normal);
    let (along_u, along_v) = (Wide3::from(plane.along[0]), Wide3::from(plane.along[1]));
    let to_center = Wide3::from(plane.center) - segments.origin;
    let cos = -segments.direction.dot(normal);
    let inverse_cos = cos.max(GRAZING.into()).recip();
    let distance = -to_center.dot(normal) * inverse_cos;
    let (window, by_distance) = between(distance, segments, plane.width);
    let (front, front_slope) = emission(plane, cos, inverse_cos);
    // The crossing relative to the centre, in the plane.
    let crossing = segments.direction * distance - to_center;
    let (u, v) = (crossing.dot(along_u), crossing.dot(along_v));
    let face = face(plane, u, v);

    let scale = (plane.half[0].share * plane.half[1].share).sqrt();
    let lit = scale * (window * front);
    let (by_u, by_v) = (lit * face.by_u, lit * face.by_v);
    let (direction_u, direction_v) = (segments.direction.dot(along_u), segments.direction.dot(along_v));
    // By the height of the plane over the origin, along the normal.
    let by_height =
        (by_u * direction_u + by_v * direction_v + scale * (by_distance * front * face.value)) * inverse_cos;
    let by_center = normal * -by_height - along_u * by_u - along_v * by_v;
    let by_cos = scale * (window * front_slope * face.value);
    let by_rotation = normal.cross(crossing) * by_height + normal * (by_u * v - by_v * u)
        - normal.cross(segments.direction) * by_cos;
    let value = lit * face.value;
    let by_width = edge_slope(&plane.half[0], value, lit * face.shrinking[0]);
    let by_length = edge_slope(&plane.half[1], value, lit * face.shrinking[1]);
    [
        value,
        by_center.x,
        by_center.y,
        by_center.z,
        by_rotation.x,
        by_rotation.y,
        by_rotation.z,
        by_width,
        by_length,
    ]
}

/// Derivative by the length of an edge, which scales the value once; see [`size_slope`].
#[inline(always)]
fn edge_slope<L: Lanes>(half: &Enlarged, value: Wide<L>, shrinking: Wide<L>) -> Wide<L> {
    match half.is_free {
        true => value * (1.0 - half.share) - half.share * shrinking,
        false => value,
    }
}

/// Radiance by the cosine to the normal, and its derivative: nothing from behind, fading in towards the front; the spread.
#[inline(always)]
fn emission<L: Lanes>(plane: &SoftPlane, cos: Wide<L>, inverse_cos: Wide<L>) -> (Wide<L>, Wide<L>) {
    let (front, slope) = step(cos * (1.0 / plane.fade));
    let slope = slope * (1.0 / plane.fade);
    let Some(SoftSpread { exact: Spread { tan_half, normalisation }, knee }) = plane.spread else {
        return (front, slope);
    };
    let sin = (1.0 - cos * cos).max(Wide::from(1e-12)).sqrt();
    let left = tan_half - sin * inverse_cos;
    let above = (left + knee).max(Wide::from(0.0));
    let limit = Wide::from(knee);
    let spread = left.select_less(limit, above * above * (0.25 / knee), left);
    // The tangent falls by 1 / (sin cos^2) as the cosine grows.
    let rise = sin.recip() * inverse_cos * inverse_cos;
    let spread_slope = left.select_less(limit, above * (0.5 / knee), Wide::from(1.0)) * rise;
    (normalisation * (front * spread), normalisation * (slope * spread + front * spread_slope))
}

/// Share of a face that is there at a point of its plane.
struct Face<L> {
    value: Wide<L>,
    /// Derivatives by the point, 1 / m.
    by_u: Wide<L>,
    by_v: Wide<L>,
    /// Derivatives by the logarithms of the enlarged half edges, signs reversed.
    shrinking: [Wide<L>; 2],
}

#[inline(always)]
fn face<L: Lanes>(plane: &SoftPlane, u: Wide<L>, v: Wide<L>) -> Face<L> {
    let [half_u, half_v] = &plane.half;
    let (u, v) = (u * half_u.inverse, v * half_v.inverse);
    if plane.is_ellipse {
        let edge = (half_u.edge * half_v.edge).sqrt();
        let disk = rim(u * u + v * v, edge);
        let by_edge = (0.5 * edge) * disk.by_edge;
        return Face {
            value: disk.value,
            by_u: (2.0 * half_u.inverse) * u * disk.by_x,
            by_v: (2.0 * half_v.inverse) * v * disk.by_x,
            shrinking: [2.0 * u * u * disk.by_x + by_edge, 2.0 * v * v * disk.by_x + by_edge],
        };
    }
    let (strip_u, strip_v) = (rim(u.abs(), half_u.edge), rim(v.abs(), half_v.edge));
    let (slope_u, slope_v) = (strip_u.by_x * u.signum(), strip_v.by_x * v.signum());
    Face {
        value: strip_u.value * strip_v.value,
        by_u: half_u.inverse * slope_u * strip_v.value,
        by_v: half_v.inverse * slope_v * strip_u.value,
        shrinking: [
            (slope_u * u + half_u.edge * strip_u.by_edge) * strip_v.value,
            (slope_v * v + half_v.edge * strip_v.by_edge) * strip_u.value,
        ],
    }
}

/// Value, derivatives by the rotation and the logarithm of the half angle, for segments that escape.
#[inline(always)]
pub fn sun_slopes<L: Lanes>(sun: &SoftSun, segments: &Segments<L>) -> [Wide<L>; 5] {
    let direction = Wide3::from(sun.direction);
    let Enlarged { inverse, share, edge, .. } = sun.enlarged;
    let apart = segments.direction - direction;
    let x = apart.dot(apart) * (inverse * inverse);
    let disk = rim(x, edge);
    let value = share * disk.value;
    let by_rotation = direction.cross(segments.direction) * ((-2.0 * share * inverse * inverse) * disk.by_x);
    let by_chord = size_slope(&sun.enlarged, value, 2.0 * (x * disk.by_x) + edge * disk.by_edge);
    let by_size = by_chord * (0.5 * sun.chord2_by_angle);
    [value, by_rotation.x, by_rotation.y, by_rotation.z, by_size]
}
