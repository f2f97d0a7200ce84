//! AVX-512: 16 lanes. On machines that split these vectors in two it is no slower than AVX2.

use std::arch::x86_64::*;

use super::avx2::transpose_block;

type V = __m512;
const WIDTH: usize = 16;
const WIDE: usize = LANES / WIDTH;

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn load(from: *const f32) -> V {
    // SAFETY: the caller has checked that 16 values can be read.
    unsafe { _mm512_loadu_ps(from) }
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn store(to: *mut f32, value: V) {
    // SAFETY: the caller has checked that 16 values can be written.
    unsafe { _mm512_storeu_ps(to, value) }
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn splat(x: f32) -> V {
    _mm512_set1_ps(x)
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn add(a: V, b: V) -> V {
    _mm512_add_ps(a, b)
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn fma(a: V, b: V, c: V) -> V {
    _mm512_fmadd_ps(a, b, c)
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn relu(x: V) -> V {
    _mm512_max_ps(x, _mm512_setzero_ps())
}

#[inline]
#[target_feature(enable = "avx512f,avx2,fma")]
fn keep_positive(x: V, mask: V) -> V {
    _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(mask, _mm512_setzero_ps()), x)
}

super::kernels::define_kernels!(#[target_feature(enable = "avx512f,avx2,fma")]);
