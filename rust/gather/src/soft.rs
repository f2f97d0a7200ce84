//! Smoothed gather with derivatives by the lights' parameters, for solving lights through the path dump itself.
//!
//! A gather sums `T_k V(segment k, light)` over segments. `V` is a step: its derivative is 0 almost everywhere, and what
//! moves the picture are the few segments that enter and leave. Here lights are smoothed by a width `h`, relative to the
//! scene, which a solver shrinks as it converges: then `V` has derivatives, and the value tends to that of
//! [`Gather`](crate::Gather). The rules, with `r` a size, `w` the unit direction of a segment from `o` on, `l` its length,
//! `c` the centre:
//!
//! - **Sizes enlarge at equal power.** A disk of radius `r` becomes one of `R = hypot(r, h)` with the factor `(r / R)^2`, an
//!   edge likewise by itself, a sun with squared chords instead of squared radii. From afar the picture stays.
//! - **Rims are soft.** `S(x; e)` is a cubic step that falls from 1 to 0 between `x = 1 - e` and `1 + e`, symmetrically, so
//!   that integrals over `x` stay. For disks `x` is the square of the distance to the centre over `R^2`, proportional to
//!   area; for edges it is the distance over the half edge. `e = h / R`: all of the disk where the smoothing outweighs the
//!   light.
//! - **Ends are soft.** The condition that the crossing, at distance `s`, lies on the segment becomes
//!   `W(s / h) - W((s - l) / h)` with a cubic step `W` from -1 to 1: the share of shifts along the segment that put it there. It is symmetric
//!   about both ends and vanishes with `l`, so that short segments do not catch more than their share.
//!   Pieces of a ray ([`crate::piece`]) take what the ray does up to their ends, less what it does up to their starts.
//! - **Balls** are crossed at `s = (c - o) . w -+ q` with `q = r sqrt(1 - x)`; segments that start inside count where they
//!   leave. The shifts that do are two intervals of `s`. Beyond the rim's middle the root goes on as a line, so that its
//!   slope stays finite.
//! - **Facing disks** lie across the line from the origin: `x = d^2 (1 + t) / R^2` and `s (1 + t)` is the distance of the
//!   crossing, with `d` the distance of the centre from the line and `t = d^2 / s^2`, here `d^2 / (s^2 + h^2)`.
//! - **Cones** of spots are soft in `1 - cos`, proportional to solid angle, and enlarge like disks. The case of Cycles that
//!   leaves out the cone inside of the sphere is a soft one, too.
//! - **Fronts** of area lights fade in over small cosines, where the crossing would move without bounds; spreads widen and
//!   end softly.
//!
//! - **Maps** of emission are looked up by the direction of the segment.
//!
//! Derivatives are those of these formulas, exactly, but that factors of maps count as constant.

pub(crate) mod light;
mod profile;
mod wide;

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::{End, Flags, Shard, decode_rgb9e5};
use relume_scene::{LANES, Light, LightShape};

use self::light::{SoftLight, SoftProfile};
use self::profile::Segments;
use self::wide::{Wide, Wide3};
use crate::gather::{SumSink, add};
use crate::kernel::{self, KernelWork, SegmentBlock, Visitor};
use crate::lanes::{Lanes, Portable, WIDTH};
use crate::light::{PreparedLight, Reach};
use crate::piece::RayPiece;
use crate::{Gather, GatherError, SampleSplit};

/// Share of the extent up to which a light's reach is so small that a first test on packed records saves time.
const SELECTIVE: f32 = 0.06;

/// The value and its derivatives by lanes.
pub(crate) const OUTPUTS: usize = 1 + LANES;

/// Smoothed unit values of cells with derivatives. Cells are the means of squares of pixels: single pixels of a dump are too
/// noisy to be compared.
///
/// Results do not depend on the number of threads; they do in the last digits on the instruction set.
#[derive(Clone, Copy, Debug)]
pub struct SoftGather<'a> {
    gather: &'a Gather,
    pub(crate) edge: usize,
    extent: f32,
}

/// Unit values (radiance 1) of a light, RGB, and their derivatives by its lanes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UnitValues {
    /// One per cell that was asked for.
    pub values: Vec<[f32; 3]>,
    /// Derivatives by [`relume_scene::lane`], one per cell that was asked for.
    pub slopes: Vec<[[f32; 3]; LANES]>,
}

