// Whether a light may touch a block of segments: the mirror of `rust/gather/src/gpu/bounds.rs`.
// use: gather/light

// Where the ends of the segments of a block lie: a box that they start in, and one that they go to. Each word of the first
// three of `start` and `end` has the lower and the upper side on an axis, rounded outwards.
struct Bounds {
    // The fourth word is not 0 where the segments escape: then they go to directions, from -1 to 1.
    start: vec4u,
    end: vec4u,
}

// Map from the sides of boxes to world space, metres.
struct Frame {
    minimum: vec3f,
    // Added to what a light reaches, metres: the rounding of positions.
    slack: f32,
    step: vec3f,
}

struct Box {
    low: vec3f,
    high: vec3f,
}

fn decode_box(words: vec3u, minimum: vec3f, step: vec3f) -> Box {
    let high = vec3f(words >> vec3u(16u)) * step + minimum;
    return Box(vec3f(words & vec3u(0xffffu)) * step + minimum, high);
}

fn may_touch(light: u32, bounds: Bounds, frame: Frame) -> bool {
    let escapes = bounds.start.w != 0u;
    let is_sun = lights[light].kind == SUN;
    if is_sun && !escapes {
        return false;
    }
    let start = decode_box(bounds.start.xyz, frame.minimum, frame.step);
    if !escapes {
        let end = decode_box(bounds.end.xyz, frame.minimum, frame.step);
        return boxes_meet(start, end, lights[light].center, half_extent(light) + frame.slack);
    }
    let directions = decode_box(bounds.end.xyz, vec3f(-1.0), vec3f(2.0 / 65535.0));
    if is_sun {
        // Directions are 0.57 to 1 long: seen from a point that goes along that of the sun, they pass the origin.
        let near = lights[light].direction * 0.57;
        let far = lights[light].direction;
        let low = Box(directions.low - near, directions.high - near);
        let high = Box(directions.low - far, directions.high - far);
        return boxes_meet(low, high, vec3f(0.0), vec3f(sqrt(lights[light].reach2) + 1e-4));
    }
    let end = Box(start.low + directions.low * FAR, start.high + directions.high * FAR);
    return boxes_meet(start, end, lights[light].center, half_extent(light) + frame.slack);
}

// Half of the size of a box around what a light reaches.
fn half_extent(light: u32) -> vec3f {
    if lights[light].kind <= SOFT_SPOT || lights[light].kind > SUN {
        return vec3f(sqrt(lights[light].reach2));
    }
    let u = lights[light].inverse_u;
    let v = lights[light].inverse_v;
    return 0.5 * (abs(u) / dot(u, u) + abs(v) / dot(v, v));
}

// Whether a box that changes from `start` to `end` in equal steps meets a box around `center` meanwhile. What all segments
// from the one to the other pass at the same share of their lengths lies in it.
fn boxes_meet(start: Box, end: Box, center: vec3f, extent: vec3f) -> bool {
    let above = center + extent;
    let below = center - extent;
    let lower = clip(start.low - above, end.low - above);
    let upper = clip(below - start.high, below - end.high);
    let enter = max(lower.x, upper.x);
    let leave = min(lower.y, upper.y);
    // A few units in the last place of the divisions.
    return enter * 0.99999 <= leave * 1.00001;
}

// From which share on, and up to which, all values are at most 0 that change from `start` to `end`.
fn clip(start: vec3f, end: vec3f) -> vec2f {
    let zero = start / (start - end);
    let enter = select(select(vec3f(0.0), vec3f(2.0), end > vec3f(0.0)), zero, end <= vec3f(0.0));
    let from_above = start > vec3f(0.0);
    let shares = select(vec3f(0.0), enter, from_above);
    let leaves = select(vec3f(1.0), zero, !from_above & (end > vec3f(0.0)));
    return vec2f(max(max(shares.x, shares.y), shares.z), min(min(leaves.x, leaves.y), leaves.z));
}
