//! Halving of patches until their edges are short, and triangles that leave no cracks between them.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::Dicing;
use super::keys::{BuildKeyHasher, edge_key};
use super::surface::{NONE, Surface};

/// Edges may be longer than asked for by this factor, since halves would be as much shorter.
const HALVED_BEYOND: f32 = std::f32::consts::SQRT_2;

/// A part of a patch of the surface.
#[derive(Clone, Copy, Debug)]
struct Part {
    patch: u32,
    /// Vertices, in order around it.
    corners: [u32; 4],
    /// Places of its first and its third corner.
    low: Vec2,
    high: Vec2,
    /// Times that it was halved along its first side and along its second.
    halvings: [u8; 2],
}

/// A triangle on the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    pub patch: u32,
    pub corners: [u32; 3],
    /// Place of each corner on the patch.
    pub places: [Vec2; 3],
}

/// A diced surface.
#[derive(Debug, Default)]
pub(super) struct Diced {
    pub positions: Vec<Vec3>,
    /// Unit normals of vertices.
    pub normals: Vec<Vec3>,
    /// A patch of each vertex, and its place there.
    pub origins: Vec<(u32, Vec2)>,
    pub triangles: Vec<Triangle>,
}

impl Diced {
    /// Values of all corners of all triangles.
    pub fn per_corner<T>(&self, value: impl Fn(u32, Vec2) -> T) -> Vec<T> {
        let corners =
            self.triangles.iter().flat_map(|triangle| triangle.places.map(|place| (triangle.patch, place)));
        corners.map(|(patch, place)| value(patch, place)).collect()
    }
}

/// A surface that is being diced.
pub(super) struct Dicer<'a> {
    surface: &'a Surface,
    dicing: &'a Dicing,
    limit: usize,
    out: Diced,
    /// Vertices in the middle of edges that were halved.
    middles: HashMap<u64, u32, BuildKeyHasher>,
}

impl<'a> Dicer<'a> {
    /// Takes a surface, how finely it is diced, and the most triangles that may come of it.
    pub fn new(surface: &'a Surface, dicing: &'a Dicing, limit: usize) -> Self {
        Self { surface, dicing, limit, out: Diced::default(), middles: HashMap::default() }
    }

    /// Dices all patches; nothing if there would be too many triangles.
    pub fn dice(mut self) -> Option<Diced> {
        let patches = 0..self.surface.patch_count() as u32;
        let mut numbers = vec![NONE; self.surface.vertex_count()];
        let places = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let mut parts = Vec::new();
        for patch in patches {
            let corners = self.surface.patch_corners(patch);
            for (vertex, place) in corners.into_iter().zip(places) {
                if numbers[vertex as usize] == NONE {
                    numbers[vertex as usize] = self.add_vertex(patch, place);
                }
            }
            let corners = corners.map(|vertex| numbers[vertex as usize]);
            parts.push(Part { patch, corners, low: Vec2::ZERO, high: Vec2::ONE, halvings: [0; 2] });
        }
        parts.reverse();
        let mut leaves = Vec::new();
        while let Some(part) = parts.pop() {
            match self.longer_side(&part) {
                Some(side) => parts.extend(self.halved(&part, side)),
                None => leaves.push(part),
            }
            if 2 * (leaves.len() + parts.len()) > self.limit {
                return None;
            }
        }
        leaves.iter().for_each(|leaf| self.add_triangles(leaf));
        Some(self.out)
    }

    /// Side along which a part is to be halved: 0 for its first, 1 for its second, nothing if it is small enough.
    fn longer_side(&self, part: &Part) -> Option<usize> {
        let [a, b, c, d] = part.corners.map(|vertex| self.out.positions[vertex as usize]);
        let length = |a, b| self.dicing.length(a, b) / (HALVED_BEYOND * self.dicing.edge);
        let lengths = [length(a, b).max(length(d, c)), length(a, d).max(length(b, c))];
        let may = |side: usize| lengths[side] > 1.0 && part.halvings[side] + 1 < self.dicing.levels;
        match [may(0), may(1)] {
            [true, true] => Some(usize::from(lengths[1] > lengths[0])),
            [first, second] => first.then_some(0).or(second.then_some(1)),
        }
    }

