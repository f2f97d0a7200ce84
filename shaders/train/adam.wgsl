// use: train/parameters
// Adam (Kingma and Ba 2015) for all parameters but those that Muon moves.

struct Rates {
    parameters: u32,
    adam: f32,
    grid: f32,
    /// One over one minus the powers of the decays.
    first_correction: f32,
    second_correction: f32,
}

@group(0) @binding(0) var<storage, read> blocks: array<u32>;
@group(0) @binding(1) var<storage, read> progress: Progress;
@group(0) @binding(2) var<storage, read> gradient: array<f32>;
@group(0) @binding(3) var<storage, read_write> params: array<f32>;
@group(0) @binding(4) var<storage, read_write> first: array<f32>;
@group(0) @binding(5) var<storage, read_write> second: array<f32>;
var<immediate> arguments: Rates;

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.99;
const EPSILON: f32 = 1e-15;
const THREADS: u32 = 256u;

@compute @workgroup_size(THREADS)
fn adam(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.x + id.y * groups.x * THREADS;
    if index >= arguments.parameters || progress.diverged != 0u {
        return;
    }
    let optimiser = blocks[index / BLOCK] >> 8u;
    let g = gradient[index];
    if optimiser == MUON || (optimiser == SPARSE_ADAM && g == 0.0) {
        return;
    }
    let m = BETA1 * first[index] + (1.0 - BETA1) * g;
    let v = BETA2 * second[index] + (1.0 - BETA2) * g * g;
    first[index] = m;
    second[index] = v;
    let rate = select(arguments.adam, arguments.grid, optimiser == SPARSE_ADAM);
    params[index] -= rate * (m * arguments.first_correction) / (sqrt(v * arguments.second_correction) + EPSILON);
}
