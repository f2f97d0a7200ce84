// Adds what a chunk of records gives at some cells for a smoothed light: values and derivatives. A workgroup sums a cell.
// use: gather/pixel
// use: gather/soft
// constant: PIXEL_LANES 64

struct Arguments {
    cells: u32,
    // Of cells.
    columns: u32,
    // Of a cell, pixels.
    edge: u32,
    // Of the image, pixels.
    width: u32,
    height: u32,
    // Number of the light in `lights` and `values`.
    light: u32,
}
var<immediate> arguments: Arguments;

// By place in the image, for `number_of`.
@group(0) @binding(9) var<storage, read> numbers: array<u32>;
@group(0) @binding(10) var<storage, read> cells: array<u32>;
// RGB of the value and of each derivative; light by light, then cell by cell.
@group(0) @binding(11) var<storage, read_write> values: array<f32>;

@compute @workgroup_size(GROUP_SIZE)
fn add_slopes(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = group.x + group.y * groups.x;
    if index >= arguments.cells {
        return;
    }
    let first = vec2u(cells[index] % arguments.columns, cells[index] / arguments.columns) * arguments.edge;
    let size = min(vec2u(arguments.edge), vec2u(arguments.width, arguments.height) - first);
    let count = size.x * size.y;
    for (var i = thread / PIXEL_LANES; i < count; i += GROUP_SIZE / PIXEL_LANES) {
        let place = (first.y + i / size.x) * arguments.width + first.x + i % size.x;
        let pixel = number_of(place, numbers[place]);
        if pixel != ELSEWHERE {
            add_pixel(pixel, thread % PIXEL_LANES, 1.0 / f32(count));
        }
    }
    reduce(thread);
    workgroupBarrier();
    if thread < 3u * OUTPUTS {
        values[(arguments.light * arguments.cells + index) * 3u * OUTPUTS + thread] += total(thread / 3u, thread % 3u, 0u);
    }
}

// Adds a thread's share of a pixel's records to its sums: one for the value and one for each derivative.
fn add_pixel(pixel: u32, lane: u32, share: f32) {
    let scale = pixels[pixel].scale * share;
    for (var part = pixels[pixel].first_part; part < pixels[pixel + 1u].first_part; part++) {
        let shard = shards[parts[part].shard];
        for (var record = parts[part].start + lane; record < parts[part].end; record += PIXEL_LANES) {
            add_record(record, shard, scale);
        }
    }
}

fn add_record(record: u32, shard: Shard, scale: f32) {
    let z_flags = z_flags_of(record);
    let is_escape = (z_flags & ESCAPED) != 0u;
    let weight = factor(arguments.light, z_flags) * scale;
    if weight == 0.0 || (soft.kind == SUN && !is_escape) {
        return;
    }
    let origin = start_of(record, shard);
    var edge = decode_escape(xy_of(record));
    if !is_escape {
        edge = decode_position(xy_of(record), z_flags, Grid(shard.step, shard.minimum)) - origin;
    }
    let length2 = dot(edge, edge);
    if length2 == 0.0 || !comes_near(origin, edge, length2) {
        return;
    }
    let length = sqrt(length2);
    let direction = edge / length;
    var start = 0.0;
    if (z_flags & CONTINUES) != 0u {
        start = behind(record, origin, shard);
    }
    evaluate(Ray(origin - direction * start, direction, start, start + length));
    var rgb = decode_rgb9e5(throughput[record]) * weight;
    if lights[arguments.light].map_rows != 0u {
        rgb *= map_factor_near(arguments.light, origin - direction * start, edge);
    }
    for (var i = 0u; i < OUTPUTS; i++) {
        sums[i] += rgb * outputs[i];
    }
}

fn comes_near(origin: vec3f, edge: vec3f, length2: f32) -> bool {
    let to_center = soft.center - origin;
    let nearest = to_center - edge * clamp(dot(to_center, edge) / length2, 0.0, 1.0);
    return soft.kind == SUN || dot(nearest, nearest) <= soft.reach2;
}
