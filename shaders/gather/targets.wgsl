// Adds what a chunk of records gives at single pixels, each with up to LIGHTS lights of its own.
// use: gather/pixel

struct Arguments {
    targets: u32,
    // Per pixel.
    lights: u32,
    // First of those of a pixel that this run is about, and their number.
    first_light: u32,
    count: u32,
    // Neighbouring targets that have the same lights.
    sharing: u32,
}
var<immediate> arguments: Arguments;

// By place in the image, for `number_of`.
@group(0) @binding(8) var<storage, read> numbers: array<u32>;
// Places in the image, row by row.
@group(0) @binding(9) var<storage, read> places: array<u32>;
// Pixel by pixel, then light by light.
@group(0) @binding(10) var<storage, read_write> values: array<f32>;

@compute @workgroup_size(GROUP_SIZE)
fn add_targets(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = (group.x + group.y * groups.x) * (GROUP_SIZE / LANES) + thread / LANES;
    var pixel = ELSEWHERE;
    if index < arguments.targets && places[index] < arrayLength(&numbers) {
        pixel = number_of(places[index], numbers[places[index]]);
    }
    if pixel != ELSEWHERE {
        let first_light = index / arguments.sharing * arguments.lights + arguments.first_light;
        visit_pixel(pixel, thread % LANES, first_light, arguments.count);
    }
    reduce(thread);
    if thread % LANES != 0u || pixel == ELSEWHERE {
        return;
    }
    let first_value = index * arguments.lights + arguments.first_light;
    for (var i = 0u; i < LIGHTS; i++) {
        if i < arguments.count {
            for (var channel = 0u; channel < 3u; channel++) {
                values[(first_value + i) * 3u + channel] += total(i, channel, thread) * pixels[pixel].scale;
            }
        }
    }
}
