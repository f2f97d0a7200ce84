use super::{BRICK, BRICK_VOXELS, Bricks, Grid, check_size};
use glam::{Affine3A, IVec3, UVec3, Vec3};

/// A box full of voxels, as smoke simulations have them. Outside is 0.
#[derive(Clone, Copy, Debug)]
pub struct DenseGrid<'a> {
    /// Name by which shaders ask for it.
    pub name: &'a str,
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Numbers of a voxel, as of [`Grid::channels`].
    pub channels: usize,
    /// Numbers of voxels, those of a voxel side by side, voxels along x first, then y.
    pub values: &'a [f32],
    /// Transform of positions in voxels to object space.
    pub object_from_index: Affine3A,
}

impl DenseGrid<'_> {
    /// Transform of voxels that fill a box between its lowest and highest corner: their centres are half a voxel from its faces.
    pub fn place(size: [usize; 3], [low, high]: [Vec3; 2]) -> Affine3A {
        let voxel = (high - low) / Vec3::from_array(size.map(|edge| edge as f32));
        Affine3A::from_translation(low + 0.5 * voxel) * Affine3A::from_scale(voxel)
    }

    /// The grid in bricks. A voxel whose numbers are all at most `clipping` becomes 0. Fails in words if its parts do not fit or it is
    /// too large.
    pub fn to_grid(&self, clipping: f32) -> Result<Grid, String> {
        let [x, y, z] = self.size;
        let voxels = x.checked_mul(y).and_then(|voxels| voxels.checked_mul(z));
        let numbers = voxels.and_then(|voxels| voxels.checked_mul(self.channels));
        if numbers != Some(self.values.len()) || self.values.is_empty() {
            let (name, found) = (self.name, self.values.len());
            return Err(format!("grid '{name}': {found} numbers do not make {x} x {y} x {z} voxels"));
        }
        let counts = self.size.map(|edge| u32::try_from(edge.div_ceil(BRICK)).unwrap_or(u32::MAX));
        let bricks = Bricks { origin: IVec3::ZERO, counts: UVec3::from_array(counts) };
        let too_large = |reason| format!("grid '{}': {reason}", self.name);
        check_size(&bricks, 1 + bricks.len(), self.channels).map_err(too_large)?;
        let mut grid = Grid {
            name: self.name.to_owned(),
            channels: self.channels,
            object_from_index: self.object_from_index,
            bricks,
            active: None,
            slots: vec![0; bricks.len()],
            values: vec![0.0; BRICK_VOXELS * self.channels],
        };
        for number in 0..bricks.len() {
            self.add_brick(&mut grid, number, clipping);
        }
        Ok(grid)
    }

    fn add_brick(&self, grid: &mut Grid, number: usize, clipping: f32) {
        let [_, y, z] = grid.bricks.counts.to_array().map(|count| count as usize);
        let brick = [number / (y * z), number / z % y, number % z];
        let start = grid.values.len();
        let mut active = [false; BRICK_VOXELS];
        for (place, is_active) in active.iter_mut().enumerate() {
            let step = [place / (BRICK * BRICK), place / BRICK % BRICK, place % BRICK];
            let voxel: [usize; 3] = std::array::from_fn(|axis| brick[axis] * BRICK + step[axis]);
            let is_clipped = |value: &f32| value.abs() <= clipping;
            let numbers = self.voxel(voxel).filter(|numbers| !numbers.iter().all(is_clipped));
            *is_active = numbers.is_some();
            match numbers {
                Some(numbers) => grid.values.extend_from_slice(numbers),
                None => grid.values.resize(grid.values.len() + self.channels, 0.0),
            }
        }
        if active.contains(&true) {
            grid.slots[number] = (start / (BRICK_VOXELS * self.channels)) as u32;
            grid.include_active(IVec3::from_array(brick.map(|step| step as i32)), |place| active[place]);
        } else {
            grid.values.truncate(start);
        }
    }

    fn voxel(&self, [x, y, z]: [usize; 3]) -> Option<&[f32]> {
        let is_inside = [x, y, z].iter().zip(self.size).all(|(place, edge)| *place < edge);
        let place = (z * self.size[1] + y) * self.size[0] + x;
        is_inside.then(|| &self.values[place * self.channels..][..self.channels])
    }
}
