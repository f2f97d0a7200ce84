//! Any machine: eight lanes in an array, which compilers turn into whatever vectors there are.

const WIDTH: usize = 8;
const WIDE: usize = LANES / WIDTH;

#[inline(always)]
unsafe fn load(from: *const f32) -> [f32; WIDTH] {
    // SAFETY: the caller has checked that 8 values can be read.
    unsafe { from.cast::<[f32; WIDTH]>().read_unaligned() }
}

#[inline(always)]
unsafe fn store(to: *mut f32, value: [f32; WIDTH]) {
    // SAFETY: the caller has checked that 8 values can be written.
    unsafe { to.cast::<[f32; WIDTH]>().write_unaligned(value) }
}

#[inline(always)]
fn splat(x: f32) -> [f32; WIDTH] {
    [x; 8]
}

#[inline(always)]
fn add(a: [f32; WIDTH], b: [f32; WIDTH]) -> [f32; WIDTH] {
    std::array::from_fn(|i| a[i] + b[i])
}

#[inline(always)]
fn fma(a: [f32; WIDTH], b: [f32; WIDTH], c: [f32; WIDTH]) -> [f32; WIDTH] {
    std::array::from_fn(|i| a[i] * b[i] + c[i])
}

#[inline(always)]
fn relu(x: [f32; WIDTH]) -> [f32; WIDTH] {
    x.map(|x| x.max(0.0))
}

#[inline(always)]
fn keep_positive(x: [f32; WIDTH], mask: [f32; WIDTH]) -> [f32; WIDTH] {
    std::array::from_fn(|i| if mask[i] > 0.0 { x[i] } else { 0.0 })
}

#[inline(always)]
unsafe fn transpose_block(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize) {
    for i in 0..8 {
        for j in 0..8 {
            // SAFETY: the caller has checked that 8 rows of 8 values lie behind both pointers.
            unsafe { *to.add(j * to_stride + i) = *from.add(i * from_stride + j) };
        }
    }
}

super::kernels::define_kernels!([f32; WIDTH],);
