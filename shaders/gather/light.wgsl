// Lights for crossing tests: the profiles of `rust/gather/src/light.rs`, decided by the same operations. A segment goes
// from `origin` along `edge`, which is not normalised; each crossing counts once.
// use: common/packing

const SPHERE = 0u;
const FACING_DISK = 1u;
const SPOT = 2u;
// A spot that is a facing disk in its cone.
const SOFT_SPOT = 3u;
const QUAD = 4u;
const ELLIPSE = 5u;
const SUN = 6u;
// Kinds from here on are found by a ball, as the first ones are.
const STRETCHED_SPOT = 7u;
const STRETCHED_SOFT_SPOT = 8u;
const SHEARED_QUAD = 9u;
const SHEARED_ELLIPSE = 10u;

const WAY_BACK = 0u;
const NORMAL = 1u;
const PLACE = 2u;

// Words of a receiver set: a bit for each of 2048.
const RECEIVER_WORDS = 64u;

struct Light {
    center: vec3f,
    kind: u32,
    // Axis of a spot, normal of an area, where a sheared one faces, towards a sun.
    direction: vec3f,
    radius: f32,
    // Edges of an area divided by their squared length; of a sheared one, the first two rows for the way to its centre.
    inverse_u: vec3f,
    // Squared: the radius with room for rounding, or the chord of a sun.
    reach2: f32,
    inverse_v: vec3f,
    // Number of its receiver set.
    receivers: u32,
    // By lobe code; 0 for what is not a segment.
    factors: array<f32, 8>,
    // Of a spot.
    cos_half_angle: f32,
    inverse_blend: f32,
    // Of the spread of an area; a normalisation of 0 is that of a Lambertian emitter.
    tan_half: f32,
    normalisation: f32,
    // Of a stretched spot or a light with a map, rows that take a direction to its own space, or a place to the map; of a sheared
    // area, those for edges of segments (`rust/gather/src/sheared.rs`), with the lengths of its own edges.
    row_x: vec3f,
    length_u: f32,
    row_y: vec3f,
    length_v: f32,
    row_z: vec3f,
    determinant: f32,
    // The third row for the way to its centre.
    center_row_z: vec3f,
    // Of its map: tangent of half of the angle of a square cone, or 0 for all directions.
    map_cone: f32,
    // Row of `receivers` from which on its texels lie; 0 for none.
    map_rows: u32,
    map_width: u32,
    map_height: u32,
    // What it is looked up by: WAY_BACK, NORMAL of a sphere, or PLACE on an area.
    map_key: u32,
    // Factor by distance, as of `Falloff`; 0 and 0 for none.
    falloff_power: f32,
    falloff_smooth: f32,
    // By lobe code, what squared distances are multiplied by for the share of light that counts by crossings; 0 for all of it.
    crossed: array<f32, 8>,
}

@group(0) @binding(0) var<storage, read> lights: array<Light>;
// Sets of RECEIVER_WORDS, then texels of maps.
@group(0) @binding(1) var<storage, read> receivers: array<u32>;

struct Segment {
    origin: vec3f,
    edge: vec3f,
    length2: f32,
    // Second word of the record.
    z_flags: u32,
}

// Smallest normal float.
const TINY = 1.1754944e-38;
const PI = 3.14159265358979;

fn segment(origin: vec3f, edge: vec3f, z_flags: u32) -> Segment {
    return Segment(origin, edge, max(dot(edge, edge), TINY), z_flags);
}

// Whether a segment may cross a light: no crossing one is left out, few others pass.
fn is_near(light: u32, s: Segment) -> bool {
    let kind = lights[light].kind;
    if kind <= SOFT_SPOT || kind > SUN {
        let to_center = lights[light].center - s.origin;
        let share = clamp(dot(to_center, s.edge) / s.length2, 0.0, 1.0);
        let nearest = to_center - s.edge * share;
        return dot(nearest, nearest) <= lights[light].reach2;
    }
    if kind <= ELLIPSE {
        return area_cosine(light, s) > 0.0;
    }
    let apart = s.edge / sqrt(s.length2) - lights[light].direction;
    return (s.z_flags & ESCAPED) != 0u && dot(apart, apart) <= lights[light].reach2;
}

