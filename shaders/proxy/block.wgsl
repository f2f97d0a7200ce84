// Dense layers of a network for a tile of pixels. Activations lie in workgroup memory, `x[row][pixel]`; each invocation owns
// a block of 8 rows by 8 pixels of every layer, which it sums up in registers. All invocations read the same few weights.
// use: proxy/pixels
// constant: ROWS 64

// Rows of a layer are a multiple of 8; `x` has room for the widest layer or input.
const QUADS: u32 = PIXELS / 4u;
const PIXEL_BLOCKS: u32 = PIXELS / 8u;
const ROW_BLOCKS: u32 = WIDTH / 8u;
const THREADS: u32 = PIXEL_BLOCKS * ROW_BLOCKS;

@group(0) @binding(0) var<storage, read> weights: array<vec4f>;

var<workgroup> x: array<vec4f, ROWS * QUADS>;

// Sums of four rows (columns of a matrix) for four pixels each: first half of the rows and pixels, first half of the rows with
// second half of the pixels, then the second half of the rows. Halves lie apart so that neighbours read neighbours.
struct Block { aa: mat4x4f, ab: mat4x4f, ba: mat4x4f, bb: mat4x4f }

// Which block: pixels in x, rows in y, both in quads.
fn place_of(thread: u32) -> vec2u { return vec2u(thread % PIXEL_BLOCKS, thread / PIXEL_BLOCKS); }

fn outer(sum: mat4x4f, pixels: vec4f, rows: vec4f) -> mat4x4f {
    return mat4x4f(
        fma(pixels, vec4f(rows.x), sum[0]),
        fma(pixels, vec4f(rows.y), sum[1]),
        fma(pixels, vec4f(rows.z), sum[2]),
        fma(pixels, vec4f(rows.w), sum[3]),
    );
}

fn outer_block(sum: Block, pixels_a: vec4f, pixels_b: vec4f, rows_a: vec4f, rows_b: vec4f) -> Block {
    return Block(
        outer(sum.aa, pixels_a, rows_a),
        outer(sum.ab, pixels_b, rows_a),
        outer(sum.ba, pixels_a, rows_b),
        outer(sum.bb, pixels_b, rows_b),
    );
}

// Adds the product of the weights from `at` on, `[input][row]`, with the first `inputs` rows of `x`.
fn product(start: Block, at: u32, inputs: u32, place: vec2u) -> Block {
    var sum = start;
    for (var k = 0u; k < ROWS; k++) {
        if k >= inputs { break; }
        let pixels = k * QUADS + place.x;
        let rows = at + k * ROW_QUADS + place.y;
        sum = outer_block(
            sum, x[pixels], x[pixels + PIXEL_BLOCKS], weights[rows], weights[rows + ROW_BLOCKS],
        );
    }
    return sum;
}

// The same for a few inputs that lie as `vectors` quads a pixel, `x[pixel][vector]`.
fn product_by_pixel(start: Block, at: u32, vectors: u32, place: vec2u) -> Block {
    var sum = start;
    for (var j = 0u; j < 3u; j++) {
        if j >= vectors { break; }
        let a = transposed_quad(4u * place.x, vectors, j);
        let b = transposed_quad(4u * (place.x + PIXEL_BLOCKS), vectors, j);
        let rows = at + 4u * j * ROW_QUADS + place.y;
        sum = outer_block(sum, a[0], b[0], weights[rows], weights[rows + ROW_BLOCKS]);
        let rows1 = rows + ROW_QUADS;
        sum = outer_block(sum, a[1], b[1], weights[rows1], weights[rows1 + ROW_BLOCKS]);
        let rows2 = rows1 + ROW_QUADS;
        sum = outer_block(sum, a[2], b[2], weights[rows2], weights[rows2 + ROW_BLOCKS]);
        let rows3 = rows2 + ROW_QUADS;
        sum = outer_block(sum, a[3], b[3], weights[rows3], weights[rows3 + ROW_BLOCKS]);
    }
    return sum;
}

fn transposed_quad(pixel: u32, vectors: u32, j: u32) -> mat4x4f {
    let at = pixel * vectors + j;
    return transpose(mat4x4f(x[at], x[at + vectors], x[at + 2u * vectors], x[at + 3u * vectors]));
}

fn load_quads(row_quad: u32, pixel_quad: u32) -> mat4x4f {
    let at = 4u * row_quad * QUADS + pixel_quad;
    return mat4x4f(x[at], x[at + QUADS], x[at + 2u * QUADS], x[at + 3u * QUADS]);
}

fn store_quads(row_quad: u32, pixel_quad: u32, values: mat4x4f) {
    let at = 4u * row_quad * QUADS + pixel_quad;
    x[at] = values[0];
    x[at + QUADS] = values[1];
    x[at + 2u * QUADS] = values[2];
    x[at + 3u * QUADS] = values[3];
}

fn load_block(place: vec2u) -> Block {
    return Block(
        load_quads(place.y, place.x),
        load_quads(place.y, place.x + PIXEL_BLOCKS),
        load_quads(place.y + ROW_BLOCKS, place.x),
        load_quads(place.y + ROW_BLOCKS, place.x + PIXEL_BLOCKS),
    );
}

fn store_block(place: vec2u, values: Block) {
    store_quads(place.y, place.x, values.aa);
    store_quads(place.y, place.x + PIXEL_BLOCKS, values.ab);
    store_quads(place.y + ROW_BLOCKS, place.x, values.ba);
    store_quads(place.y + ROW_BLOCKS, place.x + PIXEL_BLOCKS, values.bb);
}

// `scale * row + shift`.
fn modulated_quads(rows: mat4x4f, scale: vec4f, shift: vec4f) -> mat4x4f {
    return mat4x4f(
        rows[0] * scale.x + shift.x,
        rows[1] * scale.y + shift.y,
        rows[2] * scale.z + shift.z,
        rows[3] * scale.w + shift.w,
    );
}

fn modulated(block: Block, scale_a: vec4f, scale_b: vec4f, shift_a: vec4f, shift_b: vec4f) -> Block {
    return Block(
        modulated_quads(block.aa, scale_a, shift_a),
        modulated_quads(block.ab, scale_a, shift_a),
        modulated_quads(block.ba, scale_b, shift_b),
        modulated_quads(block.bb, scale_b, shift_b),
    );
}

fn positive_quads(a: mat4x4f) -> mat4x4f {
    return mat4x4f(max(a[0], vec4f()), max(a[1], vec4f()), max(a[2], vec4f()), max(a[3], vec4f()));
}

fn positive(block: Block) -> Block {
    return Block(
        positive_quads(block.aa), positive_quads(block.ab), positive_quads(block.ba), positive_quads(block.bb),
    );
}
