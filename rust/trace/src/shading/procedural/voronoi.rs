//! Voronoi textures: one random point in each cell of a grid, and distances to the nearest of them (Steven Worley, "A
//! Cellular Texture Basis Function", 1996), in octaves as in Cycles.

use glam::{Vec3, Vec4};
use relume_scene::{Metric, VoronoiFeature, VoronoiHash};

use super::arrays::{add, dot, lerp, mix, scale, smooth, subtract};
use super::hash::{pcg_color, pcg_point, random_color, random_point};

/// The Voronoi Texture node.
#[derive(Clone, Copy, Debug)]
pub struct Voronoi {
    pub feature: VoronoiFeature,
    pub metric: Metric,
    pub hash: VoronoiHash,
    pub normalize: bool,
    /// True if positions are wanted and not colours.
    pub position: bool,
    /// True if colours are wanted.
    pub colored: bool,
    pub scale: f32,
    pub detail: f32,
    pub roughness: f32,
    pub lacunarity: f32,
    /// 0..=0.5.
    pub smoothness: f32,
    pub exponent: f32,
    /// 0..=1.
    pub randomness: f32,
}

/// Result of one octave, or of all of them, at a place.
#[derive(Clone, Copy, Debug)]
struct VoronoiOutput<const N: usize> {
    distance: f32,
    color: Vec3,
    /// The point that is meant, in the octave's coordinates.
    position: [f32; N],
}

impl<const N: usize> VoronoiOutput<N> {
    const NOTHING: Self = Self { distance: 0.0, color: Vec3::ZERO, position: [0.0; N] };

    fn mix(&self, other: &Self, t: f32) -> Self {
        Self {
            distance: lerp(self.distance, other.distance, t),
            color: self.color.lerp(other.color, t),
            position: mix(self.position, other.position, t),
        }
    }
}

/// The point of one cell about the place that is looked at.
#[derive(Clone, Copy)]
struct Candidate<const N: usize> {
    cell: [f32; N],
    /// The point seen from the lower corner of the middle cell.
    position: [f32; N],
}

impl Voronoi {
    /// Colour and, in w, distance or radius; for positions their first three coordinates, and in w the last one of one
    /// and of four. `at` is scaled.
    pub fn evaluate<const N: usize>(&self, at: [f32; N]) -> Vec4 {
        match self.feature {
            VoronoiFeature::DistanceToEdge => Vec4::splat(self.octaves_of_edges(at)),
            VoronoiFeature::NSphereRadius => Vec4::splat(self.radius(at)),
            _ => {
                let found = self.octaves(at);
                if self.position { placed(found.position) } else { found.color.extend(found.distance) }
            }
        }
    }

    /// True if there is more than one octave.
    fn is_fractal(&self) -> bool {
        self.detail != 0.0 && self.roughness != 0.0
    }

    fn octaves<const N: usize>(&self, at: [f32; N]) -> VoronoiOutput<N> {
        let reach = 0.5 + 0.5 * self.randomness;
        let farthest = if self.feature == VoronoiFeature::F2 { 2.0 } else { 1.0 }
            * if N == 1 { reach } else { self.length([reach; N]) };
        let mut total = 0.0;
        let mut found = VoronoiOutput::NOTHING;
        if self.is_fractal() {
            let (mut amplitude, mut frequency) = (1.0, 1.0);
            for octave in 0..=self.detail.ceil() as u32 {
                let part = (self.detail - octave as f32 + 1.0).min(1.0);
                let one = self.nearest(scale(at, frequency));
                let more = VoronoiOutput {
                    distance: found.distance + one.distance * amplitude,
                    color: found.color + one.color * amplitude,
                    position: mix(found.position, scale(one.position, frequency.recip()), amplitude),
                };
                found = found.mix(&more, part);
                total += amplitude * part;
                frequency *= self.lacunarity;
                amplitude *= self.roughness;
            }
        } else {
            found = self.nearest(at);
            total = 1.0;
        }
        if self.normalize {
            found.distance /= total * farthest;
            found.color /= total;
        }
        let shrink = if self.scale == 0.0 { 0.0 } else { self.scale.recip() };
        VoronoiOutput { position: scale(found.position, shrink), ..found }
    }

