//! Levels that the paths of a picture come in, and how many of them memory allows to keep.

use std::sync::OnceLock;

use relume_dump::{Manifest, Pass};
use relume_trace::{PixelVertices, VertexLimits};

/// Memory of all vertices that are kept, of all shots that are shown together, bytes. The first level of each is kept
/// whatever it takes.
pub(super) const VERTEX_MEMORY: usize = 1 << 30;
/// Number of the first path. Bakes are of those far below, and so are [`crate::device::blocks::BlockVertices`]: what is connected,
/// what crosses a light and what was solved by are independent. It is within the numbers that the sampler shuffles.
const FIRST_PATH: u32 = 1 << 15;
/// Paths per pixel whose vertices lights are connected to.
const PATHS: u32 = 32;
/// Vertices that are kept of a path that nothing scattered before: one where it scatters, and one for its flight there through media.
const FIRST: u32 = 2;
/// Vertices that are kept of a path but those: those of later bounces matter less.
const LATER: u32 = 2;
/// Most vertices that are kept of a path.
pub(super) const KEPT: u32 = FIRST + LATER;

/// Some paths of each pixel.
pub(super) struct Level {
    pub pass: Pass,
    pub limits: VertexLimits,
    /// Vertices of each tile, where memory allows to keep them. Others are traced anew for each use.
    pub kept: Vec<OnceLock<PixelVertices>>,
}

/// Most vertices that are kept of a pixel of so many paths.
pub(crate) fn limits(samples: u32) -> VertexLimits {
    VertexLimits { first: (FIRST * samples) as usize, later: (LATER * samples) as usize }
}

/// Levels of a picture.
pub(super) fn levels(manifest: &Manifest) -> Vec<Level> {
    let mut levels = Vec::new();
    let mut sum = 0;
    while sum < PATHS {
        let samples = sum.clamp(1, PATHS - sum);
        levels.push(Level {
            pass: Pass { first_sample: FIRST_PATH + sum, samples },
            limits: limits(samples),
            kept: (0..manifest.tile_count()).map(|_| OnceLock::new()).collect(),
        });
        sum += samples;
    }
    levels
}

/// Number of levels, of so many paths each, whose vertices memory allows to keep if those of the first one take so many
/// bytes; one at least.
pub(super) fn levels_within(
    memory: usize,
    bytes_of_first: usize,
    paths: impl Iterator<Item = u32> + Clone,
) -> usize {
    let first = paths.clone().next().unwrap_or(1) as usize;
    let most = memory / bytes_of_first.max(1) * first;
    let mut sum = 0;
    let fits = |paths: &u32| {
        sum += *paths as usize;
        sum <= most
    };
    paths.take_while(fits).count().max(1)
}
