//! The guide's lights in columns, eight of them in loops that compilers turn into vector instructions. Each operation is the one
//! that a single light takes, in the same order, so values are equal to those of one light at a time.

use std::f32::consts::TAU;

use glam::{Mat3, Vec3};

use super::{
    Horizon, LARGE, WIDE,
    plate::Plate,
    target::{Beam, GuideTarget, NARROWEST, TargetPlace, height},
};

/// Lights of a group.
pub(super) const LANES: usize = 8;

type Column = [f32; LANES];
type Columns = [Column; 3];

/// Eight lights; those that are missing have no brightness.
#[derive(Clone, Debug)]
#[repr(align(32))]
pub(super) struct TargetGroup {
    /// Centres, and directions of suns.
    place: Columns,
    /// How far places come nearer with the point: 1, or 0 for suns.
    is_near: Column,
    radius: Column,
    /// Squared sines of suns; below 0 for others.
    sky_sine_squared: Column,
    brightness: Column,
    /// See [`Beam`]: a light shines in directions from this cosine to the axis on, in all from minus infinity on.
    beam_axis: Columns,
    beam_cos: Column,
    plates: Plates,
    has_plates: bool,
    /// Lights that are seen at other places, see [`TargetPlace::Sheared`].
    apparent: Vec<(usize, Mat3)>,
}

/// [`Plate`]s in columns.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(32))]
struct Plates {
    edges: [Columns; 2],
    across: [Columns; 2],
    normal: Columns,
    /// Infinite where there is no plate.
    area: Column,
    /// 1 for ellipses, 0 for others.
    is_ellipse: Column,
}

/// Eight lights as a point sees them; the share of those that are not drawn from is 0.
#[derive(Clone, Debug, Default)]
#[repr(align(32))]
pub(super) struct LobeGroup {
    to_center: Columns,
    axis: Columns,
    /// Heights of the cones that hold the lights, below 0 for plates, and densities in them.
    narrow: Column,
    narrow_density: Column,
    /// Heights of the wider cones, and densities in them.
    wide: Column,
    wide_density: Column,
    /// Probability that one of both is drawn from, where any is; both alike.
    pub probability: Column,
    /// 1 where points of a plate are drawn, which has some probability.
    by_plate: Column,
    plates: Plates,
    has_plates: bool,
}

/// Region that directions to a light are drawn from.
pub(super) enum Lobe {
    /// A cone around an axis, of this height.
    Cone(Vec3, f32),
    /// A point of a plate, as seen from here; `axis` is the direction to its middle.
    Point { to: Vec3, axis: Vec3 },
}

/// Sums of the weights of lights, and of those that are guided to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Weights {
    pub all: f32,
    pub guided: f32,
}

/// True if the processor has AVX2: without it, one light at a time is faster.
pub(super) fn is_fast() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::is_x86_feature_detected!("avx2");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Makes `lobes` those of the groups that are seen from a point above its horizon.
pub(super) fn fill(
    groups: &[TargetGroup],
    point: Vec3,
    horizon: Horizon,
    lobes: &mut [LobeGroup],
) -> Weights {
    #[cfg(target_arch = "x86_64")]
    if is_fast() {
        // SAFETY: the processor has AVX2.
        return unsafe { fill_avx2(groups, point, horizon, lobes) };
    }
    fill_lanes(groups, point, horizon, lobes)
}

/// [`fill_lanes`] compiled for AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn fill_avx2(groups: &[TargetGroup], point: Vec3, horizon: Horizon, lobes: &mut [LobeGroup]) -> Weights {
    fill_lanes(groups, point, horizon, lobes)
}

#[inline(always)]
fn fill_lanes(groups: &[TargetGroup], point: Vec3, horizon: Horizon, lobes: &mut [LobeGroup]) -> Weights {
    let mut weights = Weights::default();
    for (group, lobes) in groups.iter().zip(&mut *lobes) {
        group.fill(point, horizon, lobes, &mut weights);
    }
    if weights.guided > 0.0 {
        for lobes in lobes {
            lobes.probability.iter_mut().for_each(|probability| *probability /= weights.guided);
        }
    }
    weights
}

/// A place to go to from three numbers in 0..1. There has to be a light that is drawn from.
pub(super) fn sample(lobes: &[LobeGroup], u: [f32; 3]) -> Lobe {
    let mut rest = u[0];
    let (mut chosen, mut probability) = ((&lobes[0], 0), 0.0);
    for (group, lane) in lobes.iter().flat_map(|group| (0..LANES).map(move |lane| (group, lane))) {
        if group.probability[lane] > 0.0 {
            (chosen, probability) = ((group, lane), group.probability[lane]);
            if rest < probability {
                break;
            }
            rest -= probability;
        }
    }
    let (group, lane) = chosen;
    group.lobe(lane, rest >= 0.5 * probability, [u[1], u[2]])
}

/// Density of a direction over solid angle.
pub(super) fn density(lobes: &[LobeGroup], direction: Vec3) -> f32 {
    #[cfg(target_arch = "x86_64")]
    if is_fast() {
        // SAFETY: the processor has AVX2.
        return unsafe { density_avx2(lobes, direction) };
    }
    density_lanes(lobes, direction)
}

