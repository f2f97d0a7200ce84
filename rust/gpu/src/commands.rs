use std::ops::Range;
use std::time::Instant;

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

/// Commands that were handed to the device.
#[derive(Debug)]
pub struct Submission(wgpu::SubmissionIndex);

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

    /// Waits until these commands, and those before them, are done.
    ///
    /// # Errors
    /// See [`Gpu::check`].
    pub fn wait_for(&self, submission: Submission) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(submission.0), timeout: None };
        let polled = self.device.poll(wait);
        self.check()?;
        polled.map(|_| ()).map_err(|error| self.found_lost(&error))
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

    /// Copies some values of a buffer to the place `start` of another.
    ///
    /// # Panics
    /// If they do not lie in both buffers.
    pub fn copy_part<T>(&mut self, from: &Buffer<T>, range: Range<usize>, to: &Buffer<T>, start: usize) {
        assert!(range.start <= range.end && range.end <= from.len(), "{range:?} of {} values", from.len());
        assert!(start + range.len() <= to.len(), "{} values at {start} of {}", range.len(), to.len());
        self.pass = None;
        let bytes = |values: usize| values as u64 * size_of::<T>() as u64;
        let size = Some(bytes(range.len()));
        self.encoder.copy_buffer_to_buffer(&from.raw, bytes(range.start), &to.raw, bytes(start), size);
    }

    /// Notes the time on the device, once all commands so far are done.
    pub fn mark(&mut self, timer: &mut Timer) {
        self.pass = None;
        timer.mark(&mut self.encoder);
    }

    /// Hands the commands to the device, which starts on them; does not wait.
    ///
    /// # Errors
    /// See [`Gpu::check`].
    pub fn submit(self) -> Result<(), GpuError> {
        self.submit_tracked().map(|_| ())
    }

    /// [`Commands::submit`], for [`Gpu::wait_for`].
    ///
    /// # Errors
    /// See [`Gpu::check`].
    pub fn submit_tracked(mut self) -> Result<Submission, GpuError> {
        self.pass = None;
        let submission = self.gpu.queue.submit([self.encoder.finish()]);
        self.gpu.staging().trim(Instant::now());
        self.gpu.check().map(|()| Submission(submission))
    }
}
