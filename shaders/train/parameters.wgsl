// use: train/batch
// What the kernels over all parameters share. Tensors begin at multiples of 16, so that one word says of each block of 16
// what it is.

/// Parameters of a block.
const BLOCK: u32 = 16u;

/// Low byte: the space that its gradient is summed over, or GRID, or NONE. Next byte: its optimiser.
const GRID: u32 = 3u;
const NONE: u32 = 4u;

const ADAM: u32 = 0u;
const MUON: u32 = 1u;
const SPARSE_ADAM: u32 = 2u;

/// Momentum of Muon.
const MUON_MOMENTUM: f32 = 0.95;

struct Progress {
    /// Loss of the last step, finite or not; sum over the steps since the host has asked.
    loss: f32,
    loss_sum: f32,
    /// Steps since then, those that had no effect left out.
    steps: u32,
    /// 1 if a loss or a gradient was not finite. From then on steps have no effect.
    diverged: u32,
    /// One more than a pixel with a target that is not finite; 0 if there was none.
    bad_target: u32,
}

/// True if `x` is finite. Fast arithmetic may take `x == x` for granted, bits it may not.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
