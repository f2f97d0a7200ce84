//! AVX-512: 16 lanes. On machines that split these vectors in two it is no slower than AVX2.

use std::arch::x86_64::*;

use super::avx2::transpose_block;

const WIDTH: usize = 16;
const WIDE: usize = LANES / WIDTH;

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn load(from: *const f32) -> __m512 {
    // SAFETY: the caller has checked that 16 values can be read.
    unsafe { _mm512_loadu_ps(from) }
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn store(to: *mut f32, value: __m512) {
    // SAFETY: the caller has checked that 16 values can be written.
    unsafe { _mm512_storeu_ps(to, value) }
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn splat(x: f32) -> __m512 {
    _mm512_set1_ps(x)
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn add(a: __m512, b: __m512) -> __m512 {
    _mm512_add_ps(a, b)
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn fma(a: __m512, b: __m512, c: __m512) -> __m512 {
    _mm512_fmadd_ps(a, b, c)
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn relu(x: __m512) -> __m512 {
    _mm512_max_ps(x, _mm512_setzero_ps())
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn keep_positive(x: __m512, mask: __m512) -> __m512 {
    _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(mask, _mm512_setzero_ps()), x)
}

super::kernels::define_kernels!(__m512, #[target_feature(enable = "avx512f,avx2,fma")]);
