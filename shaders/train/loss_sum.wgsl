// use: train/parameters
// Adds up the loss of a batch.

@group(0) @binding(0) var<storage, read> losses: array<f32>;
@group(0) @binding(1) var<storage, read_write> progress: Progress;
/// Sums of the loss, one from each workgroup that has computed it.
var<immediate> count: u32;

const THREADS: u32 = 256u;

var<workgroup> sums: array<f32, THREADS>;

/// One workgroup; after it the step counts, unless it has diverged.
@compute @workgroup_size(THREADS)
fn sum_losses(@builtin(local_invocation_index) local: u32) {
    var sum = 0.0;
    for (var i = local; i < count; i += THREADS) {
        sum += losses[i];
    }
    sums[local] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            sums[local] += sums[local + half];
        }
    }
    if local != 0u {
        return;
    }
    if !is_finite(sums[0]) {
        progress.diverged = 1u;
    }
    if progress.diverged == 0u {
        progress.loss = sums[0];
        progress.loss_sum += sums[0];
        progress.steps += 1u;
    }
}
