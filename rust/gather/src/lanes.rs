//! Eight floats at a time, on AVX2 or portably. Kernels are written once over [`Lanes`]; apart from
//! [`Lanes::mul_add`], every operation is the same IEEE operation in both, so results are equal bit by bit.

/// Number of lanes.
pub const WIDTH: usize = 8;

/// Eight `f32`. Masks are lanes whose sign bit counts.
pub trait Lanes: Copy {
    /// All lanes the same.
    fn splat(value: f32) -> Self;
    /// Loads lanes from memory.
    fn load(values: &[f32; WIDTH]) -> Self;
    /// To memory.
    fn store(self, values: &mut [f32; WIDTH]);
    /// Hints that `words[index]`, if there is such a word, will be read soon.
    fn prefetch(words: &[u32], index: usize);
    /// The low and the high 16 bits of each word as numbers.
    fn unpack(words: &[u32; WIDTH]) -> (Self, Self);
    /// Mask of the words that have none of some bits.
    fn none_of<const BITS: u32>(words: &[u32; WIDTH]) -> Self;
    /// Mask of a bit, 0..31, of each word.
    fn bit<const BIT: u32>(words: &[u32; WIDTH]) -> Self;
    /// `self + other`.
    fn add(self, other: Self) -> Self;
    /// `self - other`.
    fn sub(self, other: Self) -> Self;
    /// `self * other`.
    fn mul(self, other: Self) -> Self;
    /// `self / other`.
    fn div(self, other: Self) -> Self;
    /// `self * b + c`, rounded once or twice: only for tests that allow for it.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c - self * b`, as [`Lanes::mul_add`].
    fn negated_mul_add(self, b: Self, c: Self) -> Self;
    /// Smaller of both.
    fn min(self, other: Self) -> Self;
    /// Larger of both.
    fn max(self, other: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// `-self` where `sign` is negative.
    fn flip_sign_by(self, sign: Self) -> Self;
    /// Mask of `self < other`.
    fn lt(self, other: Self) -> Self;
    /// Mask of `self <= other`.
    fn le(self, other: Self) -> Self;
    /// Mask of both masks.
    fn and(self, other: Self) -> Self;
    /// `if_set` where the mask is set.
    fn select(mask: Self, if_set: Self, if_clear: Self) -> Self;
    /// The sign bits, lane 0 in bit 0.
    fn sign_bits(self) -> u8;
    /// Lane 7 of `before`, then lanes 0 to 6 of `self`.
    fn shift_in(self, before: Self) -> Self;
}

/// Plain arrays, which the compiler may vectorise.
#[derive(Clone, Copy)]
pub struct Portable([f32; WIDTH]);

impl Portable {
    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Self {
        Self(self.0.map(f))
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn mask(self, other: Self, f: impl Fn(f32, f32) -> bool) -> Self {
        self.zip(other, |a, b| f32::from_bits(if f(a, b) { u32::MAX } else { 0 }))
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }
    #[inline(always)]
    fn load(values: &[f32; WIDTH]) -> Self {
        Self(*values)
    }
    #[inline(always)]
    fn store(self, values: &mut [f32; WIDTH]) {
        *values = self.0;
    }
    #[inline(always)]
    fn prefetch(_words: &[u32], _index: usize) {}
    #[inline(always)]
    fn unpack(words: &[u32; WIDTH]) -> (Self, Self) {
        (Self(words.map(|w| (w & 0xffff) as f32)), Self(words.map(|w| (w >> 16) as f32)))
    }
    #[inline(always)]
    fn none_of<const BITS: u32>(words: &[u32; WIDTH]) -> Self {
        Self(words.map(|w| f32::from_bits(if w & BITS == 0 { u32::MAX } else { 0 })))
    }
    #[inline(always)]
    fn bit<const BIT: u32>(words: &[u32; WIDTH]) -> Self {
        Self(words.map(|w| f32::from_bits(w << (31 - BIT))))
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self.mul(b).add(c)
    }
    #[inline(always)]
    fn negated_mul_add(self, b: Self, c: Self) -> Self {
        c.sub(self.mul(b))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f32::abs)
    }
    #[inline(always)]
    fn flip_sign_by(self, sign: Self) -> Self {
        self.zip(sign, |value, sign| if sign.is_sign_negative() { -value } else { value })
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self {
        self.mask(other, |a, b| a < b)
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self {
        self.mask(other, |a, b| a <= b)
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self.zip(other, |a, b| f32::from_bits(a.to_bits() & b.to_bits()))
    }
    #[inline(always)]
    fn select(mask: Self, if_set: Self, if_clear: Self) -> Self {
        let pick = |i: usize| if mask.0[i].is_sign_negative() { if_set.0[i] } else { if_clear.0[i] };
        Self(std::array::from_fn(pick))
    }
    #[inline(always)]
    fn sign_bits(self) -> u8 {
        (0..WIDTH).fold(0, |bits, i| bits | ((self.0[i].to_bits() >> 31) as u8) << i)
    }
    #[inline(always)]
    fn shift_in(self, before: Self) -> Self {
        Self(std::array::from_fn(|i| if i == 0 { before.0[WIDTH - 1] } else { self.0[i - 1] }))
    }
}

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2Lanes;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::{Lanes, WIDTH};

    /// One AVX register.
    #[derive(Clone, Copy)]
    pub struct Avx2Lanes(__m256);

    /// SAFETY of all blocks in this impl: values of this type are only made and used inside the
    /// `#[target_feature(enable = "avx2,fma")]` functions of `kernel`, which run after detection; loads and stores are
    /// of whole arrays of eight.
    #[expect(clippy::undocumented_unsafe_blocks, reason = "one reason for the whole impl, stated above")]
    impl Lanes for Avx2Lanes {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            Self(unsafe { _mm256_set1_ps(value) })
        }
        #[inline(always)]
        fn load(values: &[f32; WIDTH]) -> Self {
            Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, values: &mut [f32; WIDTH]) {
            unsafe { _mm256_storeu_ps(values.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn prefetch(words: &[u32], index: usize) {
            // A prefetch of any address is allowed, so the pointer may leave its array.
            let address = words.as_ptr().wrapping_add(index);
            unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) }
        }
        #[inline(always)]
        fn unpack(words: &[u32; WIDTH]) -> (Self, Self) {
            unsafe {
                let words = _mm256_loadu_si256(words.as_ptr().cast());
                let low = _mm256_and_si256(words, _mm256_set1_epi32(0xffff));
                let high = _mm256_srli_epi32::<16>(words);
                (Self(_mm256_cvtepi32_ps(low)), Self(_mm256_cvtepi32_ps(high)))
            }
        }
        #[inline(always)]
        fn none_of<const BITS: u32>(words: &[u32; WIDTH]) -> Self {
            unsafe {
                let words = _mm256_loadu_si256(words.as_ptr().cast());
                let bits = _mm256_and_si256(words, _mm256_set1_epi32(BITS as i32));
                Self(_mm256_castsi256_ps(_mm256_cmpeq_epi32(bits, _mm256_setzero_si256())))
            }
        }
        #[inline(always)]
        fn bit<const BIT: u32>(words: &[u32; WIDTH]) -> Self {
            unsafe {
                let words = _mm256_loadu_si256(words.as_ptr().cast());
                let shifted = _mm256_sll_epi32(words, _mm_cvtsi32_si128(31 - BIT as i32));
                Self(_mm256_castsi256_ps(shifted))
            }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self(unsafe { _mm256_div_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            Self(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
        }
        #[inline(always)]
        fn negated_mul_add(self, b: Self, c: Self) -> Self {
            Self(unsafe { _mm256_fnmadd_ps(self.0, b.0, c.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn flip_sign_by(self, sign: Self) -> Self {
            Self(unsafe { _mm256_xor_ps(self.0, _mm256_and_ps(_mm256_set1_ps(-0.0), sign.0)) })
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Self {
            Self(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn le(self, other: Self) -> Self {
            Self(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn and(self, other: Self) -> Self {
            Self(unsafe { _mm256_and_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn select(mask: Self, if_set: Self, if_clear: Self) -> Self {
            Self(unsafe { _mm256_blendv_ps(if_clear.0, if_set.0, mask.0) })
        }
        #[inline(always)]
        fn sign_bits(self) -> u8 {
            unsafe { _mm256_movemask_ps(self.0) as u8 }
        }
        #[inline(always)]
        fn shift_in(self, before: Self) -> Self {
            unsafe {
                let rotation = _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6);
                let current = _mm256_permutevar8x32_ps(self.0, rotation);
                let before = _mm256_permutevar8x32_ps(before.0, rotation);
                Self(_mm256_blend_ps::<1>(current, before))
            }
        }
    }
}

/// A vector of lanes.
#[derive(Clone, Copy)]
pub struct Vec3x<L> {
    /// Component.
    pub x: L,
    /// Component.
    pub y: L,
    /// Component.
    pub z: L,
}

impl<L: Lanes> Vec3x<L> {
    /// Loads vectors from memory.
    #[inline(always)]
    pub fn load([x, y, z]: &[[f32; WIDTH]; 3]) -> Self {
        Self { x: L::load(x), y: L::load(y), z: L::load(z) }
    }

    /// To memory.
    #[inline(always)]
    pub fn store(self, [x, y, z]: &mut [[f32; WIDTH]; 3]) {
        self.x.store(x);
        self.y.store(y);
        self.z.store(z);
    }

    /// `self - v * factor`, fused where that is possible.
    #[inline(always)]
    pub fn sub_scaled(self, v: Self, factor: L) -> Self {
        Self {
            x: v.x.negated_mul_add(factor, self.x),
            y: v.y.negated_mul_add(factor, self.y),
            z: v.z.negated_mul_add(factor, self.z),
        }
    }

    /// All lanes the same.
    #[inline(always)]
    pub fn splat(v: glam::Vec3) -> Self {
        Self { x: L::splat(v.x), y: L::splat(v.y), z: L::splat(v.z) }
    }

    /// `self + other`.
    #[inline(always)]
    pub fn add(self, other: Self) -> Self {
        Self { x: self.x.add(other.x), y: self.y.add(other.y), z: self.z.add(other.z) }
    }

    /// `self - other`.
    #[inline(always)]
    pub fn sub(self, other: Self) -> Self {
        Self { x: self.x.sub(other.x), y: self.y.sub(other.y), z: self.z.sub(other.z) }
    }

    /// `self * factor`.
    #[inline(always)]
    pub fn scale(self, factor: L) -> Self {
        Self { x: self.x.mul(factor), y: self.y.mul(factor), z: self.z.mul(factor) }
    }

    /// `self * other` by component.
    #[inline(always)]
    pub fn mul(self, other: Self) -> Self {
        Self { x: self.x.mul(other.x), y: self.y.mul(other.y), z: self.z.mul(other.z) }
    }

    /// Dot product, every operation rounded: the same as glam's `Vec3::dot`.
    #[inline(always)]
    pub fn dot(self, other: Self) -> L {
        self.x.mul(other.x).add(self.y.mul(other.y)).add(self.z.mul(other.z))
    }

    /// Dot product with fused operations where there are any.
    #[inline(always)]
    pub fn dot_fused(self, other: Self) -> L {
        self.z.mul_add(other.z, self.y.mul_add(other.y, self.x.mul(other.x)))
    }

    /// `if_set` where the mask is set.
    #[inline(always)]
    pub fn select(mask: L, if_set: Self, if_clear: Self) -> Self {
        Self {
            x: L::select(mask, if_set.x, if_clear.x),
            y: L::select(mask, if_set.y, if_clear.y),
            z: L::select(mask, if_set.z, if_clear.z),
        }
    }

    /// Component-wise [`Lanes::shift_in`].
    #[inline(always)]
    pub fn shift_in(self, before: Self) -> Self {
        Self { x: self.x.shift_in(before.x), y: self.y.shift_in(before.y), z: self.z.shift_in(before.z) }
    }
}
