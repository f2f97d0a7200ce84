/// SplitMix64 (Steele, Lea, Flood 2014): a counter through a mixing function.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(crate) fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in 0..1.
    pub(crate) fn next_f32(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in 0..n.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        ((self.next_u64() as u128 * n as u128) >> 64) as usize
    }
}

/// Draws pixels without replacement, a fresh subset each time.
pub(crate) struct PixelSubset {
    pixels: Vec<u32>,
    count: usize,
}

impl PixelSubset {
    pub(crate) fn new(pixel_count: usize, count: usize) -> Self {
        Self { pixels: (0..pixel_count as u32).collect(), count: count.clamp(1, pixel_count) }
    }

    /// The front of a Fisher-Yates shuffle that goes on where the last one stopped.
    pub(crate) fn draw(&mut self, random: &mut Random) -> &[u32] {
        let len = self.pixels.len();
        for i in 0..self.count {
            let j = i + random.below(len - i);
            self.pixels.swap(i, j);
        }
        &self.pixels[..self.count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subsets_hold_different_pixels_and_all_get_their_turn() {
        let mut subset = PixelSubset::new(100, 30);
        let mut random = Random::new(7);
        let mut hits = [0; 100];
        for _ in 0..1000 {
            let mut drawn = subset.draw(&mut random).to_vec();
            drawn.sort();
            drawn.dedup();
            assert_eq!(drawn.len(), 30);
            drawn.iter().for_each(|p| hits[*p as usize] += 1);
        }
        // Binomial of mean 300, deviation 14.5: five deviations.
        assert!(hits.iter().all(|h| (228..=372).contains(h)), "{hits:?}");
    }
}
