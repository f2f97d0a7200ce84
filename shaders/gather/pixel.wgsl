// Sums lights over the records of one pixel, by LANES threads; GROUP_SIZE / LANES pixels a workgroup.
// use: gather/light
// constant: LIGHTS 4
// constant: LANES 64

const GROUP_SIZE = 64u;

// What the records of a shard are decoded with.
struct Shard {
    step: vec3f,
    minimum: vec3f,
    camera: vec3f,
}

struct Pixel {
    // Row by row in the image.
    image: u32,
    // Its parts go on to the first one of the next pixel.
    first_part: u32,
    // 1 / samples.
    scale: f32,
}

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
@group(0) @binding(5) var<storage, read> shards: array<Shard>;
// One more than there are pixels.
@group(0) @binding(6) var<storage, read> pixels: array<Pixel>;
@group(0) @binding(7) var<storage, read> parts: array<Part>;

// One per light, of what this thread has seen.
var<private> sums: array<vec3f, LIGHTS>;
// Channel by channel, then thread by thread.
var<workgroup> partial: array<f32, 3u * LIGHTS * GROUP_SIZE>;

// Adds what a thread's share of a pixel's records gives for `count` lights.
fn visit_pixel(pixel: u32, lane: u32, first_light: u32, count: u32) {
    for (var part = pixels[pixel].first_part; part < pixels[pixel + 1u].first_part; part++) {
        let records = parts[part];
        let shard = shards[records.shard];
        for (var quad = records.start / 4u + lane; quad * 4u < records.end; quad += LANES) {
            visit_quad(quad, records, shard, first_light, count);
        }
    }
}

fn visit_quad(quad: u32, part: Part, shard: Shard, first_light: u32, count: u32) {
    let grid = Grid(shard.step, shard.minimum);
    let xy = position_xy[quad];
    let z_flags = position_z_flags[quad];
    // The first record of all starts a path, so that what stands for its predecessor is not used.
    let before = max(quad, 1u) - 1u;
    var previous = decode_position(position_xy[before].w, position_z_flags[before].w, grid);
    for (var i = 0u; i < 4u; i++) {
        let record = quad * 4u + i;
        let origin = select(previous, shard.camera, (z_flags[i] & PATH_START) != 0u);
        previous = decode_position(xy[i], z_flags[i], grid);
        if record >= part.start && record < part.end {
            var edge = previous - origin;
            if (z_flags[i] & ESCAPED) != 0u {
                edge = decode_escape(xy[i]);
            }
            visit_segment(record, segment(origin, edge, z_flags[i]), first_light, count);
        }
    }
}

fn visit_segment(record: u32, s: Segment, first_light: u32, count: u32) {
    for (var i = 0u; i < LIGHTS; i++) {
        if i >= count {
            break;
        }
        if is_near(first_light + i, s) {
            let factor = weight(first_light + i, s);
            if factor != 0.0 {
                sums[i] += decode_rgb9e5(throughput[record]) * factor;
            }
        }
    }
}

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
