// Unit images: a workgroup runs a tile of pixels through all layers under one light. Outputs are `[light][pixel]` RGB.
// use: proxy/network

struct Arguments { count: u32, lights: u32 }

@group(0) @binding(3) var<storage, read_write> outputs: array<f32>;

var<immediate> arguments: Arguments;

@compute @workgroup_size(THREADS)
fn infer(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let count = arguments.count;
    let tiles = (count + PIXELS - 1u) / PIXELS;
    let number = group.x + group.y * groups.x;
    let light = number / tiles;
    let tile = number % tiles;
    if light >= arguments.lights { return; }
    let place = place_of(thread);
    exchange(place, first_layer(light, tile, count, thread, place).h);
    for (var layer = 1u; layer < LAYERS; layer++) {
        exchange(place, hidden_layer(light, layer, place).h);
    }
    sum_outputs(thread);
    let scale = output_scale(light);
    for (var p = thread; p < PIXELS; p += THREADS) {
        let position = tile * PIXELS + p;
        if position < count {
            let value = scale * max(output_of(p) * factor_of(pixel_of(tile, p, count)), vec3f());
            let at = 3u * (light * count + position);
            outputs[at] = value.x;
            outputs[at + 1u] = value.y;
            outputs[at + 2u] = value.z;
        }
    }
}
