// Brings the encoded rows of listed pixels together, in the order of the list: one value a thread.
// use: proxy/rows

struct Arguments {
    // Listed pixels.
    count: u32,
    // Those of the image that `encoded` holds; others are left alone.
    first: u32,
    end: u32,
}

@group(0) @binding(0) var<storage, read> encoded: array<f32>;
@group(0) @binding(1) var<storage, read> pixels: array<u32>;
@group(0) @binding(2) var<storage, read_write> collected: array<f32>;

var<immediate> arguments: Arguments;

@compute @workgroup_size(64)
fn collect(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = id.x + id.y * groups.x * 64u;
    let position = at / (32u * PIXEL_ROWS) * 32u + at % 32u;
    if position >= arguments.count { return; }
    let pixel = pixels[position];
    if pixel >= arguments.first && pixel < arguments.end {
        collected[at] = encoded[encoded_at(pixel - arguments.first, at / 32u % PIXEL_ROWS)];
    }
}