    /// Distances to edges shrink with each octave, and the smallest counts.
    fn octaves_of_edges<const N: usize>(&self, at: [f32; N]) -> f32 {
        let farthest = 0.5 + 0.5 * self.randomness;
        if !self.is_fractal() {
            let distance = self.distance_to_edge(at);
            return if self.normalize { distance / farthest } else { distance };
        }
        let (mut total, mut distance) = (farthest, 8.0);
        let (mut amplitude, mut frequency) = (1.0, 1.0);
        for octave in 0..=self.detail.ceil() as u32 {
            let part = (self.detail - octave as f32 + 1.0).min(1.0);
            let one = self.distance_to_edge(scale(at, frequency)) / frequency;
            total = lerp(total, lerp(total, farthest / frequency, amplitude), part);
            let nearer = lerp(distance, one.min(distance), amplitude);
            distance = lerp(distance, nearer.min(distance), part);
            frequency *= self.lacunarity;
            amplitude *= self.roughness;
        }
        if self.normalize { distance / total } else { distance }
    }

    /// One octave of a feature that has a colour and a position.
    fn nearest<const N: usize>(&self, at: [f32; N]) -> VoronoiOutput<N> {
        match self.feature {
            VoronoiFeature::SmoothF1 if self.smoothness != 0.0 => self.smooth(at),
            feature => self.ranked(at, feature == VoronoiFeature::F2),
        }
    }

    /// The nearest point, or the second nearest one.
    fn ranked<const N: usize>(&self, at: [f32; N], second: bool) -> VoronoiOutput<N> {
        let nowhere = Candidate { cell: [0.0; N], position: [0.0; N] };
        let (mut first, mut next) = ((f32::MAX, nowhere), (f32::MAX, nowhere));
        let (cell, inside) = split(at);
        self.for_each_cell::<1, N>(cell, |candidate| {
            let distance = self.distance(candidate.position, inside);
            if distance < first.0 {
                (next, first) = (first, (distance, candidate));
            } else if distance < next.0 {
                next = (distance, candidate);
            }
        });
        let (distance, chosen) = if second { next } else { first };
        let color = if self.colored { self.color(chosen.cell) } else { Vec3::ZERO };
        VoronoiOutput { distance, color, position: add(chosen.position, cell) }
    }

    /// The polynomial smooth minimum of all points about (Inigo Quilez, "Smooth Minimum").
    fn smooth<const N: usize>(&self, at: [f32; N]) -> VoronoiOutput<N> {
        let (cell, inside) = split(at);
        let mut found: Option<VoronoiOutput<N>> = None;
        self.for_each_cell::<2, N>(cell, |candidate| {
            let distance = self.distance(candidate.position, inside);
            let color = if self.colored { self.color(candidate.cell) } else { Vec3::ZERO };
            let one = VoronoiOutput { distance, color, position: candidate.position };
            found = Some(match found {
                None => one,
                Some(known) => {
                    let t =
                        smooth((0.5 + 0.5 * (known.distance - distance) / self.smoothness).clamp(0.0, 1.0));
                    let bulge = self.smoothness * t * (1.0 - t);
                    let outer = bulge / (1.0 + 3.0 * self.smoothness);
                    let mixed = known.mix(&one, t);
                    VoronoiOutput {
                        distance: mixed.distance - bulge,
                        color: mixed.color - outer,
                        position: mixed.position.map(|x| x - outer),
                    }
                }
            });
        });
        let found = found.unwrap_or(VoronoiOutput::NOTHING);
        VoronoiOutput { position: add(found.position, cell), ..found }
    }

    /// Distance to the nearest plane half-way between the nearest point and another one.
    fn distance_to_edge<const N: usize>(&self, at: [f32; N]) -> f32 {
        const SAME: f32 = 1e-4;
        let (cell, inside) = split(at);
        if N == 1 {
            return self.distance_to_middle(cell, inside);
        }
        let mut closest = (f32::MAX, [0.0; N]);
        self.for_each_cell::<1, N>(cell, |candidate| {
            let way = subtract(candidate.position, inside);
            let squared = dot(way, way);
            if squared < closest.0 {
                closest = (squared, way);
            }
        });
        let (_, closest) = closest;
        let mut distance = f32::MAX;
        self.for_each_cell::<1, N>(cell, |candidate| {
            let way = subtract(candidate.position, inside);
            let apart = subtract(way, closest);
            let squared = dot(apart, apart);
            if squared > SAME {
                let middle = scale(add(closest, way), 0.5);
                distance = distance.min(dot(middle, apart) / squared.sqrt());
            }
        });
        distance
    }