// What a segment is weighted with: profile and factors; 0 if it does not cross the light or is left out by it.
fn weight(light: u32, s: Segment) -> f32 {
    let factor = factor(light, s.z_flags);
    if factor == 0.0 {
        return 0.0;
    }
    return factor * profile(light, s) * crossed_share(light, s);
}

// What a piece of a ray is weighted with that began `behind` metres before (`rust/gather/src/piece.rs`): nothing of a light
// that the ray has crossed before.
fn piece_weight(light: u32, s: Segment, behind: f32) -> f32 {
    let to_start = s.edge * (behind / sqrt(s.length2));
    let origin = s.origin - to_start;
    // Suns are beyond all that does not escape.
    let is_sun = lights[light].kind == SUN;
    if !is_sun && profile(light, segment(origin, to_start, s.z_flags)) != 0.0 {
        return 0.0;
    }
    return weight(light, segment(origin, to_start + s.edge, s.z_flags));
}

// Factor of a light on what segments with these flags see of it; 0 for those that it leaves out.
fn factor(light: u32, z_flags: u32) -> f32 {
    let lobe = lobe_code(z_flags);
    let bit = receiver(z_flags);
    let word = receivers[lights[light].receivers * RECEIVER_WORDS + (bit >> 5u)];
    // Camera rays leave no object; light linking does not concern them.
    if lobe != 0u && ((word >> (bit & 31u)) & 1u) == 0u {
        return 0.0;
    }
    return lights[light].factors[lobe];
}

// Share of what a segment sees that counts by crossings (`rust/gather/src/balance.rs`).
fn crossed_share(light: u32, s: Segment) -> f32 {
    let scale = lights[light].crossed[lobe_code(s.z_flags)];
    if scale == 0.0 {
        return 1.0;
    }
    let ratio = scale * squared_distance(light, s.origin);
    return 1.0 / (1.0 + ratio * ratio);
}

// Squared distance of a place from a light: from the centre of a ball, from the next point of an area, but of one with a spread at
// least that from which all of it shines to the place; 1 for a sun, 0 for a sheared area.
fn squared_distance(light: u32, place: vec3f) -> f32 {
    let from_center = place - lights[light].center;
    switch lights[light].kind {
        case QUAD, ELLIPSE: {
            let nearest = along_edge(lights[light].inverse_u, from_center) + along_edge(lights[light].inverse_v, from_center);
            let squared = dot(from_center - nearest, from_center - nearest);
            if lights[light].normalisation == 0.0 {
                return squared;
            }
            let share = select(1.0, 0.25 * PI, lights[light].kind == ELLIPSE);
            let area = share / (length(lights[light].inverse_u) * length(lights[light].inverse_v));
            return max(squared, area / (PI * lights[light].tan_half * lights[light].tan_half));
        }
        case SUN: { return 1.0; }
        case SHEARED_QUAD, SHEARED_ELLIPSE: { return 0.0; }
        default: { return dot(from_center, from_center); }
    }
}

// The part along an edge of the way from the centre of an area, up to the area's end; the edge is divided by its squared length.
fn along_edge(inverse: vec3f, from_center: vec3f) -> vec3f {
    return inverse * (clamp(dot(from_center, inverse), -0.5, 0.5) / dot(inverse, inverse));
}

fn profile(light: u32, s: Segment) -> f32 {
    switch lights[light].kind {
        case SPHERE: { return select(0.0, 1.0, sphere_is_crossed(light, s)); }
        case FACING_DISK: { return select(0.0, 1.0, facing_disk_is_crossed(light, s)); }
        case SPOT, SOFT_SPOT: { return spot(light, s, SOFT_SPOT); }
        case QUAD, ELLIPSE: { return area(light, s); }
        case STRETCHED_SPOT, STRETCHED_SOFT_SPOT: { return spot(light, s, STRETCHED_SOFT_SPOT); }
        case SHEARED_QUAD, SHEARED_ELLIPSE: { return sheared(light, s); }
        // `is_near` has decided.
        default: { return 1.0; }
    }
}

