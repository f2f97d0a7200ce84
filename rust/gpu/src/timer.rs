use crate::{Buffer, Gpu, GpuError};

/// Times on the device itself, without what submitting and waiting cost.
#[derive(Debug)]
pub struct Timer {
    queries: wgpu::QuerySet,
    /// Queries resolve only into a buffer made for that, from which they are copied to one that can be read.
    resolved: wgpu::Buffer,
    ticks: Buffer<u64>,
    marks: u32,
    capacity: u32,
    seconds_per_tick: f64,
}

impl Gpu {
    /// A timer for up to `marks` marks; none if the device has no clock that can be read.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn timer(&self, marks: u32) -> Result<Option<Timer>, GpuError> {
        let needed = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
        if !self.features().contains(needed) {
            return Ok(None);
        }
        let queries = self.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timer"),
            ty: wgpu::QueryType::Timestamp,
            count: marks,
        });
        let resolved = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("timer"),
            size: u64::from(marks) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let seconds_per_tick = f64::from(self.queue.get_timestamp_period()) * 1e-9;
        let ticks = self.zeros("timer", marks as usize)?;
        Ok(Some(Timer { queries, ticks, resolved, marks: 0, capacity: marks, seconds_per_tick }))
    }
}

impl Timer {
    pub(crate) fn mark(&mut self, encoder: &mut wgpu::CommandEncoder) {
        assert!(self.marks < self.capacity, "a timer for {} marks", self.capacity);
        encoder.write_timestamp(&self.queries, self.marks);
        self.marks += 1;
    }

    /// Seconds between each mark and the next. Waits for all that was submitted; the timer can then be used anew.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn seconds(&mut self, gpu: &Gpu) -> Result<Vec<f64>, GpuError> {
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.resolve_query_set(&self.queries, 0..self.marks, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.ticks.raw, 0, Some(u64::from(self.marks) * 8));
        gpu.queue.submit([encoder.finish()]);
        let ticks = gpu.read(&self.ticks, 0..self.marks as usize)?;
        self.marks = 0;
        Ok(ticks
            .windows(2)
            .map(|pair| pair[1].saturating_sub(pair[0]) as f64 * self.seconds_per_tick)
            .collect())
    }
}
