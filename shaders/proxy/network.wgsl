// The part of a network that runs for each pixel and light (`network.rs` packs it): layers `relu(scale * (W h) + shift)`, of
// which scale and shift belong to the light, and a linear output of three values. The first layer of the factorised network
// is `relu(scale * trunk + shift + A features)`; its output is multiplied with the factor of the surface.
// use: proxy/block

// Quads of the features of a pixel.
const FEATURE_QUADS: u32 = 3u;
// Rows of an encoded pixel that are loaded, zeros included.
const LOADED_ROWS: u32 = FAST * WIDTH + (1u - FAST) * PIXEL_ROWS;
// Where the weights of the hidden matrices and of the output start, in quads; bias last.
const HIDDEN_QUADS: u32 = WIDTH * ROW_QUADS;
const HIDDEN_AT: u32 = (FAST * 4u * FEATURE_QUADS + (1u - FAST) * PIXEL_ROWS) * ROW_QUADS;
const OUTPUT_AT: u32 = HIDDEN_AT + HIDDEN * HIDDEN_QUADS;
// And those for the way back: the hidden ones, of the output three rows and one of zeros, of the features three quads a row.
const BACK_AT: u32 = OUTPUT_AT + WIDTH + 1u;
const BACK_OUTPUT_AT: u32 = BACK_AT + HIDDEN * HIDDEN_QUADS;
const BACK_FEATURES_AT: u32 = BACK_OUTPUT_AT + 4u * ROW_QUADS;
// Invocations that share the output of a pixel, the rows of each, and how many outputs an invocation has a share in.
const PARTS: u32 = (WIDTH + 63u) / 64u;
const PART_ROWS: u32 = (WIDTH + PARTS - 1u) / PARTS;
const SHARES: u32 = (PIXELS * PARTS + THREADS - 1u) / THREADS;

// Products of a layer before scale and shift, and its outputs.
struct Layer { z: Block, h: Block }

// Brings the encoded rows of a tile into `x`.
fn load_rows(tile: u32, count: u32, thread: u32) {
    for (var i = thread; i < LOADED_ROWS * QUADS; i += THREADS) {
        let row = i / QUADS;
        var values = vec4f();
        if row < ENCODED_ROWS {
            let first = 4u * (i % QUADS);
            values.x = encoded[encoded_at(pixel_of(tile, first, count), row)];
            values.y = encoded[encoded_at(pixel_of(tile, first + 1u, count), row)];
            values.z = encoded[encoded_at(pixel_of(tile, first + 2u, count), row)];
            values.w = encoded[encoded_at(pixel_of(tile, first + 3u, count), row)];
        }
        x[i] = values;
    }
}

// Brings the features of a tile into `x`, three quads a pixel.
fn store_features(light: u32, tile: u32, count: u32, thread: u32) {
    for (var p = thread; p < PIXELS; p += THREADS) {
        let f = features_of(light, pixel_of(tile, p, count), 9u);
        x[FEATURE_QUADS * p] = vec4f(f[0].x, f[1].x, f[2].x, f[3].x);
        x[FEATURE_QUADS * p + 1u] = vec4f(f[4].x, f[5].x, f[6].x, f[7].x);
        x[FEATURE_QUADS * p + 2u] = vec4f(f[8].x, f[9].x, f[10].x, 0.0);
    }
}

// A block under scale and shift of a light's layer.
fn lit(z: Block, light: u32, layer: u32, place: vec2u) -> Block {
    let scale = light * LIGHT_QUADS + layer * 2u * ROW_QUADS + place.y;
    let shift = scale + ROW_QUADS;
    return modulated(z, lights[scale], lights[scale + ROW_BLOCKS], lights[shift], lights[shift + ROW_BLOCKS]);
}

// Nobody may still use `x`.
fn first_layer(light: u32, tile: u32, count: u32, thread: u32, place: vec2u) -> Layer {
    load_rows(tile, count, thread);
    workgroupBarrier();
    if FAST == 1u {
        let z = load_block(place);
        workgroupBarrier();
        store_features(light, tile, count, thread);
        workgroupBarrier();
        return Layer(z, positive(product_by_pixel(lit(z, light, 0u, place), 0u, FEATURE_QUADS, place)));
    }
    let z = product(Block(), 0u, PIXEL_ROWS, place);
    return Layer(z, positive(lit(z, light, 0u, place)));
}

// From the outputs of the layer before in `x`.
fn hidden_layer(light: u32, layer: u32, place: vec2u) -> Layer {
    let z = product(Block(), HIDDEN_AT + (layer - 1u) * HIDDEN_QUADS, WIDTH, place);
    return Layer(z, positive(lit(z, light, layer, place)));
}

// Replaces what is in `x` once all have read it.
fn exchange(place: vec2u, values: Block) {
    workgroupBarrier();
    store_block(place, values);
    workgroupBarrier();
}

// From the outputs of the last layer in `x`, leaves there what `output_of` adds up.
fn sum_outputs(thread: u32) {
    var sums: array<vec3f, SHARES>;
    for (var share = 0u; share < SHARES; share++) {
        let item = thread + share * THREADS;
        let pixel = item % PIXELS;
        let first = item / PIXELS * PART_ROWS;
        for (var k = 0u; k < PART_ROWS; k++) {
            let row = first + k;
            if row >= WIDTH { break; }
            sums[share] += x[row * QUADS + pixel / 4u][pixel % 4u] * weights[OUTPUT_AT + row].xyz;
        }
    }
    workgroupBarrier();
    for (var share = 0u; share < SHARES; share++) {
        let item = thread + share * THREADS;
        if item < PIXELS * PARTS { x[item] = vec4f(sums[share], 0.0); }
    }
    workgroupBarrier();
}

fn output_of(index: u32) -> vec3f {
    var sum = weights[OUTPUT_AT + WIDTH].xyz;
    for (var part = 0u; part < PARTS; part++) {
        sum += x[part * PIXELS + index].xyz;
    }
    return sum;
}
