// `peak.wgsl` with 16-bit floats.
// constant: ROUNDS 256

enable f16;

@group(0) @binding(0) var<storage, read_write> results: array<f32>;

// A struct: DirectX takes no other arguments.
struct Arguments {
    factor: vec2f,
}
var<immediate> arguments: Arguments;

@compute @workgroup_size(128)
fn peak_half(@builtin(local_invocation_index) thread: u32) {
    let scale = vec4h(f16(arguments.factor.x));
    let shift = vec4h(f16(arguments.factor.y));
    var a = vec4h(f16(thread));
    var b = a + 1.0h;
    var c = a + 2.0h;
    var d = a + 3.0h;
    var e = a + 4.0h;
    var f = a + 5.0h;
    var g = a + 6.0h;
    var h = a + 7.0h;
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
    results[thread] = f32(sum.x + sum.y + sum.z + sum.w);
}
