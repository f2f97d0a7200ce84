// Notes the numbers of the pixels of a chunk, a pixel a thread.
// use: gather/row

struct Arguments {
    pixels: u32,
}
var<immediate> arguments: Arguments;

@group(0) @binding(0) var<storage, read> pixels: array<Pixel>;
// By place in the image. What stands for pixels of other chunks stays (`number_of` of gather/pixel).
@group(0) @binding(1) var<storage, read_write> numbers: array<u32>;

@compute @workgroup_size(64)
fn number_pixels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = (group.x + group.y * groups.x) * 64u + thread;
    if pixel < arguments.pixels {
        numbers[pixels[pixel].image] = pixel;
    }
}