impl UnitValues {
    /// Values and slopes of each cell, of a light of this shape.
    pub(crate) fn new(shape: &LightShape, outputs: &[[[f32; 3]; OUTPUTS]]) -> Self {
        let lanes: [bool; LANES] = std::array::from_fn(|lane| shape.has_lane(lane));
        let slope =
            |outputs: &[[f32; 3]; OUTPUTS], lane| if lanes[lane] { outputs[1 + lane] } else { [0.0; 3] };
        let slopes = |outputs: &[[f32; 3]; OUTPUTS]| std::array::from_fn(|lane| slope(outputs, lane));
        Self {
            values: outputs.iter().map(|outputs| outputs[0]).collect(),
            slopes: outputs.iter().map(slopes).collect(),
        }
    }
}

impl<'a> SoftGather<'a> {
    /// Cells are `edge` pixels wide and high.
    pub fn new(gather: &'a Gather, edge: usize) -> Self {
        Self { gather, edge: edge.max(1), extent: visible_extent(gather) }
    }

    /// Columns and rows of cells; numbers go row by row. The last ones may be smaller.
    pub fn cells(&self) -> (usize, usize) {
        let manifest = self.gather.dump().manifest();
        (manifest.width.div_ceil(self.edge), manifest.height.div_ceil(self.edge))
    }

    /// Size of what the camera sees, in metres: the diagonal of the box around most of it. A softness of 1 smooths by this
    /// much.
    pub fn extent(&self) -> f32 {
        self.extent
    }

    /// A light's unit values at some cells with their derivatives. `softness` is above 0 and at most 1: positions are
    /// smoothed by this share of [`SoftGather::extent`], angles by this many radians.
    ///
    /// # Errors
    /// If the light cannot be gathered, the softness is out of range or there is no such cell.
    pub fn linearise(&self, light: &Light, softness: f32, cells: &[u32]) -> Result<UnitValues, GatherError> {
        let softened = self.soften(light, softness, cells)?;
        let outputs: Vec<_> = cells
            .par_iter()
            .map_init(KernelWork::default, |work, &cell| self.cell(&softened, cell as usize, work))
            .collect();
        Ok(UnitValues::new(&light.shape, &outputs))
    }

    /// The smoothed light, if that and the cells can be.
    pub(crate) fn soften(
        &self,
        light: &Light,
        softness: f32,
        cells: &[u32],
    ) -> Result<SoftLight, GatherError> {
        if !(softness > 0.0 && softness <= 1.0) {
            return Err(GatherError::Softness(softness));
        }
        self.check_cells(cells)?;
        SoftLight::new(light, self.gather, softness, softness * self.extent)
    }

    fn check_cells(&self, cells: &[u32]) -> Result<(), GatherError> {
        let (columns, rows) = self.cells();
        match cells.iter().find(|&&cell| cell as usize >= columns * rows) {
            Some(&cell) => Err(GatherError::Cell { cell, cells: columns * rows }),
            None => Ok(()),
        }
    }

    /// Columns and rows of the pixels of a cell.
    fn pixels(&self, cell: usize) -> [Range<usize>; 2] {
        let (manifest, columns) = (self.gather.dump().manifest(), self.cells().0);
        let along = |first: usize, end: usize| first * self.edge..end.min((first + 1) * self.edge);
        [along(cell % columns, manifest.width), along(cell / columns, manifest.height)]
    }

    /// Places in the image, row by row, of the pixels of a cell.
    pub(crate) fn places(&self, cell: usize) -> impl Iterator<Item = u32> + use<> {
        let ([x, y], width) = (self.pixels(cell), self.gather.dump().manifest().width);
        y.flat_map(move |y| x.clone().map(move |x| (y * width + x) as u32))
    }

    /// The runs of neighbouring pixels of a cell that lie in one row of one tile: that tile, and their numbers in it.
    fn runs(&self, cell: usize) -> impl Iterator<Item = (usize, Range<usize>)> {
        let (dump, [x, y]) = (self.gather.dump(), self.pixels(cell));
        y.flat_map(move |y| {
            let mut start = x.start;
            let end = x.end;
            std::iter::from_fn(move || {
                let (tile, pixel) = (start < end).then(|| dump.locate(start, y))?;
                let rect = dump.manifest().tile_rect(tile);
                let length = end.min(rect.x + rect.width) - start;
                start += length;
                Some((tile, pixel..pixel + length))
            })
        })
    }

    /// Value and slopes of a cell.
    fn cell(&self, light: &SoftLight, cell: usize, work: &mut KernelWork) -> [[f32; 3]; OUTPUTS] {
        let (dump, [x, y]) = (self.gather.dump(), self.pixels(cell));
        let pixels = x.len() * y.len();
        let is_selective = light.reach.ball().is_some_and(|ball| ball.radius < SELECTIVE * self.extent);
        let mut sums = SoftSums::new(light, is_selective);
        for (tile, run) in self.runs(cell) {
            sums.scale = 1.0 / (dump.tile_samples(tile).max(1) as usize * pixels) as f32;
            for shard in dump.tile(tile) {
                let records = SampleSplit::All.run_records(shard, run.clone());
                records.for_each(|records| {
                    kernel::visit_candidates(self.gather.isa, shard, records, work, &mut sums);
                });
            }
        }
        sums.finish()
    }

