// Sums lights over the records of one pixel, by LANES threads; GROUP_SIZE / LANES pixels a workgroup.
// use: gather/light
// use: gather/records
// use: gather/shard

@group(0) @binding(7) var<storage, read> shards: array<Shard>;

const ELSEWHERE = 0xffffffffu;

// The number of the pixel at a place in the image, or ELSEWHERE if it is not of this chunk. `noted` is what stands for the
// place in a table of numbers: where it was not noted for this chunk, anything.
fn number_of(place: u32, noted: u32) -> u32 {
    // The last one is no pixel: it says where the parts of the one before it end.
    if noted < arrayLength(&pixels) - 1u && pixels[noted].image == place {
        return noted;
    }
    return ELSEWHERE;
}

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
        let origin = select(previous, shard.camera, starts_at_camera(z_flags[i]));
        previous = decode_position(xy[i], z_flags[i], grid);
        if record >= part.start && record < part.end {
            var edge = previous - origin;
            if (z_flags[i] & ESCAPED) != 0u {
                edge = decode_escape(xy[i]);
            }
            visit_segment(record, segment(origin, edge, z_flags[i]), shard, first_light, count);
        }
    }
}

fn visit_segment(record: u32, s: Segment, shard: Shard, first_light: u32, count: u32) {
    for (var i = 0u; i < LIGHTS; i++) {
        if i >= count {
            break;
        }
        if is_near(first_light + i, s) {
            var factor = 0.0;
            var before = 0.0;
            if (s.z_flags & CONTINUES) == 0u {
                factor = weight(first_light + i, s);
            } else {
                before = behind(record, s.origin, shard);
                factor = piece_weight(first_light + i, s, before);
            }
            if factor != 0.0 {
                sums[i] += decode_rgb9e5(throughput[record]) * map_factor(first_light + i, s, before) * factor;
            }
        }
    }
}

// Metres from where the ray of a segment that continues one began to `start`, where the segment does.
fn behind(record: u32, start: vec3f, shard: Shard) -> f32 {
    var first = record;
    while first > 0u && (z_flags_of(first) & CONTINUES) != 0u {
        first--;
    }
    return distance(start_of(first, shard), start);
}

// Where the segment of a record starts.
fn start_of(record: u32, shard: Shard) -> vec3f {
    if record == 0u || starts_at_camera(z_flags_of(record)) {
        return shard.camera;
    }
    return decode_position(xy_of(record - 1u), z_flags_of(record - 1u), Grid(shard.step, shard.minimum));
}

fn xy_of(record: u32) -> u32 {
    return position_xy[record / 4u][record % 4u];
}

fn z_flags_of(record: u32) -> u32 {
    return position_z_flags[record / 4u][record % 4u];
}
