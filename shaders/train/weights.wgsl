// use: train/layers
// Gradients by weights and biases. Columns are cut into pieces, each of which leaves its sum in a vector of its own; what
// adds those up takes them in order, so that no atomics are needed and the result is always the same.

@group(0) @binding(0) var<storage, read> layers: array<Layer>;
@group(0) @binding(1) var<storage, read> activations: array<vec4f>;
/// `[piece][parameter]`
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
var<immediate> arguments: Layers;

const TILE: u32 = 64u;
const SLAB: u32 = 16u;
const QUADS: u32 = TILE / 4u;
const THREADS: u32 = 256u;
/// Fours from a row of a slab to the next; one more than it has, so that columns written at once lie in different banks.
const PITCH: u32 = QUADS + 1u;

var<workgroup> left: array<vec4f, SLAB * PITCH>;
var<workgroup> right: array<vec4f, SLAB * PITCH>;

/// Four columns of a row of the activations, zeros outside.
fn four(first: u32, row: u32, rows: u32, column: u32, end: u32, stride: u32) -> vec4f {
    if row < rows && column < end {
        return activations[(first + row * stride + column) / 4u];
    }
    return vec4f();
}

@compute @workgroup_size(THREADS)
fn weights(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    var rest = group.x + group.y * groups.x;
    var index = arguments.first;
    let last = arguments.first + arguments.count;
    var tiles = vec2u();
    for (; index < last; index += 1u) {
        let size = vec2u(layers[index].outputs, layers[index].inputs);
        tiles = (size + TILE - 1u) / TILE;
        let pieces = (columns(arguments.batch, layers[index].space) + arguments.piece - 1u) / arguments.piece;
        let own = tiles.x * tiles.y * pieces;
        if rest < own {
            break;
        }
        rest -= own;
    }
    if index == last {
        return;
    }
    let layer = layers[index];
    let piece = rest / (tiles.x * tiles.y);
    let row_start = rest / tiles.y % tiles.x * TILE;
    let column_start = rest % tiles.y * TILE;
    let stride = row_stride(arguments.batch, layer.space);
    let end = min((piece + 1u) * arguments.piece, columns(arguments.batch, layer.space));
    let ty = local / QUADS;
    let tx = local % QUADS;
    let place = local / 16u;
    let lane = local / 4u % 4u;
    var sum = mat4x4f();
    var bias = vec4f();
    for (var start = piece * arguments.piece; start < end; start += SLAB) {
        let at = start + local % 4u * 4u;
        let d = four(layer.d_product, row_start + local / 4u, layer.outputs, at, end, stride);
        let x = four(layer.input, column_start + local / 4u, layer.inputs, at, end, stride);
        for (var i = 0u; i < 4u; i += 1u) {
            left[(local % 4u * 4u + i) * PITCH + place][lane] = d[i];
            right[(local % 4u * 4u + i) * PITCH + place][lane] = x[i];
        }
        workgroupBarrier();
        for (var k = 0u; k < SLAB; k += 1u) {
            let a = left[k * PITCH + ty];
            let b = right[k * PITCH + tx];
            sum[0] += a.x * b;
            sum[1] += a.y * b;
            sum[2] += a.z * b;
            sum[3] += a.w * b;
            bias += a;
        }
        workgroupBarrier();
    }
    let vector = piece * arguments.parameters;
    let column = column_start + tx * 4u;
    for (var i = 0u; i < 4u; i += 1u) {
        let row = row_start + ty * 4u + i;
        if row >= layer.outputs {
            return;
        }
        if column < layer.stride {
            add((vector + layer.weights + row * layer.stride + column) / 4u, sum[i]);
        }
        if column == 0u && layer.bias != NO_BIAS {
            let to = vector + layer.bias + row;
            let before = select(0.0, sums[to / 4u][to % 4u], arguments.add != 0u);
            sums[to / 4u][to % 4u] = before + bias[i];
        }
    }
}

fn add(to: u32, value: vec4f) {
    if arguments.add != 0u {
        sums[to] += value;
    } else {
        sums[to] = value;
    }
}
