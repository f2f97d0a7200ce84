// use: train/layers
// Dense layers forwards, and backwards to their inputs. A workgroup computes 64 rows by 64 columns, a thread 4 by 4.

@group(0) @binding(0) var<storage, read> layers: array<Layer>;
@group(0) @binding(1) var<storage, read> params: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> activations: array<vec4f>;
var<immediate> arguments: Layers;

const TILE: u32 = 64u;
const SLAB: u32 = 16u;
const QUADS: u32 = TILE / 4u;
const THREADS: u32 = 256u;
/// Fours from a row of the left slab to the next; one more than it has, so that columns written at once lie in different banks.
const PITCH: u32 = QUADS + 1u;

/// Slabs of both factors, `[depth][row or column]`.
var<workgroup> left: array<vec4f, SLAB * PITCH>;
var<workgroup> right: array<vec4f, SLAB * QUADS>;

struct Task {
    layer: u32,
    row: u32,
    column: u32,
}

/// What workgroup `group` computes, if tiles of `rows(layer)` rows are dealt out layer by layer.
fn task_of(group: u32, forwards: bool) -> Task {
    var rest = group;
    for (var index = arguments.first; index < arguments.first + arguments.count; index += 1u) {
        let rows = select(layers[index].inputs, layers[index].outputs, forwards);
        let column_tiles = (columns(arguments.batch, layers[index].space) + TILE - 1u) / TILE;
        let tiles = (rows + TILE - 1u) / TILE * column_tiles;
        if rest < tiles {
            return Task(index, rest / column_tiles * TILE, rest % column_tiles * TILE);
        }
        rest -= tiles;
    }
    return Task(arguments.first + arguments.count, 0u, 0u);
}

/// The product of a thread: four rows of four columns each.
fn product(task: Task, forwards: bool, local: u32) -> mat4x4f {
    let layer = layers[task.layer];
    let stride = row_stride(arguments.batch, layer.space);
    let width = columns(arguments.batch, layer.space);
    let depth = select(layer.outputs, layer.inputs, forwards);
    let rows = select(layer.inputs, layer.outputs, forwards);
    let factor = select(layer.d_product, layer.input, forwards);
    let ty = local / QUADS;
    let tx = local % QUADS;
    var sum = mat4x4f();
    for (var start = 0u; start < depth; start += SLAB) {
        // Weights lie row by row: forwards four of one row are read and spread, backwards four of a row are kept.
        if forwards {
            let row = task.row + local / 4u;
            let at = start + local % 4u * 4u;
            var values = vec4f();
            if row < rows && at < layer.stride {
                values = params[(layer.weights + row * layer.stride + at) / 4u];
            }
            for (var i = 0u; i < 4u; i += 1u) {
                left[(local % 4u * 4u + i) * PITCH + local / 16u][local / 4u % 4u] = values[i];
            }
        } else {
            let row = start + ty;
            let at = task.row + tx * 4u;
            var values = vec4f();
            if row < depth && at < layer.stride {
                values = params[(layer.weights + row * layer.stride + at) / 4u];
            }
            left[ty * PITCH + tx] = values;
        }
        let column = task.column + tx * 4u;
        var values = vec4f();
        if start + ty < depth && column < width {
            values = activations[(factor + (start + ty) * stride + column) / 4u];
        }
        right[local] = values;
        workgroupBarrier();
        for (var k = 0u; k < SLAB; k += 1u) {
            let a = left[k * PITCH + ty];
            let b = right[k * QUADS + tx];
            sum[0] += a.x * b;
            sum[1] += a.y * b;
            sum[2] += a.z * b;
            sum[3] += a.w * b;
        }
        workgroupBarrier();
    }
    return sum;
}

/// Value of a row of the modulations for the tile of a sample.
fn light_value(first: u32, row: u32, sample: u32) -> f32 {
    let at = first + row * row_stride(arguments.batch, LIGHTS) + sample / LANES;
    return activations[at / 4u][at % 4u];
}

