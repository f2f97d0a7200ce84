// use: train/layers
// use: common/matrices
// Products of matrices by tiles, as `product.wgsl`, but both factors are rounded to 16 bits, and subgroups multiply matrices of
// them at once; sums have 32 bits. A subgroup has some pairs of a tile's matrices.

enable f16;

@group(0) @binding(0) var<storage, read> layers: array<Layer>;
@group(0) @binding(1) var<storage, read_write> activations: array<vec4f>;

const TILE: u32 = 64u;
const SLAB: u32 = 32u;
const QUADS: u32 = TILE / 4u;
const THREADS: u32 = 256u;
/// Values from a row of a slab, and of the sums, to the next: some more than it has, so that rows do not start in the same bank.
const PITCH: u32 = TILE + 8u;
const SUM_PITCH: u32 = TILE + 4u;
/// Pairs in a row of a tile, and of a subgroup: one of 16 by 16 where a subgroup is 32 invocations.
const ROW_PAIRS: u32 = TILE / (2u * SIDE);
const PAIRS: u32 = TILE / SIDE * ROW_PAIRS * SUBGROUP / THREADS;
/// Largest 16-bit float.
const LARGEST: f32 = 65504.0;

/// Slabs of both factors, `[depth][row or column]`.
var<workgroup> left: array<f16, SLAB * PITCH>;
var<workgroup> right: array<f16, SLAB * PITCH>;
/// Sums, `[row][column]`; between products, what a tile keeps.
var<workgroup> sums_of_tile: array<f32, TILE * SUM_PITCH>;

/// A row of two sums.
struct Pair {
    near: WideSum,
    far: WideSum,
}

/// A subgroup's share of a product.
alias Sum = array<Pair, PAIRS>;

/// First row and column of a pair of an invocation's subgroup.
fn place_of_pair(pair: u32, local: u32) -> vec2u {
    let number = local / SUBGROUP * PAIRS + pair;
    return vec2u(number / ROW_PAIRS * SIDE, number % ROW_PAIRS * 2u * SIDE);
}

/// Adds the product of both slabs, once all threads have filled them; after it they may be filled again.
fn add_slabs(start: Sum, local: u32) -> Sum {
    workgroupBarrier();
    let pitch = PITCH;
    var sum = start;
    for (var pair = 0u; pair < PAIRS; pair += 1u) {
        let place = place_of_pair(pair, local);
        var near = sum[pair].near;
        var far = sum[pair].far;
        for (var k = 0u; k < SLAB; k += SIDE) {
            let a_at = k * pitch + place.x;
            let near_at = k * pitch + place.y;
            let far_at = near_at + SIDE;
            let a = coopLoad<Left>(&left[a_at], pitch);
            let b_near = coopLoadT<Right>(&right[near_at], pitch);
            let b_far = coopLoadT<Right>(&right[far_at], pitch);
            near = coopMultiplyAdd(a, b_near, near);
            far = coopMultiplyAdd(a, b_far, far);
        }
        sum[pair] = Pair(near, far);
    }
    workgroupBarrier();
    return sum;
}

/// A thread's 4 by 4 of a finished product: columns of the sum are its rows.
fn values_of(sum: Sum, local: u32) -> mat4x4f {
    let pitch = SUM_PITCH;
    // With an index that is no constant, an array has to be a variable.
    var pairs = sum;
    for (var pair = 0u; pair < PAIRS; pair += 1u) {
        let place = place_of_pair(pair, local);
        let near_at = place.x * pitch + place.y;
        let far_at = near_at + SIDE;
        coopStoreT(pairs[pair].near, &sums_of_tile[near_at], pitch);
        coopStoreT(pairs[pair].far, &sums_of_tile[far_at], pitch);
    }
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
