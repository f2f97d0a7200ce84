use rayon::prelude::*;

use crate::GridConfig;
use crate::params::{ParamLayout, TensorId};
use crate::simd::LANES;

/// Multiresolution hash grid over the image (Mueller et al. 2022, "Instant Neural Graphics Primitives with a
/// Multiresolution Hash Encoding"). Levels that fit their table are stored densely.
#[derive(Clone, Debug)]
pub(crate) struct HashGrid {
    levels: Vec<Level>,
    features: usize,
    width: usize,
    height: usize,
}

#[derive(Clone, Debug)]
struct Level {
    tensor: TensorId,
    /// Cells per unit of the longer side.
    resolution: f32,
    /// Grid points along x.
    columns: u32,
    /// Entries of the table minus one if hashed.
    hash_mask: Option<u32>,
}

/// `Level` of `shaders/proxy/grid.wgsl`, where the fields are described.
#[derive(Clone, Copy, Debug, bytemuck::NoUninit)]
#[repr(C)]
pub(crate) struct DeviceLevel {
    pub table: u32,
    pub resolution: f32,
    pub columns: u32,
    pub hash_mask: u32,
}

impl HashGrid {
    /// Adds the levels for an image of this size.
    pub fn new(layout: &mut ParamLayout, config: &GridConfig, width: usize, height: usize) -> Self {
        let longer = width.max(height);
        let base = config.base_resolution as f32;
        let finest = (longer as f32 * config.finest_cells_per_pixel).max(base);
        let growth = (finest / base).powf(1.0 / (config.levels.max(2) - 1) as f32);
        let levels = (0..config.levels).map(|level| {
            let resolution = (base * growth.powi(level as i32)).round();
            let points = |side: usize| (side as f32 / longer as f32 * resolution).ceil() as usize + 1;
            let (columns, rows) = (points(width), points(height));
            let table = 1usize << config.log2_hashmap_size;
            let hashed = columns * rows > table;
            let entries = if hashed { table } else { columns * rows };
            Level {
                tensor: layout.grid(&format!("grid.{level}"), entries, config.features_per_level),
                resolution,
                columns: columns as u32,
                hash_mask: hashed.then_some(table as u32 - 1),
            }
        });
        Self { levels: levels.collect(), features: config.features_per_level, width, height }
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Width and height of the image.
    pub fn image(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Levels as kernels take them.
    pub fn device_levels(&self, layout: &ParamLayout) -> Vec<DeviceLevel> {
        let device_level = |level: &Level| DeviceLevel {
            table: layout.tensors[level.tensor].start as u32,
            resolution: level.resolution,
            columns: level.columns,
            hash_mask: level.hash_mask.unwrap_or(0),
        };
        self.levels.iter().map(device_level).collect()
    }

    /// Values of an encoded pixel.
    pub fn outputs(&self) -> usize {
        self.levels.len() * self.features
    }

    /// Encodes the pixels of one tile into its first [`HashGrid::outputs`] rows.
    pub fn encode(&self, layout: &ParamLayout, params: &[f32], pixels: &[u32], out: &mut [f32]) {
        for (index, level) in self.levels.iter().enumerate() {
            let table = layout.slice(params, level.tensor);
            let rows = &mut out[index * self.features * LANES..(index + 1) * self.features * LANES];
            for (lane, &pixel) in pixels.iter().enumerate() {
                let corners = self.corners(level, pixel);
                for feature in 0..self.features {
                    let value =
                        |(entry, weight): (usize, f32)| weight * table[entry * self.features + feature];
                    rows[feature * LANES + lane] = corners.into_iter().map(value).sum();
                }
            }
        }
    }

    /// Adds the gradient by the entries to `grads`, from tiles `[features][LANES]` of gradients by the encoded pixels,
    /// one tile for every 32 pixels. Each level is summed in the order of the pixels by one thread.
    pub fn backward(&self, layout: &ParamLayout, pixels: &[u32], d_encoded: &[f32], grads: &mut [f32]) {
        let rows = d_encoded.len() / pixels.len().max(1);
        let mut rest = grads;
        let mut offset = 0;
        let mut tables = Vec::with_capacity(self.levels.len());
        for level in &self.levels {
            let range = layout.tensors[level.tensor].range();
            let (_, at) = rest.split_at_mut(range.start - offset);
            let (table, after) = at.split_at_mut(range.len());
            tables.push(table);
            offset = range.end;
            rest = after;
        }
        self.levels.par_iter().zip(tables).enumerate().for_each(|(index, (level, table))| {
            for (pixels, tile) in pixels.chunks(LANES).zip(d_encoded.chunks(rows * LANES)) {
                let tile = &tile[index * self.features * LANES..];
                for (lane, &pixel) in pixels.iter().enumerate() {
                    for (entry, weight) in self.corners(level, pixel) {
                        for feature in 0..self.features {
                            table[entry * self.features + feature] += weight * tile[feature * LANES + lane];
                        }
                    }
                }
            }
        });
    }

    /// The four grid points around a pixel's centre and their bilinear weights.
    #[inline]
    fn corners(&self, level: &Level, pixel: u32) -> [(usize, f32); 4] {
        let longer = self.width.max(self.height) as f32;
        let (x, y) = (pixel as usize % self.width, pixel as usize / self.width);
        let u = (x as f32 + 0.5) / longer * level.resolution;
        let v = (y as f32 + 0.5) / longer * level.resolution;
        let (column, row) = (u as u32, v as u32);
        let (fu, fv) = (u - column as f32, v - row as f32);
        let entry = |column: u32, row: u32| match level.hash_mask {
            // The primes are those of the paper; the first is 1.
            Some(mask) => ((column ^ row.wrapping_mul(2_654_435_761)) & mask) as usize,
            None => (row * level.columns + column) as usize,
        };
        [
            (entry(column, row), (1.0 - fu) * (1.0 - fv)),
            (entry(column + 1, row), fu * (1.0 - fv)),
            (entry(column, row + 1), (1.0 - fu) * fv),
            (entry(column + 1, row + 1), fu * fv),
        ]
    }
}
