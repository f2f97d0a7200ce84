// use: train/parameters
// Muon (Jordan et al. 2024, "Muon: An optimizer for hidden layers in neural networks") for square matrices, all at once, that
// are too large for `optimise.wgsl`. A matrix has four squares of scratch: the iterate, its Gram matrix, the polynomial of that, and the next iterate.

struct Muon {
    /// Rows and columns; values from row to row among the parameters.
    size: u32,
    stride: u32,
    matrices: u32,
    /// Indices among the four squares: `to = factor * left * right + share * plus`, with `right` turned or not.
    left: u32,
    right: u32,
    turned: u32,
    plus: u32,
    to: u32,
    factor: f32,
    share: f32,
    /// Length of the step.
    step: f32,
    /// Share of the way that the mean goes.
    mean_share: f32,
}

@group(0) @binding(0) var<storage, read_write> squares: array<f32>;
/// First parameter of each matrix.
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> progress: Progress;
/// At the start the momentum, at the end the parameters.
@group(0) @binding(3) var<storage, read_write> moved: array<f32>;
@group(0) @binding(4) var<storage, read> gradient: array<f32>;
/// At the end, in its place.
@group(0) @binding(4) var<storage, read_write> mean: array<f32>;
var<immediate> arguments: Muon;

const TILE: u32 = 16u;
const THREADS: u32 = 256u;

fn square(matrix: u32, number: u32) -> u32 {
    return (matrix * 4u + number) * arguments.size * arguments.size;
}

var<workgroup> sums: array<f32, THREADS>;

/// Nesterov's momentum, scaled to norm 1, in the first square; one workgroup a matrix.
@compute @workgroup_size(THREADS)
fn start(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    if progress.diverged != 0u {
        return;
    }
    let size = arguments.size;
    let to = square(group.x, 0u);
    var sum = 0.0;
    for (var i = local; i < size * size; i += THREADS) {
        let at = starts[group.x] + i / size * arguments.stride + i % size;
        let g = gradient[at];
        let m = MUON_MOMENTUM * moved[at] + g;
        moved[at] = m;
        let x = g + MUON_MOMENTUM * m;
        squares[to + i] = x;
        sum += x * x;
    }
    sums[local] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            sums[local] += sums[local + half];
        }
    }
    workgroupBarrier();
    // Nothing to go by: no step.
    let norm = sqrt(sums[0]);
    let inverse = select(0.0, 1.0 / norm, norm >= 1e-30);
    for (var i = local; i < size * size; i += THREADS) {
        squares[to + i] *= inverse;
    }
}

var<workgroup> left: array<f32, TILE * TILE>;
var<workgroup> right: array<f32, TILE * TILE>;

/// A workgroup computes 16 by 16 values of a product.
@compute @workgroup_size(THREADS)
fn multiply(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let size = arguments.size;
    let across = (size + TILE - 1u) / TILE;
    let tile = group.x + group.y * groups.x;
    let matrix = tile / (across * across);
    if matrix >= arguments.matrices {
        return;
    }
    let ty = local / TILE;
    let tx = local % TILE;
    let row = tile / across % across * TILE + ty;
    let column_start = tile % across * TILE;
    let a = square(matrix, arguments.left);
    let b = square(matrix, arguments.right);
    var sum = 0.0;
    for (var depth = 0u; depth < size; depth += TILE) {
        // Rows are read along; those of a turned factor are kept as columns.
        let b_row = select(depth, column_start, arguments.turned != 0u) + ty;
        let b_column = select(column_start, depth, arguments.turned != 0u) + tx;
        var a_value = 0.0;
        var b_value = 0.0;
        if row < size && depth + tx < size {
            a_value = squares[a + row * size + depth + tx];
        }
        if b_row < size && b_column < size {
            b_value = squares[b + b_row * size + b_column];
        }
        left[local] = a_value;
        right[select(local, tx * TILE + ty, arguments.turned != 0u)] = b_value;
        workgroupBarrier();
        for (var k = 0u; k < TILE; k += 1u) {
            sum += left[ty * TILE + k] * right[k * TILE + tx];
        }
        workgroupBarrier();
    }
    if row < size && column_start + tx < size {
        let at = row * size + column_start + tx;
        let plus = arguments.share * squares[square(matrix, arguments.plus) + at];
        squares[square(matrix, arguments.to) + at] = arguments.factor * sum + plus;
    }
}

/// Moves the parameters along the square `left`, and their mean.
@compute @workgroup_size(THREADS)
fn finish(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.x + id.y * groups.x * THREADS;
    let size = arguments.size;
    let matrix = index / (size * size);
    if matrix >= arguments.matrices || progress.diverged != 0u {
        return;
    }
    let at = index % (size * size);
    let parameter = starts[matrix] + at / size * arguments.stride + at % size;
    moved[parameter] -= arguments.step * squares[square(matrix, arguments.left) + at];
    mean[parameter] += arguments.mean_share * (moved[parameter] - mean[parameter]);
}
