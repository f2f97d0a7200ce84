// use: train/layers
// Products of matrices by tiles, as `product.wgsl`, but both factors are rounded to 16 bits, and subgroups of 32 multiply 16 by
// 16 of them at once; sums have 32 bits. A subgroup has 16 rows by 32 columns of a tile.

enable f16;
enable wgpu_cooperative_matrix;

@group(0) @binding(0) var<storage, read> layers: array<Layer>;
@group(0) @binding(1) var<storage, read_write> activations: array<vec4f>;

const TILE: u32 = 64u;
const SLAB: u32 = 32u;
const QUADS: u32 = TILE / 4u;
const THREADS: u32 = 256u;
/// Values from a row of a slab, and of the sums, to the next: some more than it has, so that rows do not start in the same bank.
const PITCH: u32 = TILE + 8u;
const SUM_PITCH: u32 = TILE + 4u;
/// Largest 16-bit float.
const LARGEST: f32 = 65504.0;

/// Slabs of both factors, `[depth][row or column]`.
var<workgroup> left: array<f16, SLAB * PITCH>;
var<workgroup> right: array<f16, SLAB * PITCH>;
/// Sums, `[row][column]`; between products, what a tile keeps.
var<workgroup> sums_of_tile: array<f32, TILE * SUM_PITCH>;

/// A subgroup's share of a product.
struct Sum {
    near: coop_mat16x16<f32, C>,
    far: coop_mat16x16<f32, C>,
}

/// Adds the product of both slabs, once all threads have filled them; after it they may be filled again.
fn add_slabs(start: Sum, local: u32) -> Sum {
    workgroupBarrier();
    let row = local / 64u * 16u;
    let column = local / 32u % 2u * 32u;
    let pitch = PITCH;
    var near = start.near;
    var far = start.far;
    for (var k = 0u; k < SLAB; k += 16u) {
        let a_at = k * pitch + row;
        let near_at = k * pitch + column;
        let far_at = near_at + 16u;
        let a = coopLoad<coop_mat16x16<f16, A>>(&left[a_at], pitch);
        let b_near = coopLoadT<coop_mat16x16<f16, B>>(&right[near_at], pitch);
        let b_far = coopLoadT<coop_mat16x16<f16, B>>(&right[far_at], pitch);
        near = coopMultiplyAdd(a, b_near, near);
        far = coopMultiplyAdd(a, b_far, far);
    }
    workgroupBarrier();
    return Sum(near, far);
}

/// A thread's 4 by 4 of a finished product: columns of the sum are its rows.
fn values_of(sum: Sum, local: u32) -> mat4x4f {
    let near_at = local / 64u * 16u * SUM_PITCH + local / 32u % 2u * 32u;
    let far_at = near_at + 16u;
    let pitch = SUM_PITCH;
    coopStoreT(sum.near, &sums_of_tile[near_at], pitch);
    coopStoreT(sum.far, &sums_of_tile[far_at], pitch);
    workgroupBarrier();
    var values: mat4x4f;
    for (var i = 0u; i < 4u; i += 1u) {
        let at = (local / QUADS * 4u + i) * SUM_PITCH + local % QUADS * 4u;
        values[i] = vec4f(sums_of_tile[at], sums_of_tile[at + 1u], sums_of_tile[at + 2u], sums_of_tile[at + 3u]);
    }
    workgroupBarrier();
    return values;
}

fn rounded(value: f32) -> f16 {
    return f16(clamp(value, -LARGEST, LARGEST));
}

/// Puts four values of a row or column, four of its depth, into part `part` of a slab.
fn spread_left(local: u32, part: u32, values: vec4f) {
    let at = (part * 16u + local % 4u * 4u) * PITCH + local / 4u;
    for (var i = 0u; i < 4u; i += 1u) {
        left[at + i * PITCH] = rounded(values[i]);
    }
}

fn spread_right(local: u32, part: u32, values: vec4f) {
    let at = (part * 16u + local % 4u * 4u) * PITCH + local / 4u;
    for (var i = 0u; i < 4u; i += 1u) {
        right[at + i * PITCH] = rounded(values[i]);
    }
}

/// Puts four neighbouring rows or columns of one depth into part `part` of a slab.
fn put_left(local: u32, part: u32, values: vec4f) {
    let at = (part * 16u + local / QUADS) * PITCH + local % QUADS * 4u;
    for (var i = 0u; i < 4u; i += 1u) {
        left[at + i] = rounded(values[i]);
    }
}

fn put_right(local: u32, part: u32, values: vec4f) {
    let at = (part * 16u + local / QUADS) * PITCH + local % QUADS * 4u;
    for (var i = 0u; i < 4u; i += 1u) {
        right[at + i] = rounded(values[i]);
    }
}

/// Keeps one of 1,024 pairs until the next product.
fn keep(place: u32, pair: vec2f) {
    sums_of_tile[2u * place] = pair.x;
    sums_of_tile[2u * place + 1u] = pair.y;
}

fn kept(place: u32) -> vec2f {
    return vec2f(sums_of_tile[2u * place], sums_of_tile[2u * place + 1u]);
}
