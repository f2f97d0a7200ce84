//! Catmull-Clark surfaces of any polygon mesh, refined where they are large, with points and normals on their limit.
//!
//! Masks of refinement, creases and limit points are those of DeRose, Kass and Truong, "Subdivision Surfaces in
//! Character Animation" (1998), and of OpenSubdiv's uniform creases.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::keys::{BuildKeyHasher, edge_key};

/// Number that stands for no face or vertex.
pub(super) const NONE: u32 = u32::MAX;
/// Sharpness from which on a crease never becomes smooth (OpenSubdiv's `SHARPNESS_INFINITE`).
const INFINITE: f32 = 10.0;

/// How the border of a mesh is subdivided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Border {
    /// A smooth curve all around.
    Smooth,
    /// A smooth curve from corner to corner: vertices of one face stay where they are.
    Corners,
    /// Straight from vertex to vertex.
    Straight,
}

/// Scheme that a surface is made by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scheme {
    CatmullClark(Border),
    /// Every face is a bilinear patch, or as many as it has corners.
    Linear,
}

/// Sharpness of edges, by key, and of vertices.
#[derive(Clone, Debug, Default)]
pub(super) struct Creases {
    pub edges: HashMap<u64, f32, BuildKeyHasher>,
    pub vertices: HashMap<u64, f32, BuildKeyHasher>,
}

/// A mesh of one level: each face of the level before became a quad at each of its corners.
#[derive(Debug)]
struct Level {
    /// First corner of each face, and the number of corners.
    starts: Vec<u32>,
    /// Vertex of each corner.
    corners: Vec<u32>,
    points: Vec<Vec3>,
    creases: Creases,
    /// Corners that each vertex is at: the first of each, and all of them.
    first_use: Vec<u32>,
    uses: Vec<(u32, u32)>,
    /// First child of each face in the next level, [`NONE`] where there is none to look at.
    first_child: Vec<u32>,
    /// Points on the limit surface; none at level 0, whose faces need not be quads.
    limits: Vec<Vec3>,
    normals: Vec<Vec3>,
}

/// A surface, refined as far as it was asked for.
#[derive(Debug)]
pub(super) struct Surface {
    scheme: Scheme,
    levels: Vec<Level>,
}

impl Surface {
    /// The surface of a mesh, refined once.
    pub fn new(
        scheme: Scheme,
        starts: Vec<u32>,
        corners: Vec<u32>,
        points: Vec<Vec3>,
        mut creases: Creases,
    ) -> Self {
        let base = Level::new(starts, corners, points, Creases::default());
        creases.sharpen_corners(&base);
        let base = Level { creases, ..base };
        let all: Vec<u32> = (0..base.face_count() as u32).collect();
        let mut surface = Self { scheme, levels: vec![base] };
        surface.refine(&all, &all);
        surface
    }

    /// Faces of level 1, each a quad.
    pub fn patch_count(&self) -> usize {
        self.levels[1].face_count()
    }

    /// Vertices of a patch, in order around it.
    pub fn patch_corners(&self, patch: u32) -> [u32; 4] {
        self.levels[1].quad(patch)
    }

    /// Vertices of level 1.
    pub fn vertex_count(&self) -> usize {
        self.levels[1].points.len()
    }

    /// Number of the deepest level.
    pub fn depth(&self) -> usize {
        self.levels.len() - 1
    }

    /// Points of all levels.
    pub fn point_count(&self) -> usize {
        self.levels.iter().map(|level| level.points.len()).sum()
    }

    /// Limit points at the corners of a face of the deepest level.
    pub fn deepest_corners(&self, face: u32) -> [Vec3; 4] {
        let level = &self.levels[self.depth()];
        level.quad(face).map(|vertex| level.limits[vertex as usize])
    }

    /// Faces of the deepest level with a vertex in common with any of some, in order of their numbers, those included.
    pub fn with_neighbours(&self, faces: &[u32]) -> Vec<u32> {
        let level = &self.levels[self.depth()];
        let mut is_near = vec![false; level.face_count()];
        for vertex in faces.iter().flat_map(|face| level.quad(*face)) {
            level.uses_of(vertex).iter().for_each(|(face, _)| is_near[*face as usize] = true);
        }
        (0..level.face_count() as u32).filter(|face| is_near[*face as usize]).collect()
    }

