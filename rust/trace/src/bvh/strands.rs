//! Strands of hair in a tree of their own, in object space.
//!
//! A span of a curve is cut into pieces with a box each. A block holds the straight axes of eight pieces: those that a
//! ray passes within their reach are found eight at a time, and only they are met exactly.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3, Vec4};
use relume_scene::{Curves, StrandShape};

use super::{
    storage::Storage,
    traverse::LocalRay,
    tree::{BvhLanes, WIDTH},
    tube,
};
use crate::strand::Span;

/// Binary logarithm of the pieces of a span: four boxes have a third of the surface of one along a diagonal.
const PIECE_BITS: u32 = 2;
/// Bits of a piece's number that count keys.
const KEY_BITS: u32 = 32 - PIECE_BITS;
/// Keys of one geometry that its pieces can count.
pub(super) const KEY_LIMIT: usize = 1 << KEY_BITS;
/// Ribbons are not met nearer to a ray's start than so many of their radii, so that they do not hide themselves. That is
/// Embree's and Cycles' factor.
const RIBBON_CLEARANCE: f32 = 2.0;
/// Roundings of a coordinate relative to the ray's start.
pub(super) const SLACK: f32 = 8.0 * f32::EPSILON;

/// Up to eight pieces of strands.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct StrandBlock {
    /// Start of the straight axis: x, y, z.
    pub start: [BvhLanes; 3],
    /// From there to its end.
    pub axis: [BvhLanes; 3],
    /// Largest distance of the piece from its straight axis; negative in empty lanes.
    pub reach: BvhLanes,
    /// Number of the span's first key, and of the piece above [`KEY_BITS`].
    ids: [u32; WIDTH],
}

impl StrandBlock {
    pub fn empty() -> Self {
        let zero = BvhLanes([0.0; WIDTH]);
        Self { start: [zero; 3], axis: [zero; 3], reach: BvhLanes([-1.0; WIDTH]), ids: [u32::MAX; WIDTH] }
    }

    pub fn set(&mut self, lane: usize, piece: &Piece) {
        let axis = piece.end - piece.start;
        for coordinate in 0..3 {
            self.start[coordinate].0[lane] = piece.start[coordinate];
            self.axis[coordinate].0[lane] = axis[coordinate];
        }
        self.reach.0[lane] = piece.reach;
        self.ids[lane] = piece.id;
    }

    /// Start, axis and reach of a lane.
    pub fn lane(&self, lane: usize) -> (Vec3, Vec3, f32) {
        let vector = |lanes: &[BvhLanes; 3]| Vec3::new(lanes[0].0[lane], lanes[1].0[lane], lanes[2].0[lane]);
        (vector(&self.start), vector(&self.axis), self.reach.0[lane])
    }
}

/// A part of a span, as the tree holds it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    id: u32,
    start: Vec3,
    end: Vec3,
    reach: f32,
    pub min: Vec3,
    pub max: Vec3,
}

/// A ray in a space whose z axis it is, with lengths as in object space.
#[derive(Clone, Copy, Debug)]
pub(super) struct StrandRay {
    pub origin: Vec3,
    /// Unit axes; z is the ray's direction.
    pub axes: [Vec3; 3],
    /// Length of the ray's direction: distances along it times this are object-space lengths.
    pub length: f32,
}

impl StrandRay {
    pub fn new(ray: &LocalRay) -> Self {
        let length = ray.direction.length();
        let z = ray.direction / length;
        let (x, y) = z.any_orthonormal_pair();
        Self { origin: ray.origin, axes: [x, y, z], length }
    }

    /// A vector in the ray's space.
    pub fn inside(&self, vector: Vec3) -> Vec3 {
        Vec3::from(self.axes.map(|axis| vector.dot(axis)))
    }

    fn span(&self, span: &Span) -> Span {
        let keys = span.keys.map(|key| self.inside(key.truncate() - self.origin).extend(key.w));
        Span { keys, ..*span }
    }
}

/// Nearest hit on a block's strands.
#[derive(Clone, Copy, Debug)]
pub(super) struct StrandHit {
    /// Distance in units of the ray's direction.
    pub t: f32,
    /// Place along the span, 0..1.
    pub u: f32,
    /// Place across a ribbon, -1..1.
    pub v: f32,
    /// First key of the span.
    pub key: u32,
}

