// Adds what a chunk of records gives to the images of up to LIGHTS lights.
// use: gather/pixel

struct Arguments {
    pixels: u32,
    first_light: u32,
    lights: u32,
    // Values of an image.
    stride: u32,
}
var<immediate> arguments: Arguments;

// Image by image.
@group(0) @binding(8) var<storage, read_write> images: array<f32>;

@compute @workgroup_size(GROUP_SIZE)
fn add_images(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = (group.x + group.y * groups.x) * (GROUP_SIZE / LANES) + thread / LANES;
    if pixel < arguments.pixels {
        visit_pixel(pixel, thread % LANES, arguments.first_light, arguments.lights);
    }
    reduce(thread);
    if thread % LANES != 0u || pixel >= arguments.pixels {
        return;
    }
    for (var i = 0u; i < LIGHTS; i++) {
        if i < arguments.lights {
            let first = i * arguments.stride + pixels[pixel].image * 3u;
            for (var channel = 0u; channel < 3u; channel++) {
                images[first + channel] += total(i, channel, thread) * pixels[pixel].scale;
            }
        }
    }
}
