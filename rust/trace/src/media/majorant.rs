//! Bounds of the extinction of media that vary from place to place, cell by cell of a grid.

use glam::{Affine3A, IVec3, UVec3, Vec3};

/// Cells along the longest edge of a grid whose medium is only known at points.
const CELLS: f32 = 20.0;
/// Points of a cell at which the medium is looked at, first.
const POINTS: usize = 8;
/// Factor between what was found in a cell and around it, and its bound.
const MARGIN: f32 = 1.25;
/// Rounds in which bounds are compared with the medium at new points and raised.
const MOST_ROUNDS: usize = 6;

/// Bounds of the largest channel of a medium's extinction, per metre, over a box.
#[derive(Clone, Debug)]
pub(crate) struct MajorantGrid {
    grid_from_world: Affine3A,
    size: IVec3,
    cells: Vec<f32>,
    /// Bound outside of the box.
    outside: f32,
}

/// A ray in a grid's own coordinates, in which a cell has an edge of 1. Distances stay those of the world.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct GridRay {
    origin: Vec3,
    direction: Vec3,
}

impl MajorantGrid {
    /// Bounds of a medium whose `extinction` is known at points of the box from `min` to `max` in the space that `local_from_world`
    /// leads to. They are found at points, so that peaks that are narrower than a cell can be cut; from what is between
    /// the points of the first round, later rounds take new ones and raise all bounds by as much as one was exceeded.
    pub fn sampled(
        local_from_world: Affine3A,
        [min, max]: [Vec3; 2],
        is_bounded: bool,
        extinction: impl Fn(Vec3) -> f32,
    ) -> Self {
        let extent = (max - min).max(Vec3::splat(1e-6 * (max - min).max_element().max(1e-30)));
        let size = (extent / extent.max_element() * CELLS).ceil().as_ivec3().max(IVec3::ONE);
        let world_from_local = local_from_world.inverse();
        let at = |cell: usize, point: usize| {
            let corner = Self::corner(size, cell);
            let offset = Vec3::from([0.754_877_7, 0.569_840_3, 0.430_159_7].map(|step: f32| {
                // Additive recurrence (Roberts 2018), shifted from cell to cell.
                (0.5 + step * (point as f32 + 1.0) + cell as f32 * 0.618_034).fract()
            }));
            let local = min + (corner.as_vec3() + offset) / size.as_vec3() * extent;
            extinction(world_from_local.transform_point3(local))
        };
        let most_at = |first: usize| {
            // Not in parallel: who waits for the bounds may be a worker whose turn would never come.
            let most = |cell| (first..first + POINTS).map(|point| at(cell, point)).fold(0.0, f32::max);
            (0..(size.x * size.y * size.z) as usize).map(most).collect::<Vec<f32>>()
        };
        let mut found = most_at(0);
        let mut bounds = around(size, &found, MARGIN);
        for round in 1..MOST_ROUNDS {
            let more = most_at(round * POINTS);
            let excess =
                more.iter().zip(&bounds).map(|(more, bound)| excess(*more, *bound)).fold(1.0, f32::max);
            if excess == 1.0 {
                break;
            }
            found.iter_mut().zip(more).for_each(|(known, more)| *known = known.max(more));
            bounds = around(size, &found, MARGIN * excess.min(2.0));
        }
        let outside = if is_bounded { 0.0 } else { bounds.iter().copied().fold(0.0, f32::max) };
        let scale = size.as_vec3() / extent;
        let grid_from_local = Affine3A::from_scale(scale) * Affine3A::from_translation(-min);
        Self { grid_from_world: grid_from_local * local_from_world, size, cells: bounds, outside }
    }

    /// A bound that holds everywhere.
    pub fn even(bound: f32) -> Self {
        Self { grid_from_world: Affine3A::IDENTITY, size: IVec3::ZERO, cells: Vec::new(), outside: bound }
    }

    /// Bounds of cells of edge 1 from the origin of the space that `grid_from_world` leads to, along x first; nothing is outside.
    pub fn new(grid_from_world: Affine3A, size: IVec3, cells: Vec<f32>) -> Self {
        Self { grid_from_world, size, cells, outside: 0.0 }
    }

    fn corner(size: IVec3, cell: usize) -> UVec3 {
        let (x, y) = (size.x as usize, size.y as usize);
        UVec3::new((cell % x) as u32, (cell / x % y) as u32, (cell / (x * y)) as u32)
    }

    /// A ray from the world, in this grid's coordinates.
    pub fn ray(&self, origin: Vec3, direction: Vec3) -> GridRay {
        GridRay {
            origin: self.grid_from_world.transform_point3(origin),
            direction: self.grid_from_world.transform_vector3(direction),
        }
    }