/// Axes of all strands of one geometry.
#[derive(Debug)]
pub(super) struct StrandSet {
    /// Position and radius of each key; the sign bit of the radius marks the first key of a curve.
    keys: Storage<[f32; 4]>,
    shape: StrandShape,
}

impl StrandSet {
    pub fn new(curves: &Curves) -> Self {
        let mut keys: Vec<[f32; 4]> = curves
            .keys
            .iter()
            .zip(&curves.radii)
            .map(|(key, radius)| key.extend(radius.abs()).to_array())
            .collect();
        for &first in &curves.first_keys[..curves.curve_count()] {
            keys[first as usize][3] *= -1.0;
        }
        Self { keys: Storage::new(keys), shape: curves.shape }
    }

    /// Memory of the keys.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.keys)
    }

    /// The span that starts at a key.
    pub fn span(&self, key: usize) -> Span {
        let at = |key: usize| Vec4::from(self.keys[key]);
        let is_first = |key: usize| self.keys.get(key).is_none_or(|key| key[3].is_sign_negative());
        let (here, next) = (at(key), at(key + 1));
        let before = if is_first(key) { here } else { at(key - 1) };
        let after = if is_first(key + 2) { next } else { at(key + 2) };
        let sound = |key: Vec4| key.truncate().extend(key.w.abs());
        Span::new([before, here, next, after].map(sound), self.shape)
    }

    /// All pieces that a ray could meet.
    pub fn pieces(&self) -> Vec<Piece> {
        let is_last = |key: usize| self.keys.get(key + 1).is_none_or(|key| key[3].is_sign_negative());
        let spans = (0..self.keys.len()).filter(|key| !is_last(*key));
        spans.flat_map(|key| self.pieces_of(key)).collect()
    }

    fn pieces_of(&self, key: usize) -> impl Iterator<Item = Piece> + use<> {
        let span = self.span(key);
        let count = self.piece_count();
        (0..count).filter_map(move |number| {
            let [from, to] = [number, number + 1].map(|step| step as f32 / count as f32);
            let hull = span.hull(from, to);
            let [start, end] = [hull[0], hull[3]].map(Vec4::truncate);
            let axis = end - start;
            let reach = hull.iter().map(|point| {
                let along =
                    (point.truncate() - start).dot(axis) / axis.length_squared().max(f32::MIN_POSITIVE);
                point.truncate().distance(start + axis * along.clamp(0.0, 1.0)) + point.w
            });
            // A little more, for roundings here and of the boxes.
            let reach = reach.fold(0.0, f32::max) * (1.0 + 1e-4);
            let width = hull.iter().fold(0.0, |width, point| point.w.max(width));
            let points = hull.map(Vec4::truncate);
            let margin =
                width + points.iter().fold(0.0, |most, point| point.abs().max_element().max(most)) * SLACK;
            let (min, max) = points.iter().fold((start, start), |(min, max), p| (min.min(*p), max.max(*p)));
            let id = key as u32 | number << KEY_BITS;
            (width > 0.0).then_some(Piece { id, start, end, reach, min: min - margin, max: max + margin })
        })
    }

    fn piece_count(&self) -> u32 {
        match self.shape {
            StrandShape::Ribbon { subdivisions } => 1 << u32::from(subdivisions).min(PIECE_BITS),
            StrandShape::Round | StrandShape::Linear => 1 << PIECE_BITS,
        }
    }

    /// Nearest hit between the distances on the lanes `mask` of a block; `from` is the first key of the span that the
    /// ray leaves, or none.
    #[inline(never)]
    pub fn hit(
        &self,
        block: &StrandBlock,
        mut mask: u32,
        ray: &StrandRay,
        (t_min, t_max): (f32, f32),
        from: u32,
    ) -> Option<StrandHit> {
        let (z_min, mut z_max) = (t_min * ray.length, t_max * ray.length);
        let mut found: Option<StrandHit> = None;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % WIDTH;
            mask &= mask - 1;
            if let Some((z, u, v)) = self.piece_hit(block.ids[lane], ray, (z_min, z_max), from) {
                z_max = z;
                let key = block.ids[lane] & (KEY_LIMIT as u32 - 1);
                found = Some(StrandHit { t: z / ray.length, u, v, key });
            }
        }
        found.filter(|hit| hit.t > t_min && hit.t < t_max)
    }

    fn piece_hit(&self, id: u32, ray: &StrandRay, reach: (f32, f32), from: u32) -> Option<(f32, f32, f32)> {
        let (key, piece) = (id & (KEY_LIMIT as u32 - 1), id >> KEY_BITS);
        let span = ray.span(&self.span(key as usize));
        match self.shape {
            StrandShape::Ribbon { subdivisions } => {
                let count = 1 << u32::from(subdivisions);
                let each = count / self.piece_count();
                ribbon(&span, piece * each..(piece + 1) * each, count, reach)
            }
            StrandShape::Round | StrandShape::Linear => {
                // First keys of neighbours differ by one, those of other curves by more.
                let (z_min, z_max) = reach;
                let clearance = if key.abs_diff(from) <= 1 { RIBBON_CLEARANCE * span.at(0.5).w } else { 0.0 };
                let reach = (z_min.max(clearance), z_max);
                let hit = if span.is_linear {
                    tube::linear(&span, reach)
                } else {
                    let [from, to] = [piece, piece + 1].map(|step| step as f32 / self.piece_count() as f32);
                    tube::round(&span, from, to, reach)
                };
                hit.map(|(z, u)| (z, u, 0.0))
            }
        }
    }

    /// Normal of a hit in object space, of any length. Ribbons face the ray.
    pub fn normal(&self, key: u32, u: f32, position: Vec3, direction: Vec3) -> Vec3 {
        match self.shape {
            StrandShape::Ribbon { .. } => -direction,
            _ => position - self.span(key as usize).at(u).truncate(),
        }
    }
}

