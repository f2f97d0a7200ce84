// use: train/store
// use: proxy/grid
// use: proxy/features
// What enters the networks: encoded pixels, what is known of them, encoded lights, and analytic features of each sample's light
// at its pixel's surface, from the chunks that a batch draws.

struct Inputs {
    batch: Batch,
    /// Where the batch's chunks begin in the list of draws.
    first_draw: u32,
    /// Activations: encoded pixels followed by what is known of them; encoded lights; factors on the outputs and features, of
    /// which there may be none.
    pixels: u32,
    lights: u32,
    factors: u32,
    values: u32,
    /// Rows of what is known, and of lights.
    known: u32,
    light_inputs: u32,
    levels: u32,
    features: u32,
    /// Pixels of the image.
    width: u32,
    height: u32,
}

@group(0) @binding(0) var<storage, read> params: array<f32>;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
@group(0) @binding(2) var<storage, read> draws: array<u32>;
/// `[chunk][pixel]`
@group(0) @binding(3) var<storage, read> stored_pixels: array<u32>;
/// `[chunk][pixel][PIXEL_ROW]`
@group(0) @binding(4) var<storage, read> stored_scene: array<f32>;
/// `[chunk][tile][LIGHT_ROW]`
@group(0) @binding(5) var<storage, read> stored_lights: array<f32>;
@group(0) @binding(6) var<storage, read_write> activations: array<f32>;
var<immediate> arguments: Inputs;

/// Instead of a place, where there is none.
const NOTHING: u32 = 0xffffffffu;

@compute @workgroup_size(64)
fn inputs(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let pixels = columns(arguments.batch, PIXELS);
    let lights = columns(arguments.batch, LIGHTS);
    var thread = id.x + id.y * groups.x * 64u;
    if thread < pixels * (arguments.levels + 1u) {
        pixel_input(thread % pixels, thread / pixels);
        return;
    }
    thread -= pixels * (arguments.levels + 1u);
    if thread < lights * arguments.light_inputs {
        light_input(thread % lights, thread / lights);
        return;
    }
    thread -= lights * arguments.light_inputs;
    if thread < arguments.batch.samples && arguments.values != NOTHING {
        sample_input(thread);
    }
}

/// Row of the store of lights of a column of lights.
fn stored_light(column: u32) -> u32 {
    let chunk = draws[arguments.first_draw + column / (CHUNK / LANES)];
    return (chunk * (CHUNK / LANES) + column % (CHUNK / LANES)) * LIGHT_ROW;
}

/// Place in the store of a column of pixels.
fn stored_pixel(column: u32) -> u32 {
    let per_chunk = CHUNK / arguments.batch.slots;
    let chunk = draws[arguments.first_draw + column / per_chunk];
    return chunk * per_chunk + column % per_chunk;
}

fn light_input(column: u32, row: u32) {
    let to = arguments.lights + row * row_stride(arguments.batch, LIGHTS) + column;
    activations[to] = stored_lights[stored_light(column) + LIGHT_INPUTS + row];
}

fn scene_vector(first: u32) -> vec3f {
    return vec3f(stored_scene[first], stored_scene[first + 1u], stored_scene[first + 2u]);
}

fn light_vector(first: u32) -> vec3f {
    return vec3f(stored_lights[first], stored_lights[first + 1u], stored_lights[first + 2u]);
}

fn sample_input(sample: u32) {
    let at = stored_pixel(pixel_of(arguments.batch, sample)) * PIXEL_ROW + PIXEL_SURFACE;
    let surface = Surface(scene_vector(at), scene_vector(at + 3u), scene_vector(at + 6u));
    let row = stored_light(sample / LANES);
    // No derivative by a parameter of the light.
    let light = feature_light(light_vector(row), light_vector(row + 3u), light_vector(row + 6u), LIGHT_WEIGHT);
    var values = features(light, surface);
    for (var i = 0u; i < FEATURES; i += 1u) {
        activations[arguments.values + i * row_stride(arguments.batch, SAMPLES) + sample] = values[i].x;
    }
}

/// One level of the grid for a pixel column, or, as the last, all that is known of it.
fn pixel_input(column: u32, level: u32) {
    let place = stored_pixel(column);
    let stride = row_stride(arguments.batch, PIXELS);
    if level < arguments.levels {
        let table = levels[level];
        let corners = corners_of(table, stored_pixels[place], arguments.width, arguments.height);
        for (var feature = 0u; feature < arguments.features; feature += 1u) {
            let first = table.table + feature;
            let values = vec4f(
                params[first + corners.entries.x * arguments.features],
                params[first + corners.entries.y * arguments.features],
                params[first + corners.entries.z * arguments.features],
                params[first + corners.entries.w * arguments.features],
            );
            let row = level * arguments.features + feature;
            activations[arguments.pixels + row * stride + column] = dot(corners.weights, values);
        }
        return;
    }
    let first = arguments.pixels + arguments.levels * arguments.features * stride + column;
    for (var row = 0u; row < arguments.known; row += 1u) {
        activations[first + row * stride] = stored_scene[place * PIXEL_ROW + row];
    }
    if arguments.factors != NOTHING {
        for (var row = 0u; row < 3u; row += 1u) {
            activations[arguments.factors + row * stride + column] = stored_scene[place * PIXEL_ROW + PIXEL_FACTORS + row];
        }
    }
}