    /// First child of a face of the level above the deepest, if it has any.
    pub fn first_child(&self, face: u32) -> u32 {
        self.levels[self.depth() - 1].first_child[face as usize]
    }

    /// Refines some faces of the deepest level to a further one: `chosen` is `wanted` with its neighbours.
    pub fn refine(&mut self, wanted: &[u32], chosen: &[u32]) {
        let scheme = self.scheme;
        let depth = self.depth();
        let (mut next, first_children) = self.levels[depth].refined(scheme, chosen);
        next.find_limits(scheme);
        let level = &mut self.levels[depth];
        let mut is_wanted = vec![false; level.face_count()];
        wanted.iter().for_each(|face| is_wanted[*face as usize] = true);
        for (face, child) in chosen.iter().zip(first_children) {
            if is_wanted[*face as usize] {
                level.first_child[*face as usize] = child;
            }
        }
        self.levels.push(next);
    }

    /// Point and unit normal of the limit surface at a place of a patch, 0..1 from its first corner to the second, and
    /// to the fourth.
    pub fn at(&self, patch: u32, place: Vec2) -> (Vec3, Vec3) {
        let (level, quad, place) = self.leaf(patch, place);
        let normal = bilinear(quad.map(|vertex| level.normals[vertex as usize]), place);
        (bilinear(quad.map(|vertex| level.limits[vertex as usize]), place), normal.normalize_or(Vec3::Z))
    }

    /// Point of the limit surface, as [`Surface::at`].
    pub fn point(&self, patch: u32, place: Vec2) -> Vec3 {
        let (level, quad, place) = self.leaf(patch, place);
        bilinear(quad.map(|vertex| level.limits[vertex as usize]), place)
    }

    /// Smallest face around a place of a patch, and the place in it.
    fn leaf(&self, patch: u32, mut place: Vec2) -> (&Level, [u32; 4], Vec2) {
        let (mut level, mut face) = (1, patch);
        loop {
            let child = self.levels[level].first_child[face as usize];
            if child == NONE {
                return (&self.levels[level], self.levels[level].quad(face), place);
            }
            // Each child begins at its own corner, and its first side goes on around the face.
            let Vec2 { x, y } = 2.0 * place;
            let corner;
            (corner, place) = match (x < 1.0, y < 1.0) {
                (true, true) => (0, Vec2::new(x, y)),
                (false, true) => (1, Vec2::new(y, 2.0 - x)),
                (false, false) => (2, Vec2::new(2.0 - x, 2.0 - y)),
                (true, false) => (3, Vec2::new(2.0 - y, x)),
            };
            (level, face) = (level + 1, child + corner);
        }
    }
}

/// Value at a place between those of four corners in order around a quad.
pub(super) fn bilinear(corners: [Vec3; 4], place: Vec2) -> Vec3 {
    let [a, b, c, d] = corners;
    a.lerp(b, place.x).lerp(d.lerp(c, place.x), place.y)
}

/// Vertices and edges around a vertex.
#[derive(Default)]
struct Ring {
    /// Vertices across edges, and the sharpness of each edge.
    edges: Vec<(u32, f32)>,
    is_border: bool,
}

impl Level {
    fn new(starts: Vec<u32>, corners: Vec<u32>, points: Vec<Vec3>, creases: Creases) -> Self {
        let mut first_use = vec![0; points.len() + 1];
        corners.iter().for_each(|vertex| first_use[*vertex as usize + 1] += 1);
        for vertex in 0..points.len() {
            first_use[vertex + 1] += first_use[vertex];
        }
        let mut place = first_use.clone();
        let mut uses = vec![(0, 0); corners.len()];
        for face in 0..starts.len() as u32 - 1 {
            for corner in starts[face as usize]..starts[face as usize + 1] {
                let vertex = corners[corner as usize] as usize;
                uses[place[vertex] as usize] = (face, corner);
                place[vertex] += 1;
            }
        }
        let first_child = vec![NONE; starts.len() - 1];
        let (limits, normals) = (Vec::new(), Vec::new());
        Self { starts, corners, points, creases, first_use, uses, first_child, limits, normals }
    }

