//! Owen-scrambled Sobol points, four dimensions at a time.
//!
//! Each decision group of a path (film and lens, a BSDF and its roulette, a light) takes four dimensions of a Sobol
//! sequence that is shuffled and scrambled on its own, as in Burley (2020), "Practical Hash-based Owen Scrambling",
//! JCGT 9(4), sections 4 and 5. The hash is Laine and Karras's with Vegdahl's constants
//! (<https://psychopath.io/post/2021_01_30_building_a_better_lk_hash>). A sample depends only on the seed, the pixel,
//! its number and the group, so that neither threads nor passes change it, and each aligned block of `2^k` samples is
//! stratified.

/// Dimensions of a group.
pub const GROUP_SIZE: usize = 4;

/// Bits of the sample number that are shuffled; higher ones are kept.
const SHUFFLED_BITS: u32 = 16;

/// The samples of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelSampler {
    seed: u32,
}

impl PixelSampler {
    /// The samples of pixel `x`, `y` for a seed of the whole image.
    pub fn new(seed: u64, x: u32, y: u32) -> Self {
        let image = hash(seed as u32 ^ hash((seed >> 32) as u32 ^ 0x9e37_79b9));
        Self { seed: hash(x ^ hash(y ^ image)) }
    }

    /// Four numbers in 0..1 (1 excluded) for sample number `sample` and group `group`.
    #[inline]
    pub fn draw(self, sample: u32, group: u32) -> [f32; GROUP_SIZE] {
        let group_seed = hash(self.seed ^ group.wrapping_mul(0x85eb_ca6b));
        let index = shuffle(sample, group_seed);
        let mut points = [0.0; GROUP_SIZE];
        let mut seed = group_seed;
        for (dimension, point) in points.iter_mut().enumerate() {
            seed = hash(seed.wrapping_add(0x68bc_21eb));
            let scrambled = laine_karras(reversed_sobol(index, dimension), seed).reverse_bits();
            *point = (scrambled >> 8) as f32 * (1.0 / (1 << 24) as f32);
        }
        points
    }
}

/// Numbers of one vertex of a path: a group of its own, and others by their distance from that.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Draws {
    sampler: PixelSampler,
    sample: u32,
    group: u32,
}

impl Draws {
    /// Numbers of sample number `sample` whose own group is `group`.
    pub fn new(sampler: PixelSampler, sample: u32, group: u32) -> Self {
        Self { sampler, sample, group }
    }

    /// Four numbers of the group so far from its own.
    pub fn at(self, distance: u32) -> [f32; GROUP_SIZE] {
        self.sampler.draw(self.sample, self.group.wrapping_add(distance))
    }

    /// Four numbers of one of the parts that the sample has, stratified over all parts of all samples.
    pub fn part(self, distance: u32, part: u32, parts: u32) -> [f32; GROUP_SIZE] {
        let sample = self.sample.wrapping_mul(parts).wrapping_add(part);
        self.sampler.draw(sample, self.group.wrapping_add(distance))
    }

    /// Those whose own group is so far from this one's.
    pub fn moved(self, distance: u32) -> Self {
        Self { group: self.group.wrapping_add(distance), ..self }
    }
}

