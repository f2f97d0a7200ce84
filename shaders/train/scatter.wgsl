// use: train/store
// use: proxy/grid
// Gradient by the hash grid: each pixel adds to the four points around it. Sums are kept in fixed point of 64 bits, in two
// words, since integers add up to the same in any order and every back end has atomics for them (DX12 has none for
// floats).

struct Scatter {
    batch: Batch,
    first_draw: u32,
    /// Activations: gradients by encoded pixels.
    d_pixels: u32,
    levels: u32,
    features: u32,
    /// Pixels of the image.
    width: u32,
    height: u32,
    /// First parameter of the grid.
    grid: u32,
}

@group(0) @binding(0) var<storage, read> levels: array<Level>;
@group(0) @binding(1) var<storage, read> draws: array<u32>;
@group(0) @binding(2) var<storage, read> stored_pixels: array<u32>;
@group(0) @binding(3) var<storage, read> activations: array<f32>;
/// Low and high word of each parameter of the grid.
@group(0) @binding(4) var<storage, read_write> sums: array<atomic<u32>>;
var<immediate> arguments: Scatter;

@compute @workgroup_size(64)
fn scatter(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let thread = id.x + id.y * groups.x * 64u;
    let pixels = columns(arguments.batch, PIXELS);
    let column = thread % pixels;
    let level = thread / pixels;
    if level >= arguments.levels {
        return;
    }
    let per_chunk = CHUNK / arguments.batch.slots;
    let chunk = draws[arguments.first_draw + column / per_chunk];
    let pixel = stored_pixels[chunk * per_chunk + column % per_chunk];
    let table = levels[level];
    var corners = corners_of(table, pixel, arguments.width, arguments.height);
    for (var feature = 0u; feature < arguments.features; feature += 1u) {
        let row = level * arguments.features + feature;
        let d = activations[arguments.d_pixels + row * row_stride(arguments.batch, PIXELS) + column];
        for (var corner = 0u; corner < 4u; corner += 1u) {
            let entry = table.table - arguments.grid + corners.entries[corner] * arguments.features + feature;
            add(entry, corners.weights[corner] * d);
        }
    }
}

/// Adds to a sum in units of 2^-48, modulo 2^64. What does not fit, or is not a number, is left out: a gradient of that size
/// shows in the loss.
fn add(entry: u32, value: f32) {
    let scaled = abs(value) * 65536.0;
    if !(scaled < 2147483520.0) {
        return;
    }
    var high = u32(scaled);
    var low = u32((scaled - floor(scaled)) * 4294967296.0);
    if value < 0.0 {
        high = select(~high, ~high + 1u, low == 0u);
        low = ~low + 1u;
    }
    let before = atomicAdd(&sums[2u * entry], low);
    if before + low < before {
        high += 1u;
    }
    if high != 0u {
        atomicAdd(&sums[2u * entry + 1u], high);
    }
}