fn sphere_is_crossed(light: u32, s: Segment) -> bool {
    let to_center = lights[light].center - s.origin;
    let radius2 = lights[light].radius * lights[light].radius;
    let distance2 = dot(to_center, to_center);
    let along = dot(to_center, s.edge);
    let outside = distance2 > radius2;
    if outside && along <= 0.0 {
        return false;
    }
    // Distance of the centre from the line as a vector: squares of coordinates would cancel for small spheres.
    let perpendicular = to_center - s.edge * (along / s.length2);
    let half_chord2 = radius2 - dot(perpendicular, perpendicular);
    // A segment without length crosses nothing.
    if half_chord2 < 0.0 || s.length2 <= TINY {
        return false;
    }
    let length = sqrt(s.length2);
    let foot = along / length;
    let half_chord = sqrt(half_chord2);
    let distance = foot + select(half_chord, -half_chord, outside);
    return distance > 0.0 && distance < length;
}

// The disk lies through the centre, perpendicular to the line from the origin.
fn facing_disk_is_crossed(light: u32, s: Segment) -> bool {
    let to_center = lights[light].center - s.origin;
    let distance2 = dot(to_center, to_center);
    let along = dot(to_center, s.edge);
    if !(along > distance2 && distance2 > 0.0) {
        return false;
    }
    let in_disk = s.edge * (distance2 / along) - to_center;
    return dot(in_disk, in_disk) <= lights[light].radius * lights[light].radius;
}

// `soft` is the kind of such a spot that is a facing disk.
fn spot(light: u32, s: Segment, soft: u32) -> f32 {
    let is_soft = lights[light].kind == soft;
    let to_center = lights[light].center - s.origin;
    var crossed = false;
    if is_soft {
        crossed = facing_disk_is_crossed(light, s);
    } else {
        crossed = dot(s.edge, to_center) > 0.0 && sphere_is_crossed(light, s);
    }
    // The cone is left out for points inside of a sphere.
    let inside = dot(to_center, to_center) <= lights[light].radius * lights[light].radius;
    if !crossed || (inside && !is_soft) {
        return select(0.0, 1.0, crossed);
    }
    let cos = cone_cosine(light, s);
    let x = clamp((cos - lights[light].cos_half_angle) * lights[light].inverse_blend, 0.0, 1.0);
    return x * x * (3.0 - 2.0 * x);
}

// Cosine between the axis of a spot and the way back, in the space where its cone is round.
fn cone_cosine(light: u32, s: Segment) -> f32 {
    if lights[light].kind <= SOFT_SPOT {
        return -dot(s.edge, lights[light].direction) / sqrt(s.length2);
    }
    let z = dot(s.edge, lights[light].row_z);
    return z / length(vec3f(dot(s.edge, lights[light].row_x), dot(s.edge, lights[light].row_y), z));
}

