// Reads a buffer, and does nothing else: what a kernel that is bound by memory can be compared with.

const GROUP_SIZE = 256u;

@group(0) @binding(0) var<storage, read> words: array<vec4u>;
@group(0) @binding(1) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(GROUP_SIZE)
fn read_all(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let all = groups.x * groups.y * GROUP_SIZE;
    var sum = vec4u(0u);
    for (var i = (group.x + group.y * groups.x) * GROUP_SIZE + thread; i < arrayLength(&words); i += all) {
        sum ^= words[i];
    }
    // So that the loads are not left out.
    if (sum.x ^ sum.y ^ sum.z ^ sum.w) == 0x9e3779b9u {
        sums[0] = sum.x;
    }
}