/// [`density_lanes`] compiled for AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn density_avx2(lobes: &[LobeGroup], direction: Vec3) -> f32 {
    density_lanes(lobes, direction)
}

#[inline(always)]
fn density_lanes(lobes: &[LobeGroup], direction: Vec3) -> f32 {
    lobes.iter().fold(0.0, |sum, group| group.add_density(direction, sum))
}

fn set(columns: &mut Columns, lane: usize, value: Vec3) {
    columns.iter_mut().zip(value.to_array()).for_each(|(column, value)| column[lane] = value);
}

fn get(columns: &Columns, lane: usize) -> Vec3 {
    Vec3::from(columns.map(|column| column[lane]))
}

#[inline(always)]
fn dot(columns: &Columns, lane: usize, [x, y, z]: [f32; 3]) -> f32 {
    columns[0][lane] * x + columns[1][lane] * y + columns[2][lane] * z
}

#[inline(always)]
fn dot_point(columns: &Columns, lane: usize, point: Vec3) -> f32 {
    dot(columns, lane, point.to_array())
}

impl TargetGroup {
    /// At most eight lights.
    pub fn new(targets: &[GuideTarget]) -> Self {
        let mut group = Self {
            place: [[0.0; LANES]; 3],
            is_near: [1.0; LANES],
            radius: [1.0; LANES],
            sky_sine_squared: [-1.0; LANES],
            brightness: [0.0; LANES],
            beam_axis: [[0.0; LANES]; 3],
            beam_cos: [f32::NEG_INFINITY; LANES],
            plates: Plates { area: [f32::INFINITY; LANES], ..Plates::default() },
            has_plates: false,
            apparent: Vec::new(),
        };
        for (lane, target) in targets.iter().take(LANES).enumerate() {
            let (place, radius) = match target.place {
                TargetPlace::Ball { center, radius }
                | TargetPlace::Flat { center, radius, .. }
                | TargetPlace::Sheared { center, radius, .. } => (center, radius),
                TargetPlace::Sky { direction, sine_squared } => {
                    group.is_near[lane] = 0.0;
                    group.sky_sine_squared[lane] = sine_squared;
                    (direction, 1.0)
                }
            };
            set(&mut group.place, lane, place);
            group.radius[lane] = radius;
            group.brightness[lane] = target.brightness;
            let (axis, cos) = match target.beam {
                Beam::Everywhere => (Vec3::ZERO, f32::NEG_INFINITY),
                Beam::Cone { axis, cos } => (axis, cos),
                // The least that is more than 0.
                Beam::Front { normal } => (normal, f32::from_bits(1)),
            };
            set(&mut group.beam_axis, lane, axis);
            group.beam_cos[lane] = cos;
            if let TargetPlace::Sheared { apparent, .. } = target.place {
                group.apparent.push((lane, apparent));
            }
            if let TargetPlace::Flat { plate, .. } | TargetPlace::Sheared { plate, .. } = &target.place {
                group.plates.put(lane, plate);
                group.has_plates = true;
            }
        }
        group
    }

    /// Makes `lobes` those that are seen from a point above its horizon, their probabilities not yet divided by the sum, and adds to
    /// `weights`.
    #[inline(always)]
    pub fn fill(&self, point: Vec3, horizon: Horizon, lobes: &mut LobeGroup, weights: &mut Weights) {
        for (axis, from) in point.to_array().into_iter().enumerate() {
            for lane in 0..LANES {
                lobes.to_center[axis][lane] = self.place[axis][lane] - self.is_near[lane] * from;
            }
        }
        for (lane, apparent) in &self.apparent {
            let to_center = *apparent * get(&lobes.to_center, *lane);
            set(&mut lobes.to_center, *lane, to_center);
        }
        // From below these nothing comes in.
        let [shading, geometric] = horizon.0.unwrap_or_default();
        let mut all = [0.0; LANES];
        for lane in 0..LANES {
            let to_center = [0, 1, 2].map(|axis: usize| lobes.to_center[axis][lane]);
            let length_squared = dot(&lobes.to_center, lane, to_center);
            let length = length_squared.sqrt();
            let inverse = 1.0 / length;
            let sine = self.radius[lane] * inverse;
            let is_sky = self.sky_sine_squared[lane] >= 0.0;
            let sine_squared = if is_sky { self.sky_sine_squared[lane] } else { sine * sine };
            let scale = if is_sky { 1.0 } else { inverse };
            let axis = to_center.map(|v| v * scale);
            let ball = height(sine_squared.min(1.0));
            let cos = dot(&self.plates.normal, lane, to_center) / length;
            let plate = self.plates.area[lane] * cos.abs() / (length_squared * TAU);
            let seen = plate.min(ball);
            let beam_cos = self.beam_cos[lane];
            let is_lit =
                (beam_cos == f32::NEG_INFINITY) | (dot(&self.beam_axis, lane, axis.map(|v| -v)) >= beam_cos);
            let is_below = |normal: Vec3| {
                let cos = normal.x * axis[0] + normal.y * axis[1] + normal.z * axis[2];
                (cos < 0.0) & (cos * cos > sine_squared)
            };
            let is_seen = is_lit & !(is_below(shading) & is_below(geometric));
            // Irradiance is what a light matters by here; by its root, so that weak lights can be turned up later.
            let weight = if is_seen { (self.brightness[lane] * seen).sqrt() } else { 0.0 };
            let probability = weight * (1.0 - seen / LARGE).max(0.0);
            // Single precision would miss plates that look smaller.
            let is_large = (self.plates.area[lane] < f32::INFINITY) & (2.0 * seen > NARROWEST);
            let by_plate = is_large & (probability > 0.0);
            let narrow = height(sine_squared.clamp(NARROWEST, 1.0));
            let wide = height((32.0 * seen).max(sine_squared).clamp(WIDE, 1.0));
            for (column, v) in lobes.axis.iter_mut().zip(axis) {
                column[lane] = v;
            }
            all[lane] = weight;
            lobes.probability[lane] = probability;
            lobes.narrow[lane] = if by_plate { -1.0 } else { narrow };
            lobes.narrow_density[lane] = 1.0 / (TAU * narrow);
            lobes.wide[lane] = wide;
            lobes.wide_density[lane] = 1.0 / (TAU * wide);
            lobes.by_plate[lane] = if by_plate { 1.0 } else { 0.0 };
        }
        for (weight, probability) in all.into_iter().zip(lobes.probability) {
            weights.all += weight;
            weights.guided += probability;
        }
        lobes.has_plates = self.has_plates;
        if self.has_plates {
            lobes.plates = self.plates;
        }
    }
}