// The profile of an area whose object is sheared.
fn sheared(light: u32, s: Segment) -> f32 {
    let to_center = lights[light].center - s.origin;
    if dot(to_center, lights[light].direction) >= 0.0 {
        return 0.0;
    }
    let along = vec3f(dot(s.edge, lights[light].row_x), dot(s.edge, lights[light].row_y), dot(s.edge, lights[light].row_z));
    let share = dot(to_center, lights[light].center_row_z) / along.z;
    if !(share > 0.0 && share < 1.0) {
        return 0.0;
    }
    let middle = vec2f(dot(to_center, lights[light].inverse_u), dot(to_center, lights[light].inverse_v));
    let uv = along.xy * share - middle;
    let is_ellipse = lights[light].kind == SHEARED_ELLIPSE;
    if !select(all(abs(uv) <= vec2f(0.5)), dot(uv, uv) <= 0.25, is_ellipse) {
        return 0.0;
    }
    let length_of_edge = sqrt(s.length2);
    let cos = -dot(s.edge, lights[light].direction) / length_of_edge;
    let straight = length(along * vec3f(lights[light].length_u, lights[light].length_v, 1.0));
    let ratio = length_of_edge / straight;
    let weight = select(
        lights[light].determinant * ratio * ratio * ratio,
        max(cos * length_of_edge / abs(along.z), 0.0),
        is_ellipse,
    );
    if lights[light].normalisation == 0.0 {
        return weight;
    }
    let tan = sqrt(max(1.0 - cos * cos, 0.0)) / cos;
    return select(0.0, weight * max((lights[light].tan_half - tan) * lights[light].normalisation, 0.0), cos > 0.0);
}

// Factor of the map of a light along a segment that crosses it, of a ray that began `behind` metres before.
fn map_factor(light: u32, piece: Segment, behind: f32) -> vec3f {
    if lights[light].map_rows == 0u {
        return vec3f(1.0);
    }
    let before = piece.edge * (behind * inverseSqrt(piece.length2));
    let s = segment(piece.origin - before, piece.edge + before, piece.z_flags);
    let factor = falloff(light, crossing_distance(light, s));
    if lights[light].map_key == NORMAL {
        return factor * map_lookup(light, place_of_direction(light, sphere_normal(light, s)));
    }
    return factor * map_texels(light, s.origin, s.edge);
}

// Likewise along a ray that may pass a smoothed light: by the way back in place of normals.
fn map_factor_near(light: u32, origin: vec3f, edge: vec3f) -> vec3f {
    let to_center = length(lights[light].center - origin);
    var distance = select(to_center, abs(to_center - lights[light].radius), is_ball(light));
    if lights[light].kind == SUN {
        distance = 1.0;
    }
    return falloff(light, distance) * map_texels(light, origin, edge);
}

// Factor by distance.
fn falloff(light: u32, distance: f32) -> f32 {
    let smoothing = lights[light].falloff_smooth;
    if lights[light].falloff_power == 0.0 && smoothing == 0.0 {
        return 1.0;
    }
    let squared = distance * distance;
    return pow(distance, lights[light].falloff_power) * select(1.0, squared / (smoothing + squared), smoothing > 0.0);
}

// True if rays meet the surface of the light's ball.
fn is_ball(light: u32) -> bool {
    let kind = lights[light].kind;
    return kind == SPHERE || kind == SPOT || kind == STRETCHED_SPOT;
}

// Metres from where a ray begins to where it crosses a light; a sun has none that matters.
fn crossing_distance(light: u32, s: Segment) -> f32 {
    let to_center = lights[light].center - s.origin;
    let length = sqrt(s.length2);
    switch lights[light].kind {
        case QUAD, ELLIPSE: {
            return length * dot(to_center, lights[light].direction) / dot(s.edge, lights[light].direction);
        }
        case SUN: {
            return 1.0;
        }
        default: {}
    }
    let foot = dot(to_center, s.edge) / length;
    let distance2 = dot(to_center, to_center);
    if !is_ball(light) {
        return distance2 / foot;
    }
    let radius2 = lights[light].radius * lights[light].radius;
    let perpendicular = to_center - s.edge * (foot / length);
    let half_chord = sqrt(max(radius2 - dot(perpendicular, perpendicular), 0.0));
    return max(foot + select(half_chord, -half_chord, distance2 > radius2), 0.0);
}

// Value of the map of a light that is looked up by the way back or by place.
fn map_texels(light: u32, origin: vec3f, edge: vec3f) -> vec3f {
    if lights[light].map_key == PLACE {
        let to_center = lights[light].center - origin;
        let slope = dot(edge, lights[light].direction);
        let share = select(dot(to_center, lights[light].direction) / slope, 0.0, slope == 0.0);
        let in_plane = edge * share - to_center;
        return map_lookup(light, vec2f(dot(in_plane, lights[light].row_x), dot(in_plane, lights[light].row_y)) + 0.5);
    }
    return map_lookup(light, place_of_direction(light, -edge));
}

