//! Matrix kernels on tiles of 32 samples, for AVX-512, AVX2 with FMA, and any other machine.
//!
//! Activations lie as `[feature][LANES]`; weights are packed by [`ROWS`] outputs. The inner block holds 6 outputs by
//! two vectors of samples in twelve accumulators, which leaves registers for two inputs and a broadcast weight: a
//! block of sixteen live registers makes LLVM spill and halves the speed.

mod aligned;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod kernels;
mod packed;
mod portable;

pub(crate) use aligned::AlignedVec;
pub(crate) use packed::PackedMatrix;

/// Samples in a tile.
pub(crate) const LANES: usize = 32;
/// Outputs in a register block.
pub(crate) const ROWS: usize = 6;
/// Row strides of weights and their gradients are multiples of this many values, zero-padded.
pub(crate) const PAD: usize = 16;

/// `n` rounded up to a multiple of [`PAD`].
pub(crate) fn padded(n: usize) -> usize {
    n.next_multiple_of(PAD)
}

/// Instruction set of the kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// Any machine.
    Portable,
    /// AVX2 and FMA, 8 lanes.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512, 16 lanes.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Isa {
    /// The widest that this machine has.
    pub fn detect() -> Self {
        Self::available().last().copied().unwrap_or(Self::Portable)
    }

    /// All that this machine has, narrowest first.
    pub fn available() -> Vec<Self> {
        #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "only x86-64 adds to it"))]
        let mut found = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            found.push(Self::Avx2);
            if is_x86_feature_detected!("avx512f") {
                found.push(Self::Avx512);
            }
        }
        found
    }

    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "avx2+fma",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "avx512f",
        }
    }
}

/// Calls one kernel of the module of an instruction set.
macro_rules! dispatch {
    ($isa:expr, $kernel:ident($($argument:expr),* $(,)?)) => {
        match $isa {
            // SAFETY: the caller of the macro has checked all lengths.
            Isa::Portable => unsafe { portable::$kernel($($argument),*) },
            // SAFETY: as above; `Isa::available` hands this out only where the instructions exist.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => unsafe { avx2::$kernel($($argument),*) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => unsafe { avx512::$kernel($($argument),*) },
        }
    };
}

/// Initial value of a matrix product.
#[derive(Clone, Copy)]
pub(crate) enum Start<'a> {
    /// Zero.
    Zero,
    /// One value per output.
    Bias(&'a [f32]),
    /// Value of the output tile.
    Output,
}

/// Operation on a result on its way to memory.
#[derive(Clone, Copy)]
pub(crate) enum Finish<'a> {
    /// Linear output: nothing happens to the result.
    Linear,
    /// `max(x, 0)`.
    Relu,
    /// Zero where this tile, as long as the output, is not above zero: the gradient of a ReLU from its output.
    Mask(&'a [f32]),
}

/// Arguments of the `dense` kernels.
pub(crate) struct DenseJob {
    pub outputs: usize,
    pub inputs: usize,
    pub weights: *const f32,
    pub bias: *const f32,
    pub from_output: bool,
    pub x: *const f32,
    pub y: *mut f32,
    pub relu: bool,
    pub mask: *const f32,
}

/// `y[o][s] = finish(start + sum_i w[o][i] x[i][s])` for one tile.
pub(crate) fn dense(isa: Isa, w: &PackedMatrix, start: Start, x: &[f32], y: &mut [f32], finish: Finish) {
    assert_eq!(x.len(), w.inputs() * LANES, "input tile");
    assert_eq!(y.len(), w.outputs() * LANES, "output tile");
    let bias = match start {
        Start::Bias(bias) => {
            assert_eq!(bias.len(), w.outputs(), "bias");
            bias.as_ptr()
        }
        Start::Zero | Start::Output => std::ptr::null(),
    };
    let mask = match finish {
        Finish::Mask(mask) => {
            assert_eq!(mask.len(), y.len(), "mask tile");
            mask.as_ptr()
        }
        Finish::Linear | Finish::Relu => std::ptr::null(),
    };
    let job = DenseJob {
        outputs: w.outputs(),
        inputs: w.inputs(),
        weights: w.data().as_ptr(),
        bias,
        from_output: matches!(start, Start::Output),
        x: x.as_ptr(),
        y: y.as_mut_ptr(),
        relu: matches!(finish, Finish::Relu),
        mask,
    };
    dispatch!(isa, dense(&job));
}

/// Sums of outer products over samples: `out[r][c] += sum_t sum_s a[t][r][s] b[t][s][c]`, `a` in tiles
/// `[t][rows][LANES]`, `b` transposed `[t][LANES][stride]`, `out` `[rows][stride]`; `stride` a multiple of [`PAD`].
pub(crate) fn outer(isa: Isa, a: &[f32], b: &[f32], rows: usize, stride: usize, out: &mut [f32]) {
    assert_eq!(stride % PAD, 0, "stride");
    let tiles = a.len() / (rows * LANES);
    assert_eq!(a.len(), tiles * rows * LANES, "left tiles");
    assert_eq!(b.len(), tiles * LANES * stride, "right tiles");
    assert_eq!(out.len(), rows * stride, "products");
    dispatch!(isa, outer(tiles, rows, stride, a.as_ptr(), b.as_ptr(), out.as_mut_ptr()));
}

/// Transposes a tile `[features][LANES]` into `[LANES][stride]`, zero beyond the features.
pub(crate) fn transpose(isa: Isa, x: &[f32], stride: usize, out: &mut [f32]) {
    let features = x.len() / LANES;
    assert!(features <= stride && stride.is_multiple_of(PAD), "stride");
    assert_eq!(out.len(), LANES * stride, "transposed tile");
    dispatch!(isa, transpose(features, stride, x.as_ptr(), out.as_mut_ptr()));
}

/// `sums[r] += sum_s x[r][s]` over one tile.
pub(crate) fn row_sums(isa: Isa, x: &[f32], sums: &mut [f32]) {
    assert_eq!(x.len(), sums.len() * LANES, "tile");
    dispatch!(isa, row_sums(x, sums));
}

/// `h[r][s] = gamma[r] z[r][s] + beta[r]`, through a ReLU if asked, over one tile.
pub(crate) fn modulate(isa: Isa, z: &[f32], gamma: &[f32], beta: &[f32], relu: bool, h: &mut [f32]) {
    assert!(z.len() == h.len() && gamma.len() * LANES == z.len() && beta.len() == gamma.len(), "modulation");
    dispatch!(isa, modulate(z, gamma, beta, relu, h));
}

/// Backward of [`modulate`] before its ReLU: `d_gamma[r] += sum_s d[r][s] z[r][s]`, `d_beta[r] += sum_s d[r][s]`, then
/// `d[r][s] *= gamma[r]`.
pub(crate) fn modulate_backward(
    isa: Isa,
    z: &[f32],
    gamma: &[f32],
    d: &mut [f32],
    d_gamma: &mut [f32],
    d_beta: &mut [f32],
) {
    assert!(z.len() == d.len() && gamma.len() * LANES == z.len(), "modulation");
    assert!(d_gamma.len() == gamma.len() && d_beta.len() == gamma.len(), "modulation");
    dispatch!(isa, modulate_backward(z, gamma, d, d_gamma, d_beta));
}

#[cfg(test)]
mod tests;
