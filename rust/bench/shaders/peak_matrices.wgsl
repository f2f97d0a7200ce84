// As many products of 16-bit matrices as a device can: sums that do not wait for each other and stay in registers. Factors come
// from outside and are not zeros, which some devices multiply faster; each sum starts with another matrix, or a compiler could
// make one of all.
// use: common/matrices
// constant: ROUNDS 256

const VALUES: u32 = SIDE * SIDE;

@group(0) @binding(0) var<storage, read> factors: array<f16, 2 * VALUES>;
@group(0) @binding(1) var<storage, read_write> results: array<f16, 9 * VALUES>;
// Of the other entry point.
@group(0) @binding(1) var<storage, read_write> wide_results: array<f32, 9 * VALUES>;

@compute @workgroup_size(128)
fn peak_matrices() {
    let stride = SIDE;
    let m = coopLoad<Left>(&factors[0], stride);
    let n = coopLoad<Right>(&factors[VALUES], stride);
    var a = coopLoad<HalfSum>(&results[0], stride);
    var b = coopLoad<HalfSum>(&results[VALUES], stride);
    var c = coopLoad<HalfSum>(&results[2 * VALUES], stride);
    var d = coopLoad<HalfSum>(&results[3 * VALUES], stride);
    var e = coopLoad<HalfSum>(&results[4 * VALUES], stride);
    var f = coopLoad<HalfSum>(&results[5 * VALUES], stride);
    var g = coopLoad<HalfSum>(&results[6 * VALUES], stride);
    var h = coopLoad<HalfSum>(&results[7 * VALUES], stride);
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
    coopStore(sum, &results[8 * VALUES], stride);
}

@compute @workgroup_size(128)
fn peak_matrices_with_wide_sums() {
    let stride = SIDE;
    let m = coopLoad<Left>(&factors[0], stride);
    let n = coopLoad<Right>(&factors[VALUES], stride);
    var a = coopLoad<WideSum>(&wide_results[0], stride);
    var b = coopLoad<WideSum>(&wide_results[VALUES], stride);
    var c = coopLoad<WideSum>(&wide_results[2 * VALUES], stride);
    var d = coopLoad<WideSum>(&wide_results[3 * VALUES], stride);
    var e = coopLoad<WideSum>(&wide_results[4 * VALUES], stride);
    var f = coopLoad<WideSum>(&wide_results[5 * VALUES], stride);
    var g = coopLoad<WideSum>(&wide_results[6 * VALUES], stride);
    var h = coopLoad<WideSum>(&wide_results[7 * VALUES], stride);
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
    coopStore(sum, &wide_results[8 * VALUES], stride);
}