    fn face_count(&self) -> usize {
        self.starts.len() - 1
    }

    fn face(&self, face: u32) -> &[u32] {
        &self.corners[self.starts[face as usize] as usize..self.starts[face as usize + 1] as usize]
    }

    fn quad(&self, face: u32) -> [u32; 4] {
        let first = self.starts[face as usize] as usize;
        std::array::from_fn(|corner| self.corners[first + corner])
    }

    /// Faces and corners of a vertex.
    fn uses_of(&self, vertex: u32) -> &[(u32, u32)] {
        &self.uses[self.first_use[vertex as usize] as usize..self.first_use[vertex as usize + 1] as usize]
    }

    /// Vertices after and before a corner of a face.
    fn beside(&self, face: u32, corner: u32) -> [u32; 2] {
        let (start, end) = (self.starts[face as usize], self.starts[face as usize + 1]);
        let after = if corner + 1 == end { start } else { corner + 1 };
        let before = if corner == start { end - 1 } else { corner - 1 };
        [after, before].map(|corner| self.corners[corner as usize])
    }

    fn mean(&self, face: u32) -> Vec3 {
        let corners = self.face(face);
        corners.iter().map(|vertex| self.points[*vertex as usize]).sum::<Vec3>() / corners.len() as f32
    }

    /// Edges around a vertex; those that do not lie between two faces never become smooth.
    fn ring(&self, vertex: u32) -> Ring {
        let mut counts: Vec<(u32, u32)> = Vec::with_capacity(8);
        for (face, corner) in self.uses_of(vertex) {
            for other in self.beside(*face, *corner) {
                match counts.iter_mut().find(|(known, _)| *known == other) {
                    Some((_, count)) => *count += 1,
                    None => counts.push((other, 1)),
                }
            }
        }
        let is_border = counts.iter().any(|(_, count)| *count != 2);
        let sharpness = |other: u32, count: u32| {
            if count != 2 {
                return INFINITE;
            }
            self.creases.edges.get(&edge_key(vertex, other)).copied().unwrap_or(0.0)
        };
        Ring {
            edges: counts.into_iter().map(|(other, count)| (other, sharpness(other, count))).collect(),
            is_border,
        }
    }

    /// Points that a vertex stays between once edges below a sharpness are smooth: none where it is smooth, two on a
    /// crease, itself where it does not move.
    fn held_by(&self, scheme: Scheme, vertex: u32, ring: &Ring, above: f32) -> Option<[Vec3; 2]> {
        let own = [self.points[vertex as usize]; 2];
        let Scheme::CatmullClark(border) = scheme else { return Some(own) };
        let sharpness = self.creases.vertices.get(&u64::from(vertex)).copied().unwrap_or(0.0);
        let is_pinned = match border {
            Border::Smooth => false,
            Border::Corners => ring.is_border && self.uses_of(vertex).len() == 1,
            Border::Straight => ring.is_border,
        };
        let mut sharp = ring.edges.iter().filter(|(_, sharpness)| *sharpness > above);
        match (sharp.next(), sharp.next(), sharp.next()) {
            _ if is_pinned || sharpness > above => Some(own),
            (Some((a, _)), Some((b, _)), None) => Some([a, b].map(|end| self.points[*end as usize])),
            (Some(_), Some(_), Some(_)) => Some(own),
            _ => None,
        }
    }

