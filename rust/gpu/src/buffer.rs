use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

use bytemuck::{NoUninit, Pod};

use crate::memory::Memory;
use crate::staging::STEP;
use crate::{Gpu, GpuError, Submission};

/// Values on the GPU, for kernels to read and write. Its bytes count against the memory budget until it is dropped.
#[derive(Debug)]
pub struct Buffer<T> {
    pub(crate) raw: wgpu::Buffer,
    len: usize,
    bytes: u64,
    memory: Arc<Memory>,
    values: PhantomData<T>,
}

/// A buffer, or a part of it, for a kernel.
#[derive(Clone, Copy, Debug)]
pub struct Binding<'a> {
    pub(crate) raw: &'a wgpu::Buffer,
    /// Bytes.
    pub(crate) range: (u64, u64),
}

impl<T> Buffer<T> {
    /// Values.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if the buffer holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// All of it.
    pub fn whole(&self) -> Binding<'_> {
        Binding { raw: &self.raw, range: (0, self.bytes) }
    }

    /// Some of its values; the first must lie at a multiple of [`crate::DeviceLimits::binding_alignment`].
    ///
    /// # Panics
    /// If the range is empty or does not lie in the buffer.
    pub fn part(&self, range: Range<usize>) -> Binding<'_> {
        assert!(range.start < range.end && range.end <= self.len, "{range:?} of {} values", self.len);
        let size = size_of::<T>() as u64;
        Binding {
            raw: &self.raw,
            range: (range.start as u64 * size, (range.end - range.start) as u64 * size),
        }
    }
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        self.memory.give_back(self.bytes);
    }
}

impl Gpu {
    /// A buffer of `len` zeros; of one if `len` is 0, since an empty one cannot be bound.
    ///
    /// # Errors
    /// If it does not fit into the budget, the device or its limits, or the device was lost.
    pub fn zeros<T: NoUninit>(&self, label: &str, len: usize) -> Result<Buffer<T>, GpuError> {
        let bytes = (len.max(1) as u64 * size_of::<T>() as u64).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        let limit = self.limits().buffer;
        if bytes > limit {
            return Err(GpuError::TooLarge { what: label.to_owned(), limit: limit >> 20 });
        }
        self.check()?;
        let free = self.free_memory() >> 20;
        self.memory().take(label, bytes)?;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        match self.allocate(label, bytes, usage, free) {
            Ok(raw) => Ok(Buffer { raw, len, bytes, memory: Arc::clone(self.memory()), values: PhantomData }),
            Err(error) => {
                self.memory().give_back(bytes);
                Err(error)
            }
        }
    }

    /// A buffer of the driver, for which buffers that no copy is using give way; `free` says how many MiB of the budget are left,
    /// for its error.
    fn allocate(
        &self,
        label: &str,
        bytes: u64,
        usage: wgpu::BufferUsages,
        free: u64,
    ) -> Result<wgpu::Buffer, GpuError> {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false };
        let raw = self.device.create_buffer(&descriptor);
        match pollster::block_on(scope.pop()) {
            None => self.check().map(|()| raw),
            Some(_) if self.staging().clear() => self.allocate(label, bytes, usage, free),
            Some(_) => {
                let needed = bytes.div_ceil(1 << 20);
                Err(GpuError::OutOfMemory { what: label.to_owned(), needed, free })
            }
        }
    }

    /// A buffer with these values.
    ///
    /// # Errors
    /// See [`Gpu::zeros`].
    pub fn buffer_of<T: NoUninit>(&self, label: &str, values: &[T]) -> Result<Buffer<T>, GpuError> {
        let buffer = self.zeros(label, values.len())?;
        self.write(&buffer, 0, values);
        Ok(buffer)
    }

    /// Replaces the values from `first` on, after all that has been submitted so far.
    ///
    /// # Panics
    /// If they do not lie in the buffer, or are not whole multiples of four bytes.
    pub fn write<T: NoUninit>(&self, buffer: &Buffer<T>, first: usize, values: &[T]) {
        assert!(first + values.len() <= buffer.len, "{} values at {first} of {}", values.len(), buffer.len);
        if !values.is_empty() {
            let offset = first as u64 * size_of::<T>() as u64;
            self.queue.write_buffer(&buffer.raw, offset, bytemuck::cast_slice(values));
        }
    }

    /// Sends on what was written, for [`Gpu::wait_for`]. It is held twice until it is on the device and that was waited for, so that
    /// whoever writes a lot should call this now and then.
    ///
    /// # Errors
    /// See [`Gpu::check`].
    pub fn submit_writes(&self) -> Result<Submission, GpuError> {
        self.commands("writes").submit_tracked()
    }

    /// Copies values to the CPU, after all that has been submitted so far.
    ///
    /// # Errors
    /// If the device was lost, or has not the memory.
    ///
    /// # Panics
    /// If the range does not lie in the buffer, or is not whole multiples of four bytes.
    pub fn read<T: Pod>(&self, buffer: &Buffer<T>, range: Range<usize>) -> Result<Vec<T>, GpuError> {
        self.read_bytes(buffer, range, bytemuck::pod_collect_to_vec)
    }

    /// [`Gpu::read`] of the values from `first` on, as many as are replaced by them. Memory that was used before spares what first
    /// touching a new vector costs.
    ///
    /// # Errors
    /// See [`Gpu::read`]; the values are as before then.
    ///
    /// # Panics
    /// See [`Gpu::read`].
    pub fn read_into<T: Pod>(
        &self,
        buffer: &Buffer<T>,
        first: usize,
        values: &mut [T],
    ) -> Result<(), GpuError> {
        let range = first..first + values.len();
        self.read_bytes(buffer, range, |bytes| bytemuck::cast_slice_mut(values).copy_from_slice(bytes))
    }

    /// Lends the bytes of some values, once they are on the CPU.
    fn read_bytes<T, R>(
        &self,
        buffer: &Buffer<T>,
        range: Range<usize>,
        take: impl FnOnce(&[u8]) -> R,
    ) -> Result<R, GpuError> {
        assert!(range.start <= range.end && range.end <= buffer.len, "{range:?} of {} values", buffer.len);
        if range.is_empty() {
            return Ok(take(&[]));
        }
        self.check()?;
        let size = size_of::<T>() as u64;
        let (start, bytes) = (range.start as u64 * size, range.len() as u64 * size);
        let staging = match self.staging().take(bytes) {
            Some(kept) => kept,
            None => {
                let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
                let rounded = bytes.next_multiple_of(STEP).min(self.limits().buffer);
                self.allocate("read back", rounded, usage, self.free_memory() >> 20)?
            }
        };
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&buffer.raw, start, &staging, 0, bytes);
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
            // The receiver waits below; if it has gone, nobody wants the answer.
            let _ = sender.send(result);
        });
        self.wait()?;
        let mapped = receiver.recv().map_err(|error| self.found_lost(&error))?;
        mapped.map_err(|error| self.found_lost(&error))?;
        let mapped = staging.get_mapped_range(..bytes).map_err(|error| self.found_lost(&error))?;
        self.count_read(bytes);
        let taken = take(&mapped);
        drop(mapped);
        staging.unmap();
        self.staging().put(staging);
        Ok(taken)
    }
}
