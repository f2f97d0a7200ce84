// use: train/store
// use: train/parameters
// Takes gathered values into the store, in units of the network's output.

struct Targets {
    /// Samples, and lights of each pixel.
    samples: u32,
    slots: u32,
    /// First sample of the first block, and the blocks that the store has room for before it begins anew.
    first_block: u32,
    blocks: u32,
    /// Samples of a block.
    block: u32,
}

/// Pixel by pixel, then light by light, RGB.
@group(0) @binding(0) var<storage, read> gathered: array<f32>;
@group(0) @binding(1) var<storage, read> stored_pixels: array<u32>;
@group(0) @binding(2) var<storage, read> stored_lights: array<f32>;
/// `[chunk][tile][channel][lane]`
@group(0) @binding(3) var<storage, read_write> stored_targets: array<f32>;
@group(0) @binding(4) var<storage, read_write> progress: Progress;
var<immediate> arguments: Targets;

@compute @workgroup_size(64)
fn store(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let sample = id.x + id.y * groups.x * 64u;
    if sample >= arguments.samples {
        return;
    }
    // Blocks follow each other, but for the end of the store.
    let block = (arguments.first_block + sample / arguments.block) % arguments.blocks;
    let tile = (block * arguments.block + sample % arguments.block) / LANES;
    let batch = Batch(arguments.samples, arguments.samples, arguments.slots);
    let slot = sample / LANES % arguments.slots;
    let pixel = pixel_of(batch, sample);
    let inverse = stored_lights[tile * LIGHT_ROW + LIGHT_INVERSE_SCALE];
    for (var channel = 0u; channel < 3u; channel += 1u) {
        let value = gathered[(pixel * arguments.slots + slot) * 3u + channel] * inverse;
        stored_targets[(tile * 3u + channel) * LANES + sample % LANES] = value;
        if !is_finite(value) {
            let place = pixel_of(batch, tile * LANES + sample % LANES);
            progress.bad_target = stored_pixels[place] + 1u;
        }
    }
}
