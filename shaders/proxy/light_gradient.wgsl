// Gradient by lights of a loss whose gradient by the picture is known: forward again, then back through the same layers.
// A workgroup runs every so many tiles of one light. What it keeps of the way forward and what it sums up lies in slots of
// each invocation, so that nobody waits for others; `light_sums` adds the slots up.
// use: proxy/network

// What layers keep of the way forward in the place of a unit that is off.
const OFF: f32 = 3e38;
// Parameters of the light that the features see.
const PARAMETERS: u32 = 4u + 5u * min(FORM, 1u);
// Quads that a layer keeps, and quads of sums: by scale and shift of each layer, then by nine parameters and the radiance.
const KEPT: u32 = 16u;
const SUMS: u32 = 4u * LAYERS + 3u;

struct Arguments {
    count: u32,
    // Workgroups of each light.
    groups: u32,
    lights: u32,
}

// Gradient of the loss by the picture, RGB of each pixel.
@group(0) @binding(3) var<storage, read> d_picture: array<f32>;
@group(0) @binding(4) var<storage, read_write> kept: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> sums: array<vec4f>;

var<immediate> arguments: Arguments;

@compute @workgroup_size(THREADS)
fn light_gradient(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group_id: vec3u,
    @builtin(num_workgroups) group_counts: vec3u,
) {
    let group = group_id.x + group_id.y * group_counts.x;
    let light = group / arguments.groups;
    if light >= arguments.lights { return; }
    let place = place_of(thread);
    let kept_at = group * LAYERS * KEPT * THREADS + thread;
    let sums_at = group * SUMS * THREADS + thread;
    let tiles = (arguments.count + PIXELS - 1u) / PIXELS;
    var own: array<f32, 12>;
    for (var tile = group % arguments.groups; tile < tiles; tile += arguments.groups) {
        forward(light, tile, thread, place, kept_at);
        output_gradient(light, tile, thread, &own);
        let d = back_to_first_layer(light, place, kept_at, sums_at);
        if FAST == 1u {
            exchange(place, d);
            feature_gradient(light, tile, thread, &own);
        }
        workgroupBarrier();
    }
    let slot = sums_at + 4u * LAYERS * THREADS;
    sums[slot] = vec4f(own[0], own[1], own[2], own[3]);
    sums[slot + THREADS] = vec4f(own[4], own[5], own[6], own[7]);
    sums[slot + 2u * THREADS] = vec4f(own[8], own[9], own[10], own[11]);
}

// Leaves shares of the output in `x`.
fn forward(light: u32, tile: u32, thread: u32, place: vec2u, kept_at: u32) {
    let first = first_layer(light, tile, arguments.count, thread, place);
    keep(kept_at, first);
    exchange(place, first.h);
    for (var index = 1u; index < LAYERS; index++) {
        let layer = hidden_layer(light, index, place);
        keep(kept_at + index * KEPT * THREADS, layer);
        exchange(place, layer.h);
    }
    sum_outputs(thread);
}

// Turns the gradient by the picture into that by the output, in `x` a quad a pixel. Where the output is below zero the clamp is
// passed over, as on the CPU.
fn output_gradient(light: u32, tile: u32, thread: u32, own: ptr<function, array<f32, 12>>) {
    let radiance = lights[light * LIGHT_QUADS + LIGHT_AT + 3u].xyz;
    let scale = output_scale(light);
    for (var p = thread; p < PIXELS; p += THREADS) {
        let position = tile * PIXELS + p;
        let factor = factor_of(pixel_of(tile, p, arguments.count));
        let unit = scale * max(output_of(p) * factor, vec3f());
        var d = vec3f();
        if position < arguments.count {
            d = vec3f(d_picture[3u * position], d_picture[3u * position + 1u], d_picture[3u * position + 2u]);
        }
        (*own)[9] += d.x * unit.x;
        (*own)[10] += d.y * unit.y;
        (*own)[11] += d.z * unit.z;
        x[p] = vec4f(scale * factor * radiance * d, 0.0);
    }
    workgroupBarrier();
}

// Returns the gradient by the sum that enters the ReLU of the first layer.
fn back_to_first_layer(light: u32, place: vec2u, kept_at: u32, sums_at: u32) -> Block {
    var d = product_by_pixel(Block(), BACK_OUTPUT_AT, 1u, place);
    for (var index = LAYERS - 1u; index > 0u; index--) {
        d = back_through(light, index, place, d, kept_at, sums_at);
        let scale = light * LIGHT_QUADS + index * 2u * ROW_QUADS + place.y;
        exchange(place, modulated(d, lights[scale], lights[scale + ROW_BLOCKS], vec4f(), vec4f()));
        d = product(Block(), BACK_AT + (index - 1u) * HIDDEN_QUADS, WIDTH, place);
    }
    return back_through(light, 0u, place, d, kept_at, sums_at);
}

