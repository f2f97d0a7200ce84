use std::ops::Range;

use relume_dump::{Dump, Flags, Pass, Shard};

/// Selection of the paths of every pixel that count. The halves are independent estimates of the same image: one can
/// train on the first and measure on the second, and their difference is a measure of the noise.
///
/// Each pass is cut into its earlier and later paths, not into even and odd ones: in a Sobol sequence all even samples
/// lie in the same half of the first dimension, while aligned runs are well spread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleSplit {
    /// All paths.
    #[default]
    All,
    /// The earlier paths of each pass.
    First,
    /// The later paths of each pass.
    Second,
}

impl SampleSplit {
    /// Numbers of the paths of a pass that count. Where the number is odd, the one over falls to the second half for even
    /// `first_sample`, else to the first.
    fn paths(self, pass: Pass) -> Range<u32> {
        let Pass { first_sample, samples } = pass;
        let cut = samples / 2 + (samples & first_sample & 1);
        match self {
            Self::All => 0..samples,
            Self::First => 0..cut,
            Self::Second => cut..samples,
        }
    }

    /// Samples per pixel of a tile that count.
    pub fn tile_samples(self, dump: &Dump, tile: usize) -> u32 {
        dump.tile(tile).map(|shard| self.paths(shard.header().pass).len() as u32).sum()
    }

    /// The records of a shard's pixel that count: they lie together.
    pub(crate) fn records(self, shard: &Shard, pixel: usize) -> Range<usize> {
        let all = shard.pixel(pixel);
        let paths = self.paths(shard.header().pass);
        if paths.len() as u32 == shard.samples() {
            return all;
        }
        let cut = if self == Self::First { paths.end } else { paths.start };
        let middle = all.start + path_start(&shard.position_z_flags()[all.clone()], cut);
        if self == Self::First { all.start..middle } else { middle..all.end }
    }

    /// The records of a shard that count, in ranges that start with a path.
    pub(crate) fn shard_records(self, shard: &Shard) -> impl Iterator<Item = Range<usize>> + '_ {
        self.run_records(shard, 0..shard.rect().pixel_count())
    }

    /// The records of some pixels in a row of numbers that count, in ranges that start with a path.
    pub(crate) fn run_records(
        self,
        shard: &Shard,
        run: Range<usize>,
    ) -> impl Iterator<Item = Range<usize>> + '_ {
        let (paths, offsets) = (self.paths(shard.header().pass).len() as u32, shard.pixel_offsets());
        let whole =
            (paths == shard.samples()).then(|| offsets[run.start] as usize..offsets[run.end] as usize);
        let pixels = if whole.is_some() || paths == 0 { 0..0 } else { run };
        whole.into_iter().chain(pixels.map(move |pixel| self.records(shard, pixel)))
    }
}

/// Index of the first record of a path, counted from 0; the number of records if there are not so many paths.
fn path_start(z_flags: &[u32], path: u32) -> usize {
    let starts = |word: &u32| u32::from(Flags((word >> 16) as u16).path_start());
    let mut left = path;
    // Sums of whole chunks are vectorised.
    for (chunk, words) in z_flags.chunks(64).enumerate() {
        let here = words.iter().map(starts).sum::<u32>();
        if left < here {
            let begins = |word: &u32| {
                let is_start = starts(word) == 1;
                let is_it = is_start && left == 0;
                left -= u32::from(is_start && !is_it);
                is_it
            };
            return chunk * 64 + words.iter().position(begins).unwrap_or(0);
        }
        left -= here;
    }
    z_flags.len()
}
