// Adds up numbers: shows that a device, its buffers and its clock work.
// constant: GROUP_SIZE 64

@group(0) @binding(0) var<storage, read> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> total: array<atomic<u32>>;

@compute @workgroup_size(GROUP_SIZE)
fn sum(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.x + id.y * groups.x * GROUP_SIZE;
    if index < arrayLength(&values) {
        atomicAdd(&total[0], values[index]);
    }
}