    /// Cells without smoothing: means of the unit values (radiance 1) of some lights, RGB, light by light, then cell by
    /// cell.
    ///
    /// # Errors
    /// If there is no such cell.
    pub fn exact(
        &self,
        lights: &[PreparedLight],
        half: SampleSplit,
        cells: &[u32],
    ) -> Result<Vec<Vec<[f32; 3]>>, GatherError> {
        self.check_cells(cells)?;
        let (gather, half) = self.gather.split(half);
        let of_cell = |work: &mut KernelWork, &cell: &u32| {
            self.exact_cell((&gather, half), lights, cell as usize, work)
        };
        let by_cell: Vec<Vec<[f32; 3]>> = cells.par_iter().map_init(KernelWork::default, of_cell).collect();
        Ok((0..lights.len()).map(|light| by_cell.iter().map(|values| values[light]).collect()).collect())
    }

    fn exact_cell(
        &self,
        (gather, half): (&Gather, SampleSplit),
        lights: &[PreparedLight],
        cell: usize,
        work: &mut KernelWork,
    ) -> Vec<[f32; 3]> {
        let (dump, [x, y]) = (gather.dump(), self.pixels(cell));
        let mut means = vec![[0.0; 3]; lights.len()];
        for (tile, run) in self.runs(cell) {
            let mut sums = vec![[0.0; 3]; lights.len()];
            for shard in dump.tile(tile) {
                for records in half.run_records(shard, run.clone()) {
                    let mut sink = SumSink { values: &mut sums, light: 0 };
                    kernel::visit(gather.isa, shard, records, work, lights, &mut sink);
                }
            }
            let scale = 1.0 / (half.tile_samples(dump, tile).max(1) as usize * x.len() * y.len()) as f32;
            means.iter_mut().zip(sums).for_each(|(mean, sum)| add(mean, scale * Vec3::from(sum)));
        }
        means
    }
}

/// Diagonal of the box that holds the middle nine tenths of what the camera sees, axis by axis: a far
/// backdrop or a speck before the lens should not count.
fn visible_extent(gather: &Gather) -> f32 {
    /// Pixels looked at along each edge.
    const LOOKS: usize = 64;
    let (dump, manifest) = (gather.dump(), gather.dump().manifest());
    let looks = |size: usize| (0..LOOKS.min(size)).map(move |i| i * size / LOOKS.min(size));
    let mut axes = [const { Vec::new() }; 3];
    for (x, y) in looks(manifest.height).flat_map(|y| looks(manifest.width).map(move |x| (x, y))) {
        for (shard, pixel) in dump.pixel(x, y) {
            let first = shard.pixel(pixel).take(2).find_map(|record| shard.segment(record));
            if let Some(End::Vertex(vertex)) = first.map(|segment| segment.end) {
                for (axis, value) in axes.iter_mut().zip(vertex.to_array()) {
                    axis.push(value);
                }
            }
        }
    }
    let range = axes.map(|mut values| {
        values.sort_by(f32::total_cmp);
        let at = |share: usize| values.get(values.len() * share / 20).copied().unwrap_or(0.0);
        at(19) - at(1)
    });
    let (min, max) = gather.bounds;
    let extent = Vec3::from(range).length();
    // A picture of the sky alone has no size; nor has an empty dump.
    let fallback = if max.distance(min) > 0.0 { max.distance(min) } else { 1.0 };
    if extent > 1e-4 * fallback { extent } else { fallback }
}

/// Segments that wait for seven others, and what those before have added.
struct SoftSums<'a> {
    light: &'a SoftLight,
    is_selective: bool,
    /// Weight of each contribution.
    scale: f32,
    /// Where their rays begin.
    origin: [[f32; WIDTH]; 3],
    edge: [[f32; WIDTH]; 3],
    /// Metres from there to where they start.
    start: [f32; WIDTH],
    /// Throughputs as the shards hold them.
    throughput: [u32; WIDTH],
    factor: [f32; WIDTH],
    /// Factors of the light's map.
    tint: [Vec3; WIDTH],
    waiting: usize,
    outputs: [[[f32; WIDTH]; 3]; OUTPUTS],
}

