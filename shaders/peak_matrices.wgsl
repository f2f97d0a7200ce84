// As many products of 16-bit matrices as a device can: sums that do not wait for each other and stay in registers. Factors come
// from outside and are not zeros, which some devices multiply faster; each sum starts with another matrix, or a compiler could
// make one of all.
// constant: ROUNDS 256

enable f16;
enable wgpu_cooperative_matrix;

@group(0) @binding(0) var<storage, read> factors: array<f16, 512>;
@group(0) @binding(1) var<storage, read_write> results: array<f16, 2304>;
// Of the other entry point.
@group(0) @binding(1) var<storage, read_write> wide_results: array<f32, 2304>;

@compute @workgroup_size(128)
fn peak_matrices() {
    let stride = 16u;
    let m = coopLoad<coop_mat16x16<f16, A>>(&factors[0], stride);
    let n = coopLoad<coop_mat16x16<f16, B>>(&factors[256], stride);
    var a = coopLoad<coop_mat16x16<f16, C>>(&results[0], stride);
    var b = coopLoad<coop_mat16x16<f16, C>>(&results[256], stride);
    var c = coopLoad<coop_mat16x16<f16, C>>(&results[512], stride);
    var d = coopLoad<coop_mat16x16<f16, C>>(&results[768], stride);
    var e = coopLoad<coop_mat16x16<f16, C>>(&results[1024], stride);
    var f = coopLoad<coop_mat16x16<f16, C>>(&results[1280], stride);
    var g = coopLoad<coop_mat16x16<f16, C>>(&results[1536], stride);
    var h = coopLoad<coop_mat16x16<f16, C>>(&results[1792], stride);
    for (var round = 0u; round < ROUNDS; round++) {
        a = coopMultiplyAdd(m, n, a);
        b = coopMultiplyAdd(m, n, b);
        c = coopMultiplyAdd(m, n, c);
        d = coopMultiplyAdd(m, n, d);
        e = coopMultiplyAdd(m, n, e);
        f = coopMultiplyAdd(m, n, f);
        g = coopMultiplyAdd(m, n, g);
        h = coopMultiplyAdd(m, n, h);
    }
    let sum = a + b + c + d + e + f + g + h;
    coopStore(sum, &results[2048], stride);
}

@compute @workgroup_size(128)
fn peak_matrices_with_wide_sums() {
    let stride = 16u;
    let m = coopLoad<coop_mat16x16<f16, A>>(&factors[0], stride);
    let n = coopLoad<coop_mat16x16<f16, B>>(&factors[256], stride);
    var a = coopLoad<coop_mat16x16<f32, C>>(&wide_results[0], stride);
    var b = coopLoad<coop_mat16x16<f32, C>>(&wide_results[256], stride);
    var c = coopLoad<coop_mat16x16<f32, C>>(&wide_results[512], stride);
    var d = coopLoad<coop_mat16x16<f32, C>>(&wide_results[768], stride);
    var e = coopLoad<coop_mat16x16<f32, C>>(&wide_results[1024], stride);
    var f = coopLoad<coop_mat16x16<f32, C>>(&wide_results[1280], stride);
    var g = coopLoad<coop_mat16x16<f32, C>>(&wide_results[1536], stride);
    var h = coopLoad<coop_mat16x16<f32, C>>(&wide_results[1792], stride);
    for (var round = 0u; round < ROUNDS; round++) {
        a = coopMultiplyAdd(m, n, a);
        b = coopMultiplyAdd(m, n, b);
        c = coopMultiplyAdd(m, n, c);
        d = coopMultiplyAdd(m, n, d);
        e = coopMultiplyAdd(m, n, e);
        f = coopMultiplyAdd(m, n, f);
        g = coopMultiplyAdd(m, n, g);
        h = coopMultiplyAdd(m, n, h);
    }
    let sum = a + b + c + d + e + f + g + h;
    coopStore(sum, &wide_results[2048], stride);
}
