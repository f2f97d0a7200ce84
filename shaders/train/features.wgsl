// use: train/store
// use: proxy/features
// Analytic features of each sample's light at its pixel's surface.

struct Features {
    batch: Batch,
    first_draw: u32,
    /// Activations: surfaces by pixel; features by sample.
    surfaces: u32,
    values: u32,
}

@group(0) @binding(0) var<storage, read> draws: array<u32>;
@group(0) @binding(1) var<storage, read> stored_lights: array<f32>;
@group(0) @binding(2) var<storage, read_write> activations: array<f32>;
var<immediate> arguments: Features;

fn surface_vector(first: u32, stride: u32) -> vec3f {
    return vec3f(activations[first], activations[first + stride], activations[first + 2u * stride]);
}

fn light_vector(first: u32) -> vec3f {
    return vec3f(stored_lights[first], stored_lights[first + 1u], stored_lights[first + 2u]);
}

@compute @workgroup_size(64)
fn fill(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let sample = id.x + id.y * groups.x * 64u;
    if sample >= arguments.batch.samples {
        return;
    }
    let stride = row_stride(arguments.batch, PIXELS);
    let pixel = arguments.surfaces + pixel_of(arguments.batch, sample);
    let surface = Surface(
        surface_vector(pixel, stride),
        surface_vector(pixel + 3u * stride, stride),
        surface_vector(pixel + 6u * stride, stride),
    );
    let chunk = draws[arguments.first_draw + sample / CHUNK];
    let tile = chunk * (CHUNK / LANES) + sample % CHUNK / LANES;
    let row = tile * LIGHT_ROW;
    // No derivative by a parameter of the light.
    let light = feature_light(light_vector(row), light_vector(row + 3u), light_vector(row + 6u), LIGHT_WEIGHT);
    var values = features(light, surface);
    for (var i = 0u; i < FEATURES; i += 1u) {
        activations[arguments.values + i * row_stride(arguments.batch, SAMPLES) + sample] = values[i].x;
    }
}
