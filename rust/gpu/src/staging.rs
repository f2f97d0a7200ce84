//! Buffers through which values come to the CPU, kept from one copy to the next: making and first touching a large one
//! costs as much as the copy. They are memory of the CPU, where the budget does not count.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Most buffers that are kept.
const MOST: usize = 4;
/// Most bytes of all that are kept; a picture of 4K has 100 MB.
const MOST_BYTES: u64 = 128 << 20;
/// Buffers that nobody needed for so long are freed when the device is next used.
const UNUSED: Duration = Duration::from_secs(10);
/// Multiple that their bytes should be of, so that small ones serve many lengths.
pub(crate) const STEP: u64 = 64 << 10;

/// Buffers that no copy is using, the one that was used last at the end.
#[derive(Debug, Default)]
pub(crate) struct Staging(Mutex<Vec<Kept>>);

#[derive(Debug)]
struct Kept {
    buffer: wgpu::Buffer,
    since: Instant,
}

impl Staging {
    /// Takes the smallest buffer of at least so many bytes.
    pub fn take(&self, bytes: u64) -> Option<wgpu::Buffer> {
        let mut kept = self.kept();
        let fits = kept.iter().enumerate().filter(|(_, kept)| kept.buffer.size() >= bytes);
        let (smallest, _) = fits.min_by_key(|(_, kept)| kept.buffer.size())?;
        Some(kept.remove(smallest).buffer)
    }

    /// Keeps a buffer that is not mapped, unless it is larger than all may be.
    pub fn put(&self, buffer: wgpu::Buffer) {
        let since = Instant::now();
        if buffer.size() <= MOST_BYTES {
            self.kept().push(Kept { buffer, since });
        }
        self.trim(since);
    }

    /// Frees the longest unused while there are too many, and those unused for too long.
    pub fn trim(&self, now: Instant) {
        let mut kept = self.kept();
        let (mut count, mut bytes) = (kept.len(), kept.iter().map(|kept| kept.buffer.size()).sum::<u64>());
        kept.retain(|kept| {
            let stays = count <= MOST && bytes <= MOST_BYTES && now.duration_since(kept.since) < UNUSED;
            if !stays {
                count -= 1;
                bytes -= kept.buffer.size();
            }
            stays
        });
    }

    /// Frees all; true if there was one.
    pub fn clear(&self) -> bool {
        !std::mem::take(&mut *self.kept()).is_empty()
    }

    fn kept(&self) -> MutexGuard<'_, Vec<Kept>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Gpu, GpuChoice, GpuError};
    use std::sync::Arc;

    fn gpu() -> Arc<Gpu> {
        Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver")
    }

    /// Buffers that are kept, in their order.
    fn kept(gpu: &Gpu) -> Vec<wgpu::Buffer> {
        gpu.staging().kept().iter().map(|kept| kept.buffer.clone()).collect()
    }

    fn sizes(gpu: &Gpu) -> Vec<u64> {
        kept(gpu).iter().map(wgpu::Buffer::size).collect()
    }

