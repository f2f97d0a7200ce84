// use: train/layers
// Products of matrices by tiles: a workgroup computes 64 rows by 64 columns, a thread 4 by 4 of them, from slabs of both factors
// in workgroup memory.

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

/// Adds the product of both slabs, once all threads have filled them; after it they may be filled again. Columns of the
/// sum are a thread's rows, their values its columns.
fn add_slabs(start: mat4x4f, local: u32) -> mat4x4f {
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

/// Spreads four values of a row or column, four of its depth, over a slab.
fn put_left(local: u32, values: vec4f) {
    for (var i = 0u; i < 4u; i += 1u) {
        left[(local % 4u * 4u + i) * PITCH + local / 16u][local / 4u % 4u] = values[i];
    }
}

fn put_right(local: u32, values: vec4f) {
    for (var i = 0u; i < 4u; i += 1u) {
        right[(local % 4u * 4u + i) * PITCH + local / 16u][local / 4u % 4u] = values[i];
    }
}

fn value_at(place: u32) -> f32 {
    return activations[place / 4u][place % 4u];
}

/// Four columns of a row of a layer's input.
fn input_four(layer: Layer, batch: Batch, row: u32, column: u32) -> vec4f {
    if layer.pixel_rows == NOTHING {
        return activations[(layer.input + row * row_stride(batch, layer.space) + column) / 4u];
    }
    if row < layer.pixel_rows {
        return activations[(layer.input + row * row_stride(batch, PIXELS) + pixel_of(batch, column)) / 4u];
    }
    let light_row = row - layer.pixel_rows;
    return vec4f(value_at(layer.light_rows + light_row * row_stride(batch, LIGHTS) + column / LANES));
}
