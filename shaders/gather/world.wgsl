// Adds what a chunk of records gives to the image of the world: the light that escaped segments see (`Environment` of
// `rust/gather/src/environment.rs`).
// use: common/packing
// use: gather/records

struct Environment {
    // A direction in the map from one in the scene.
    texture_from_world: mat3x3f,
    // Radiance, or factor on the map.
    color: vec3f,
    // Bit per lobe that sees it.
    lobes: u32,
    // Texels; 0 without a map.
    width: u32,
    height: u32,
    // Rows of the map that are here; others are black.
    first_row: u32,
    end_row: u32,
    // First receiver of segments along which no world is seen.
    first_without_world: u32,
}

@group(0) @binding(0) var<storage, read> environment: Environment;
// RGB, row by row from the bottom.
@group(0) @binding(1) var<storage, read> texels: array<f32>;
@group(0) @binding(7) var<storage, read_write> image: array<f32>;

// A struct: DirectX takes no other arguments.
struct Arguments {
    pixels: u32,
}
var<immediate> arguments: Arguments;

const PI = 3.14159265;
// Number of lobes; their code is not a segment's.
const LOBES = 7u;

@compute @workgroup_size(GROUP_SIZE)
fn add_world(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = (group.x + group.y * groups.x) * (GROUP_SIZE / LANES) + thread / LANES;
    if pixel < arguments.pixels {
        for (var part = pixels[pixel].first_part; part < pixels[pixel + 1u].first_part; part++) {
            visit_part(parts[part], thread % LANES);
        }
    }
    reduce(thread);
    if thread % LANES != 0u || pixel >= arguments.pixels {
        return;
    }
    for (var channel = 0u; channel < 3u; channel++) {
        image[pixels[pixel].image * 3u + channel] += total(0u, channel, thread) * pixels[pixel].scale;
    }
}

// Flags are read of all records, the rest of those that see the world only.
fn visit_part(part: Part, lane: u32) {
    for (var quad = part.start / 4u + lane; quad * 4u < part.end; quad += LANES) {
        let z_flags = position_z_flags[quad];
        for (var i = 0u; i < 4u; i++) {
            let record = quad * 4u + i;
            if record >= part.start && record < part.end && sees_world(z_flags[i]) {
                sums[0] += decode_rgb9e5(throughput[record]) * radiance(decode_escape(position_xy[quad][i]));
            }
        }
    }
}

fn sees_world(z_flags: u32) -> bool {
    let lobe = lobe_code(z_flags);
    let hidden = (environment.lobes >> min(lobe, LOBES) & 1u) == 0u;
    let is_without_world = receiver(z_flags) >= environment.first_without_world;
    return (z_flags & ESCAPED) != 0u && lobe < LOBES && !hidden && !is_without_world;
}

fn radiance(direction: vec3f) -> vec3f {
    if environment.width == 0u {
        return environment.color;
    }
    let uv = equirectangular(environment.texture_from_world * normalize(direction));
    let place = uv * vec2f(vec2u(environment.width, environment.height)) - 0.5;
    let corner = floor(place);
    let share = place - corner;
    let columns = vec2u(repeated(corner.x, environment.width), repeated(corner.x + 1.0, environment.width));
    let lower = between(repeated(corner.y, environment.height), columns, share.x);
    let upper = between(repeated(corner.y + 1.0, environment.height), columns, share.x);
    return environment.color * mix(lower, upper, share.y);
}

// Number of a texel of a map that goes on beyond its sides by one.
fn repeated(place: f32, count: u32) -> u32 {
    return u32(place + f32(count)) % count;
}

fn between(row: u32, columns: vec2u, share: f32) -> vec3f {
    if row < environment.first_row || row >= environment.end_row {
        return vec3f(0.0);
    }
    let first = (row - environment.first_row) * environment.width;
    return mix(texel(first + columns.x), texel(first + columns.y), share);
}

fn texel(index: u32) -> vec3f {
    return vec3f(texels[3u * index], texels[3u * index + 1u], texels[3u * index + 2u]);
}

fn equirectangular(direction: vec3f) -> vec2f {
    let azimuth = angle(direction.x, direction.y);
    return vec2f(0.5 - azimuth / (2.0 * PI), 1.0 - angle(direction.z, length(direction.xy)) / PI);
}

// Angle of the direction to (x, y), from -pi to pi. Drivers may be off by 4096 units in the last place with theirs, texels of
// a large map. The polynomial is `atanf` of Cephes, off by two units, of angles up to 22.5 degrees.
fn angle(x: f32, y: f32) -> f32 {
    // Smallest normal float: the angle to the origin is 0.
    let larger = max(max(abs(x), abs(y)), 1.1754944e-38);
    let smaller = min(abs(x), abs(y));
    let is_steep = smaller > 0.41421356 * larger;
    let t = select(smaller / larger, (smaller - larger) / (smaller + larger), is_steep);
    let z = t * t;
    let series = ((0.0805374449538 * z - 0.138776856032) * z + 0.199777106478) * z - 0.333329491539;
    var angle = series * z * t + t + select(0.0, PI / 4.0, is_steep);
    angle = select(angle, PI / 2.0 - angle, abs(y) > abs(x));
    angle = select(angle, PI - angle, x < 0.0);
    return select(angle, -angle, y < 0.0);
}
