use crate::kernel::arguments;
use crate::{Bound, Buffer, Gpu, GpuError, Timer};

/// Most workgroups along an axis of a dispatch.
const MAX_GROUPS: u32 = 65_535;

/// Commands in the making. Each sees what those before it wrote.
#[derive(Debug)]
pub struct Commands<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
}

/// The grid of a dispatch of this many workgroups. Kernels number their groups `x + y * num_workgroups.x` and leave out those
/// from `groups` on.
///
/// # Panics
/// If there are more than 65,535 squared.
pub fn fold(groups: u32) -> [u32; 2] {
    if groups <= MAX_GROUPS {
        return [groups, 1];
    }
    let rows = groups.div_ceil(MAX_GROUPS);
    [groups.div_ceil(rows), rows]
}

impl Gpu {
    /// Starts a list of commands.
    pub fn commands(&self, label: &str) -> Commands<'_> {
        let encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
        Commands { gpu: self, encoder, pass: None }
    }
}

impl Commands<'_> {
    /// Runs a kernel on `groups` workgroups ([`fold`]), with the bytes of its `var<immediate>`.
    ///
    /// # Panics
    /// If the arguments are more than 64 bytes.
    pub fn run(&mut self, bound: &Bound, groups: u32, immediates: &[u8]) {
        if groups == 0 {
            return;
        }
        let pass = self.pass.get_or_insert_with(|| {
            self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()).forget_lifetime()
        });
        pass.set_pipeline(&bound.pipeline);
        pass.set_bind_group(0, &bound.group, &[]);
        if !immediates.is_empty() {
            pass.set_immediates(0, arguments(immediates));
        }
        let [x, y] = fold(groups);
        pass.dispatch_workgroups(x, y, 1);
    }

    /// Sets all of a buffer to zero.
    pub fn clear<T>(&mut self, buffer: &Buffer<T>) {
        self.pass = None;
        self.encoder.clear_buffer(&buffer.raw, 0, None);
    }

    /// Copies all of a buffer into one of the same length.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn copy<T>(&mut self, from: &Buffer<T>, to: &Buffer<T>) {
        assert_eq!(from.len(), to.len(), "lengths of copied buffers");
        self.pass = None;
        self.encoder.copy_buffer_to_buffer(&from.raw, 0, &to.raw, 0, None);
    }

    /// Notes the time on the device, once all commands so far are done.
    pub fn mark(&mut self, timer: &mut Timer) {
        self.pass = None;
        timer.mark(&mut self.encoder);
    }

    /// Hands the commands to the device, which starts on them; does not wait.
    ///
    /// # Errors
    /// As [`Gpu::check`].
    pub fn submit(mut self) -> Result<(), GpuError> {
        self.pass = None;
        self.gpu.queue.submit([self.encoder.finish()]);
        self.gpu.check()
    }
}
