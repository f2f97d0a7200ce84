// Adds lights to a picture, each times its radiance: a cell a thread.
// use: common/units

const GROUP: u32 = 64u;

@group(0) @binding(3) var<storage, read_write> picture: array<f32>;

@compute @workgroup_size(GROUP)
fn add_units(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.x + id.y * groups.x * GROUP;
    if index >= arguments.count { return; }
    var sum = vec3f();
    for (var light = 0u; light < arguments.lights; light++) {
        sum += radiance_of(light) * unit_of(light, index, 0u);
    }
    for (var channel = 0u; channel < 3u; channel++) { picture[3u * index + channel] += sum[channel]; }
}
