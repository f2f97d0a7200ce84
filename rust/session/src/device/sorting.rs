use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use relume_gather::GpuGather;

use crate::device::threads::in_background;

/// Relights after which sorting is worth its seconds: who relights once more does so often.
const RELIGHTS: usize = 3;

/// Share of the free memory that sorted segments may take: proxies and trainings come after them.
const MOST_MEMORY: f64 = 0.5;

/// Sorts the segments of a dump on the GPU, on a thread of its own, once it was relit several times. Relighting goes on
/// meanwhile. Afterwards small lights read less, where that is measured to be quicker. Ends with its owner.
#[derive(Default)]
pub(crate) struct Sorting {
    relights: AtomicUsize,
    stop: Arc<AtomicBool>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Sorting {
    /// Counts a relight, and begins when there were enough.
    pub fn relit(&self, gather: impl FnOnce() -> Option<Arc<GpuGather>>) {
        if self.relights.fetch_add(1, Ordering::Relaxed) + 1 != RELIGHTS {
            return;
        }
        let (Some(gather), stop) = (gather(), Arc::clone(&self.stop)) else { return };
        let thread = std::thread::Builder::new().name("relume-sort".into());
        let thread = thread.spawn(move || sort(&gather, &stop));
        // Without a thread nothing is sorted, and relighting goes on as before.
        *self.thread.lock().unwrap_or_else(PoisonError::into_inner) = thread.ok();
    }

    /// Restarts the count: all sorting before is lost.
    pub fn begin_again(&self) {
        self.relights.store(0, Ordering::Relaxed);
    }

    /// Waits until what was begun is done.
    fn wait(&self) {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        // It ends by itself; a panic there was told where it happened.
        let _ = thread.map(JoinHandle::join);
    }
}

/// Sorts on half of the threads, since relighting and Blender need the others. One dump at a time.
fn sort(gather: &GpuGather, stop: &AtomicBool) {
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let threads = std::thread::available_parallelism().map_or(1, |count| count.get().div_ceil(2));
    let cancelled = || stop.load(Ordering::Relaxed);
    let sort = || gather.sort_within(MOST_MEMORY, &cancelled);
    // A lost device is found by the next relight, which tells the user; without room for an image bytes alone decide.
    let _ = in_background(threads, sort).and_then(|_| gather.weigh_sorted(&cancelled));
}

impl Drop for Sorting {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::compute::{Compute, Device};
    use crate::device::gather::DeviceGather;
    use crate::progress::Monitor;
    use crate::test_box::boxed;
    use glam::Vec3;
    use relume_dump::Dump;
    use relume_gather::Gather;
    use relume_gpu::GpuChoice;
    use relume_scene::{Light, LightShape};

    fn dump() -> Dump {
        boxed((24, 16), 4).expect("a dump")
    }

    #[test]
    fn a_dump_that_is_relit_again_is_sorted_meanwhile_with_the_same_pictures() {
        let compute = Device::Gpu(GpuChoice::Best).open(None).expect("tests need a GPU");
        let light = Light::unit(LightShape::Sphere { center: Vec3::new(0.3, 0.2, 0.4), radius: 0.05 });
        let lights = [light];
        let relight = |gather: &DeviceGather, compute: &Compute| {
            gather.unit_images(&lights, compute, &Monitor::default()).expect("a picture").remove(0)
        };
        let [sorted, unsorted] = [true, false].map(|allowed| {
            let gather = DeviceGather::new(Gather::new(dump()));
            if allowed {
                gather.allow_sorting();
            }
            for _ in 0..RELIGHTS {
                relight(&gather, &compute);
            }
            gather
        });
        sorted.sorting.wait();
        let bytes = |gather: &DeviceGather| {
            let light = gather.gather().prepare(&lights[0]).expect("a light");
            gather.on_gpu.get().expect("on the device").sorted_bytes(&light)
        };
        assert!(bytes(&sorted).is_some() && bytes(&unsorted).is_none());
        let (a, b) = (relight(&sorted, &compute), relight(&unsorted, &compute));
        let largest = b.data.iter().fold(0.0f32, |most, value| most.max(*value));
        assert!(largest > 0.0);
        // Some hundred positive values in another order.
        assert!(a.data.iter().zip(&b.data).all(|(a, b)| (a - b).abs() <= 1e-5 * largest));
    }

    #[test]
    fn who_is_closed_does_not_wait_for_sorting() {
        let compute = Device::Gpu(GpuChoice::Best).open(None).expect("tests need a GPU");
        let gather = GpuGather::new(compute.gpu.expect("one"), &Gather::new(dump())).expect("room");
        let gather = Arc::new(gather);
        let sorting = Sorting::default();
        sorting.stop.store(true, Ordering::Relaxed);
        (0..RELIGHTS).for_each(|_| sorting.relit(|| Some(Arc::clone(&gather))));
        drop(sorting);
        let light =
            Gather::new(dump()).prepare(&Light::unit(LightShape::Sphere { center: Vec3::ZERO, radius: 0.1 }));
        assert_eq!(gather.sorted_bytes(&light.expect("a light")), None);
        assert_eq!(Arc::strong_count(&gather), 1);
    }
}
