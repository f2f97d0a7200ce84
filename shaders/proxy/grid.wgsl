// The hash grid's levels and the four grid points around a pixel (Mueller et al. 2022, "Instant Neural Graphics Primitives
// with a Multiresolution Hash Encoding").

struct Level {
    /// First parameter.
    table: u32,
    /// Cells per unit of the longer side.
    resolution: f32,
    /// Grid points along x.
    columns: u32,
    /// Entries of the table minus one if hashed, else 0.
    hash_mask: u32,
}

struct Corners {
    entries: vec4u,
    weights: vec4f,
}

fn corners_of(level: Level, pixel: u32, width: u32, height: u32) -> Corners {
    let longer = f32(max(width, height));
    let at = (vec2f(f32(pixel % width), f32(pixel / width)) + 0.5) / longer * level.resolution;
    let low = vec2u(at);
    let share = at - vec2f(low);
    let columns = vec4u(low.x, low.x + 1u, low.x, low.x + 1u);
    let rows = vec4u(low.y, low.y, low.y + 1u, low.y + 1u);
    var entries = rows * level.columns + columns;
    if level.hash_mask != 0u {
        entries = (columns ^ (rows * 2654435761u)) & vec4u(level.hash_mask);
    }
    let rest = 1.0 - share;
    return Corners(entries, vec4f(rest.x * rest.y, share.x * rest.y, rest.x * share.y, share.x * share.y));
}
