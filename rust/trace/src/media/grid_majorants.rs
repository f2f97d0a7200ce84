//! Bounds of the extinction of media whose grids are known, brick by brick.

use glam::{Affine3A, BVec3, IVec3, UVec3, Vec3, Vec4};
use rayon::prelude::*;
use relume_scene::{Bricks, Grid, GridBounds, STILL};

use super::majorant::MajorantGrid;
use super::{Bounds, MediaSpace, Medium, MediumSample};
use crate::shading::{MediumPoint, RayInfo};

/// Voxels along an edge of a brick.
const BRICK: f32 = 8.0;
/// Cells that bounds have at most: where there are more bricks, some make up a cell.
const MOST_CELLS: u64 = 1 << 21;
/// Values between the bounds of a cell at which the medium is looked at: of the grid of most bricks, and of others.
const VALUES: [usize; 2] = [9, 3];
/// Points of a cell at which it is looked at, if it depends on more than grids.
const POINTS: usize = 8;
/// Factor between what was found and the bound, where what is between need not be less.
const MARGIN: f32 = 1.25;
/// The same where it is less but for roundings.
const ROUNDING: f32 = 1.0 + 1e-5;

/// A grid that a medium reads.
struct Source {
    name: usize,
    bounds: GridBounds,
    /// Bricks of the grid from cells.
    bricks_from_cells: Affine3A,
    /// Bricks by which values move.
    reach: Vec3,
}

/// Bounds of a medium in an object with grids; nothing if it reads none of them.
pub(super) fn of_grids(space: &MediaSpace, medium: &Medium) -> Option<MajorantGrid> {
    let instance = space.scene.instances.get(medium.instance as usize)?;
    let graph = space.materials.graph(medium.material);
    let mut names = graph.medium_fields();
    names.sort_unstable();
    names.dedup();
    let known = |name: usize| Some((name, space.materials.grid(space.scene, medium.instance, name)?));
    let mut found: Vec<(usize, &Grid)> = names.into_iter().filter_map(known).collect();
    // The one of most bricks gives the cells.
    found.sort_by_key(|(_, grid)| std::cmp::Reverse(grid.slots.len()));
    let finest = found.first()?.1;
    let bricks_from_object =
        Affine3A::from_scale(Vec3::splat(1.0 / BRICK)) * finest.object_from_index.inverse();
    let hull = Bounds::of_geometry(space.scene, instance.geometry).corners();
    let (cells, edge) = cells_around(hull, bricks_from_object);
    let object_from_cells = bricks_from_object.inverse()
        * Affine3A::from_translation(cells.origin.as_vec3())
        * Affine3A::from_scale(Vec3::splat(edge as f32));
    let reach = instance.grids.map_or(Vec3::ZERO, |set| space.scene.grids[set].reach());
    let source = |(name, grid): (usize, &Grid)| {
        let bricks_from_object =
            Affine3A::from_scale(Vec3::splat(1.0 / BRICK)) * grid.object_from_index.inverse();
        Source {
            name,
            bounds: grid.bounds(),
            bricks_from_cells: bricks_from_object * object_from_cells,
            reach: bricks_from_object.matrix3.abs() * reach,
        }
    };
    let sources: Vec<Source> = found.into_iter().map(source).collect();
    let local_from_world =
        object_from_cells.inverse() * space.materials.object_from_world(medium.instance, STILL);
    let finder = Finder {
        space,
        medium,
        rays: &medium.rays(),
        world_from_cells: local_from_world.inverse(),
        sources: &sources,
        varies: graph.medium_varies(),
        margin: if graph.medium_computes() { MARGIN } else { ROUNDING },
    };
    let bounds =
        (0..cells.counts.element_product()).into_par_iter().map(|cell| finder.bound(cells.counts, cell));
    Some(MajorantGrid::new(local_from_world, cells.counts.as_ivec3(), bounds.collect()))
}