    /// Bound at a distance along a ray, and up to where it holds.
    pub fn span(&self, ray: &GridRay, distance: f32) -> (f32, f32) {
        if self.cells.is_empty() {
            return (self.outside, f32::INFINITY);
        }
        let at = ray.origin + ray.direction * distance;
        let size = self.size.as_vec3();
        // Hulls are met a rounding outside of their box.
        let is_inside = at.cmpge(Vec3::splat(-1e-3)).all() && at.cmple(size + 1e-3).all();
        let bounds = |from: Vec3, to: Vec3| {
            let far = Vec3::select(ray.direction.cmpgt(Vec3::ZERO), to, from);
            let exits = (far - ray.origin) / ray.direction;
            let exits = Vec3::select(ray.direction.cmpeq(Vec3::ZERO), Vec3::INFINITY, exits);
            exits.min_element()
        };
        if !is_inside {
            let near = Vec3::select(ray.direction.cmpgt(Vec3::ZERO), Vec3::ZERO, size);
            let entries = (near - ray.origin) / ray.direction;
            let entries = Vec3::select(ray.direction.cmpeq(Vec3::ZERO), Vec3::NEG_INFINITY, entries);
            let (entry, exit) = (entries.max_element(), bounds(Vec3::ZERO, size));
            let reaches = entry < exit && entry > distance;
            return (self.outside, if reaches { entry } else { f32::INFINITY });
        }
        let cell = at.floor().as_ivec3().clamp(IVec3::ZERO, self.size - 1);
        let index = cell.x + self.size.x * (cell.y + self.size.y * cell.z);
        // At a rounding before the next cell there has to be progress.
        let exit =
            bounds(cell.as_vec3(), cell.as_vec3() + 1.0).max(distance * (1.0 + 4.0 * f32::EPSILON) + 1e-9);
        (self.cells[index as usize], exit)
    }
}

/// By how much a value is above its bound.
fn excess(value: f32, bound: f32) -> f32 {
    if value <= bound {
        1.0
    } else if bound > 0.0 {
        value / bound
    } else {
        2.0
    }
}

/// The largest value of each cell and its neighbours, times `margin`.
fn around(size: IVec3, found: &[f32], margin: f32) -> Vec<f32> {
    let index = |cell: IVec3| (cell.x + size.x * (cell.y + size.y * cell.z)) as usize;
    let largest = |number: usize| {
        let cell = MajorantGrid::corner(size, number).as_ivec3();
        let (low, high) = ((cell - 1).max(IVec3::ZERO), (cell + 1).min(size - 1));
        let mut most = 0.0_f32;
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    most = most.max(found[index(IVec3::new(x, y, z))]);
                }
            }
        }
        most * margin
    };
    (0..found.len()).map(largest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bumps(at: Vec3) -> f32 {
        ((3.0 * at.x).sin() * (5.0 * at.y).cos()).max(0.0) * (1.0 + at.z)
    }

    fn local_from_world() -> Affine3A {
        Affine3A::from_rotation_z(0.4) * Affine3A::from_scale(Vec3::new(2.0, 1.0, 0.5))
    }

    fn grid() -> MajorantGrid {
        let bounds = [Vec3::new(-1.0, 0.0, 0.0), Vec3::new(1.0, 3.0, 1.0)];
        let bumps_at = |at| bumps(local_from_world().transform_point3(at));
        MajorantGrid::sampled(local_from_world(), bounds, true, bumps_at)
    }

    #[test]
    fn bounds_hold_between_the_points_that_they_were_found_at() {
        let grid = grid();
        let world_from_local = local_from_world().inverse();
        for i in 0..20_000 {
            let step = i as f32;
            let unit = Vec3::new((step * 0.7548).fract(), (step * 0.5698).fract(), (step * 0.43).fract());
            let local = Vec3::new(-1.0, 0.0, 0.0) + unit * Vec3::new(2.0, 3.0, 1.0);
            let ray = grid.ray(world_from_local.transform_point3(local), Vec3::X);
            assert!(grid.span(&ray, 0.0).0 >= bumps(local), "{local}");
        }
    }

    #[test]
    fn spans_follow_each_other_through_the_box() {
        let grid = grid();
        let ray = grid.ray(Vec3::new(-3.0, -1.0, 0.1), Vec3::new(0.8, 0.55, 0.2).normalize());
        let (mut distance, mut spans) = (0.0, 0);
        while distance < 100.0 && spans < 1000 {
            let (bound, exit) = grid.span(&ray, distance);
            assert!(exit > distance && bound >= 0.0);
            distance = exit;
            spans += 1;
        }
        assert!(spans > 10 && spans < 100, "{spans}");
    }
}