    /// Both halves of a part, the first one last.
    fn halved(&mut self, part: &Part, side: usize) -> [Part; 2] {
        let [a, b, c, d] = part.corners;
        let Part { patch, low, high, mut halvings, .. } = *part;
        halvings[side] += 1;
        let middle = 0.5 * (low + high);
        let [first, second] = if side == 0 {
            let [below, above] = [
                self.middle([a, b], patch, Vec2::new(middle.x, low.y)),
                self.middle([d, c], patch, Vec2::new(middle.x, high.y)),
            ];
            [
                ([a, below, above, d], low, Vec2::new(middle.x, high.y)),
                ([below, b, c, above], Vec2::new(middle.x, low.y), high),
            ]
        } else {
            let [left, right] = [
                self.middle([a, d], patch, Vec2::new(low.x, middle.y)),
                self.middle([b, c], patch, Vec2::new(high.x, middle.y)),
            ];
            [
                ([a, b, right, left], low, Vec2::new(high.x, middle.y)),
                ([left, right, c, d], Vec2::new(low.x, middle.y), high),
            ]
        };
        [second, first].map(|(corners, low, high)| Part { patch, corners, low, high, halvings })
    }

    /// Vertex in the middle of an edge, at a place of a patch.
    fn middle(&mut self, [a, b]: [u32; 2], patch: u32, place: Vec2) -> u32 {
        let key = edge_key(a, b);
        if let Some(middle) = self.middles.get(&key) {
            return *middle;
        }
        let middle = self.add_vertex(patch, place);
        self.middles.insert(key, middle);
        middle
    }

    fn add_vertex(&mut self, patch: u32, place: Vec2) -> u32 {
        let (position, normal) = self.surface.at(patch, place);
        self.out.positions.push(position);
        self.out.normals.push(normal);
        self.out.origins.push((patch, place));
        self.out.positions.len() as u32 - 1
    }

    /// Triangles of a part that meet all vertices on its sides, which smaller neighbours may have put there.
    fn add_triangles(&mut self, part: &Part) {
        let Part { patch, corners, low, high, .. } = *part;
        let places = [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)];
        let mut around = Vec::with_capacity(8);
        for side in 0..4 {
            let next = (side + 1) % 4;
            around.push((corners[side], places[side]));
            self.add_between([corners[side], corners[next]], [places[side], places[next]], &mut around);
        }
        let mut add = |three: [(u32, Vec2); 3]| {
            let (corners, places) = (three.map(|(vertex, _)| vertex), three.map(|(_, place)| place));
            self.out.triangles.push(Triangle { patch, corners, places });
        };
        if let [a, b, c, d] = around[..] {
            add([a, b, c]);
            add([a, c, d]);
            return;
        }
        let middle = 0.5 * (low + high);
        let center = (self.add_vertex(patch, middle), middle);
        for (number, corner) in around.iter().enumerate() {
            let next = around[(number + 1) % around.len()];
            let (corners, places) = ([center.0, corner.0, next.0], [center.1, corner.1, next.1]);
            self.out.triangles.push(Triangle { patch, corners, places });
        }
    }

    /// Adds the vertices between both ends of an edge.
    fn add_between(&self, [a, b]: [u32; 2], [from, to]: [Vec2; 2], around: &mut Vec<(u32, Vec2)>) {
        if let Some(middle) = self.middles.get(&edge_key(a, b)) {
            let place = 0.5 * (from + to);
            self.add_between([a, *middle], [from, place], around);
            around.push((*middle, place));
            self.add_between([*middle, b], [place, to], around);
        }
    }
}