@compute @workgroup_size(THREADS)
fn forward(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let task = task_of(group.x + group.y * groups.x, true);
    if task.layer == arguments.first + arguments.count {
        return;
    }
    var sum = product(task, true, local);
    let layer = layers[task.layer];
    let stride = row_stride(arguments.batch, layer.space);
    let column = task.column + local % QUADS * 4u;
    if column >= columns(arguments.batch, layer.space) {
        return;
    }
    for (var i = 0u; i < 4u; i += 1u) {
        let row = task.row + local / QUADS * 4u + i;
        if row >= layer.outputs {
            return;
        }
        var value = sum[i];
        let at = row * stride + column;
        switch layer.finish {
            case FINISH_MODULATED: {
                activations[(layer.product + at) / 4u] = value;
                let scale = 1.0 + light_value(layer.modulation, row, column);
                value = scale * value + light_value(layer.modulation, layer.outputs + row, column);
            }
            case FINISH_TRUNK: {
                let trunk = layer.product + row * row_stride(arguments.batch, PIXELS) + pixel_of(arguments.batch, column);
                let scale = 1.0 + light_value(layer.modulation, row, column);
                value += scale * activations[trunk / 4u] + light_value(layer.modulation, layer.outputs + row, column);
            }
            default: {
                value += params[(layer.bias + row) / 4u][row % 4u];
            }
        }
        if layer.finish != FINISH_LINEAR {
            value = max(value, vec4f());
        }
        activations[(layer.output + at) / 4u] = value;
    }
}

/// Sums of the gradients by scale and shift over four columns, for 64 rows of 16 fours.
var<workgroup> scale_sums: array<f32, TILE * QUADS>;
var<workgroup> shift_sums: array<f32, TILE * QUADS>;

@compute @workgroup_size(THREADS)
fn backward(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let task = task_of(group.x + group.y * groups.x, false);
    if task.layer == arguments.first + arguments.count {
        return;
    }
    var sum = product(task, false, local);
    let layer = layers[task.layer];
    let stride = row_stride(arguments.batch, layer.space);
    let column = task.column + local % QUADS * 4u;
    let inside = column < columns(arguments.batch, layer.space);
    let modulated = layer.before == BEFORE_MODULATED || layer.before == BEFORE_TRUNK;
    for (var i = 0u; i < 4u; i += 1u) {
        let row = task.row + local / QUADS * 4u + i;
        var scale_sum = 0.0;
        var shift_sum = 0.0;
        if inside && row < layer.inputs {
            let at = row * stride + column;
            var d = sum[i];
            if layer.before != BEFORE_NOTHING {
                d = select(vec4f(), d, activations[(layer.input + at) / 4u] > vec4f());
            }
            if modulated {
                var before = layer.before_product + at;
                if layer.before == BEFORE_TRUNK {
                    before = layer.before_product + row * row_stride(arguments.batch, PIXELS) + pixel_of(arguments.batch, column);
                }
                scale_sum = dot(d, activations[before / 4u]);
                shift_sum = dot(d, vec4f(1.0));
            }
            if layer.before == BEFORE_MODULATED {
                d *= 1.0 + light_value(layer.before_modulation, row, column);
            }
            activations[(layer.d_input + at) / 4u] = d;
        }
        scale_sums[(local / QUADS * 4u + i) * QUADS + local % QUADS] = scale_sum;
        shift_sums[(local / QUADS * 4u + i) * QUADS + local % QUADS] = shift_sum;
    }
    workgroupBarrier();
    // Two tiles of eight fours for each of the rows; one thread adds up one of them.
    let row = task.row + local % TILE;
    let tile = local / TILE % 2u;
    let light = task.column / LANES + tile;
    if !modulated || local >= 2u * TILE || row >= layer.inputs || light >= columns(arguments.batch, LIGHTS) {
        return;
    }
    var total = vec2f();
    for (var i = 0u; i < LANES / 4u; i += 1u) {
        let place = local % TILE * QUADS + tile * (LANES / 4u) + i;
        total += vec2f(scale_sums[place], shift_sums[place]);
    }
    let to = layer.before_d_modulation + row * row_stride(arguments.batch, LIGHTS) + light;
    let shifts = layer.inputs * row_stride(arguments.batch, LIGHTS);
    activations[to / 4u][to % 4u] = total.x;
    activations[(to + shifts) / 4u][(to + shifts) % 4u] = total.y;
}
