// The mean of some images takes one more in, whose place is taken by how much it differs from the mean before, scaled.

const GROUP: u32 = 64u;

struct Arguments {
    values: u32,
    // Of the new image in the mean.
    share: f32,
    scale: f32,
}

@group(0) @binding(0) var<storage, read_write> mean: array<f32>;
@group(0) @binding(1) var<storage, read_write> image: array<f32>;

var<immediate> arguments: Arguments;

@compute @workgroup_size(GROUP)
fn take_in(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let at = id.x + id.y * groups.x * GROUP;
    if at >= arguments.values { return; }
    let difference = image[at] - mean[at];
    mean[at] += arguments.share * difference;
    image[at] = arguments.scale * difference;
}
