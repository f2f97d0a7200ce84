//! Random numbers of integers and floats, as Cycles has them: Bob Jenkins' hash of up to four words ("lookup3", public
//! domain).

use glam::Vec3;

/// Hash of the first `count` words; the others must be 0.
#[inline(always)]
fn hash_words(count: usize, [x, y, z, w]: [u32; 4]) -> u32 {
    let start = 0xdead_beef_u32.wrapping_add((count as u32) << 2).wrapping_add(13);
    let [mut a, mut b, mut c] = [x, y, z].map(|word| start.wrapping_add(word));
    if count > 3 {
        a = a.wrapping_sub(c) ^ c.rotate_left(4);
        c = c.wrapping_add(b);
        b = b.wrapping_sub(a) ^ a.rotate_left(6);
        a = a.wrapping_add(c);
        c = c.wrapping_sub(b) ^ b.rotate_left(8);
        b = b.wrapping_add(a);
        a = a.wrapping_sub(c) ^ c.rotate_left(16);
        c = c.wrapping_add(b);
        b = b.wrapping_sub(a) ^ a.rotate_left(19);
        a = a.wrapping_add(c);
        c = c.wrapping_sub(b) ^ b.rotate_left(4);
        b = b.wrapping_add(a);
        a = a.wrapping_add(w);
    }
    c = (c ^ b).wrapping_sub(b.rotate_left(14));
    a = (a ^ c).wrapping_sub(c.rotate_left(11));
    b = (b ^ a).wrapping_sub(a.rotate_left(25));
    c = (c ^ b).wrapping_sub(b.rotate_left(16));
    a = (a ^ c).wrapping_sub(c.rotate_left(4));
    b = (b ^ a).wrapping_sub(a.rotate_left(14));
    (c ^ b).wrapping_sub(b.rotate_left(24))
}

/// The words, followed by zeros.
#[inline(always)]
fn padded<const N: usize>(words: [u32; N]) -> [u32; 4] {
    std::array::from_fn(|i| words.get(i).copied().unwrap_or(0))
}

/// A hash of one to four words.
#[inline(always)]
pub fn hash<const N: usize>(words: [u32; N]) -> u32 {
    hash_words(N, padded(words))
}

/// Number in 0..=1.
#[inline(always)]
fn unit(hash: u32) -> f32 {
    hash as f32 * (1.0 / u32::MAX as f32)
}

/// A number in 0..=1 of one to four words.
#[inline(always)]
pub fn random_of_words<const N: usize>(words: [u32; N]) -> f32 {
    unit(hash(words))
}

/// A number in 0..=1 of one to four floats.
#[inline(always)]
pub fn random<const N: usize>(key: [f32; N]) -> f32 {
    unit(hash(key.map(f32::to_bits)))
}

/// A number in 0..=1 of one to three floats and one more.
#[inline(always)]
fn random_with<const N: usize>(key: [f32; N], last: f32) -> f32 {
    let mut words = padded(key.map(f32::to_bits));
    words[N] = last.to_bits();
    unit(hash_words(N + 1, words))
}

/// Random numbers in 0..=1, as many as there are floats.
#[inline(always)]
pub fn random_point<const N: usize>(key: [f32; N]) -> [f32; N] {
    std::array::from_fn(|i| match (N, i) {
        (_, 0) => random(key),
        (4, _) => random::<N>(std::array::from_fn(|j| key[(j + 4 - i) % 4])),
        _ => random_with(key, i as f32),
    })
}

/// A colour in 0..=1 of one to four floats; its red is [`random`].
#[inline(always)]
pub fn random_color<const N: usize>(key: [f32; N]) -> Vec3 {
    let in_order = |order: [usize; 4]| random::<N>(std::array::from_fn(|j| key[order[j]]));
    match N {
        4 => Vec3::new(random(key), in_order([2, 0, 3, 1]), in_order([3, 2, 1, 0])),
        _ => Vec3::new(random(key), random_with(key, 1.0), random_with(key, 2.0)),
    }
}

/// Random numbers in 0..=1, as many as a cell has coordinates, two to four: pcg2d, pcg3d and pcg4d of Mark Jarzynski
/// and Marc Olano, "Hash Functions for GPU Rendering" (2020), of signed words as in Cycles.
#[inline(always)]
pub fn pcg_point<const N: usize>(cell: [f32; N]) -> [f32; N] {
    const FACTOR: i32 = 1_664_525;
    let mut words = cell.map(|x| (x as i32).wrapping_mul(FACTOR).wrapping_add(1_013_904_223));
    add_products(&mut words, FACTOR);
    words = words.map(|word| word ^ (word >> 16));
    add_products(&mut words, FACTOR);
    words.map(|word| (word & i32::MAX) as f32 * (1.0 / i32::MAX as f32))
}

/// Adds to each word in turn the product of two others; in two dimensions a multiple of the other one.
#[inline(always)]
fn add_products<const N: usize>(words: &mut [i32; N], factor: i32) {
    for i in 0..N {
        let (a, b) = match (N, i) {
            (4, 0) => (1, 3),
            (4, 3) => (1, 2),
            _ => ((i + 1) % 3, (i + 2) % 3),
        };
        let product =
            if N == 2 { words[1 - i].wrapping_mul(factor) } else { words[a].wrapping_mul(words[b]) };
        words[i] = words[i].wrapping_add(product);
    }
}

/// A colour in 0..=1 of a cell of two to four coordinates.
#[inline(always)]
pub fn pcg_color<const N: usize>(cell: [f32; N]) -> Vec3 {
    if N == 2 {
        return Vec3::from(pcg_point([cell[0], cell[1], 0.0]));
    }
    let point = pcg_point(cell);
    Vec3::new(point[0], point[1], point[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_of_neighbours_are_unrelated() {
        let changed: u32 = (0..1000).map(|i| (hash([i]) ^ hash([i + 1])).count_ones()).sum();
        assert!((changed as f32 / 1000.0 - 16.0).abs() < 0.3, "half of the bits change: {changed}");
        assert_ne!(hash([1, 2]), hash([2, 1]));
        assert_ne!(hash([1, 2]), hash([1, 2, 0]));
    }
}
