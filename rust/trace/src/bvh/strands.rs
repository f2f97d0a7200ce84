//! Strands of hair in a tree of their own, in object space.
//!
//! A span of a curve is cut into pieces with a box each. A block holds the straight axes of eight pieces: those that a
//! ray passes within their reach are found eight at a time, and only they are met exactly.

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Mat4, Vec2, Vec3, Vec4};
use relume_scene::{Curves, StrandShape, blend};

use super::{storage::Storage, traverse::LocalRay, tree::WIDTH, tube};
use crate::strand::Span;

/// Binary logarithm of the pieces of a span. Two boxes have half of the surface of one along a diagonal; four have a third,
/// and take twice the memory.
const PIECE_BITS: u32 = 1;
/// Bits of a piece's number that count keys.
const KEY_BITS: u32 = 32 - PIECE_BITS;
/// Keys of one geometry that its pieces can count.
pub(super) const KEY_LIMIT: usize = 1 << KEY_BITS;
/// Ribbons are not met nearer to a ray's start than so many of their radii, so that they do not hide themselves. That is
/// Embree's and Cycles' factor.
const RIBBON_CLEARANCE: f32 = 2.0;
/// Roundings of a coordinate relative to the ray's start.
pub(super) const SLACK: f32 = 8.0 * f32::EPSILON;

/// Up to eight pieces of strands. They are kept on a lattice, since that only has to find those that a ray may meet.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct StrandBlock {
    /// Ends of the straight axes: x, y, z of the start and x, y, z of the end, in steps from `corner`.
    pub ends: [[u16; WIDTH]; 6],
    /// Largest distance of the piece from its straight axis, in steps; 0 in empty lanes.
    pub reach: [u16; WIDTH],
    /// Number of the span's first key, and of the piece above [`KEY_BITS`].
    ids: [u32; WIDTH],
    /// Lowest corner of the lattice.
    pub corner: [f32; 3],
    /// Distance of its points.
    pub step: f32,
}

/// Points along an edge of the lattice of a block.
const LATTICE: f32 = 65_500.0;
/// Steps by which reaches grow, for roundings to the lattice and of coordinates on it.
const LATTICE_SLACK: f32 = 2.0;

impl StrandBlock {
    pub fn new<'a>(pieces: impl Iterator<Item = &'a Piece> + Clone) -> Self {
        let ends = pieces.clone().flat_map(|piece| [piece.start, piece.end]);
        let corner = ends.clone().fold(Vec3::INFINITY, Vec3::min);
        let widest = (ends.fold(Vec3::NEG_INFINITY, Vec3::max) - corner).max_element();
        let step = pieces.clone().fold(widest, |widest, piece| widest.max(piece.reach)) / LATTICE;
        let (corner, step) = (corner.to_array(), step.max(f32::MIN_POSITIVE));
        let empty = [0; WIDTH];
        let mut block = Self { ends: [empty; 6], reach: empty, ids: [u32::MAX; WIDTH], corner, step };
        for (lane, piece) in pieces.enumerate() {
            let steps = [piece.start, piece.end].map(|end| ((end - Vec3::from(corner)) / step).to_array());
            for (coordinates, steps) in block.ends.iter_mut().zip(steps.as_flattened()) {
                coordinates[lane] = steps.round() as u16;
            }
            block.reach[lane] = (piece.reach / step + LATTICE_SLACK).ceil() as u16;
            block.ids[lane] = piece.id;
        }
        block
    }

    /// Start, end and reach of a lane.
    pub fn lane(&self, lane: usize) -> (Vec3, Vec3, f32) {
        let [x, y, z, end_x, end_y, end_z] =
            self.ends.map(|coordinates| f32::from(coordinates[lane]) * self.step);
        let corner = Vec3::from(self.corner);
        let reach = f32::from(self.reach[lane]) * self.step;
        (corner + Vec3::new(x, y, z), corner + Vec3::new(end_x, end_y, end_z), reach)
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
    /// Turns vectors into the ray's space and leaves their fourth coordinate.
    turn: Mat4,
    /// Length of the ray's direction: distances along it times this are object-space lengths.
    pub length: f32,
}

impl StrandRay {
    pub fn new(ray: &LocalRay) -> Self {
        let length = ray.direction.length();
        let z = ray.direction / length;
        let (x, y) = z.any_orthonormal_pair();
        let turn = Mat4::from_mat3(Mat3::from_cols(x, y, z).transpose());
        Self { origin: ray.origin, axes: [x, y, z], turn, length }
    }