impl Plates {
    fn put(&mut self, lane: usize, plate: &Plate) {
        for i in 0..2 {
            set(&mut self.edges[i], lane, plate.edges[i]);
            set(&mut self.across[i], lane, plate.across[i]);
        }
        set(&mut self.normal, lane, plate.normal);
        self.area[lane] = plate.area;
        self.is_ellipse[lane] = f32::from(plate.is_ellipse);
    }
}

impl LobeGroup {
    /// A place of the light of a lane: in its wider cone or not.
    pub fn lobe(&self, lane: usize, in_wide: bool, u: [f32; 2]) -> Lobe {
        let axis = get(&self.axis, lane);
        if in_wide {
            Lobe::Cone(axis, self.wide[lane])
        } else if self.by_plate[lane] > 0.0 {
            let edges = [0, 1].map(|i: usize| get(&self.plates.edges[i], lane));
            let from_center = Plate::point(edges, self.plates.is_ellipse[lane] > 0.0, u);
            Lobe::Point { to: get(&self.to_center, lane) + from_center, axis }
        } else {
            Lobe::Cone(axis, self.narrow[lane])
        }
    }

    /// Adds the density of a direction over solid angle to a sum.
    #[inline(always)]
    pub fn add_density(&self, direction: Vec3, sum: f32) -> f32 {
        let mut plates = [0.0; LANES];
        if self.has_plates {
            self.plate_densities(direction, &mut plates);
        }
        let mut terms = [0.0; LANES];
        for lane in 0..LANES {
            let [x, y, z] = [0, 1, 2].map(|axis: usize| direction[axis] - self.axis[axis][lane]);
            // Of two unit vectors: 1 less their cosine.
            let apart = 0.5 * (x * x + y * y + z * z);
            // Read whatever comes of it, so that no branch is needed. Plates, whose height is below 0, have the other density.
            let (narrow, wide) = (self.narrow_density[lane], self.wide_density[lane]);
            let narrow = if apart <= self.narrow[lane] { narrow } else { 0.0 } + plates[lane];
            let wide = if apart <= self.wide[lane] { wide } else { 0.0 };
            terms[lane] = self.probability[lane] * 0.5 * (narrow + wide);
        }
        terms.into_iter().fold(sum, |sum, term| sum + term)
    }

    /// Densities of directions to points of the plates: squared distance over area and cosine; 0 where none is drawn.
    #[inline(always)]
    fn plate_densities(&self, direction: Vec3, densities: &mut Column) {
        let plates = &self.plates;
        for (lane, density) in densities.iter_mut().enumerate() {
            let to_center = [0, 1, 2].map(|axis: usize| self.to_center[axis][lane]);
            let cos = -dot_point(&plates.normal, lane, direction);
            let distance = -dot(&plates.normal, lane, to_center) / cos;
            let from_center = [0, 1, 2].map(|axis: usize| direction[axis] * distance - to_center[axis]);
            let [x, y] = [0, 1].map(|i: usize| dot(&plates.across[i], lane, from_center));
            let [x, y] = [x * x, y * y];
            let (larger, smaller) = if x > y { (x, y) } else { (y, x) };
            let is_inside = larger + plates.is_ellipse[lane] * smaller <= 0.25;
            let is_there = (distance > 0.0) & (distance < f32::INFINITY) & (self.by_plate[lane] > 0.0);
            let inside = distance * distance / (plates.area[lane] * cos.abs());
            *density = if is_inside & is_there { inside } else { 0.0 };
        }
    }
}