impl Visitor for SoftSums<'_> {
    fn lights(&self) -> usize {
        1
    }

    fn reach(&self, _light: usize) -> &Reach {
        &self.light.reach
    }

    fn is_selective(&self) -> bool {
        self.is_selective
    }

    fn begin_block(&mut self, _first_record: usize) {}

    #[inline(always)]
    fn candidates<L: Lanes>(&mut self, shard: &Shard, block: &SegmentBlock, _light: usize, numbers: &[u16]) {
        let only_escaped = matches!(self.light.profile, SoftProfile::Sun(_));
        let (z_flags, throughput) = (shard.position_z_flags(), shard.throughput());
        for &index in numbers {
            let record = block.record(usize::from(index));
            let flags = Flags((z_flags[record] >> 16) as u16);
            let factor = self.light.exact.factor(flags) * self.scale;
            let (origin, edge) = block.segment(usize::from(index));
            if factor == 0.0 || (only_escaped && !flags.escaped()) || edge == [0.0; 3] {
                continue;
            }
            let (origin, start) = match flags.continues() {
                true => {
                    let piece = RayPiece::new(shard.ray_origin(record), origin.into(), edge.into());
                    (piece.origin.into(), piece.to_start.length())
                }
                false => (origin, 0.0),
            };
            for axis in 0..3 {
                self.origin[axis][self.waiting] = origin[axis];
                self.edge[axis][self.waiting] = edge[axis];
            }
            if let Some(map) = &self.light.exact.map {
                self.tint[self.waiting] = map.factor_near(origin.into(), edge.into());
            }
            self.start[self.waiting] = start;
            (self.throughput[self.waiting], self.factor[self.waiting]) = (throughput[record], factor);
            self.waiting += 1;
            if self.waiting == WIDTH {
                self.flush::<L>();
            }
        }
    }
}

impl<'a> SoftSums<'a> {
    fn new(light: &'a SoftLight, is_selective: bool) -> Self {
        let mut edge = [[0.0; WIDTH]; 3];
        edge[0] = [1.0; WIDTH];
        Self {
            light,
            is_selective,
            scale: 0.0,
            origin: [[0.0; WIDTH]; 3],
            edge,
            start: [0.0; WIDTH],
            throughput: [0; WIDTH],
            factor: [0.0; WIDTH],
            tint: [Vec3::ONE; WIDTH],
            waiting: 0,
            outputs: [[[0.0; WIDTH]; 3]; OUTPUTS],
        }
    }

    /// Adds what the waiting segments give.
    #[inline(always)]
    fn flush<L: Lanes>(&mut self) {
        let segments =
            Segments::<L>::new(Wide3::load(&self.origin), Wide3::load(&self.edge), Wide::load(&self.start));
        match &self.light.profile {
            SoftProfile::Sphere(ball) => {
                self.add(profile::sphere_slopes(ball, &segments), [0, 1, 2, 3, 7]);
            }
            SoftProfile::FacingDisk(ball) => {
                self.add(profile::facing_disk_slopes(ball, &segments), [0, 1, 2, 3, 7]);
            }
            SoftProfile::Spot { ball, cone, soft_falloff } => {
                let outputs = profile::spot_slopes(ball, cone, *soft_falloff, &segments);
                self.add(outputs, [0, 1, 2, 3, 4, 5, 6, 7, 9, 10]);
            }
            SoftProfile::Area(plane) => {
                self.add(profile::area_slopes(plane, &segments), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
            }
            SoftProfile::Sun(sun) => self.add(profile::sun_slopes(sun, &segments), [0, 4, 5, 6, 7]),
        }
        self.waiting = 0;
    }

    /// Adds some of the outputs of eight segments.
    #[inline(always)]
    fn add<L: Lanes, const N: usize>(&mut self, values: [Wide<L>; N], outputs: [usize; N]) {
        let mut weights = [[0.0; WIDTH]; 3];
        for (lane, (&throughput, &factor)) in self.throughput.iter().zip(&self.factor).enumerate() {
            let weight = decode_rgb9e5(throughput) * factor * self.tint[lane];
            (weights[0][lane], weights[1][lane], weights[2][lane]) = (weight.x, weight.y, weight.z);
        }
        let [red, green, blue] = &weights;
        let (red, green, blue) = (Wide::load(red), Wide::load(green), Wide::load(blue));
        for i in 0..N {
            let sums = &mut self.outputs[outputs[i]];
            values[i].add_scaled_to(red, &mut sums[0]);
            values[i].add_scaled_to(green, &mut sums[1]);
            values[i].add_scaled_to(blue, &mut sums[2]);
        }
    }

    /// The sums over all segments.
    fn finish(mut self) -> [[f32; 3]; OUTPUTS] {
        self.factor[self.waiting..].fill(0.0);
        self.flush::<Portable>();
        self.outputs.map(|rgb| rgb.map(|lanes| lanes.iter().sum()))
    }
}