    /// A vector in the ray's space.
    #[inline(always)]
    pub fn inside(&self, vector: Vec3) -> Vec3 {
        let [x, y, z] = self.axes;
        Vec3::new(vector.dot(x), vector.dot(y), vector.dot(z))
    }

    #[inline]
    fn span(&self, span: &Span) -> Span {
        let origin = self.origin.extend(0.0);
        let [a, b, c, d] = span.keys;
        let [a, b, c, d] = [a - origin, b - origin, c - origin, d - origin];
        Span { keys: [self.turn * a, self.turn * b, self.turn * c, self.turn * d], ..*span }
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
    /// The keys at the end of the time that the set is for; empty if they stand still.
    later: Storage<[f32; 4]>,
    shape: StrandShape,
}

impl StrandSet {
    pub fn new(curves: &Curves) -> Self {
        let keys = curves.keys.iter().zip(&curves.radii).map(|(key, radius)| key.extend(*radius));
        Self { keys: marked(curves, keys), later: Storage::new(Vec::new()), shape: curves.shape }
    }

    /// Strands that move from one key of their motion to the next.
    pub fn moving(curves: &Curves, key: usize) -> Self {
        let [keys, later] = [key, key + 1].map(|key| {
            let count = curves.keys.len();
            marked(curves, curves.motion[key * count..(key + 1) * count].iter().copied())
        });
        Self { keys, later, shape: curves.shape }
    }

    /// Memory of the keys.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.keys) + size_of_val(&*self.later)
    }

    /// The span that starts at a key, so far on its way.
    #[inline]
    pub fn span(&self, key: usize, share: f32) -> Span {
        if self.later.is_empty() {
            self.span_of(key, |key| self.keys[key])
        } else {
            let at = |key: usize| blend(Vec4::from(self.keys[key]), self.later[key].into(), share).to_array();
            self.span_of(key, at)
        }
    }

    #[inline(always)]
    fn span_of(&self, key: usize, at: impl Fn(usize) -> [f32; 4]) -> Span {
        let (here, next) = (at(key), at(key + 1));
        let before = if here[3].is_sign_negative() { here } else { at(key - 1) };
        let goes_on = self.keys.get(key + 2).is_some_and(|key| key[3].is_sign_positive());
        let after = if goes_on { at(key + 2) } else { next };
        let sound = |[x, y, z, radius]: [f32; 4]| Vec4::new(x, y, z, radius.abs());
        // Neither of the others is the first of its curve.
        Span::new([sound(before), sound(here), next.into(), after.into()], self.shape)
    }

    /// All pieces that a ray could meet.
    pub fn pieces(&self) -> Vec<Piece> {
        let is_last = |key: usize| self.keys.get(key + 1).is_none_or(|key| key[3].is_sign_negative());
        let spans = (0..self.keys.len()).filter(|key| !is_last(*key));
        spans.flat_map(|key| self.pieces_of(key)).collect()
    }