    /// Distance, in one dimension, to a middle between the cell's own point and one of its two neighbours.
    fn distance_to_middle<const N: usize>(&self, cell: [f32; N], inside: [f32; N]) -> f32 {
        let mut points = [0.0; 3];
        let mut count = 0;
        self.for_each_cell::<1, N>(cell, |candidate| {
            points[count] = candidate.position[0];
            count += 1;
        });
        let [left, own, right] = points;
        let to_middle = |other: f32| ((own + other) * 0.5 - inside[0]).abs();
        to_middle(left).min(to_middle(right))
    }

    /// Half the distance from the nearest point to the one nearest to it.
    fn radius<const N: usize>(&self, at: [f32; N]) -> f32 {
        let (cell, inside) = split(at);
        let nearest_to = |cell: [f32; N], place: [f32; N], but: Option<[f32; N]>| {
            let mut nearest = (f32::MAX, Candidate { cell, position: place });
            self.for_each_cell::<1, N>(cell, |candidate| {
                let way = subtract(candidate.position, place);
                let distance = dot(way, way);
                if distance < nearest.0 && but != Some(candidate.cell) {
                    nearest = (distance, candidate);
                }
            });
            nearest.1
        };
        let own = nearest_to(cell, inside, None);
        let place = subtract(own.position, subtract(own.cell, cell));
        let other = nearest_to(own.cell, place, Some(own.cell));
        let way = subtract(other.position, place);
        dot(way, way).sqrt() * 0.5
    }

    /// Visits all cells at most `REACH` away, the first axis fastest.
    #[inline(always)]
    fn for_each_cell<const REACH: i32, const N: usize>(
        &self,
        middle: [f32; N],
        mut visit: impl FnMut(Candidate<N>),
    ) {
        let along = |axis: usize| if axis < N { -REACH..=REACH } else { 0..=0 };
        for w in along(3) {
            for z in along(2) {
                for y in along(1) {
                    for x in along(0) {
                        let steps = [x, y, z, w];
                        let offset = std::array::from_fn(|i| steps[i] as f32);
                        let cell = add(middle, offset);
                        let position = add(offset, scale(self.point(cell), self.randomness));
                        visit(Candidate { cell, position });
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn point<const N: usize>(&self, cell: [f32; N]) -> [f32; N] {
        match self.hash {
            VoronoiHash::Pcg if N > 1 => pcg_point(cell),
            _ => random_point(cell),
        }
    }

    #[inline(always)]
    fn color<const N: usize>(&self, cell: [f32; N]) -> Vec3 {
        match self.hash {
            VoronoiHash::Pcg if N > 1 => pcg_color(cell),
            _ => random_color(cell),
        }
    }

    #[inline(always)]
    fn distance<const N: usize>(&self, a: [f32; N], b: [f32; N]) -> f32 {
        self.length(subtract(a, b))
    }

    #[inline(always)]
    fn length<const N: usize>(&self, way: [f32; N]) -> f32 {
        if N == 1 {
            return way[0].abs();
        }
        match self.metric {
            Metric::Euclidean => dot(way, way).sqrt(),
            Metric::Manhattan => way.into_iter().map(f32::abs).sum(),
            Metric::Chebychev => way.into_iter().map(f32::abs).fold(0.0, f32::max),
            Metric::Minkowski => {
                let sum: f32 = way.into_iter().map(|x| x.abs().powf(self.exponent)).sum();
                sum.powf(self.exponent.recip())
            }
        }
    }
}

/// Cell and place within it.
#[inline(always)]
fn split<const N: usize>(at: [f32; N]) -> ([f32; N], [f32; N]) {
    let cell = at.map(f32::floor);
    (cell, subtract(at, cell))
}

/// A position in the four numbers of a node: one of a single dimension is its w.
fn placed<const N: usize>(position: [f32; N]) -> Vec4 {
    let [x, y, z, w]: [f32; 4] = std::array::from_fn(|i| position.get(i).copied().unwrap_or(0.0));
    if N == 1 { Vec4::new(0.0, 0.0, 0.0, x) } else { Vec4::new(x, y, z, w) }
}
