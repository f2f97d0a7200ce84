// As many fused multiply-adds as a device can: chains that do not wait for each other and touch no memory.
// constant: ROUNDS 256

// Chains of an invocation, times values of each.
const LANES: u32 = 32u;

@group(0) @binding(0) var<storage, read_write> results: array<f32>;

// A struct: DirectX takes no other arguments.
struct Arguments {
    factor: vec2f,
}
var<immediate> arguments: Arguments;

@compute @workgroup_size(128)
fn peak(@builtin(local_invocation_index) thread: u32) {
    let scale = vec4f(arguments.factor.x);
    let shift = vec4f(arguments.factor.y);
    var a = vec4f(f32(thread));
    var b = a + 1.0;
    var c = a + 2.0;
    var d = a + 3.0;
    var e = a + 4.0;
    var f = a + 5.0;
    var g = a + 6.0;
    var h = a + 7.0;
    for (var round = 0u; round < ROUNDS; round++) {
        a = fma(a, scale, shift);
        b = fma(b, scale, shift);
        c = fma(c, scale, shift);
        d = fma(d, scale, shift);
        e = fma(e, scale, shift);
        f = fma(f, scale, shift);
        g = fma(g, scale, shift);
        h = fma(h, scale, shift);
    }
    let sum = a + b + c + d + e + f + g + h;
    results[thread] = sum.x + sum.y + sum.z + sum.w;
}