    fn pieces_of(&self, key: usize) -> impl Iterator<Item = Piece> + use<> {
        let spans = [0.0, 1.0].map(|share| self.span(key, share));
        // Points of the hull move straight, and so go farthest from anything convex at their ends.
        let poses = if self.later.is_empty() { 1 } else { 2 };
        let count = self.piece_count();
        (0..count).filter_map(move |number| {
            let [from, to] = [number, number + 1].map(|step| step as f32 / count as f32);
            let hulls = spans.map(|span| span.hull(from, to));
            let hull = hulls[..poses].as_flattened();
            let [start, end] = [0, 3].map(|point| match poses {
                1 => hulls[0][point].truncate(),
                _ => 0.5 * (hulls[0][point] + hulls[1][point]).truncate(),
            });
            let axis = end - start;
            let reach = hull.iter().map(|point| {
                let along =
                    (point.truncate() - start).dot(axis) / axis.length_squared().max(f32::MIN_POSITIVE);
                point.truncate().distance(start + axis * along.clamp(0.0, 1.0)) + point.w
            });
            // A little more, for roundings here and of the boxes.
            let reach = reach.fold(0.0, f32::max) * (1.0 + 1e-4);
            let width = hull.iter().fold(0.0, |width, point| point.w.max(width));
            let points = hull.iter().map(|point| point.truncate());
            let margin =
                width + points.clone().fold(0.0, |most, point| point.abs().max_element().max(most)) * SLACK;
            let (min, max) = points.fold((start, start), |(min, max), p| (min.min(p), max.max(p)));
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

    /// Nearest hit between the distances on the lanes `mask` of a block of strands so far on their way; `from` is the first
    /// key of the span that the ray leaves, or none.
    #[inline(never)]
    pub fn hit(
        &self,
        block: &StrandBlock,
        mut mask: u32,
        ray: &StrandRay,
        (t_min, t_max): (f32, f32),
        from: u32,
        share: f32,
    ) -> Option<StrandHit> {
        let (z_min, mut z_max) = (t_min * ray.length, t_max * ray.length);
        let mut found: Option<StrandHit> = None;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % WIDTH;
            mask &= mask - 1;
            if let Some((z, u, v)) = self.piece_hit(block.ids[lane], ray, (z_min, z_max), from, share) {
                z_max = z;
                let key = block.ids[lane] & (KEY_LIMIT as u32 - 1);
                found = Some(StrandHit { t: z / ray.length, u, v, key });
            }
        }
        found.filter(|hit| hit.t > t_min && hit.t < t_max)
    }

    fn piece_hit(
        &self,
        id: u32,
        ray: &StrandRay,
        reach: (f32, f32),
        from: u32,
        share: f32,
    ) -> Option<(f32, f32, f32)> {
        let (key, piece) = (id & (KEY_LIMIT as u32 - 1), id >> KEY_BITS);
        let span = ray.span(&self.span(key as usize, share));
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
    pub fn normal(&self, key: u32, [u, share]: [f32; 2], position: Vec3, direction: Vec3) -> Vec3 {
        match self.shape {
            StrandShape::Ribbon { .. } => -direction,
            _ => position - self.span(key as usize, share).at(u).truncate(),
        }
    }
}

/// Keys with the first one of each curve marked.
fn marked(curves: &Curves, keys: impl Iterator<Item = Vec4>) -> Storage<[f32; 4]> {
    let mut keys: Vec<[f32; 4]> = keys.map(|key| key.with_w(key.w.abs()).to_array()).collect();
    for &first in &curves.first_keys[..curves.curve_count()] {
        keys[first as usize][3] *= -1.0;
    }
    Storage::new(keys)
}

/// Hit of the ray along z from the origin on a flat band that faces it: pieces `pieces` of `count` of a span.
fn ribbon(
    span: &Span,
    pieces: std::ops::Range<u32>,
    count: u32,
    reach: (f32, f32),
) -> Option<(f32, f32, f32)> {
    let (axis, step) = (span.axis(), 1.0 / count as f32);
    let end = |number: u32| {
        let u = number as f32 * step;
        let (at, tangent) = (axis.at(u), span.tangent_of(axis.derivative(u)));
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
    let (p, q, r) = (a.truncate(), b.truncate(), c.truncate());
    let area = (q - p).perp_dot(r - p);
    let (second, third) = (r.perp_dot(p), p.perp_dot(q));
    // Most rays pass outside and need no division.
    if second * area < 0.0 || third * area < 0.0 {
        return None;
    }
    let (second, third) = (second / area, third / area);
    let is_inside = second >= 0.0 && third >= 0.0 && second + third <= 1.0;
    // Of a triangle without area the weights are no numbers.
    is_inside.then_some((a.z + (b.z - a.z) * second + (c.z - a.z) * third, second, third))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::Random;

    #[test]
    fn blocks_hold_their_pieces_on_their_lattice() {
        let mut random = Random(1);
        // Long and thick, long and thin, a point far from the origin.
        for (length, reach, place) in [(1.0, 0.3, 0.0), (0.5, 1e-7, 3.0), (0.0, 0.01, 50.0)] {
            let pieces: Vec<Piece> = (0..5)
                .map(|id| {
                    let start = random.point(length) + place;
                    let end = random.point(length) + place;
                    Piece { id, start, end, reach, min: start, max: end }
                })
                .collect();
            let block = StrandBlock::new(pieces.iter());
            for (lane, piece) in pieces.iter().enumerate() {
                let (start, end, held) = block.lane(lane);
                let moved = start.distance(piece.start).max(end.distance(piece.end));
                let rounding = f32::EPSILON * place;
                assert!(piece.reach + moved <= held + rounding, "{piece:?} {held}");
                assert!(held <= piece.reach + 4.0 * block.step, "{piece:?} {held}");
                assert!(block.step <= (2.0 * length + reach) / LATTICE * 1.01, "{}", block.step);
            }
            assert_eq!(block.lane(5).2, 0.0);
        }
    }
}
