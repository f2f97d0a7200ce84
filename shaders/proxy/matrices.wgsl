// Unit images like those of `infer.wgsl`, with matrices of 16-bit floats that a subgroup multiplies at once. A subgroup makes
// two matrices of rows of each layer for a tile of pixels, which are four.
// use: proxy/pixels
// use: common/matrices
// constant: SUBGROUPS 2

enable f16;

const THREADS: u32 = SUBGROUP * SUBGROUPS;
// Rows of the first input and of `x`, in whole matrices, and from one row of `x` to the next: eight more than there are
// pixels, so that rows do not start in the same bank.
const FIRST_ROWS: u32 = (FAST * FEATURES + (1u - FAST) * PIXEL_ROWS + SIDE - 1u) / SIDE * SIDE;
const X_ROWS: u32 = max(WIDTH, FIRST_ROWS);
const STRIDE: u32 = PIXELS + 8u;
// Where the matrices between layers and of the output start; its bias comes last. The output has quads of three values.
const HIDDEN_AT: u32 = FIRST_ROWS * WIDTH;
const OUTPUT_AT: u32 = HIDDEN_AT + HIDDEN * WIDTH * WIDTH;
// Invocations that share the output of a pixel, the rows of each, and how many outputs an invocation has a share in.
const PARTS: u32 = max(1u, THREADS / PIXELS);
const PART_ROWS: u32 = (WIDTH + PARTS - 1u) / PARTS;
const SHARES: u32 = (PIXELS * PARTS + THREADS - 1u) / THREADS;

struct Arguments { count: u32, lights: u32 }

// Matrices as `[input][row]`, then the output.
@group(0) @binding(0) var<storage, read> weights: array<f16>;
@group(0) @binding(3) var<storage, read_write> outputs: array<f32>;

var<immediate> arguments: Arguments;
var<workgroup> x: array<f16, X_ROWS * STRIDE>;
var<workgroup> shares: array<vec3f, PIXELS * PARTS>;

@compute @workgroup_size(THREADS)
fn infer_by_matrices(
    @builtin(local_invocation_index) thread: u32,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let count = arguments.count;
    let tiles = (count + PIXELS - 1u) / PIXELS;
    let number = group.x + group.y * groups.x;
    let light = number / tiles;
    let tile = number % tiles;
    if light >= arguments.lights { return; }
    if FAST == 1u {
        store_features(light, tile, count, thread);
    } else {
        load_rows(tile, count, thread);
    }
    workgroupBarrier();
    multiply(0u, FIRST_ROWS, subgroup);
    finish_first_layer(light, tile, count, thread);
    for (var layer = 1u; layer < LAYERS; layer++) {
        multiply(HIDDEN_AT + (layer - 1u) * WIDTH * WIDTH, WIDTH, subgroup);
        finish_layer(light, layer, thread);
    }
    sum_outputs(thread);
    write_outputs(light, tile, count, thread);
}

fn load_rows(tile: u32, count: u32, thread: u32) {
    for (var i = thread; i < FIRST_ROWS * PIXELS; i += THREADS) {
        let row = i / PIXELS;
        var value = 0.0;
        if row < ENCODED_ROWS { value = encoded[encoded_at(pixel_of(tile, i % PIXELS, count), row)]; }
        x[row * STRIDE + i % PIXELS] = f16(value);
    }
}

fn store_features(light: u32, tile: u32, count: u32, thread: u32) {
    for (var p = thread; p < PIXELS; p += THREADS) {
        let f = features_of(light, pixel_of(tile, p, count), 9u);
        for (var row = 0u; row < FIRST_ROWS; row++) {
            var value = 0.0;
            if row < FEATURES { value = f[row].x; }
            x[row * STRIDE + p] = f16(value);
        }
    }
}