    /// A vertex at the next level.
    fn moved(&self, scheme: Scheme, vertex: u32) -> Vec3 {
        let point = self.points[vertex as usize];
        if scheme == Scheme::Linear {
            return point;
        }
        let ring = self.ring(vertex);
        let by = |held: Option<[Vec3; 2]>| match held {
            Some([a, b]) if a == point && b == point => point,
            Some([a, b]) => 0.75 * point + 0.125 * (a + b),
            None => {
                let n = ring.edges.len() as f32;
                let around: Vec3 = ring.edges.iter().map(|(other, _)| self.points[*other as usize]).sum();
                let across: Vec3 = self.uses_of(vertex).iter().map(|(face, _)| self.mean(*face)).sum();
                point * ((n - 2.0) / n) + (around + across) / (n * n)
            }
        };
        let own = self.creases.vertices.get(&u64::from(vertex)).copied();
        let vanishing = ring.edges.iter().map(|(_, sharpness)| *sharpness).chain(own);
        let vanishing: Vec<f32> =
            vanishing.filter(|sharpness| *sharpness > 0.0 && *sharpness < 1.0).collect();
        let now = by(self.held_by(scheme, vertex, &ring, 0.0));
        if vanishing.is_empty() {
            return now;
        }
        let then = by(self.held_by(scheme, vertex, &ring, 1.0));
        then.lerp(now, vanishing.iter().sum::<f32>() / vanishing.len() as f32)
    }

    /// The next level of some faces, and the first child of each of them.
    fn refined(&self, scheme: Scheme, chosen: &[u32]) -> (Self, Vec<u32>) {
        let mut points = Vec::new();
        let mut creases = Creases::default();
        let mut vertices = vec![NONE; self.points.len()];
        // Number of the point in the middle, faces, and the sum of their means.
        let mut edges: HashMap<u64, (u32, u32, Vec3), BuildKeyHasher> = HashMap::default();
        let mut add = |point: Vec3| {
            points.push(point);
            points.len() as u32 - 1
        };
        let centers: Vec<u32> = chosen.iter().map(|face| add(self.mean(*face))).collect();
        for face in chosen {
            let mean = self.mean(*face);
            let corners = self.face(*face);
            for (number, vertex) in corners.iter().enumerate() {
                if vertices[*vertex as usize] == NONE {
                    vertices[*vertex as usize] = add(self.moved(scheme, *vertex));
                }
                let after = corners[(number + 1) % corners.len()];
                let edge = edges.entry(edge_key(*vertex, after)).or_insert((NONE, 0, Vec3::ZERO));
                *edge = (edge.0, edge.1 + 1, edge.2 + mean);
            }
        }
        let (mut corners, mut first_children) = (Vec::new(), Vec::with_capacity(chosen.len()));
        for (face, center) in chosen.iter().zip(centers) {
            first_children.push(corners.len() as u32 / 4);
            let around = self.face(*face);
            let mut middle_after = |number: usize| {
                let ends = [around[number], around[(number + 1) % around.len()]];
                let key = edge_key(ends[0], ends[1]);
                let (middle, faces, means) = edges.entry(key).or_insert((NONE, 0, Vec3::ZERO));
                if *middle == NONE {
                    let [a, b] = ends.map(|end| self.points[end as usize]);
                    let sharpness = self.creases.edges.get(&key).copied().unwrap_or(0.0);
                    let between = 0.5 * (a + b);
                    *middle = add(if *faces == 2 && sharpness < 1.0 && scheme != Scheme::Linear {
                        (0.25 * (a + b + *means)).lerp(between, sharpness)
                    } else {
                        between
                    });
                    if let Some(left) = softened(sharpness) {
                        let halves = ends.map(|end| edge_key(vertices[end as usize], *middle));
                        creases.edges.extend(halves.map(|half| (half, left)));
                    }
                }
                *middle
            };
            for (number, vertex) in around.iter().enumerate() {
                let before = middle_after((number + around.len() - 1) % around.len());
                let after = middle_after(number);
                corners.extend([vertices[*vertex as usize], after, center, before]);
            }
        }
        for (vertex, sharpness) in &self.creases.vertices {
            let child = vertices[*vertex as usize];
            if let Some(left) = softened(*sharpness).filter(|_| child != NONE) {
                creases.vertices.insert(child.into(), left);
            }
        }
        let starts = (0..=corners.len() as u32).step_by(4).collect();
        (Self::new(starts, corners, points, creases), first_children)
    }

    /// Finds limit points and normals of all vertices, whose faces are quads.
    fn find_limits(&mut self, scheme: Scheme) {
        let (limits, normals) =
            (0..self.points.len() as u32).map(|vertex| self.limit(scheme, vertex)).unzip();
        (self.limits, self.normals) = (limits, normals);
    }

