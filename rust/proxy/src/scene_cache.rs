use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::PixelFeatures;
use crate::analytic::{EightLanes, PixelSurface};
use crate::simd::LANES;

/// Normalisation of pixel features and light parameters to the range of a network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Normalisation {
    /// Centre of the visible positions, metres.
    pub center: [f32; 3],
    /// Half the diagonal of their box, metres.
    pub scale: f32,
    /// Mean depth of the pixels that hit something, metres.
    pub depth: f32,
}

impl Normalisation {
    /// Normalisation from the visible positions and depths.
    pub fn of(features: &PixelFeatures) -> Self {
        let (low, high) = features.visible_bounds();
        let hits = features.depth.iter().filter(|d| **d > 0.0);
        let (sum, count) = hits.fold((0.0f64, 0usize), |(sum, n), d| (sum + f64::from(*d), n + 1));
        Self {
            center: ((low + high) * 0.5).to_array(),
            scale: (high - low).length().mul_add(0.5, 1e-6),
            depth: if count > 0 { (sum / count as f64) as f32 } else { 1.0 },
        }
    }
}

/// Inputs of a network that come straight from the pixel: albedo (3), normal (3), depth, then position (3) and wo (3).
pub(crate) const AUX: usize = 13;
/// Number of these features that the paper has: albedo, normal, depth.
pub(crate) const AUX_PAPER: usize = 7;
/// Rows of a tile of surfaces: position, normal, mirror direction, factor on the fast network's output.
pub(crate) const SURFACE: usize = 12;
/// First row of that factor.
pub(crate) const FACTOR: usize = 9;
/// Values of a pixel: what enters the networks, then its surface; as in `train/store.wgsl`.
pub(crate) const PIXEL_ROW: usize = AUX + SURFACE;
/// Added to the albedo in that factor, for what black surfaces mirror.
const MIRRORED: f32 = 0.1;

/// Pixel features as the networks read them.
#[derive(Clone, Debug)]
pub(crate) struct SceneCache {
    pub normalisation: Normalisation,
    rows: Vec<[f32; PIXEL_ROW]>,
}

impl SceneCache {
    /// Normalises all pixels.
    pub fn new(features: &PixelFeatures, normalisation: Normalisation) -> Self {
        let row = |i| pixel_row(features, &normalisation, i);
        Self { normalisation, rows: (0..features.pixel_count()).map(row).collect() }
    }

    /// Features of some pixels, for the device.
    pub fn rows(&self, pixels: &[u32]) -> Vec<[f32; PIXEL_ROW]> {
        pixels.iter().map(|&pixel| self.rows[pixel as usize]).collect()
    }

    /// Writes the first `rows` aux inputs of some pixels into a tile.
    pub fn aux_tile(&self, pixels: &[u32], rows: usize, out: &mut [f32]) {
        for (lane, &pixel) in pixels.iter().enumerate() {
            for (row, value) in self.rows[pixel as usize][..rows].iter().enumerate() {
                out[row * LANES + lane] = *value;
            }
        }
    }

    /// Writes the surfaces of some pixels into a tile of [`SURFACE`] rows.
    pub fn surface_tile(&self, pixels: &[u32], out: &mut [f32]) {
        for (lane, &pixel) in pixels.iter().enumerate() {
            for (row, value) in self.rows[pixel as usize][AUX..].iter().enumerate() {
                out[row * LANES + lane] = *value;
            }
        }
    }
}

/// Eight lanes of a tile of surfaces.
#[inline(always)]
pub(crate) fn surface_lanes(tile: &[f32], lane: usize) -> PixelSurface<EightLanes> {
    let row = |row: usize| {
        let mut lanes = [0.0; 8];
        lanes.copy_from_slice(&tile[row * LANES + lane..row * LANES + lane + 8]);
        EightLanes(lanes)
    };
    PixelSurface {
        position: [row(0), row(1), row(2)],
        normal: [row(3), row(4), row(5)],
        mirror: [row(6), row(7), row(8)],
    }
}

fn pixel_row(features: &PixelFeatures, n: &Normalisation, i: usize) -> [f32; PIXEL_ROW] {
    let normal = Vec3::from(features.normal[i]);
    let wo = Vec3::from(features.wo[i]);
    let position = (Vec3::from(features.position[i]) - Vec3::from(n.center)) / n.scale;
    let mirror = if normal == Vec3::ZERO { -wo } else { 2.0 * normal.dot(wo) * normal - wo };
    let depth = features.depth[i].max(0.0);
    let mut row = [0.0; PIXEL_ROW];
    let (aux, surface) = row.split_at_mut(AUX);
    aux[..3].copy_from_slice(&features.albedo[i]);
    aux[3..6].copy_from_slice(&features.normal[i]);
    aux[6] = depth / (depth + n.depth);
    aux[7..10].copy_from_slice(&squashed(position));
    aux[10..].copy_from_slice(&features.wo[i]);
    let factor = Vec3::from(features.albedo[i]).clamp(Vec3::ZERO, Vec3::ONE) + MIRRORED;
    for (to, from) in surface.chunks_exact_mut(3).zip([position, normal, mirror, factor]) {
        to.copy_from_slice(&from.to_array());
    }
    row
}

/// Keeps far background points from swamping the input: the identity near 0, bounded by 2.
fn squashed(p: Vec3) -> [f32; 3] {
    p.to_array().map(|x| x / (1.0 + 0.5 * x.abs()))
}