/// Hit of the ray along z from the origin on a flat band that faces it: pieces `pieces` of `count` of a span.
fn ribbon(
    span: &Span,
    pieces: std::ops::Range<u32>,
    count: u32,
    reach: (f32, f32),
) -> Option<(f32, f32, f32)> {
    let step = 1.0 / count as f32;
    let end = |number: u32| {
        let u = number as f32 * step;
        let (at, tangent) = (span.at(u), span.tangent(u));
        let half = Vec2::new(tangent.y, -tangent.x).normalize_or_zero() * at.w;
        (at, half.extend(0.0))
    };
    let mut nearest: Option<(f32, f32, f32)> = None;
    let (mut at, mut half) = end(pieces.start);
    for number in pieces {
        let (next, next_half) = end(number + 1);
        let [a, b, c, d] = [
            at.truncate() + half,
            next.truncate() + next_half,
            next.truncate() - next_half,
            at.truncate() - half,
        ];
        if let Some((z, along, across)) = quad([a, b, c, d]) {
            let radius = at.w + (next.w - at.w) * along;
            let limit = nearest.map_or(reach.1, |nearest| nearest.0);
            if z > reach.0.max(RIBBON_CLEARANCE * radius) && z < limit {
                nearest = Some((z, (number as f32 + along) * step, 2.0 * across - 1.0));
            }
        }
        (at, half) = (next, next_half);
    }
    nearest
}

/// Height at which the z axis passes through a quad of two triangles, and how far along it and across it.
fn quad([a, b, c, d]: [Vec3; 4]) -> Option<(f32, f32, f32)> {
    if let Some((z, along, across)) = triangle(a, b, d) {
        return Some((z, along, across));
    }
    triangle(c, d, b).map(|(z, along, across)| (z, 1.0 - along, 1.0 - across))
}

/// Height at which the z axis passes through a triangle, and the weights of its second and third corner.
fn triangle(a: Vec3, b: Vec3, c: Vec3) -> Option<(f32, f32, f32)> {
    let [p, q, r] = [a, b, c].map(Vec3::truncate);
    let area = (q - p).perp_dot(r - p);
    let (second, third) = (r.perp_dot(p) / area, p.perp_dot(q) / area);
    let is_inside = second >= 0.0 && third >= 0.0 && second + third <= 1.0;
    // Of a triangle without area the weights are no numbers.
    is_inside.then_some((a.z + (b.z - a.z) * second + (c.z - a.z) * third, second, third))
}
