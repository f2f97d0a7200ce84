// Adds what sorted segments give to the images of up to LIGHTS lights. Blocks of segments that no light may touch are not
// read; sums are those of integers, so that their order does not matter.
// use: gather/bounds
// use: gather/shard
// constant: LIGHTS 1

const GROUP_SIZE = 256u;
// Segments of a block.
const BLOCK = 64u;
// Most pixels of a group.
const GROUP_PIXELS = 256u;

// A rectangle of pixels whose segments are sorted together.
struct Group {
    // Place of its first pixel in the image, row by row.
    first_pixel: u32,
    width: u32,
    pixels: u32,
    first_block: u32,
    end_block: u32,
    first_shard: u32,
    // How much less a segment's number in `behind` is.
    behind_shift: u32,
    // 1 / samples of all paths, the first half, the second half.
    scales: array<f32, 3>,
}

struct Arguments {
    frame: Frame,
    first_light: u32,
    lights: u32,
    // 0 for all paths, 1 for the first half, 2 for the second.
    paths: u32,
    image_width: u32,
    // Values of an image.
    stride: u32,
}
var<immediate> arguments: Arguments;

// Words: position_xy and position_z_flags of the end, position_xy of the start; z of the start, pixel of the group << 16,
// shard of the tile << 24, second half << 31.
@group(0) @binding(2) var<storage, read> segments: array<vec4u>;
@group(0) @binding(3) var<storage, read> throughput: array<u32>;
@group(0) @binding(4) var<storage, read> bounds: array<Bounds>;
@group(0) @binding(5) var<storage, read> shards: array<Shard>;
@group(0) @binding(6) var<storage, read> pixel_groups: array<Group>;
// Metres from where the rays of segments that continue them began to where these segments do.
@group(0) @binding(7) var<storage, read> behind: array<f32>;
// Image by image.
@group(0) @binding(8) var<storage, read_write> images: array<f32>;

// Fixed-point numbers of 64 bits, 32 of them behind the point: of each light and channel the high words of all pixels, then
// the low words.
var<workgroup> sums: array<atomic<u32>, 6u * LIGHTS * GROUP_PIXELS>;
// Blocks to be read, and a bit for each light that may touch them.
var<workgroup> found: array<vec2u, GROUP_SIZE>;
var<workgroup> found_count: atomic<u32>;

@compute @workgroup_size(GROUP_SIZE)
fn add_blocks(
    @builtin(workgroup_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = id.x + id.y * groups.x;
    if number >= arrayLength(&pixel_groups) {
        return;
    }
    for (var i = 0u; i < 6u * LIGHTS; i++) {
        atomicStore(&sums[i * GROUP_PIXELS + thread], 0u);
    }
    let first_block = pixel_groups[number].first_block;
    let end_block = pixel_groups[number].end_block;
    for (var first = first_block; first < end_block; first += GROUP_SIZE) {
        if thread == 0u {
            atomicStore(&found_count, 0u);
        }
        workgroupBarrier();
        if first + thread < end_block {
            find(first + thread);
        }
        workgroupBarrier();
        let count = atomicLoad(&found_count);
        for (var i = thread / BLOCK; i < GROUP_SIZE; i += GROUP_SIZE / BLOCK) {
            if i >= count {
                break;
            }
            visit(found[i].x * BLOCK + thread % BLOCK, found[i].y, number);
        }
        workgroupBarrier();
    }
    if thread < pixel_groups[number].pixels {
        write_pixel(number, thread);
    }
}

// Lists a block if a light may touch it.
fn find(block: u32) {
    var touching = 0u;
    for (var i = 0u; i < LIGHTS; i++) {
        if i < arguments.lights && may_touch(arguments.first_light + i, bounds[block], arguments.frame) {
            touching |= 1u << i;
        }
    }
    if touching != 0u {
        found[atomicAdd(&found_count, 1u)] = vec2u(block, touching);
    }
}

fn visit(index: u32, touching: u32, number: u32) {
    let words = segments[index];
    if arguments.paths != 0u && (words.w >> 31u) != arguments.paths - 1u {
        return;
    }
    let shard = shards[pixel_groups[number].first_shard + ((words.w >> 24u) & 127u)];
    let grid = Grid(shard.step, shard.minimum);
    let origin = select(decode_position(words.z, words.w, grid), shard.camera, starts_at_camera(words.y));
    var edge = decode_position(words.x, words.y, grid) - origin;
    if (words.y & ESCAPED) != 0u {
        edge = decode_escape(words.x);
    }
    let s = segment(origin, edge, words.y);
    for (var i = 0u; i < LIGHTS; i++) {
        let light = arguments.first_light + i;
        if ((touching >> i) & 1u) != 0u && is_near(light, s) {
            var factor = 0.0;
            var before = 0.0;
            if (words.y & CONTINUES) == 0u {
                factor = weight(light, s);
            } else {
                before = behind[index - pixel_groups[number].behind_shift];
                factor = piece_weight(light, s, before);
            }
            if factor != 0.0 {
                let value = decode_rgb9e5(throughput[index]) * map_factor(light, s, before)
                    * (factor * bitcast<f32>(0x7f000000u - unit(light)));
                let pixel = (words.w >> 16u) & 255u;
                add(6u * i, pixel, value.x);
                add(6u * i + 2u, pixel, value.y);
                add(6u * i + 4u, pixel, value.z);
            }
        }
    }
}

// The power of two at or below the largest weight that a light gives, as the bits of a float: divided by it, contributions
// use the range of the fixed-point sums.
fn unit(light: u32) -> u32 {
    var largest = 0.0;
    for (var lobe = 0u; lobe < 8u; lobe++) {
        largest = max(largest, abs(lights[light].factors[lobe]));
    }
    largest *= max(lights[light].tan_half * lights[light].normalisation, 1.0);
    return bitcast<u32>(largest) & 0x7f800000u;
}

fn add(row: u32, pixel: u32, value: f32) {
    let whole = floor(value);
    // The largest float below 2^32, for negative values that round to a fraction of 1.
    let low = u32(min((value - whole) * 4294967296.0, 4294967040.0));
    let before = atomicAdd(&sums[(row + 1u) * GROUP_PIXELS + pixel], low);
    let carry = select(0u, 1u, before + low < before);
    atomicAdd(&sums[row * GROUP_PIXELS + pixel], bitcast<u32>(i32(whole)) + carry);
}

fn write_pixel(number: u32, pixel: u32) {
    let width = pixel_groups[number].width;
    let place = pixel_groups[number].first_pixel + pixel / width * arguments.image_width + pixel % width;
    for (var i = 0u; i < LIGHTS; i++) {
        if i < arguments.lights {
            let scale = pixel_groups[number].scales[arguments.paths] * bitcast<f32>(unit(arguments.first_light + i));
            for (var channel = 0u; channel < 3u; channel++) {
                let row = 6u * i + 2u * channel;
                let high = bitcast<i32>(atomicLoad(&sums[row * GROUP_PIXELS + pixel]));
                let low = atomicLoad(&sums[(row + 1u) * GROUP_PIXELS + pixel]);
                let sum = f32(high) + f32(low) * (1.0 / 4294967296.0);
                images[i * arguments.stride + place * 3u + channel] += sum * scale;
            }
        }
    }
}
