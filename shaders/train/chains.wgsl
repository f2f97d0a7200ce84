// use: train/dense
// Chains of layers, forwards or backwards.

var<immediate> arguments: Chains;

@compute @workgroup_size(THREADS)
fn forward(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let task = task_of(arguments, group.x + group.y * groups.x, true);
    if task.first != NOTHING {
        forward_chain(arguments.batch, arguments.length, task, local);
    }
}

@compute @workgroup_size(THREADS)
fn backward(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let task = task_of(arguments, group.x + group.y * groups.x, false);
    if task.first != NOTHING {
        backward_chain(arguments, arguments.length, task, local);
    }
}
