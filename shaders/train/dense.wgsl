// use: train/values
// Dense layers forwards, and backwards to their inputs, for the columns of a workgroup.

@group(0) @binding(2) var<storage, read> params: array<vec4f>;

/// Work of a workgroup: layers from `first` on, of each the rows from `row` to `end`, of 64 columns.
struct Task {
    first: u32,
    row: u32,
    end: u32,
    column: u32,
}

/// The share of workgroup `group`. It takes all rows of a chain of several layers; of single layers, a tile of rows. If there
/// is nothing left, `first` is NOTHING.
fn task_of(chains: Chains, group: u32, forwards: bool) -> Task {
    var rest = group;
    for (var chain = 0u; chain < chains.count; chain += 1u) {
        let index = chains.first + chain * chains.pitch;
        let column_tiles = (columns(chains.batch, layers[index].space) + TILE - 1u) / TILE;
        let column = rest % column_tiles * TILE;
        var row_tiles = 1u;
        if chains.length == 1u {
            row_tiles = (select(layers[index].inputs, layers[index].outputs, forwards) + TILE - 1u) / TILE;
        }
        if rest < row_tiles * column_tiles {
            let row = rest / column_tiles * TILE;
            return Task(index, row, select(NOTHING, row + TILE, chains.length == 1u), column);
        }
        rest -= row_tiles * column_tiles;
    }
    return Task(NOTHING, 0u, 0u, 0u);
}

/// Rows from `row` on of a layer's weights times its input.
fn product(layer: Layer, batch: Batch, row: u32, column: u32, local: u32) -> mat4x4f {
    let width = columns(batch, layer.space);
    let own_row = row + local / 4u;
    let own_column = column + local % QUADS * 4u;
    var sum = Sum();
    for (var start = 0u; start < layer.inputs; start += SLAB) {
        for (var part = 0u; part < SLAB_PARTS; part += 1u) {
            let at = start + part * 16u + local % 4u * 4u;
            var values = vec4f();
            if own_row < layer.outputs && at < layer.stride {
                values = params[(layer.weights + own_row * layer.stride + at) / 4u];
            }
            spread_left(local, part, values);
            let depth = start + part * 16u + local / QUADS;
            values = vec4f();
            if depth < layer.inputs && own_column < width {
                values = input_four(layer, batch, depth, own_column);
            }
            put_right(local, part, values);
        }
        sum = add_slabs(sum, local);
    }
    return values_of(sum, local);
}

/// Rows from `row` on of a layer's weights, turned, times the gradient by its product.
fn turned_product(layer: Layer, batch: Batch, scale: f32, row: u32, column: u32, local: u32) -> mat4x4f {
    let stride = row_stride(batch, layer.space);
    let width = columns(batch, layer.space);
    let own_row = row + local % QUADS * 4u;
    let own_column = column + local % QUADS * 4u;
    var sum = Sum();
    for (var start = 0u; start < layer.outputs; start += SLAB) {
        for (var part = 0u; part < SLAB_PARTS; part += 1u) {
            let depth = start + part * 16u + local / QUADS;
            var weights = vec4f();
            var d = vec4f();
            if depth < layer.outputs && own_row < layer.stride {
                weights = params[(layer.weights + depth * layer.stride + own_row) / 4u];
            }
            if depth < layer.outputs && own_column < width {
                d = scale * activations[(layer.d_product + depth * stride + own_column) / 4u];
            }
            put_left(local, part, weights);
            put_right(local, part, d);
        }
        sum = add_slabs(sum, local);
    }
    return (1.0 / scale) * values_of(sum, local);
}

/// Value of a row of the modulations for the tile of a sample.
fn light_value(batch: Batch, first: u32, row: u32, sample: u32) -> f32 {
    return value_at(first + row * row_stride(batch, LIGHTS) + sample / LANES);
}

/// Where a row of the trunk has its values for four samples.
fn trunk_place(batch: Batch, first: u32, row: u32, sample: u32) -> u32 {
    return (first + row * row_stride(batch, PIXELS) + pixel_of(batch, sample)) / 4u;
}

/// Values of a layer from its product: modulation, bias, ReLU.
fn finished(layer: Layer, batch: Batch, row: u32, column: u32, own_product: vec4f) -> vec4f {
    var value = own_product;
    switch layer.finish {
        case FINISH_MODULATED: {
            let scale = 1.0 + light_value(batch, layer.modulation, row, column);
            value = scale * value + light_value(batch, layer.modulation, layer.outputs + row, column);
        }
        case FINISH_TRUNK: {
            let scale = 1.0 + light_value(batch, layer.modulation, row, column);
            value += scale * activations[trunk_place(batch, layer.product, row, column)];
            value += light_value(batch, layer.modulation, layer.outputs + row, column);
        }
        default: {
            value += params[(layer.bias + row) / 4u][row % 4u];
        }
    }
    if layer.finish != FINISH_LINEAR {
        value = max(value, vec4f());
    }
    return value;
}

