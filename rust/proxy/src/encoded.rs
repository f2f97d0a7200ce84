use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use crate::simd::LANES;

/// All pixels as [`crate::network::Network::encode_pixels`] leaves them, tile after tile. The first rows of a tile are
/// kept in 16 bits, which halves the memory.
pub(crate) struct EncodedTiles {
    /// Rows of a tile in 16 bits and in 32.
    rows: [usize; 2],
    half: Vec<f16>,
    full: Vec<f32>,
}

impl EncodedTiles {
    /// Tiles of as many rows as `encode` writes, which gets the tile's number.
    pub fn new(tiles: usize, rows: [usize; 2], encode: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let [half_len, full_len] = rows.map(|rows| rows * LANES);
        let (mut half, mut full) = (vec![f16::ZERO; tiles * half_len], vec![0.0; tiles * full_len]);
        // A tile without rows in 32 bits has empty chunks there, which `chunks_mut` does not make.
        let fulls: Vec<&mut [f32]> = match full_len {
            0 => (0..tiles).map(|_| Default::default()).collect(),
            _ => full.chunks_mut(full_len).collect(),
        };
        half.par_chunks_mut(half_len).zip(fulls).enumerate().for_each_init(
            || vec![0.0; half_len + full_len],
            |tile_rows, (tile, (half, full))| {
                encode(tile, tile_rows);
                half.convert_from_f32_slice(&tile_rows[..half_len]);
                full.copy_from_slice(&tile_rows[half_len..]);
            },
        );
        Self { rows, half, full }
    }

    /// Writes the rows of a tile.
    pub fn expand(&self, tile: usize, out: &mut [f32]) {
        let [half_len, full_len] = self.rows.map(|rows| rows * LANES);
        let (half, full) = out.split_at_mut(half_len);
        self.half[tile * half_len..][..half_len].convert_to_f32_slice(half);
        full.copy_from_slice(&self.full[tile * full_len..][..full_len]);
    }

    /// Writes the rows of some pixels as one tile; lanes past the last pixel repeat it.
    pub fn collect(&self, pixels: &[u32], out: &mut [f32]) {
        for lane in 0..LANES {
            let pixel = pixels[lane.min(pixels.len() - 1)] as usize;
            for (row, value) in self.pixel(pixel).enumerate() {
                out[row * LANES + lane] = value;
            }
        }
    }

    /// Rows of a pixel.
    pub fn pixel(&self, pixel: usize) -> impl Iterator<Item = f32> {
        let (tile, lane) = (pixel / LANES, pixel % LANES);
        let [half_rows, full_rows] = self.rows;
        let half = (0..half_rows).map(move |row| self.half[(tile * half_rows + row) * LANES + lane].to_f32());
        half.chain((0..full_rows).map(move |row| self.full[(tile * full_rows + row) * LANES + lane]))
    }

    /// Some tiles one after the other, all rows in 32 bits.
    pub fn tiles(&self, tiles: std::ops::Range<usize>) -> Vec<f32> {
        let len = (self.rows[0] + self.rows[1]) * LANES;
        let mut values = vec![0.0; tiles.len() * len];
        values.chunks_exact_mut(len).zip(tiles).for_each(|(out, tile)| self.expand(tile, out));
        values
    }
}
