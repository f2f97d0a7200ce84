// From a loss's gradient by a picture to those by the lights that it is made of: the sums over its cells of that gradient times
// what is known of them. A workgroup sums one output of a light, and adds it to what is there.
// use: common/units

const GROUP: u32 = 64u;
// Of a light's gradient: by its radiance, then by what its derivatives are by.
const GRADIENT: u32 = OUTPUTS + 2u;

@group(0) @binding(3) var<storage, read> d_picture: array<f32>;
@group(0) @binding(4) var<storage, read_write> results: array<f32>;

var<workgroup> sums: array<vec3f, GROUP>;

@compute @workgroup_size(GROUP)
fn pull_units(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group_id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let group = group_id.x + group_id.y * groups.x;
    if group >= arguments.lights * OUTPUTS { return; }
    let light = group / OUTPUTS;
    let output = group % OUTPUTS;
    var sum = vec3f();
    for (var cell = thread; cell < arguments.count; cell += GROUP) {
        let d = vec3f(d_picture[3u * cell], d_picture[3u * cell + 1u], d_picture[3u * cell + 2u]);
        sum += unit_of(light, cell, output) * d;
    }
    sums[thread] = sum;
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half { sums[thread] += sums[thread + half]; }
    }
    if thread != 0u { return; }
    let first = arguments.results + light * GRADIENT;
    if output == 0u {
        for (var channel = 0u; channel < 3u; channel++) { results[first + channel] += sums[0][channel]; }
    } else {
        results[first + 2u + output] += dot(sums[0], radiance_of(light));
    }
}
