// use: train/batch
// From the gradients by samples to those by their pixels: sums over the lights of each pixel.

struct Slots {
    batch: Batch,
    /// Activations: gradients by samples, to be summed into gradients by pixels; rows of both.
    samples: u32,
    pixels: u32,
    rows: u32,
    /// Modulation whose scales the gradients are multiplied with, of which there may be none.
    modulation: u32,
}

@group(0) @binding(0) var<storage, read_write> activations: array<f32>;
var<immediate> arguments: Slots;

const NO_MODULATION: u32 = 0xffffffffu;

@compute @workgroup_size(64)
fn sum_slots(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let thread = id.x + id.y * groups.x * 64u;
    let pixels = columns(arguments.batch, PIXELS);
    let row = thread / pixels;
    let column = thread % pixels;
    if row >= arguments.rows {
        return;
    }
    let slots = arguments.batch.slots;
    let first_tile = column / LANES * slots;
    let samples = arguments.samples + row * row_stride(arguments.batch, SAMPLES) + column % LANES;
    let scales = arguments.modulation + row * row_stride(arguments.batch, LIGHTS);
    var sum = 0.0;
    for (var slot = 0u; slot < slots; slot += 1u) {
        var scale = 1.0;
        if arguments.modulation != NO_MODULATION {
            scale += activations[scales + first_tile + slot];
        }
        sum += scale * activations[samples + (first_tile + slot) * LANES];
    }
    activations[arguments.pixels + row * row_stride(arguments.batch, PIXELS) + column] = sum;
}
