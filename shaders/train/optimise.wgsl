// use: train/parameters
// constant: SIDE 64
// constant: ROUNDS 5
// Moves all parameters, and their running mean, in one dispatch: Muon (Jordan et al. 2024, "Muon: An optimizer for hidden
// layers in neural networks") for small hidden matrices, one a workgroup, and Adam (Kingma and Ba 2015) for the rest. Matrices
// with more than SIDE rows, whose iterates do not fit workgroup memory, are left to `muon.wgsl`.

struct Rates {
    parameters: u32,
    adam: f32,
    grid: f32,
    /// One over one minus the powers of the decays.
    first_correction: f32,
    second_correction: f32,
    /// Share of the way that the mean goes.
    mean_share: f32,
    /// Matrices of Muon that are moved here, the rows of each, values from row to row, and the length of a step.
    matrices: u32,
    size: u32,
    stride: u32,
    muon: f32,
    /// Coefficients of the Newton-Schulz iteration.
    linear: f32,
    cubic: f32,
    quintic: f32,
}

@group(0) @binding(0) var<storage, read> blocks: array<u32>;
@group(0) @binding(1) var<storage, read_write> progress: Progress;
@group(0) @binding(2) var<storage, read> gradient: array<f32>;
@group(0) @binding(3) var<storage, read_write> params: array<f32>;
/// First moments of Adam, momentum of Muon.
@group(0) @binding(4) var<storage, read_write> first: array<f32>;
@group(0) @binding(5) var<storage, read_write> second: array<f32>;
@group(0) @binding(6) var<storage, read_write> mean: array<f32>;
/// First parameter of each matrix.
@group(0) @binding(7) var<storage, read> starts: array<u32>;
var<immediate> arguments: Rates;

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.99;
const EPSILON: f32 = 1e-15;
const THREADS: u32 = 256u;

@compute @workgroup_size(THREADS)
fn optimise(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    if progress.diverged != 0u {
        return;
    }
    let group = workgroup.x + workgroup.y * groups.x;
    if group == 0u && local == 0u {
        progress.loss_sum += progress.loss;
        progress.steps += 1u;
    }
    if group < arguments.matrices {
        muon(starts[group], local);
        return;
    }
    let index = (group - arguments.matrices) * THREADS + local;
    if index < arguments.parameters && blocks[index / BLOCK] >> 8u != MUON {
        adam(index, blocks[index / BLOCK] >> 8u == SPARSE_ADAM);
    }
}

fn adam(index: u32, sparse: bool) {
    let g = gradient[index];
    if !(sparse && g == 0.0) {
        let m = BETA1 * first[index] + (1.0 - BETA1) * g;
        let v = BETA2 * second[index] + (1.0 - BETA2) * g * g;
        first[index] = m;
        second[index] = v;
        let rate = select(arguments.adam, arguments.grid, sparse);
        params[index] -= rate * (m * arguments.first_correction) / (sqrt(v * arguments.second_correction) + EPSILON);
    }
    mean[index] += arguments.mean_share * (params[index] - mean[index]);
}

const QUADS: u32 = SIDE / 4u;
/// Quads of a square, and where the iterate X and what is made of X XT start.
const SQUARE: u32 = SIDE * QUADS;
const X: u32 = 0u;
const GRAM: u32 = SQUARE;

/// Rows of four values each. A thread owns 4 by 4 of them.
var<workgroup> squares: array<vec4f, 2u * SQUARE>;

/// Where a quad of a row lies: each row is turned by its number, so that neither rows nor columns share banks.
fn quad_at(square: u32, row: u32, quad: u32) -> u32 {
    return square + row * QUADS + (quad + row / 4u) % QUADS;
}

fn rows_of(square: u32, row_quad: u32, quad: u32) -> mat4x4f {
    let row = 4u * row_quad;
    return mat4x4f(
        squares[quad_at(square, row, quad)],
        squares[quad_at(square, row + 1u, quad)],
        squares[quad_at(square, row + 2u, quad)],
        squares[quad_at(square, row + 3u, quad)],
    );
}

