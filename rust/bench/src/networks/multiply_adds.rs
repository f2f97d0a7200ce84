//! Peak of fused multiply-adds of one core, the limit of its kernels.

use relume_proxy::Isa;

/// Chains that do not wait for each other.
const CHAINS: usize = 12;
/// Multiply-adds of a round of [`chains`].
pub const OF_A_ROUND: usize = 8 * 32 * CHAINS;

/// Runs so many rounds with the widest vectors of an instruction set and returns the sum of what comes out.
pub fn chains(isa: Isa, rounds: usize) -> f32 {
    match isa {
        Isa::Portable => portable(rounds),
        // SAFETY: `Isa::detect` hands this out only where the instructions exist.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { avx2(rounds) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => unsafe { avx512(rounds) },
    }
}

/// Different starts, hidden from the compiler, keep it from merging the chains.
fn starts() -> [f32; CHAINS] {
    std::hint::black_box(std::array::from_fn(|i| i as f32))
}

fn portable(rounds: usize) -> f32 {
    let mut sums = starts().map(|start| [start; 32]);
    for _ in 0..rounds * 8 {
        for sum in &mut sums {
            *sum = sum.map(|x| x * 0.999 + 0.001);
        }
    }
    sums.as_flattened().iter().sum()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2(rounds: usize) -> f32 {
    use std::arch::x86_64::{_mm256_cvtss_f32, _mm256_fmadd_ps, _mm256_set1_ps};
    let (scale, offset) = (_mm256_set1_ps(0.999), _mm256_set1_ps(0.001));
    let mut sums = [offset; CHAINS];
    for (sum, start) in sums.iter_mut().zip(starts()) {
        *sum = _mm256_set1_ps(start);
    }
    for _ in 0..rounds * 8 * 4 {
        for sum in &mut sums {
            *sum = _mm256_fmadd_ps(*sum, scale, offset);
        }
    }
    let mut total = 0.0;
    for sum in sums {
        total += _mm256_cvtss_f32(sum);
    }
    total
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn avx512(rounds: usize) -> f32 {
    use std::arch::x86_64::{_mm512_cvtss_f32, _mm512_fmadd_ps, _mm512_set1_ps};
    let (scale, offset) = (_mm512_set1_ps(0.999), _mm512_set1_ps(0.001));
    let mut sums = [offset; CHAINS];
    for (sum, start) in sums.iter_mut().zip(starts()) {
        *sum = _mm512_set1_ps(start);
    }
    for _ in 0..rounds * 8 * 2 {
        for sum in &mut sums {
            *sum = _mm512_fmadd_ps(*sum, scale, offset);
        }
    }
    let mut total = 0.0;
    for sum in sums {
        total += _mm512_cvtss_f32(sum);
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every chain ends at 1, where `x = 0.999 x + 0.001`.
    #[test]
    fn chains_of_every_instruction_set_come_to_their_fixed_point() {
        for isa in Isa::available() {
            let lanes = if isa == Isa::Portable { 32 } else { 1 };
            let sum = chains(isa, 3000);
            assert!((sum / (lanes * CHAINS) as f32 - 1.0).abs() < 1e-3, "{isa:?}: {sum}");
        }
    }
}
