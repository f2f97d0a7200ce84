// use: train/values
// Gradients by weights and biases. Columns are cut into pieces, each of which leaves its sum in a vector of its own; what
// adds those up takes them in order, so that no atomics are needed and the result is always the same.

struct Weights {
    batch: Batch,
    /// Rows of the table of layers.
    layers: u32,
    /// Columns that are summed up in one piece of a weight's gradient; whether pieces are added to.
    piece: u32,
    add: u32,
    /// Values of such a piece.
    parameters: u32,
    /// Factor on gradients while they are multiplied.
    scale: f32,
}

/// `[piece][parameter]`
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
var<immediate> arguments: Weights;

/// A tile of a layer's gradient, and the piece.
struct Task {
    layer: u32,
    row: u32,
    column: u32,
    piece: u32,
}

/// The share of workgroup `group`; without one, `layer` is that after the last.
fn task_of(group: u32) -> Task {
    var rest = group;
    for (var index = 0u; index < arguments.layers; index += 1u) {
        let tiles = (vec2u(layers[index].outputs, layers[index].inputs) + TILE - 1u) / TILE;
        let pieces = (columns(arguments.batch, layers[index].space) + arguments.piece - 1u) / arguments.piece;
        let own = tiles.x * tiles.y * pieces;
        if rest < own {
            return Task(index, rest / tiles.y % tiles.x * TILE, rest % tiles.y * TILE, rest / (tiles.x * tiles.y));
        }
        rest -= own;
    }
    return Task(arguments.layers, 0u, 0u, 0u);
}

@compute @workgroup_size(THREADS)
fn weights(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let task = task_of(group.x + group.y * groups.x);
    if task.layer == arguments.layers {
        return;
    }
    let layer = layers[task.layer];
    let stride = row_stride(arguments.batch, layer.space);
    let end = min((task.piece + 1u) * arguments.piece, columns(arguments.batch, layer.space));
    let row = task.row + local / 4u;
    let input_row = task.column + local / 4u;
    var sum = Sum();
    var bias = vec4f();
    for (var start = task.piece * arguments.piece; start < end; start += SLAB) {
        for (var part = 0u; part < SLAB_PARTS; part += 1u) {
            let at = start + part * 16u + local % 4u * 4u;
            var d = vec4f();
            if row < layer.outputs && at < end {
                d = activations[(layer.d_product + row * stride + at) / 4u];
            }
            var x = vec4f();
            if input_row < layer.inputs && at < end {
                x = input_four(layer, arguments.batch, input_row, at);
            }
            bias += d;
            spread_left(local, part, arguments.scale * d);
            spread_right(local, part, x);
        }
        sum = add_slabs(sum, local);
    }
    add_tile(layer, task, local, (1.0 / arguments.scale) * values_of(sum, local));
    if task.column == 0u && layer.bias != NOTHING {
        keep(local, vec2f(dot(bias, vec4f(1.0)), 0.0));
        workgroupBarrier();
        add_bias(layer, task, local);
    }
}

fn add_tile(layer: Layer, task: Task, local: u32, sum: mat4x4f) {
    let vector = task.piece * arguments.parameters;
    let column = task.column + local % QUADS * 4u;
    for (var i = 0u; i < 4u; i += 1u) {
        let row = task.row + local / QUADS * 4u + i;
        if row < layer.outputs && column < layer.stride {
            let to = (vector + layer.weights + row * layer.stride + column) / 4u;
            if arguments.add != 0u {
                sums[to] += sum[i];
            } else {
                sums[to] = sum[i];
            }
        }
    }
}

/// Sums of rows, of which four threads have four columns each.
fn add_bias(layer: Layer, task: Task, local: u32) {
    let row = task.row + local;
    if local < TILE && row < layer.outputs {
        let sum = kept(4u * local) + kept(4u * local + 1u) + kept(4u * local + 2u) + kept(4u * local + 3u);
        let to = task.piece * arguments.parameters + layer.bias + row;
        let before = select(0.0, sums[to / 4u][to % 4u], arguments.add != 0u);
        sums[to / 4u][to % 4u] = before + sum.x;
    }
}