/// Replaces a thread's share of a square, after all have read it and before any reads it again.
fn replace(square: u32, place: vec2u, values: mat4x4f) {
    workgroupBarrier();
    if place.y < QUADS {
        for (var i = 0u; i < 4u; i += 1u) {
            squares[quad_at(square, 4u * place.y + i, place.x)] = values[i];
        }
    }
    workgroupBarrier();
}

/// A thread's share of X XT.
fn gram(place: vec2u) -> mat4x4f {
    var sum = mat4x4f();
    if place.y < QUADS {
        for (var k = 0u; k < QUADS; k += 1u) {
            sum += transpose(rows_of(X, place.x, k)) * rows_of(X, place.y, k);
        }
    }
    return sum;
}

/// Four by four values of GRAM times a square.
fn product(right: u32, place: vec2u) -> mat4x4f {
    var sum = mat4x4f();
    if place.y < QUADS {
        for (var k = 0u; k < QUADS; k += 1u) {
            sum += rows_of(right, k, place.x) * rows_of(GRAM, place.y, k);
        }
    }
    return sum;
}

fn own(square: u32, place: vec2u) -> mat4x4f {
    if place.y < QUADS {
        return rows_of(square, place.y, place.x);
    }
    return mat4x4f();
}

/// Moves the matrix that begins at a parameter by its momentum, whose singular values are brought near 1.
fn muon(start: u32, local: u32) {
    let place = vec2u(local % QUADS, local / QUADS);
    replace(X, place, momentum(start, place));
    for (var round = 0u; round < ROUNDS; round += 1u) {
        replace(GRAM, place, gram(place));
        replace(GRAM, place, arguments.cubic * own(GRAM, place) + arguments.quintic * product(GRAM, place));
        replace(X, place, arguments.linear * own(X, place) + product(X, place));
    }
    let moved = own(X, place);
    for (var i = 0u; i < 16u; i += 1u) {
        let at = parameter(start, place, i);
        if at != OUTSIDE {
            params[at] -= arguments.muon * moved[i / 4u][i % 4u];
            mean[at] += arguments.mean_share * (params[at] - mean[at]);
        }
    }
}

const OUTSIDE: u32 = 0xffffffffu;

/// Parameter of one of a thread's values.
fn parameter(start: u32, place: vec2u, value: u32) -> u32 {
    let row = 4u * place.y + value / 4u;
    let column = 4u * place.x + value % 4u;
    return select(OUTSIDE, start + row * arguments.stride + column, row < arguments.size && column < arguments.size);
}

/// Nesterov's momentum, scaled to norm 1.
fn momentum(start: u32, place: vec2u) -> mat4x4f {
    const m = MUON_MOMENTUM;
    var values = mat4x4f();
    var sum = 0.0;
    for (var i = 0u; i < 16u; i += 1u) {
        let at = parameter(start, place, i);
        if at != OUTSIDE {
            let g = gradient[at];
            first[at] = m * first[at] + g;
            let x = g + m * first[at];
            values[i / 4u][i % 4u] = x;
            sum += x * x;
        }
    }
    return inverse_norm(sum, place) * values;
}

/// One over the norm of a matrix, from the squares of each thread's share.
fn inverse_norm(squares_sum: f32, place: vec2u) -> f32 {
    if place.y < QUADS {
        squares[place.y * QUADS + place.x] = vec4f(squares_sum);
    }
    workgroupBarrier();
    var sum = 0.0;
    for (var i = 0u; i < QUADS * QUADS; i += 1u) {
        sum += squares[i].x;
    }
    // Nothing to go by: no step.
    let norm = sqrt(sum);
    return select(0.0, 1.0 / norm, norm >= 1e-30);
}
