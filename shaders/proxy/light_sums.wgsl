// Adds up what `light_gradient` left: for each light, layer by layer the gradient by scales, then shifts; then by nine
// parameters and the radiance. A workgroup makes one quad, always in the same order, and adds it to what is there.
// constant: LAYERS 3
// constant: PIXEL_BLOCKS 16
// constant: ROW_BLOCKS 8

const THREADS: u32 = PIXEL_BLOCKS * ROW_BLOCKS;
const SUMS: u32 = 4u * LAYERS + 3u;
const QUADS: u32 = 4u * LAYERS * ROW_BLOCKS + 3u;
const GROUP: u32 = 64u;

struct Arguments {
    groups: u32,
    lights: u32,
    // Where the gradients start in `results`.
    first: u32,
}

@group(0) @binding(0) var<storage, read> sums: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;

var<immediate> arguments: Arguments;
var<workgroup> shares: array<vec4f, GROUP>;

@compute @workgroup_size(GROUP)
fn light_sums(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let number = group.x + group.y * groups.x;
    let light = number / QUADS;
    if light >= arguments.lights { return; }
    let quad = number % QUADS;
    var slot = quad / ROW_BLOCKS;
    var first = quad % ROW_BLOCKS * PIXEL_BLOCKS;
    var width = PIXEL_BLOCKS;
    if quad >= 4u * LAYERS * ROW_BLOCKS {
        slot = quad - 4u * LAYERS * (ROW_BLOCKS - 1u);
        first = 0u;
        width = THREADS;
    }
    var sum = vec4f();
    for (var i = thread; i < arguments.groups * width; i += GROUP) {
        let source = light * arguments.groups + i / width;
        sum += sums[(source * SUMS + slot) * THREADS + first + i % width];
    }
    shares[thread] = sum;
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half { shares[thread] += shares[thread + half]; }
    }
    if thread != 0u { return; }
    for (var i = 0u; i < 4u; i++) { results[arguments.first + 4u * number + i] += shares[0][i]; }
}