    fn limit(&self, scheme: Scheme, vertex: u32) -> (Vec3, Vec3) {
        let point = self.points[vertex as usize];
        let ring = self.ring(vertex);
        let opposite = |face: u32, corner: u32| {
            let first = self.starts[face as usize];
            self.points[self.corners[(first + (corner - first + 2) % 4) as usize] as usize]
        };
        let limit = match self.held_by(scheme, vertex, &ring, 0.0) {
            Some([a, b]) if a == point && b == point => point,
            Some([a, b]) => (4.0 * point + a + b) / 6.0,
            None => {
                let n = ring.edges.len() as f32;
                let around: Vec3 = ring.edges.iter().map(|(other, _)| self.points[*other as usize]).sum();
                let across: Vec3 =
                    self.uses_of(vertex).iter().map(|(face, corner)| opposite(*face, *corner)).sum();
                let normal = self.smooth_normal(vertex, ring.edges.len());
                let limit = (n * n * point + 4.0 * around + across) / (n * (n + 5.0));
                return (limit, normal.unwrap_or(self.mean_normal(vertex)));
            }
        };
        (limit, self.mean_normal(vertex))
    }

    /// Sum of the normals of the corners at a vertex.
    fn mean_normal(&self, vertex: u32) -> Vec3 {
        let point = self.points[vertex as usize];
        let normals = self.uses_of(vertex).iter().map(|(face, corner)| {
            let [after, before] =
                self.beside(*face, *corner).map(|other| self.points[other as usize] - point);
            after.cross(before)
        });
        normals.sum::<Vec3>().normalize_or_zero()
    }

    /// Normal of the limit surface at a smooth vertex of `count` edges: across the tangents of Halstead, Kass and DeRose,
    /// "Efficient, Fair Interpolation using Catmull-Clark Surfaces" (1993).
    fn smooth_normal(&self, vertex: u32, count: usize) -> Option<Vec3> {
        let turn = std::f32::consts::TAU / count as f32;
        let share = 1.0 + turn.cos() + (0.5 * turn).cos() * (2.0 * (9.0 + turn.cos())).sqrt();
        let uses = self.uses_of(vertex);
        let (mut tangents, mut along) = ([Vec3::ZERO; 2], None);
        for number in 0..count {
            let matches = |(face, corner): &&(u32, u32)| {
                along.is_none_or(|along| self.beside(*face, *corner)[0] == along)
            };
            let (face, corner) = uses.iter().find(matches)?;
            let [after, before] = self.beside(*face, *corner);
            along = Some(before);
            let first = self.starts[*face as usize];
            let across = self.corners[(first + (corner - first + 2) % 4) as usize];
            let [edge, across] = [after, across].map(|other| self.points[other as usize]);
            for (shift, tangent) in tangents.iter_mut().enumerate() {
                let angle = |step: usize| (turn * (number + count - shift + step) as f32).cos();
                *tangent += share * angle(0) * edge + (angle(0) + angle(1)) * across;
            }
        }
        // The second tangent lies one edge ahead of the first.
        let [first, second] = tangents;
        first.cross(second).try_normalize()
    }
}

impl Creases {
    /// Makes vertices with two edges as sharp as the smoother of both besides their own, as Cycles does.
    fn sharpen_corners(&mut self, base: &Level) {
        if self.edges.is_empty() && self.vertices.is_empty() {
            return;
        }
        for vertex in 0..base.points.len() as u32 {
            let ring = base.ring(vertex);
            if let [(a, _), (b, _)] = ring.edges[..] {
                let [a, b] =
                    [a, b].map(|other| self.edges.get(&edge_key(vertex, other)).copied().unwrap_or(0.0));
                if a.min(b) > 0.0 {
                    let own = self.vertices.entry(vertex.into()).or_insert(0.0);
                    *own = (*own + a.min(b)).min(INFINITE);
                }
            }
        }
    }
}

/// Sharpness of what is left of a crease at the next level, if anything is.
fn softened(sharpness: f32) -> Option<f32> {
    if sharpness >= INFINITE { Some(sharpness) } else { Some(sharpness - 1.0).filter(|left| *left > 0.0) }
}
