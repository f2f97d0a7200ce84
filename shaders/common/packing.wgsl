// Records of a path dump, the bits of `rust/dump/src/packing.rs`, and what `rust/gather` makes of them.

// Length of escaped segments in metres, up to a factor of 0.57: beyond every light, and harmless in f32.
const FAR = 1e8;

// Bits of a record's second word: its segment continues the ray of the one before (of an origin record, no meaning), it escapes.
const CONTINUES = 1u << 16u;
const ESCAPED = 1u << 17u;
// Bits of which a segment that starts at the camera's position has none.
const NOT_FROM_CAMERA = 0x1du << 16u;
// Bits of NOT_FROM_CAMERA of a camera segment behind an origin record; an origin record has all of them.
const CAMERA_BEHIND_ORIGIN = 0x1cu << 16u;

// Map from grid coordinates to world space, metres.
struct Grid {
    step: vec3f,
    minimum: vec3f,
}

// Where a record ends that does not escape.
fn decode_position(xy: u32, z_flags: u32, grid: Grid) -> vec3f {
    return vec3f(vec3u(xy & 0xffffu, xy >> 16u, z_flags & 0xffffu)) * grid.step + grid.minimum;
}

// FAR times the octahedral direction of an escaped record before it is normalised: its length, 0.57 to 1, does not
// matter there.
fn decode_escape(xy: u32) -> vec3f {
    let uv = vec2f(vec2u(xy & 0xffffu, xy >> 16u)) * (FAR * 2.0 / 65535.0) - FAR;
    let z = FAR - abs(uv.x) - abs(uv.y);
    let fold = min(z, 0.0);
    return vec3f(uv + select(vec2f(-fold), vec2f(fold), uv >= vec2f(0.0)), z);
}

fn starts_at_camera(z_flags: u32) -> bool {
    return (z_flags & NOT_FROM_CAMERA) == 0u;
}

// Number of the lobe; 7 is not a segment.
fn lobe_code(z_flags: u32) -> u32 {
    return select((z_flags >> 18u) & 7u, 0u, (z_flags & NOT_FROM_CAMERA) == CAMERA_BEHIND_ORIGIN);
}

fn receiver(z_flags: u32) -> u32 {
    return z_flags >> 21u;
}

// A throughput: mantissa times 2^(e - 24), whose float has the exponent bits e - 24 + 127.
fn decode_rgb9e5(bits: u32) -> vec3f {
    let scale = bitcast<f32>(((bits >> 27u) + 103u) << 23u);
    return vec3f(vec3u(bits & 511u, (bits >> 9u) & 511u, (bits >> 18u) & 511u)) * scale;
}
