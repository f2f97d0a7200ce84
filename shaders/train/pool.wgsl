// use: train/store
// Takes into the store what the images of a pool, of those in one of its buffers, are to the samples there.

struct Pool {
    /// Tiles of the store, from its start on, and lights of each pixel.
    tiles: u32,
    slots: u32,
    /// Images of the buffer: place of the first, how many there are, and pixels of each.
    first: u32,
    images: u32,
    pixels: u32,
}

/// `[image][pixel]` RGB, of this buffer.
@group(0) @binding(0) var<storage, read> images: array<f32>;
/// `[image][LIGHT_ROW]`, of all.
@group(0) @binding(1) var<storage, read> image_lights: array<f32>;
/// `[chunk][tile]`
@group(0) @binding(2) var<storage, read> stored_images: array<u32>;
@group(0) @binding(3) var<storage, read> stored_pixels: array<u32>;
@group(0) @binding(4) var<storage, read_write> stored_lights: array<f32>;
/// `[chunk][tile][channel][lane]`
@group(0) @binding(5) var<storage, read_write> stored_targets: array<f32>;
var<immediate> arguments: Pool;

@compute @workgroup_size(64)
fn store(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let sample = id.x + id.y * groups.x * 64u;
    let tile = sample / LANES;
    let lane = sample % LANES;
    if tile >= arguments.tiles {
        return;
    }
    let image = stored_images[tile];
    if image < arguments.first || image - arguments.first >= arguments.images {
        return;
    }
    let light = image * LIGHT_ROW;
    for (var i = lane; i < LIGHT_ROW; i += LANES) {
        stored_lights[tile * LIGHT_ROW + i] = image_lights[light + i];
    }
    let pixel = stored_pixels[pixel_of(Batch(0u, 0u, arguments.slots), sample)];
    let source = ((image - arguments.first) * arguments.pixels + pixel) * 3u;
    for (var channel = 0u; channel < 3u; channel += 1u) {
        let value = images[source + channel] * image_lights[light + LIGHT_INVERSE_SCALE];
        stored_targets[(tile * 3u + channel) * LANES + lane] = value;
    }
}
