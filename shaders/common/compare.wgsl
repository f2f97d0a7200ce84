// The loss of `term.rs` in `optimise` between a picture and a target, both under Reinhard's curve, and its gradient by
// the picture: base and the unit images of some lights times their radiances.
// constant: LIGHT_QUADS 1
// constant: UNIT_VALUES 3

const GROUP: u32 = 64u;

struct Arguments {
    count: u32,
    lights: u32,
    exposure: f32,
    // Where the losses start in `results`; one for each workgroup.
    losses: u32,
}

// LIGHT_QUADS of each light; the last one is its radiance.
@group(0) @binding(0) var<storage, read> lights: array<vec4f>;
// Places in `base` and `target_picture`.
@group(0) @binding(1) var<storage, read> pixels: array<u32>;
// Light by light, then pixel by pixel UNIT_VALUES, of which RGB come first.
@group(0) @binding(2) var<storage, read> units: array<f32>;
@group(0) @binding(3) var<storage, read> base: array<f32>;
@group(0) @binding(4) var<storage, read> target_picture: array<f32>;
// What each pixel counts in the loss, in the order of `pixels`.
@group(0) @binding(5) var<storage, read> shares: array<f32>;
@group(0) @binding(6) var<storage, read_write> d_picture: array<f32>;
@group(0) @binding(7) var<storage, read_write> results: array<f32>;

var<immediate> arguments: Arguments;
var<workgroup> losses: array<f32, GROUP>;

@compute @workgroup_size(GROUP)
fn compare(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group_id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let group = group_id.x + group_id.y * groups.x;
    if group * GROUP >= arguments.count { return; }
    let index = group * GROUP + thread;
    var loss = 0.0;
    if index < arguments.count {
        let pixel = 3u * pixels[index];
        for (var channel = 0u; channel < 3u; channel++) {
            var value = base[pixel + channel];
            for (var light = 0u; light < arguments.lights; light++) {
                let radiance = lights[(light + 1u) * LIGHT_QUADS - 1u];
                value += radiance[channel] * units[UNIT_VALUES * (light * arguments.count + index) + channel];
            }
            let scale = 1.0 / (1.0 + abs(arguments.exposure * value));
            let wanted = arguments.exposure * target_picture[pixel + channel];
            let difference = arguments.exposure * value * scale - wanted / (1.0 + abs(wanted));
            loss += difference * difference * shares[index];
            let weight = 2.0 * scale * scale * arguments.exposure * shares[index];
            d_picture[3u * index + channel] = weight * difference;
        }
    }
    losses[thread] = loss;
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half { losses[thread] += losses[thread + half]; }
    }
    if thread == 0u { results[arguments.losses + group] = losses[0]; }
}
