// use: train/parameters
// Moves the running mean of the parameters.

struct Mean {
    parameters: u32,
    /// Share of the way that the mean goes.
    share: f32,
}

@group(0) @binding(0) var<storage, read> progress: Progress;
@group(0) @binding(1) var<storage, read> params: array<f32>;
@group(0) @binding(2) var<storage, read_write> mean: array<f32>;
var<immediate> arguments: Mean;

@compute @workgroup_size(256)
fn average(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.x + id.y * groups.x * 256u;
    if index < arguments.parameters && progress.diverged == 0u {
        mean[index] += arguments.share * (params[index] - mean[index]);
    }
}
