// A gather of segments that lie as the paper stores them (section 4.2), for comparing layouts alone (`rust/bench/src/gather/paper.rs`): paths of
// seven vertices, each of twelve bytes: three 16-bit floats, two bytes that are not used here, and the throughput of the
// segment that starts there. Lengths and escapes of paths are left out, so that every path has six segments.
// use: gather/light
// use: gather/records

const VERTICES = 7u;
// Of a vertex.
const WORDS = 3u;
// Flags of every segment: lobe code 1, a diffuse reflection, since lights may be hidden from camera rays.
const DIFFUSE = 1u << 18u;

struct Arguments {
    pixels: u32,
    // Of a pixel, whole paths.
    vertices: u32,
    lights: u32,
}
var<immediate> arguments: Arguments;

@group(0) @binding(2) var<storage, read> vertices: array<u32>;
// Image by image.
@group(0) @binding(3) var<storage, read_write> images: array<f32>;

@compute @workgroup_size(GROUP_SIZE)
fn add_paths(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = (group.x + group.y * groups.x) * (GROUP_SIZE / LANES) + thread / LANES;
    if pixel < arguments.pixels {
        for (var i = thread % LANES; i < arguments.vertices; i += LANES) {
            // The last vertex of a path starts no segment.
            if i % VERTICES != VERTICES - 1u {
                visit(pixel * arguments.vertices + i);
            }
        }
    }
    reduce(thread);
    if thread % LANES != 0u || pixel >= arguments.pixels {
        return;
    }
    for (var i = 0u; i < LIGHTS; i++) {
        if i < arguments.lights {
            for (var channel = 0u; channel < 3u; channel++) {
                images[3u * (i * arguments.pixels + pixel) + channel] += total(i, channel, thread);
            }
        }
    }
}

fn visit(vertex: u32) {
    let origin = position(vertex);
    let s = segment(origin, position(vertex + 1u) - origin, DIFFUSE);
    for (var i = 0u; i < LIGHTS; i++) {
        if i >= arguments.lights {
            break;
        }
        if is_near(i, s) {
            let weight = weight(i, s);
            if weight != 0.0 {
                sums[i] += decode_rgb9e5(vertices[WORDS * vertex + 2u]) * weight;
            }
        }
    }
}

fn position(vertex: u32) -> vec3f {
    let xy = unpack2x16float(vertices[WORDS * vertex]);
    return vec3f(xy, unpack2x16float(vertices[WORDS * vertex + 1u]).x);
}
