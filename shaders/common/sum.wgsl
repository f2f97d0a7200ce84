// Adds some images of one size, each times its weight, to their sum: RGB, row by row, a value a thread.

const GROUP: u32 = 64u;

struct Arguments {
    // Pixels of the sum.
    width: u32,
    height: u32,
    // Pixels of a row of the images.
    row: u32,
    // 1, or 2 if each pixel of the sum is the mean of two by two of theirs; an odd last column or row is left out.
    scale: u32,
    // Weight of the first image.
    first: u32,
    // Images, at most 8; what else is bound is not read.
    count: u32,
}

@group(0) @binding(0) var<storage, read> weights: array<vec4f>;
@group(0) @binding(1) var<storage, read> image_0: array<f32>;
@group(0) @binding(2) var<storage, read> image_1: array<f32>;
@group(0) @binding(3) var<storage, read> image_2: array<f32>;
@group(0) @binding(4) var<storage, read> image_3: array<f32>;
@group(0) @binding(5) var<storage, read> image_4: array<f32>;
@group(0) @binding(6) var<storage, read> image_5: array<f32>;
@group(0) @binding(7) var<storage, read> image_6: array<f32>;
@group(0) @binding(8) var<storage, read> image_7: array<f32>;
@group(0) @binding(9) var<storage, read_write> sum: array<f32>;

var<immediate> arguments: Arguments;

fn value_of(image: u32, at: u32) -> f32 {
    switch image {
        case 0u: { return image_0[at]; }
        case 1u: { return image_1[at]; }
        case 2u: { return image_2[at]; }
        case 3u: { return image_3[at]; }
        case 4u: { return image_4[at]; }
        case 5u: { return image_5[at]; }
        case 6u: { return image_6[at]; }
        default: { return image_7[at]; }
    }
}

@compute @workgroup_size(GROUP)
fn add_images(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = id.x + id.y * groups.x * GROUP;
    if at >= 3u * arguments.width * arguments.height { return; }
    let pixel = at / 3u;
    let channel = at % 3u;
    let corner = arguments.scale * (pixel / arguments.width * arguments.row + pixel % arguments.width);
    let upper = 3u * corner + channel;
    let lower = upper + 3u * arguments.row;
    var total = sum[at];
    for (var image = 0u; image < arguments.count; image++) {
        var value = value_of(image, upper);
        if arguments.scale == 2u {
            value += value_of(image, upper + 3u) + value_of(image, lower) + value_of(image, lower + 3u);
            value *= 0.25;
        }
        total += weights[arguments.first + image][channel] * value;
    }
    sum[at] = total;
}