/// A bijection of 32 bits (`lowbias32` of <https://github.com/skeeto/hash-prospector>).
#[inline]
fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A bijection whose bits depend only on the input bits at or below them.
#[inline]
fn laine_karras(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// Permutes the low bits so that aligned blocks of `2^k` stay together.
#[inline]
fn shuffle(index: u32, seed: u32) -> u32 {
    let mask = (1 << SHUFFLED_BITS) - 1;
    let reversed = (index & mask).reverse_bits() >> (32 - SHUFFLED_BITS);
    let shuffled = (laine_karras(reversed, seed) & mask).reverse_bits() >> (32 - SHUFFLED_BITS);
    (index & !mask) | shuffled
}

/// Bit-reversed coordinate of point `index`.
#[inline]
fn reversed_sobol(index: u32, dimension: usize) -> u32 {
    if dimension == 0 {
        return index;
    }
    let table = &SOBOL[dimension - 1];
    let [a, b, c, d] = index.to_le_bytes().map(usize::from);
    let low = table[0][a] ^ table[1][b];
    if index >> SHUFFLED_BITS == 0 { low } else { low ^ table[2][c] ^ table[3][d] }
}

/// Contribution of each byte of the index to the reversed coordinate, for the dimensions after the first.
static SOBOL: [[[u32; 256]; 4]; GROUP_SIZE - 1] = [
    byte_tables(directions(1, 0, [1, 0, 0])),
    byte_tables(directions(2, 1, [1, 3, 0])),
    byte_tables(directions(3, 1, [1, 3, 1])),
];

/// Direction numbers of a primitive polynomial of `degree` with inner coefficients `a` and initial values `m`:
/// Joe and Kuo (2008), "Constructing Sobol sequences with better two-dimensional projections".
const fn directions(degree: usize, a: u32, m: [u32; 3]) -> [u32; 32] {
    let mut v = [0; 32];
    let mut bit = 0;
    while bit < 32 {
        if bit < degree {
            v[bit] = m[bit] << (31 - bit);
        } else {
            v[bit] = v[bit - degree] ^ (v[bit - degree] >> degree);
            let mut k = 1;
            while k < degree {
                v[bit] ^= ((a >> (degree - 1 - k)) & 1) * v[bit - k];
                k += 1;
            }
        }
        bit += 1;
    }
    v
}

const fn byte_tables(directions: [u32; 32]) -> [[u32; 256]; 4] {
    let mut tables = [[0; 256]; 4];
    let mut byte = 0;
    while byte < 4 {
        let mut value = 0;
        while value < 256 {
            let mut bit = 0;
            while bit < 8 {
                if value >> bit & 1 == 1 {
                    tables[byte][value] ^= directions[8 * byte + bit].reverse_bits();
                }
                bit += 1;
            }
            value += 1;
        }
        byte += 1;
    }
    tables
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(sampler: PixelSampler, group: u32, first: u32, count: u32) -> Vec<[f32; 4]> {
        (first..first + count).map(|sample| sampler.draw(sample, group)).collect()
    }

    /// True if each cell of a grid of `columns` by `rows` holds exactly one of the points.
    fn is_stratified(points: &[[f32; 4]], dimensions: [usize; 2], columns: usize) -> bool {
        let rows = points.len() / columns;
        let mut seen = vec![false; points.len()];
        for point in points {
            let x = (point[dimensions[0]] * columns as f32) as usize;
            let y = (point[dimensions[1]] * rows as f32) as usize;
            seen[y * columns + x] = true;
        }
        seen.into_iter().all(|cell| cell)
    }

    #[test]
    fn every_aligned_block_is_a_stratified_net() {
        for (seed, group, first, count) in
            [(0, 0, 0, 256), (1, 7, 256, 256), (2, 3, 64, 64), (3, 1, 1 << 16, 1024), (4, 900, 4096, 16)]
        {
            let points = block(PixelSampler::new(seed, 3, 4), group, first, count);
            for dimension in 0..4 {
                assert!(is_stratified(&points, [dimension, 0], points.len()), "dimension {dimension} alone");
            }
            for log in 0..=count.ilog2() {
                assert!(is_stratified(&points, [0, 1], 1 << log), "{count} points, 2^{log} columns");
            }
        }
    }

    #[test]
    fn pairs_of_all_dimensions_fill_a_coarse_grid() {
        let points = block(PixelSampler::new(5, 1, 1), 2, 0, 1024);
        for pair in [[0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
            let mut counts = [0; 64];
            for point in &points {
                counts[(point[pair[0]] * 8.0) as usize * 8 + (point[pair[1]] * 8.0) as usize] += 1;
            }
            assert!(counts.iter().all(|count| (8..=24).contains(count)), "{pair:?}: {counts:?}");
        }
    }

    #[test]
    fn groups_pixels_and_seeds_are_uncorrelated() {
        let base = block(PixelSampler::new(1, 10, 10), 1, 0, 4096);
        let others = [
            block(PixelSampler::new(1, 10, 10), 2, 0, 4096),
            block(PixelSampler::new(1, 11, 10), 1, 0, 4096),
            block(PixelSampler::new(2, 10, 10), 1, 0, 4096),
        ];
        for other in others {
            for (d, e) in [(0, 0), (1, 1), (0, 1), (3, 2)] {
                let covariance: f32 =
                    base.iter().zip(&other).map(|(a, b)| (a[d] - 0.5) * (b[e] - 0.5)).sum::<f32>() / 4096.0;
                // Independent points give 1/12 / sqrt(4096) = 0.0013.
                assert!(covariance.abs() < 0.006, "{covariance}");
            }
        }
    }

    #[test]
    fn integrals_converge_faster_than_at_random() {
        let error = |pixel: u32| {
            let points = block(PixelSampler::new(9, pixel, 0), 0, 0, 256);
            let mean = points.iter().map(|p| p[0] * p[1]).sum::<f32>() / 256.0;
            (mean - 0.25).powi(2)
        };
        let rms = ((0..64).map(error).sum::<f32>() / 64.0).sqrt();
        // Random points: sqrt(7/144 / 256) = 0.0138.
        assert!(rms < 0.002, "{rms}");
    }

    #[test]
    fn numbers_stay_below_one() {
        let sampler = PixelSampler::new(u64::MAX, u32::MAX, u32::MAX);
        for sample in [0, 1, 65_535, 65_536, u32::MAX] {
            assert!(sampler.draw(sample, u32::MAX).iter().all(|value| (0.0..1.0).contains(value)));
        }
    }
}