    /// A buffer that no copy has used.
    fn fresh(gpu: &Gpu, size: u64) -> wgpu::Buffer {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        })
    }

    #[test]
    fn values_of_changing_lengths_come_through_one_buffer() {
        let gpu = gpu();
        let values: Vec<u32> = (0..50_000).map(|i: u32| i.wrapping_mul(2_654_435_761)).collect();
        let buffer = gpu.buffer_of("values", &values).unwrap();
        assert_eq!(gpu.read(&buffer, 0..values.len()).unwrap(), values);
        let first = kept(&gpu);
        assert_eq!(sizes(&gpu), [4 * STEP]);
        for range in [0..1, 49_999..50_000, 7..7, 1..40_000, 123..456, 0..50_000] {
            assert_eq!(gpu.read(&buffer, range.clone()).unwrap(), values[range.clone()]);
            let mut found = vec![7; range.len()];
            gpu.read_into(&buffer, range.start, &mut found).unwrap();
            assert_eq!(found, values[range]);
        }
        assert_eq!(kept(&gpu), first);
        // What is larger has a buffer of its own, and the smallest that does is taken.
        let long = gpu.zeros::<u32>("long", 100_000).unwrap();
        gpu.read(&long, 0..100_000).unwrap();
        assert_eq!(sizes(&gpu), [4 * STEP, 7 * STEP]);
        gpu.read(&buffer, 0..50_000).unwrap();
        assert_eq!(sizes(&gpu), [7 * STEP, 4 * STEP]);
        assert_eq!(kept(&gpu)[1], first[0]);
    }

    #[test]
    fn threads_read_at_once() {
        let gpu = gpu();
        std::thread::scope(|scope| {
            for thread in 0..8_u32 {
                let gpu = &gpu;
                scope.spawn(move || {
                    for round in 1..20_u32 {
                        let values: Vec<u32> = (0..round * 3000).map(|i| i * thread + round).collect();
                        let buffer = gpu.buffer_of("values", &values).unwrap();
                        let mut found = vec![0; values.len()];
                        gpu.read_into(&buffer, 0, &mut found).unwrap();
                        assert!(found == values, "thread {thread}, round {round}");
                    }
                });
            }
        });
        assert!((1..=MOST).contains(&kept(&gpu).len()));
    }

    #[test]
    fn the_last_used_stay_within_their_bounds() {
        let gpu = gpu();
        let staging = gpu.staging();
        for step in 1..=6 {
            staging.put(fresh(&gpu, step * STEP));
        }
        assert_eq!(sizes(&gpu), [3, 4, 5, 6].map(|step| step * STEP));
        staging.put(fresh(&gpu, MOST_BYTES + 4));
        assert_eq!(sizes(&gpu), [3, 4, 5, 6].map(|step| step * STEP), "larger than all may be");
        staging.put(fresh(&gpu, MOST_BYTES - 6 * STEP));
        assert_eq!(sizes(&gpu), [6 * STEP, MOST_BYTES - 6 * STEP]);
    }

    #[test]
    fn buffers_are_freed_when_unused_for_long_or_all_at_once() {
        let gpu = gpu();
        let buffer = gpu.buffer_of("values", &[1_u32, 2]).unwrap();
        gpu.read(&buffer, 0..2).unwrap();
        let staging = gpu.staging();
        staging.trim(Instant::now());
        assert_eq!(sizes(&gpu), [STEP]);
        staging.trim(Instant::now() + UNUSED);
        assert_eq!(sizes(&gpu), []);
        // A submission does the same once the time is there.
        let since = Instant::now().checked_sub(UNUSED).expect("a clock that runs for long enough");
        staging.kept().push(Kept { buffer: fresh(&gpu, STEP), since });
        gpu.submit_writes().unwrap();
        assert_eq!(sizes(&gpu), []);
        gpu.read(&buffer, 0..2).unwrap();
        assert!(staging.clear() && !staging.clear());
        assert_eq!(gpu.read(&buffer, 0..2).unwrap(), [1, 2]);
    }

    #[test]
    fn no_buffer_of_a_copy_that_failed_is_kept() {
        let gpu = gpu();
        let buffer = gpu.buffer_of("values", &[1_u32, 2]).unwrap();
        gpu.read(&buffer, 0..2).unwrap();
        gpu.lose();
        let mut values = [7, 7];
        for _ in 0..2 {
            assert!(matches!(gpu.read_into(&buffer, 0, &mut values), Err(GpuError::Lost(_))));
        }
        assert_eq!(values, [7, 7]);
        // One that cannot be mapped, since it is.
        let gpu = self::gpu();
        let buffer = gpu.buffer_of("values", &[1_u32, 2]).unwrap();
        let mapped = fresh(&gpu, STEP);
        mapped.map_async(wgpu::MapMode::Read, .., |_| ());
        gpu.wait().unwrap();
        gpu.staging().put(mapped);
        assert!(gpu.read_into(&buffer, 0, &mut values).is_err());
        assert_eq!((sizes(&gpu), values), (vec![], [7, 7]));
    }
}
