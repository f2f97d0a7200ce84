// use: train/batch
// The reference network's input: the rows of a sample's pixel, then those of its light.

struct Expansion {
    batch: Batch,
    /// Activations: encoded pixels, encoded lights, and the rows of both for each sample.
    pixels: u32,
    lights: u32,
    samples: u32,
    pixel_rows: u32,
    light_rows: u32,
}

@group(0) @binding(0) var<storage, read_write> activations: array<f32>;
var<immediate> arguments: Expansion;

@compute @workgroup_size(64)
fn expand(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let thread = id.x + id.y * groups.x * 64u;
    let sample = thread % arguments.batch.samples;
    let row = thread / arguments.batch.samples;
    if row >= arguments.pixel_rows + arguments.light_rows {
        return;
    }
    var place = arguments.pixels + row * row_stride(arguments.batch, PIXELS) + pixel_of(arguments.batch, sample);
    if row >= arguments.pixel_rows {
        let light_row = row - arguments.pixel_rows;
        place = arguments.lights + light_row * row_stride(arguments.batch, LIGHTS) + sample / LANES;
    }
    activations[arguments.samples + row * row_stride(arguments.batch, SAMPLES) + sample] = activations[place];
}
