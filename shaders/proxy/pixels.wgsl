// What networks know of pixels and lights, as `proxy.rs` and `network.rs` lay it out.
// use: proxy/features
// use: proxy/rows
// constant: WIDTH 64
// constant: PIXELS 128
// constant: FAST 1
// constant: HIDDEN 2

// Rows of a surface with its factor, which come last in the encoded pixels of the factorised network.
const SURFACE_ROWS: u32 = 12u;
// Rows of an encoded pixel that enter the first layer.
const ENCODED_ROWS: u32 = PIXEL_ROWS - FAST * SURFACE_ROWS;
// Layers before the output, and quads of a row of values.
const LAYERS: u32 = HIDDEN + 1u;
const ROW_QUADS: u32 = WIDTH / 4u;
// Quads of a light: scale and shift of every layer, then centre and output scale, the rest of the shape, radiance.
const LIGHT_AT: u32 = LAYERS * 2u * ROW_QUADS;
const LIGHT_QUADS: u32 = LIGHT_AT + 4u;

@group(0) @binding(1) var<storage, read> encoded: array<f32>;
@group(0) @binding(2) var<storage, read> lights: array<vec4f>;

// The number of a tile's pixel among the encoded ones; past the last pixel, that one.
fn pixel_of(tile: u32, index: u32, count: u32) -> u32 { return min(tile * PIXELS + index, count - 1u); }

fn surface_vector(pixel: u32, vector: u32) -> vec3f {
    let at = encoded_at(pixel, ENCODED_ROWS + 3u * vector);
    return vec3f(encoded[at], encoded[at + 32u], encoded[at + 64u]);
}

fn surface_of(pixel: u32) -> Surface {
    return Surface(surface_vector(pixel, 0u), surface_vector(pixel, 1u), surface_vector(pixel, 2u));
}

fn factor_of(pixel: u32) -> vec3f {
    if FAST == 1u { return surface_vector(pixel, 3u); }
    return vec3f(1.0);
}

fn features_of(light: u32, pixel: u32, parameter: u32) -> array<vec2f, FEATURES> {
    let at = light * LIGHT_QUADS + LIGHT_AT;
    let shape = feature_light(lights[at].xyz, lights[at + 1u].xyz, lights[at + 2u].xyz, parameter);
    return features(shape, surface_of(pixel));
}

fn output_scale(light: u32) -> f32 { return lights[light * LIGHT_QUADS + LIGHT_AT].w; }
