// From a loss's gradient by a picture to those by the lights that it is made of: the sums over its cells of that gradient times
// what `slopes.wgsl` leaves. A workgroup sums one output of a light.

const GROUP = 64u;
// Of a light and cell: its value, then derivatives by the lanes; RGB each.
const OUTPUTS = 11u;
// Of a light's gradient: by its radiance, then by the lanes.
const GRADIENT = OUTPUTS + 2u;

struct Arguments {
    cells: u32,
    lights: u32,
}

@group(0) @binding(0) var<storage, read> radiances: array<vec4f>;
// Light by light, then cell by cell.
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read> d_picture: array<f32>;
@group(0) @binding(3) var<storage, read_write> results: array<f32>;

var<immediate> arguments: Arguments;
var<workgroup> sums: array<vec3f, GROUP>;

@compute @workgroup_size(GROUP)
fn pull_back(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group_id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let group = group_id.x + group_id.y * groups.x;
    if group >= arguments.lights * OUTPUTS { return; }
    let light = group / OUTPUTS;
    let output = group % OUTPUTS;
    var sum = vec3f();
    for (var cell = thread; cell < arguments.cells; cell += GROUP) {
        let first = 3u * ((light * arguments.cells + cell) * OUTPUTS + output);
        let value = vec3f(values[first], values[first + 1u], values[first + 2u]);
        sum += value * vec3f(d_picture[3u * cell], d_picture[3u * cell + 1u], d_picture[3u * cell + 2u]);
    }
    sums[thread] = sum;
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half { sums[thread] += sums[thread + half]; }
    }
    if thread != 0u { return; }
    let first = light * GRADIENT;
    if output == 0u {
        for (var channel = 0u; channel < 3u; channel++) { results[first + channel] = sums[0][channel]; }
    } else {
        results[first + 2u + output] = dot(sums[0], radiances[light].xyz);
    }
}
