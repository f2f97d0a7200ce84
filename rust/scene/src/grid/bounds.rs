use super::look_up::shown;
use super::{BRICK, Bricks, Grid};
use glam::IVec3;
use rayon::prelude::*;

/// Bounds of what look-ups give, brick by brick: what a majorant is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct GridBounds {
    /// Bricks of the grid and one more on each side. Brick B is of positions from 8 B to 8 B + 8, in voxels; elsewhere is background.
    pub bricks: Bricks,
    /// Least and greatest channel of any value, one a brick; along z first, then y.
    pub ranges: Vec<[f32; 2]>,
    /// Least and greatest channel of the background.
    pub background: [f32; 2],
}

impl GridBounds {
    /// Bounds in a brick.
    pub fn range(&self, brick: IVec3) -> [f32; 2] {
        if self.bricks.contains(brick) { self.ranges[self.bricks.index(brick)] } else { self.background }
    }
}

impl Grid {
    /// Bounds of look-ups of either interpolation. Both are means of voxels with weights of at least 0, so voxels bound them.
    pub fn bounds(&self) -> GridBounds {
        let bricks = Bricks { origin: self.bricks.origin - 1, counts: self.bricks.counts + 2 };
        let [_, y, z] = bricks.counts.to_array().map(|count| count as usize);
        let range = |number: usize| {
            let place = [number / (y * z), number / z % y, number % z].map(|step| step as i32);
            self.range_of(bricks.origin + IVec3::from_array(place))
        };
        let ranges = (0..bricks.len()).into_par_iter().map(range).collect();
        let far = self.bricks.origin * BRICK as i32 - 1;
        GridBounds { bricks, ranges, background: self.range_of_voxels(far, far) }
    }

    fn range_of(&self, brick: IVec3) -> [f32; 2] {
        let slot = |offset: IVec3| {
            let brick = brick + offset;
            if self.bricks.contains(brick) { self.slots[self.bricks.index(brick)] } else { 0 }
        };
        let first = slot(IVec3::ZERO);
        let around = |number: i32| IVec3::new(number / 9, number / 3 % 3, number % 3) - 1;
        let low = brick * BRICK as i32;
        // Bricks that share their memory are all of one value.
        if (0..27).all(|number| slot(around(number)) == first) {
            return self.range_of_voxels(low, low);
        }
        // Cubic look-ups reach one voxel below and two beyond the last.
        self.range_of_voxels(low - 1, low + BRICK as i32 + 1)
    }

    /// Range of the channels of a box of voxels.
    fn range_of_voxels(&self, low: IVec3, high: IVec3) -> [f32; 2] {
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    let value = shown(self.voxel(IVec3::new(x, y, z)), self.channels);
                    range = [range[0].min(value.min_element()), range[1].max(value.max_element())];
                }
            }
        }
        range
    }
}