// Normal, of any length, where a segment that crosses a sphere does so first.
fn sphere_normal(light: u32, s: Segment) -> vec3f {
    let to_center = lights[light].center - s.origin;
    let radius2 = lights[light].radius * lights[light].radius;
    let perpendicular = to_center - s.edge * (dot(to_center, s.edge) / s.length2);
    let half_chord = sqrt(max((radius2 - dot(perpendicular, perpendicular)) / s.length2, 0.0));
    let is_outside = dot(to_center, to_center) > radius2;
    let normal = s.edge * select(half_chord, -half_chord, is_outside) - perpendicular;
    return select(-s.edge, normal, dot(normal, normal) > 0.0);
}

// Place in a map of a direction of any length in world space.
fn place_of_direction(light: u32, direction: vec3f) -> vec2f {
    let local = vec3f(
        dot(direction, lights[light].row_x), dot(direction, lights[light].row_y), dot(direction, lights[light].row_z)
    );
    let cone = lights[light].map_cone;
    if cone > 0.0 {
        return local.xy * (0.5 / (cone * max(-local.z, 1e-6 * length(local)))) + 0.5;
    }
    return vec2f(atan2(local.y, local.x) * (0.5 / PI) + 0.5, atan2(length(local.xy), local.z) / PI);
}

// Bilinear value at a place of a map.
fn map_lookup(light: u32, place: vec2f) -> vec3f {
    let size = vec2f(f32(lights[light].map_width), f32(lights[light].map_height));
    let texel = clamp(place * size - 0.5, vec2f(-1.0), size);
    let low = floor(texel);
    let share = texel - low;
    let corner = vec2i(low);
    let lower = mix(map_texel(light, corner), map_texel(light, corner + vec2i(1, 0)), share.x);
    let upper = mix(map_texel(light, corner + vec2i(0, 1)), map_texel(light, corner + vec2i(1, 1)), share.x);
    return mix(lower, upper, share.y);
}

fn map_texel(light: u32, place: vec2i) -> vec3f {
    let width = i32(lights[light].map_width);
    var column = clamp(place.x, 0, width - 1);
    if lights[light].map_cone == 0.0 && lights[light].map_key != PLACE {
        column = (place.x + width) % width;
    }
    let row = clamp(place.y, 0, i32(lights[light].map_height) - 1);
    return decode_rgb9e5(receivers[lights[light].map_rows * RECEIVER_WORDS + u32(row * width + column)]);
}

// Cosine between the normal and the way back times the length of the edge; 0 if the segment does not cross the area from
// the side of its normal.
fn area_cosine(light: u32, s: Segment) -> f32 {
    let to_center = lights[light].center - s.origin;
    let normal = lights[light].direction;
    let height = dot(to_center, normal);
    let slope = dot(s.edge, normal);
    if !(slope < 0.0 && height < 0.0 && slope < height) {
        return 0.0;
    }
    let in_plane = s.edge * (height / slope) - to_center;
    let uv = vec2f(dot(in_plane, lights[light].inverse_u), dot(in_plane, lights[light].inverse_v));
    let inside = select(all(abs(uv) <= vec2f(0.5)), dot(uv, uv) <= 0.25, lights[light].kind == ELLIPSE);
    return select(0.0, -slope, inside);
}

fn area(light: u32, s: Segment) -> f32 {
    let projected = area_cosine(light, s);
    if projected <= 0.0 || lights[light].normalisation == 0.0 {
        return select(0.0, 1.0, projected > 0.0);
    }
    // The soft-box grid of Blender's D10594.
    let cos = projected / sqrt(s.length2);
    let tan = sqrt(max(1.0 - cos * cos, 0.0)) / cos;
    return max((lights[light].tan_half - tan) * lights[light].normalisation, 0.0);
}