// Zero where a layer's unit was off; adds to the sums by its scale and shift.
fn back_through(light: u32, layer: u32, place: vec2u, d_outputs: Block, kept_at: u32, sums_at: u32) -> Block {
    let z = kept_block(kept_at + layer * KEPT * THREADS);
    let d = Block(
        where_on(d_outputs.aa, z.aa), where_on(d_outputs.ab, z.ab),
        where_on(d_outputs.ba, z.ba), where_on(d_outputs.bb, z.bb),
    );
    // The reference network has no other scales and shifts that depend on the light.
    if FAST == 1u || layer == 0u {
        let slot = sums_at + 4u * layer * THREADS;
        sums[slot] += dots_of(d.aa, z.aa) + dots_of(d.ab, z.ab);
        sums[slot + THREADS] += dots_of(d.ba, z.ba) + dots_of(d.bb, z.bb);
        sums[slot + 2u * THREADS] += totals(d.aa) + totals(d.ab);
        sums[slot + 3u * THREADS] += totals(d.ba) + totals(d.bb);
    }
    return d;
}

// From the gradient by the first layer's sums in `x`, adds the gradient by the parameters that the features see.
fn feature_gradient(light: u32, tile: u32, thread: u32, own: ptr<function, array<f32, 12>>) {
    for (var p = thread; p < PIXELS; p += THREADS) {
        var d: array<vec4f, FEATURE_QUADS>;
        for (var row = 0u; row < WIDTH; row++) {
            let at = BACK_FEATURES_AT + FEATURE_QUADS * row;
            let d_row = x[row * QUADS + p / 4u][p % 4u];
            d[0] += d_row * weights[at];
            d[1] += d_row * weights[at + 1u];
            d[2] += d_row * weights[at + 2u];
        }
        let pixel = pixel_of(tile, p, arguments.count);
        for (var i = 0u; i < PARAMETERS; i++) {
            let f = features_of(light, pixel, i);
            (*own)[i] += dot(d[0], vec4f(f[0].y, f[1].y, f[2].y, f[3].y))
                + dot(d[1], vec4f(f[4].y, f[5].y, f[6].y, f[7].y))
                + dot(d[2].xyz, vec3f(f[8].y, f[9].y, f[10].y));
        }
    }
}

fn keep(at: u32, layer: Layer) {
    keep_quads(at, layer.z.aa, layer.h.aa);
    keep_quads(at + 4u * THREADS, layer.z.ab, layer.h.ab);
    keep_quads(at + 8u * THREADS, layer.z.ba, layer.h.ba);
    keep_quads(at + 12u * THREADS, layer.z.bb, layer.h.bb);
}

fn keep_quads(at: u32, z: mat4x4f, h: mat4x4f) {
    kept[at] = select(vec4f(OFF), z[0], h[0] > vec4f());
    kept[at + THREADS] = select(vec4f(OFF), z[1], h[1] > vec4f());
    kept[at + 2u * THREADS] = select(vec4f(OFF), z[2], h[2] > vec4f());
    kept[at + 3u * THREADS] = select(vec4f(OFF), z[3], h[3] > vec4f());
}

fn kept_block(at: u32) -> Block {
    return Block(
        kept_quads(at), kept_quads(at + 4u * THREADS), kept_quads(at + 8u * THREADS), kept_quads(at + 12u * THREADS),
    );
}

fn kept_quads(at: u32) -> mat4x4f {
    return mat4x4f(kept[at], kept[at + THREADS], kept[at + 2u * THREADS], kept[at + 3u * THREADS]);
}

fn where_on(d: mat4x4f, z: mat4x4f) -> mat4x4f {
    return mat4x4f(
        select(vec4f(), d[0], z[0] < vec4f(OFF)),
        select(vec4f(), d[1], z[1] < vec4f(OFF)),
        select(vec4f(), d[2], z[2] < vec4f(OFF)),
        select(vec4f(), d[3], z[3] < vec4f(OFF)),
    );
}

fn dots_of(a: mat4x4f, b: mat4x4f) -> vec4f {
    return vec4f(dot(a[0], b[0]), dot(a[1], b[1]), dot(a[2], b[2]), dot(a[3], b[3]));
}

fn totals(a: mat4x4f) -> vec4f {
    let ones = vec4f(1.0);
    return vec4f(dot(a[0], ones), dot(a[1], ones), dot(a[2], ones), dot(a[3], ones));
}