// Replaces `x` by the product of the weights from `at` on with its first `inputs` rows. Of two by four
// matrices nothing is kept but these eight sums; places are named first, as the compiler asks for.
fn multiply(at: u32, inputs: u32, subgroup: u32) {
    let row = 2u * SIDE * subgroup;
    var c00 = HalfSum();
    var c01 = HalfSum();
    var c02 = HalfSum();
    var c03 = HalfSum();
    var c10 = HalfSum();
    var c11 = HalfSum();
    var c12 = HalfSum();
    var c13 = HalfSum();
    let width = WIDTH;
    let stride = STRIDE;
    for (var k = 0u; k < inputs; k += SIDE) {
        let a0_at = at + k * width + row;
        let a1_at = a0_at + SIDE;
        let b0_at = k * stride;
        let b1_at = b0_at + SIDE;
        let b2_at = b0_at + 2u * SIDE;
        let b3_at = b0_at + 3u * SIDE;
        let a0 = coopLoad<Left>(&weights[a0_at], width);
        let a1 = coopLoad<Left>(&weights[a1_at], width);
        let b0 = coopLoadT<Right>(&x[b0_at], stride);
        let b1 = coopLoadT<Right>(&x[b1_at], stride);
        let b2 = coopLoadT<Right>(&x[b2_at], stride);
        let b3 = coopLoadT<Right>(&x[b3_at], stride);
        c00 = coopMultiplyAdd(a0, b0, c00);
        c01 = coopMultiplyAdd(a0, b1, c01);
        c02 = coopMultiplyAdd(a0, b2, c02);
        c03 = coopMultiplyAdd(a0, b3, c03);
        c10 = coopMultiplyAdd(a1, b0, c10);
        c11 = coopMultiplyAdd(a1, b1, c11);
        c12 = coopMultiplyAdd(a1, b2, c12);
        c13 = coopMultiplyAdd(a1, b3, c13);
    }
    workgroupBarrier();
    let c0_at = row * stride;
    let c1_at = c0_at + SIDE * stride;
    let c01_at = c0_at + SIDE;
    let c02_at = c0_at + 2u * SIDE;
    let c03_at = c0_at + 3u * SIDE;
    let c11_at = c1_at + SIDE;
    let c12_at = c1_at + 2u * SIDE;
    let c13_at = c1_at + 3u * SIDE;
    coopStoreT(c00, &x[c0_at], stride);
    coopStoreT(c01, &x[c01_at], stride);
    coopStoreT(c02, &x[c02_at], stride);
    coopStoreT(c03, &x[c03_at], stride);
    coopStoreT(c10, &x[c1_at], stride);
    coopStoreT(c11, &x[c11_at], stride);
    coopStoreT(c12, &x[c12_at], stride);
    coopStoreT(c13, &x[c13_at], stride);
    workgroupBarrier();
}

// One of the values of a light's layer: a scale, or `WIDTH` further a shift.
fn modulation(light: u32, layer: u32, index: u32) -> f32 {
    let at = layer * 2u * WIDTH + index;
    return lights[light * LIGHT_QUADS + at / 4u][at % 4u];
}

// ReLU of what the first matrix gave, with the modulated trunk of the factorised network.
fn finish_first_layer(light: u32, tile: u32, count: u32, thread: u32) {
    for (var i = thread; i < WIDTH * PIXELS; i += THREADS) {
        let row = i / PIXELS;
        let at = row * STRIDE + i % PIXELS;
        var value = f32(x[at]) + modulation(light, 0u, WIDTH + row);
        if FAST == 1u {
            let trunk = encoded[encoded_at(pixel_of(tile, i % PIXELS, count), row)];
            value += modulation(light, 0u, row) * trunk;
        }
        x[at] = f16(max(value, 0.0));
    }
    workgroupBarrier();
}

fn finish_layer(light: u32, layer: u32, thread: u32) {
    for (var i = thread; i < WIDTH * PIXELS; i += THREADS) {
        let row = i / PIXELS;
        let at = row * STRIDE + i % PIXELS;
        let scale = modulation(light, layer, row);
        let shift = modulation(light, layer, WIDTH + row);
        x[at] = f16(max(scale * f32(x[at]) + shift, 0.0));
    }
    workgroupBarrier();
}

fn output_weights(row: u32) -> vec3f {
    let at = OUTPUT_AT + 4u * row;
    return vec3f(f32(weights[at]), f32(weights[at + 1u]), f32(weights[at + 2u]));
}

fn sum_outputs(thread: u32) {
    for (var share = 0u; share < SHARES; share++) {
        let item = thread + share * THREADS;
        if item < PIXELS * PARTS {
            let first = item / PIXELS * PART_ROWS;
            var sum = vec3f();
            for (var k = 0u; k < PART_ROWS; k++) {
                let row = first + k;
                if row >= WIDTH { break; }
                sum += f32(x[row * STRIDE + item % PIXELS]) * output_weights(row);
            }
            shares[item] = sum;
        }
    }
    workgroupBarrier();
}

fn write_outputs(light: u32, tile: u32, count: u32, thread: u32) {
    let scale = output_scale(light);
    for (var p = thread; p < PIXELS; p += THREADS) {
        let position = tile * PIXELS + p;
        if position < count {
            var sum = output_weights(WIDTH);
            for (var part = 0u; part < PARTS; part++) { sum += shares[part * PIXELS + p]; }
            let value = scale * max(sum * factor_of(pixel_of(tile, p, count)), vec3f());
            let at = 3u * (light * count + position);
            outputs[at] = value.x;
            outputs[at + 1u] = value.y;
            outputs[at + 2u] = value.z;
        }
    }
}
