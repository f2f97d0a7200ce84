// use: train/store
// The last layer (three outputs), the loss (paper, equation 4) and the gradient by the outputs; one sample a thread.

struct Loss {
    batch: Batch,
    first_draw: u32,
    /// First weight, its row stride, first bias, inputs.
    weights: u32,
    stride: u32,
    bias: u32,
    inputs: u32,
    /// Activations: the input; the gradient by the outputs; factors on the outputs, of which there may be none.
    input: u32,
    d_product: u32,
    factors: u32,
    /// Weight of a sample.
    weight: f32,
    /// Where this part's sums of the loss begin.
    first_sum: u32,
}

@group(0) @binding(0) var<storage, read> params: array<f32>;
@group(0) @binding(1) var<storage, read> draws: array<u32>;
@group(0) @binding(2) var<storage, read> stored_lights: array<f32>;
/// `[chunk][tile][channel][lane]`
@group(0) @binding(3) var<storage, read> stored_targets: array<f32>;
@group(0) @binding(4) var<storage, read_write> activations: array<f32>;
@group(0) @binding(5) var<storage, read_write> losses: array<f32>;
var<immediate> arguments: Loss;

/// Constant of the loss.
const EPSILON: f32 = 0.01;
const NO_FACTORS: u32 = 0xffffffffu;
const THREADS: u32 = 256u;

var<workgroup> sums: array<f32, THREADS>;

@compute @workgroup_size(THREADS)
fn loss(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let group = workgroup.x + workgroup.y * groups.x;
    let sample = group * THREADS + local;
    sums[local] = 0.0;
    if sample < arguments.batch.samples {
        sums[local] = sample_loss(sample);
    }
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            sums[local] += sums[local + half];
        }
    }
    if local == 0u && group * THREADS < arguments.batch.samples {
        losses[arguments.first_sum + group] = sums[0];
    }
}

fn sample_loss(sample: u32) -> f32 {
    let stride = row_stride(arguments.batch, SAMPLES);
    var y = vec3f(params[arguments.bias], params[arguments.bias + 1u], params[arguments.bias + 2u]);
    for (var i = 0u; i < arguments.inputs; i += 1u) {
        let at = arguments.weights + i;
        let w = vec3f(params[at], params[at + arguments.stride], params[at + 2u * arguments.stride]);
        y += w * activations[arguments.input + i * stride + sample];
    }
    var factor = vec3f(1.0);
    if arguments.factors != NO_FACTORS {
        let pixels = row_stride(arguments.batch, PIXELS);
        let at = arguments.factors + pixel_of(arguments.batch, sample);
        factor = vec3f(activations[at], activations[at + pixels], activations[at + 2u * pixels]);
    }
    y *= factor;
    let chunk = draws[arguments.first_draw + sample / CHUNK];
    let tile = chunk * (CHUNK / LANES) + sample % CHUNK / LANES;
    let target_at = tile * 3u * LANES + sample % LANES;
    let target_value = vec3f(stored_targets[target_at], stored_targets[target_at + LANES], stored_targets[target_at + 2u * LANES]);
    let weight = arguments.weight * stored_lights[tile * LIGHT_ROW + LIGHT_WEIGHT];
    let inverse = 1.0 / (y * y + EPSILON);
    let difference = y - target_value;
    let d = 2.0 * weight * difference * inverse * factor;
    for (var channel = 0u; channel < 3u; channel += 1u) {
        activations[arguments.d_product + channel * stride + sample] = d[channel];
    }
    return weight * dot(difference * difference, inverse);
}
