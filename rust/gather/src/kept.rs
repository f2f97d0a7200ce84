//! Numbers of the bits that a scan sets, written several at a time: how many there are cannot be predicted, so a loop over
//! bits mispredicts about once for each group that has any.

use std::arch::x86_64::*;

/// Most numbers that [`write_set_bits`] writes, and those that are written too much: the room that it needs.
pub const ROOM: usize = 32;

/// Numbers of the bits that are set in each byte, rising, a byte each from the lowest on; zeros behind them.
static SET_BITS: [u64; 256] = set_bits_of_bytes();

const fn set_bits_of_bytes() -> [u64; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut bit, mut count) = (0, 0);
        while bit < 8 {
            if byte >> bit & 1 == 1 {
                table[byte] |= bit << (8 * count);
                count += 1;
            }
            bit += 1;
        }
        byte += 1;
    }
    table
}

/// Writes `first` plus the number of each bit that is set, rising, to the front of `room` and returns how many these are;
/// the rest of `room` may change, too.
#[inline]
#[target_feature(enable = "avx2,popcnt")]
pub fn write_set_bits(bits: u32, first: u32, room: &mut [u32; ROOM]) -> usize {
    let mut count = 0;
    let mut start = _mm256_set1_epi32(first as i32);
    for byte in bits.to_le_bytes() {
        let numbers = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(SET_BITS[usize::from(byte)] as i64));
        let room: &mut [u32; 8] = room[count..].first_chunk_mut().expect("at most eight a byte before");
        // SAFETY: 32 bytes are written to an array of eight words.
        unsafe { _mm256_storeu_si256(room.as_mut_ptr().cast(), _mm256_add_epi32(numbers, start)) };
        start = _mm256_add_epi32(start, _mm256_set1_epi32(8));
        count += byte.count_ones() as usize;
    }
    count
}

/// Bits for tests: none, all, the ends, and random ones of every density.
#[cfg(test)]
pub fn masks_for_tests() -> Vec<u32> {
    let mut random = crate::tests::Random(5);
    let mut masks = vec![0, u32::MAX, 1, 1 << 15, 1 << 16, 1 << 31, 0xffff, 0xffff_0000];
    for i in 0..4000 {
        let density = (i % 40) as f32 / 39.0;
        masks.push((0..32).fold(0, |bits, bit| bits | u32::from(random.next() < density) << bit));
    }
    masks
}

/// Numbers of the bits that are set, one by one.
#[cfg(test)]
pub fn set_bits_one_by_one(bits: u32, first: u32) -> Vec<u32> {
    (0..32).filter(|bit| bits >> bit & 1 == 1).map(|bit| first + bit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_bits_by_table_are_those_one_by_one() {
        if !is_x86_feature_detected!("avx2") {
            println!("skipped: no AVX2");
            return;
        }
        for (i, bits) in masks_for_tests().into_iter().enumerate() {
            let first = i as u32 * 8191;
            let mut room = [u32::MAX; ROOM];
            // SAFETY: AVX2 has been detected, and with it goes the rest.
            let count = unsafe { write_set_bits(bits, first, &mut room) };
            assert_eq!(room[..count], set_bits_one_by_one(bits, first), "{bits:#x}");
        }
    }
}
