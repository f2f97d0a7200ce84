// Pictures of lights for radiance 1 at the cells that a step looks at, which may have derivatives beside them.
// constant: LIGHT_QUADS 1
// constant: OUTPUTS 1
// constant: WHOLE 0

struct Arguments {
    // Cells.
    count: u32,
    // Cells of each light in `units`.
    stride: u32,
    lights: u32,
    // The first of the lights in `lights`.
    first: u32,
    // Where their gradients start in `results`.
    results: u32,
}

// LIGHT_QUADS of each light; the last one is its radiance.
@group(0) @binding(0) var<storage, read> lights: array<vec4f>;
// Places of the cells in the whole picture.
@group(0) @binding(1) var<storage, read> cells: array<u32>;
// Light by light, then cell by cell OUTPUTS, RGB each, of which the value comes first. All cells of the picture if WHOLE is 1.
@group(0) @binding(2) var<storage, read> units: array<f32>;

var<immediate> arguments: Arguments;

fn radiance_of(light: u32) -> vec3f { return lights[(arguments.first + light + 1u) * LIGHT_QUADS - 1u].xyz; }

fn unit_of(light: u32, index: u32, output: u32) -> vec3f {
    let place = select(index, cells[index], WHOLE == 1u);
    let at = 3u * ((light * arguments.stride + place) * OUTPUTS + output);
    return vec3f(units[at], units[at + 1u], units[at + 2u]);
}