/// Cells that cover a box of object space: the brick where they begin, how many they are, and bricks along their edges.
fn cells_around([low, high]: [Vec3; 2], bricks_from_object: Affine3A) -> (Bricks, u32) {
    let corner = |number: u32| {
        let is_high = BVec3::new(number & 1 != 0, number & 2 != 0, number & 4 != 0);
        bricks_from_object.transform_point3(Vec3::select(is_high, high, low))
    };
    let corners = (0..8).map(corner);
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), corner| {
        (low.min(corner), high.max(corner))
    });
    let (origin, end) = (low.floor().as_ivec3(), high.ceil().as_ivec3());
    let bricks = (end - origin).max(IVec3::ONE).as_uvec3();
    let cells = |edge: u32| (bricks + (edge - 1)) / edge;
    let count = |cells: UVec3| cells.to_array().into_iter().map(u64::from).product::<u64>();
    let edge = (1..).find(|edge| count(cells(*edge)) <= MOST_CELLS).unwrap_or(1);
    (Bricks { origin, counts: cells(edge) }, edge)
}

/// Finds the bounds of cells.
struct Finder<'a> {
    space: &'a MediaSpace<'a>,
    medium: &'a Medium,
    /// Rays by which it is looked at.
    rays: &'a [RayInfo],
    world_from_cells: Affine3A,
    sources: &'a [Source],
    /// True if the medium depends on more than grids.
    varies: bool,
    margin: f32,
}

impl Finder<'_> {
    fn bound(&self, counts: UVec3, cell: u32) -> f32 {
        let place =
            UVec3::new(cell % counts.x, cell / counts.x % counts.y, cell / (counts.x * counts.y)).as_vec3();
        let ranges: Vec<[f32; 2]> = self.sources.iter().map(|source| source.range(place)).collect();
        let points = if self.varies { POINTS } else { 1 };
        let at = |point: usize| {
            // Additive recurrence (Roberts 2018), shifted from cell to cell.
            let step = |step: f32| (0.5 + step * point as f32 + cell as f32 * 0.618_034).fract();
            let offset = Vec3::new(step(0.754_877_7), step(0.569_840_3), step(0.430_159_7));
            self.most_at(self.world_from_cells.transform_point3(place + offset), &ranges)
        };
        self.margin * (0..points).map(at).fold(0.0, f32::max)
    }

    /// The largest extinction at a position, whatever the grids have there within ranges.
    fn most_at(&self, position: Vec3, ranges: &[[f32; 2]]) -> f32 {
        let counts = ranges
            .iter()
            .enumerate()
            .map(|(number, [low, high])| if low == high { 1 } else { VALUES[number.min(VALUES.len() - 1)] });
        let counts: Vec<usize> = counts.collect();
        let (instance, time) = (self.medium.instance, STILL);
        let (mut values, mut sample) = (Vec::new(), MediumSample::default());
        let mut most = 0.0_f32;
        for mut combination in 0..counts.iter().product() {
            let mut assume = |(source, ([low, high], count)): (&Source, (&[f32; 2], &usize))| {
                let share = (combination % count) as f32 / (count - 1).max(1) as f32;
                combination /= count;
                (source.name, Vec3::splat(low + (high - low) * share).extend(1.0))
            };
            let known = self.sources.iter().zip(ranges.iter().zip(&counts));
            let assumed: Vec<(usize, Vec4)> = known.map(&mut assume).collect();
            let (scene, material) = (self.space.scene, self.medium.material);
            for ray in self.rays {
                let point = MediumPoint { position, wo: Vec3::Z, instance, time, ray: *ray };
                sample.clear();
                let materials = self.space.materials;
                materials.evaluate_medium(scene, material, &point, &assumed, &mut values, &mut sample);
                most = most.max(sample.extinction.max_element());
            }
        }
        most
    }
}

impl Source {
    /// Bounds of the grid in the cell with this lowest corner.
    fn range(&self, cell: Vec3) -> [f32; 2] {
        /// Share of a brick by which a cell may reach into the next by rounding.
        const SLACK: f32 = 1e-3;
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for corner in 0..8 {
            let step = Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32);
            let corner = self.bricks_from_cells.transform_point3(cell + step);
            (low, high) = (low.min(corner), high.max(corner));
        }
        let first = (low - self.reach + SLACK).floor().as_ivec3();
        let last = (high + self.reach - SLACK).floor().as_ivec3().max(first);
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for x in first.x..=last.x {
            for y in first.y..=last.y {
                for z in first.z..=last.z {
                    let [least, most] = self.bounds.range(IVec3::new(x, y, z));
                    range = [range[0].min(least), range[1].max(most)];
                }
            }
        }
        range
    }
}
