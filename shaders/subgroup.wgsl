// How many invocations a subgroup has in kernels with matrices: drivers that offer several sizes choose by what a kernel does.
// use: common/matrices

@group(0) @binding(0) var<storage, read_write> values: array<f16, SIDE * SIDE>;
@group(0) @binding(1) var<storage, read_write> invocations: u32;

@compute @workgroup_size(128)
fn size_of_subgroup(@builtin(subgroup_size) size: u32) {
    let stride = SIDE;
    let left = coopLoadT<Left>(&values[0], stride);
    let right = coopLoadT<Right>(&values[0], stride);
    let product = coopMultiplyAdd(left, right, HalfSum());
    coopStoreT(product, &values[0], stride);
    invocations = size;
}
