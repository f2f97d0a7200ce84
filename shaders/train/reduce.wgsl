// use: train/parameters
// Adds up the pieces of the gradient in their order, and the loss of a batch.

struct Reduction {
    batch: Batch,
    /// Columns of a piece; values of a piece, which are the parameters before the grid.
    piece: u32,
    dense: u32,
    /// All parameters.
    parameters: u32,
    /// Sums of the loss, one from each workgroup that has computed it.
    losses: u32,
}

@group(0) @binding(0) var<storage, read> blocks: array<u32>;
/// `[piece][parameter]`
@group(0) @binding(1) var<storage, read> pieces: array<f32>;
@group(0) @binding(2) var<storage, read_write> grid: array<u32>;
@group(0) @binding(3) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(4) var<storage, read_write> progress: Progress;
@group(0) @binding(5) var<storage, read> losses: array<f32>;
var<immediate> arguments: Reduction;

const THREADS: u32 = 256u;

/// The first workgroup takes the loss, a thread of the others a parameter.
@compute @workgroup_size(THREADS)
fn reduce(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let group = workgroup.x + workgroup.y * groups.x;
    if group == 0u {
        sum_losses(local);
        return;
    }
    let index = (group - 1u) * THREADS + local;
    if index >= arguments.parameters {
        return;
    }
    let sum = gradient_of(index);
    gradient[index] = sum;
    if !is_finite(sum) {
        progress.diverged = 1u;
    }
}

var<workgroup> sums: array<f32, THREADS>;

fn sum_losses(local: u32) {
    var sum = 0.0;
    for (var i = local; i < arguments.losses; i += THREADS) {
        sum += losses[i];
    }
    sums[local] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            sums[local] += sums[local + half];
        }
    }
    if local == 0u {
        progress.loss = sums[0];
        if !is_finite(sums[0]) {
            progress.diverged = 1u;
        }
    }
}

/// Sum of the gradients by a parameter; the grid's begin anew.
fn gradient_of(index: u32) -> f32 {
    let space = blocks[index / BLOCK] & 255u;
    var sum = 0.0;
    if space == GRID {
        let at = 2u * (index - arguments.dense);
        sum = value_of(grid[at], grid[at + 1u]);
        grid[at] = 0u;
        grid[at + 1u] = 0u;
    } else if space != NONE {
        let count = (columns(arguments.batch, space) + arguments.piece - 1u) / arguments.piece;
        for (var i = 0u; i < count; i += 1u) {
            sum += pieces[i * arguments.dense + index];
        }
    }
    return sum;
}

/// Value of a sum in units of 2^-48.
fn value_of(low: u32, high: u32) -> f32 {
    if high >= 0x80000000u {
        let carry = select(0u, 1u, low == 0u);
        return -magnitude(~low + 1u, ~high + carry);
    }
    return magnitude(low, high);
}

fn magnitude(low: u32, high: u32) -> f32 {
    return f32(high) / 65536.0 + f32(low) / 281474976710656.0;
}