fn forward_tile(layer: Layer, batch: Batch, first_row: u32, first_column: u32, local: u32) {
    var sum = product(layer, batch, first_row, first_column, local);
    let column = first_column + local % QUADS * 4u;
    if column >= columns(batch, layer.space) {
        return;
    }
    for (var i = 0u; i < 4u; i += 1u) {
        let row = first_row + local / QUADS * 4u + i;
        if row >= layer.outputs {
            return;
        }
        let at = row * row_stride(batch, layer.space) + column;
        if layer.finish == FINISH_MODULATED {
            activations[(layer.product + at) / 4u] = sum[i];
        }
        activations[(layer.output + at) / 4u] = finished(layer, batch, row, column, sum[i]);
    }
}

fn forward_chain(batch: Batch, length: u32, task: Task, local: u32) {
    for (var index = task.first; index < task.first + length; index += 1u) {
        let layer = layers[index];
        for (var row = task.row; row < min(task.end, layer.outputs); row += TILE) {
            forward_tile(layer, batch, row, task.column, local);
        }
        storageBarrier();
    }
}

fn backward_tile(layer: Layer, batch: Batch, scale: f32, first_row: u32, first_column: u32, local: u32) {
    var sum = turned_product(layer, batch, scale, first_row, first_column, local);
    let column = first_column + local % QUADS * 4u;
    let inside = column < columns(batch, layer.space);
    let modulated = layer.before == BEFORE_MODULATED || layer.before == BEFORE_TRUNK;
    for (var i = 0u; i < 4u; i += 1u) {
        let row = first_row + local / QUADS * 4u + i;
        var sums = vec2f();
        if inside && row < layer.inputs {
            let at = row * row_stride(batch, layer.space) + column;
            var d = sum[i];
            if layer.before != BEFORE_NOTHING {
                d = select(vec4f(), d, activations[(layer.input + at) / 4u] > vec4f());
            }
            if modulated {
                var before = (layer.before_product + at) / 4u;
                if layer.before == BEFORE_TRUNK {
                    before = trunk_place(batch, layer.before_product, row, column);
                }
                sums = vec2f(dot(d, activations[before]), dot(d, vec4f(1.0)));
            }
            if layer.before == BEFORE_MODULATED {
                d *= 1.0 + light_value(batch, layer.before_modulation, row, column);
            }
            activations[(layer.d_input + at) / 4u] = d;
        }
        keep((local / QUADS * 4u + i) * QUADS + local % QUADS, sums);
    }
    workgroupBarrier();
    if modulated {
        sum_modulations(layer, batch, first_row, first_column / LANES, local);
    }
    workgroupBarrier();
}

/// Gradients by scale and shift of the layer before: two tiles of eight fours for each of 64 rows, each added up by a thread.
fn sum_modulations(layer: Layer, batch: Batch, first_row: u32, first_light: u32, local: u32) {
    let row = first_row + local % TILE;
    let tile = local / TILE % 2u;
    let light = first_light + tile;
    if local >= 2u * TILE || row >= layer.inputs || light >= columns(batch, LIGHTS) {
        return;
    }
    var total = vec2f();
    for (var i = 0u; i < LANES / 4u; i += 1u) {
        total += kept(local % TILE * QUADS + tile * (LANES / 4u) + i);
    }
    let to = layer.before_d_modulation + row * row_stride(batch, LIGHTS) + light;
    let shifts = layer.inputs * row_stride(batch, LIGHTS);
    activations[to / 4u][to % 4u] = total.x;
    activations[(to + shifts) / 4u][(to + shifts) % 4u] = total.y;
}

/// The last layer first; those whose gradient by the input nobody needs do nothing.
fn backward_chain(chains: Chains, length: u32, task: Task, local: u32) {
    for (var i = 1u; i <= length; i += 1u) {
        let layer = layers[task.first + length - i];
        for (var row = task.row; row < min(task.end, layer.inputs); row += TILE) {
            if layer.d_input != NOTHING {
                backward_tile(layer, chains.batch, chains.scale, row, task.column, local);
            }
        }
        storageBarrier();
    }
}
