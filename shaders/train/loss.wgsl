// use: train/store
// use: train/dense
// The last layer (three outputs), the loss (paper, equation 4) and the gradient by the outputs; alone, or between the layers
// of samples forwards and backwards.

struct Loss {
    /// The layers of samples before the last, which are one chain.
    chain: Chains,
    first_draw: u32,
    /// Activations: factors on the outputs, of which there may be none.
    factors: u32,
    /// Weight of a sample.
    weight: f32,
    /// Where this part's sums of the loss begin, one of each 64 samples.
    first_sum: u32,
}

@group(0) @binding(3) var<storage, read> draws: array<u32>;
@group(0) @binding(4) var<storage, read> stored_lights: array<f32>;
/// `[chunk][tile][channel][lane]`
@group(0) @binding(5) var<storage, read> stored_targets: array<f32>;
@group(0) @binding(6) var<storage, read_write> losses: array<f32>;
var<immediate> arguments: Loss;

/// Constant of the loss.
const EPSILON: f32 = 0.01;
/// Threads that share the outputs of a sample.
const PARTS: u32 = THREADS / TILE;

var<workgroup> shares: array<vec3f, THREADS>;

/// Forwards through all layers of samples, the loss, and backwards.
@compute @workgroup_size(THREADS)
fn samples(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let group = workgroup.x + workgroup.y * groups.x;
    let chain = arguments.chain;
    let task = Task(chain.first, 0u, NOTHING, group * TILE);
    if task.column < chain.batch.samples {
        forward_chain(chain.batch, chain.length, task, local);
        loss_of(group, local);
        storageBarrier();
        backward_chain(chain, chain.length + 1u, task, local);
    }
}

@compute @workgroup_size(THREADS)
fn loss(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let group = workgroup.x + workgroup.y * groups.x;
    if group * TILE < arguments.chain.batch.samples {
        loss_of(group, local);
    }
}

/// Loss of 64 samples.
fn loss_of(group: u32, local: u32) {
    let layer = layers[arguments.chain.first + arguments.chain.length];
    let sample = group * TILE + local % TILE;
    shares[local] = output_share(layer, sample, local / TILE);
    workgroupBarrier();
    var own = 0.0;
    if local < TILE {
        var y = vec3f(param(layer.bias), param(layer.bias + 1u), param(layer.bias + 2u));
        for (var part = 0u; part < PARTS; part += 1u) {
            y += shares[part * TILE + local];
        }
        own = sample_loss(layer, sample, y);
    }
    workgroupBarrier();
    shares[local] = vec3f(own);
    for (var half = TILE / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            shares[local] += shares[local + half];
        }
    }
    if local == 0u {
        losses[arguments.first_sum + group] = shares[0].x;
    }
}

fn param(place: u32) -> f32 {
    return params[place / 4u][place % 4u];
}

/// Share of the outputs of a sample that every fourth input makes, from number `part` on.
fn output_share(layer: Layer, sample: u32, part: u32) -> vec3f {
    let stride = row_stride(arguments.chain.batch, SAMPLES);
    var y = vec3f();
    for (var i = part; i < layer.inputs; i += PARTS) {
        let at = layer.weights + i;
        y += vec3f(param(at), param(at + layer.stride), param(at + 2u * layer.stride))
            * value_at(layer.input + i * stride + sample);
    }
    return y;
}

fn sample_loss(layer: Layer, sample: u32, output: vec3f) -> f32 {
    let batch = arguments.chain.batch;
    var factor = vec3f(1.0);
    if arguments.factors != NOTHING {
        let pixels = row_stride(batch, PIXELS);
        let at = arguments.factors + pixel_of(batch, sample);
        factor = vec3f(value_at(at), value_at(at + pixels), value_at(at + 2u * pixels));
    }
    let y = output * factor;
    let chunk = draws[arguments.first_draw + sample / CHUNK];
    let tile = chunk * (CHUNK / LANES) + sample % CHUNK / LANES;
    let target_at = tile * 3u * LANES + sample % LANES;
    let target_value = vec3f(stored_targets[target_at], stored_targets[target_at + LANES], stored_targets[target_at + 2u * LANES]);
    let weight = arguments.weight * stored_lights[tile * LIGHT_ROW + LIGHT_WEIGHT];
    let inverse = 1.0 / (y * y + EPSILON);
    let difference = y - target_value;
    let d = 2.0 * weight * difference * inverse * factor;
    for (var channel = 0u; channel < 3u; channel += 1u) {
        let to = layer.d_product + channel * row_stride(batch, SAMPLES) + sample;
        activations[to / 4u][to % 4u] = d[channel];
    }
    return weight * dot(difference * difference, inverse);
}
