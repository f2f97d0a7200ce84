use std::collections::VecDeque;

use crate::gradient::Batch;
use crate::loss::TILE;
use crate::network::{CHUNK, CHUNK_TILES};
use crate::simd::LANES;
use crate::{LightParams, ProxyError, Rng};

/// Samples gathered at a time.
pub(crate) const BLOCK: u64 = 4096;
/// Blocks that are kept.
pub(crate) const CAPACITY: u64 = 128;
/// Blocks gathered before the first step.
const FIRST: u64 = 8;
/// Blocks gathered in one call while filling, so that a step never blocks for long.
pub(crate) const FILL: u64 = 8;
/// Counter of the random streams of blocks; block `b` has the counter `BLOCK_STREAM + b`.
const BLOCK_STREAM: u64 = 1 << 62;

/// The latest gathered samples, each of which is trained on several times: gathering costs more than training. Block
/// `b` depends on the seed and `b` alone, and the number of blocks on the samples trained alone, so that a resumed
/// training gathers what it has lost.
#[derive(Debug)]
pub(crate) struct Replay {
    reuse: u64,
    blocks: VecDeque<Batch>,
    /// Number of the next block.
    next: u64,
}

impl Replay {
    /// Empty, for a training that has done `samples` samples and uses each gathered sample `reuse` times.
    pub fn new(reuse: usize, samples: u64) -> Self {
        let mut replay = Self { reuse: reuse as u64, blocks: VecDeque::new(), next: 0 };
        replay.next = replay.wanted(samples).saturating_sub(CAPACITY);
        replay
    }

    /// Blocks that should have been gathered after so many samples.
    fn wanted(&self, samples: u64) -> u64 {
        FIRST + samples / (self.reuse * BLOCK)
    }

    /// Blocks that are missing before a training that has done `samples` samples can go on.
    pub fn missing(&self, samples: u64) -> usize {
        self.wanted(samples).saturating_sub(self.next) as usize
    }

    /// Adds some of the missing blocks of `BLOCK` samples, made by `make` from the key of their random stream.
    pub fn fill(
        &mut self,
        samples: u64,
        seed: u64,
        make: impl Fn((u64, u64)) -> Result<Batch, ProxyError>,
    ) -> Result<(), ProxyError> {
        for _ in 0..FILL.min(self.missing(samples) as u64) {
            self.blocks.push_back(make((seed, BLOCK_STREAM + self.next))?);
            self.next += 1;
            if self.blocks.len() as u64 > CAPACITY {
                self.blocks.pop_front();
            }
        }
        Ok(())
    }

    /// Number of the next block.
    pub fn next_block(&self) -> u64 {
        self.next
    }

    /// Number of the oldest block that is kept.
    fn oldest(&self) -> u64 {
        self.next - self.blocks.len() as u64
    }

    /// The blocks that are kept, with their numbers.
    pub fn blocks(&self) -> impl Iterator<Item = (u64, &Batch)> {
        (self.oldest()..).zip(&self.blocks)
    }

    /// Random chunks: the number of a block and which of its chunks.
    pub fn draw(&self, samples: usize, (seed, step): (u64, u64)) -> impl Iterator<Item = (u64, usize)> {
        let mut rng = Rng::stream(seed, step, 0);
        let chunks = BLOCK as usize / CHUNK;
        (0..samples / CHUNK).map(move |_| {
            let index = rng.below((self.blocks.len() * chunks) as u32) as usize;
            (self.oldest() + (index / chunks) as u64, index % chunks)
        })
    }

    /// The lights of a drawn chunk.
    pub fn lights(&self, (number, chunk): (u64, usize)) -> &[LightParams] {
        &self.blocks[(number - self.oldest()) as usize].lights[chunk * CHUNK_TILES..(chunk + 1) * CHUNK_TILES]
    }

    /// A batch of random chunks.
    pub fn batch(&self, samples: usize, key: (u64, u64)) -> Batch {
        let slots = self.blocks[0].slots;
        let mut batch = Batch { slots, ..Batch::default() };
        for (number, chunk) in self.draw(samples, key) {
            let block = &self.blocks[(number - self.oldest()) as usize];
            let pixels = CHUNK_TILES / slots * LANES;
            batch.pixels.extend_from_slice(&block.pixels[chunk * pixels..(chunk + 1) * pixels]);
            let tiles = chunk * CHUNK_TILES..(chunk + 1) * CHUNK_TILES;
            batch.targets.extend_from_slice(&block.targets[tiles.start * TILE..tiles.end * TILE]);
            batch.weights.extend_from_slice(&block.weights[tiles.clone()]);
            batch.lights.extend_from_slice(&block.lights[tiles]);
        }
        batch
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoding::OutputScale;
    use crate::sampling::Sampler;
    use crate::synthetic::SyntheticRoom;
    use crate::{LightKind, LightPlacement, SizeRange};

    #[test]
    fn resumed_replay_draws_the_same_batches_after_old_blocks_are_gone() {
        let room = SyntheticRoom::new(16, 12);
        let size = SizeRange { min: 0.1, max: 0.4 };
        let placement = LightPlacement::Segments;
        let sampler =
            Sampler { kind: LightKind::Sphere, size, placement, area_weight: 0.0, pixel_count: 192 };
        let scale = OutputScale { factor: 1.0, area: None };
        let fill = |replay: &mut Replay, samples: u64| {
            while replay.missing(samples) > 0 {
                let block = |key| sampler.gathered(&room, &scale, (BLOCK as usize, 8), key);
                replay.fill(samples, 3, block).expect("gathered");
            }
        };
        let end = (CAPACITY + 5) * BLOCK;
        let mut whole = Replay::new(1, 0);
        for samples in (0..=end).step_by(BLOCK as usize) {
            fill(&mut whole, samples);
        }
        let mut resumed = Replay::new(1, end);
        fill(&mut resumed, end);
        assert_eq!(whole.blocks.len() as u64, CAPACITY);
        for step in 0..20 {
            let (a, b) = (whole.batch(2048, (3, step)), resumed.batch(2048, (3, step)));
            assert_eq!((a.pixels, a.lights, a.targets), (b.pixels, b.lights, b.targets), "step {step}");
        }
    }
}
