// use: train/store
// use: proxy/grid
// What enters the networks: encoded pixels, what is known of them, and encoded lights, from the chunks that a batch draws.

struct Inputs {
    batch: Batch,
    /// Where the batch's chunks begin in the list of draws.
    first_draw: u32,
    /// Activations: encoded pixels followed by what is known of them; encoded lights; surfaces.
    pixels: u32,
    lights: u32,
    surfaces: u32,
    /// Rows of them.
    known: u32,
    light_inputs: u32,
    surface_rows: u32,
    levels: u32,
    features: u32,
    /// Pixels of the image.
    width: u32,
    height: u32,
}

@group(0) @binding(0) var<storage, read> params: array<f32>;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
/// `[pixel][SCENE_ROW]`: what is known of each pixel, then its surface.
@group(0) @binding(2) var<storage, read> scene: array<f32>;
@group(0) @binding(3) var<storage, read> draws: array<u32>;
/// `[chunk][pixel]`
@group(0) @binding(4) var<storage, read> stored_pixels: array<u32>;
/// `[chunk][tile][LIGHT_ROW]`
@group(0) @binding(5) var<storage, read> stored_lights: array<f32>;
@group(0) @binding(6) var<storage, read_write> activations: array<f32>;
var<immediate> arguments: Inputs;

/// Values that the scene holds for a pixel, the first of them what is known, the rest its surface.
const SCENE_ROW: u32 = 25u;
const KNOWN: u32 = 13u;

@compute @workgroup_size(64)
fn inputs(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let thread = id.x + id.y * groups.x * 64u;
    let pixels = columns(arguments.batch, PIXELS);
    if thread < pixels * (arguments.levels + 1u) {
        pixel_input(thread % pixels, thread / pixels);
        return;
    }
    let rest = thread - pixels * (arguments.levels + 1u);
    let lights = columns(arguments.batch, LIGHTS);
    let row = rest / lights;
    if row < arguments.light_inputs {
        let tile = rest % lights;
        let chunk = draws[arguments.first_draw + tile / (CHUNK / LANES)];
        let light = chunk * (CHUNK / LANES) + tile % (CHUNK / LANES);
        let to = arguments.lights + row * row_stride(arguments.batch, LIGHTS) + tile;
        activations[to] = stored_lights[light * LIGHT_ROW + LIGHT_INPUTS + row];
    }
}

/// One level of the grid for a pixel column, or, as the last, all that is known of it.
fn pixel_input(column: u32, level: u32) {
    let per_chunk = CHUNK / arguments.batch.slots;
    let chunk = draws[arguments.first_draw + column / per_chunk];
    let pixel = stored_pixels[chunk * per_chunk + column % per_chunk];
    let stride = row_stride(arguments.batch, PIXELS);
    if level < arguments.levels {
        let table = levels[level];
        let corners = corners_of(table, pixel, arguments.width, arguments.height);
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
        activations[first + row * stride] = scene[pixel * SCENE_ROW + row];
    }
    for (var row = 0u; row < arguments.surface_rows; row += 1u) {
        activations[arguments.surfaces + row * stride + column] = scene[pixel * SCENE_ROW + KNOWN + row];
    }
}
