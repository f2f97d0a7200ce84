// use: train/layers
// Products of matrices by tiles: a workgroup computes 64 rows by 64 columns, a thread 4 by 4 of them, from slabs of both factors
// in workgroup memory. `product_matrices.wgsl` has the same names.

@group(0) @binding(0) var<storage, read> layers: array<Layer>;
@group(0) @binding(1) var<storage, read_write> activations: array<vec4f>;

const TILE: u32 = 64u;
const SLAB: u32 = 16u;
const QUADS: u32 = TILE / 4u;
const THREADS: u32 = 256u;
/// Fours from a row of a slab to the next; one more than it has, so that columns written at once lie in different banks.
const PITCH: u32 = QUADS + 1u;

/// Slabs of both factors, `[depth][row or column]`.
var<workgroup> left: array<vec4f, SLAB * PITCH>;
var<workgroup> right: array<vec4f, SLAB * PITCH>;

/// A thread's share of a product: columns of the matrix are its rows.
alias Sum = mat4x4f;

/// Adds the product of both slabs, once all threads have filled them; after it they may be filled again.
fn add_slabs(start: Sum, local: u32) -> Sum {
    workgroupBarrier();
    let ty = local / QUADS;
    let tx = local % QUADS;
    var sum = start;
    for (var k = 0u; k < SLAB; k += 1u) {
        let a = left[k * PITCH + ty];
        let b = right[k * PITCH + tx];
        sum[0] += a.x * b;
        sum[1] += a.y * b;
        sum[2] += a.z * b;
        sum[3] += a.w * b;
    }
    workgroupBarrier();
    return sum;
}

/// A thread's 4 by 4 of a finished product.
fn values_of(sum: Sum, local: u32) -> mat4x4f {
    return sum;
}

/// Puts four values of a row or column, four of its depth, into part `part` of a slab, of which there is one.
fn spread_left(local: u32, part: u32, values: vec4f) {
    for (var i = 0u; i < 4u; i += 1u) {
        left[(local % 4u * 4u + i) * PITCH + local / 16u][local / 4u % 4u] = values[i];
    }
}

fn spread_right(local: u32, part: u32, values: vec4f) {
    for (var i = 0u; i < 4u; i += 1u) {
        right[(local % 4u * 4u + i) * PITCH + local / 16u][local / 4u % 4u] = values[i];
    }
}

/// Puts four neighbouring rows or columns of one depth into part `part` of a slab.
fn put_left(local: u32, part: u32, values: vec4f) {
    left[local / QUADS * PITCH + local % QUADS] = values;
}

fn put_right(local: u32, part: u32, values: vec4f) {
    right[local / QUADS * PITCH + local % QUADS] = values;
}

/// Keeps one of 1,024 pairs until the next product.
fn keep(place: u32, pair: vec2f) {
    left[place / 4u][place % 4u] = pair.x;
    right[place / 4u][place % 4u] = pair.y;
}

fn kept(place: u32) -> vec2f {
    return vec2f(left[place / 4u][place % 4u], right[place / 4u][place % 4u]);
}
