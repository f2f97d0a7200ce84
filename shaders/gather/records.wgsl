// Records of a chunk, and the sums that LANES threads make of those of a pixel; GROUP_SIZE / LANES pixels a workgroup.
// use: gather/row
// constant: LIGHTS 4
// constant: LANES 64

const GROUP_SIZE = 64u;

// Records that lie together and start with a path.
struct Part {
    start: u32,
    end: u32,
    shard: u32,
}

// Records, four at a time: 16 bytes a load, and five decoded ends for four segments.
@group(0) @binding(2) var<storage, read> position_xy: array<vec4u>;
@group(0) @binding(3) var<storage, read> position_z_flags: array<vec4u>;
@group(0) @binding(4) var<storage, read> throughput: array<u32>;
// One more than there are pixels.
@group(0) @binding(5) var<storage, read> pixels: array<Pixel>;
@group(0) @binding(6) var<storage, read> parts: array<Part>;

// One per light or derivative, of what this thread has seen.
var<private> sums: array<vec3f, LIGHTS>;
// Channel by channel, then thread by thread.
var<workgroup> partial: array<f32, 3u * LIGHTS * GROUP_SIZE>;

// Adds up the sums of the threads of each pixel in a fixed order; afterwards the first of them finds the whole in `total`.
fn reduce(thread: u32) {
    for (var i = 0u; i < LIGHTS; i++) {
        partial[(3u * i) * GROUP_SIZE + thread] = sums[i].x;
        partial[(3u * i + 1u) * GROUP_SIZE + thread] = sums[i].y;
        partial[(3u * i + 2u) * GROUP_SIZE + thread] = sums[i].z;
    }
    for (var stride = LANES / 2u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if thread % LANES < stride {
            for (var i = 0u; i < 3u * LIGHTS; i++) {
                partial[i * GROUP_SIZE + thread] += partial[i * GROUP_SIZE + thread + stride];
            }
        }
    }
}

fn total(light: u32, channel: u32, thread: u32) -> f32 {
    return partial[(3u * light + channel) * GROUP_SIZE + thread];
}
