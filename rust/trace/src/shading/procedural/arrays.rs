//! Points of one to four coordinates.

#[inline(always)]
pub fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

#[inline(always)]
pub fn mix<const N: usize>(a: [f32; N], b: [f32; N], t: f32) -> [f32; N] {
    std::array::from_fn(|i| lerp(a[i], b[i], t))
}

#[inline(always)]
pub fn add<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|i| a[i] + b[i])
}

#[inline(always)]
pub fn subtract<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|i| a[i] - b[i])
}

#[inline(always)]
pub fn scale<const N: usize>(a: [f32; N], by: f32) -> [f32; N] {
    a.map(|x| x * by)
}

#[inline(always)]
pub fn dot<const N: usize>(a: [f32; N], b: [f32; N]) -> f32 {
    (0..N).map(|i| a[i] * b[i]).sum()
}

/// The Hermite step of a number in 0..=1.
#[inline(always)]
pub fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}
