//! Memory budget of our buffers, and its use.
//!
//! If the user sets no limit, it is a share of what the driver says:
//!
//! | back end | all of the memory | what is free of it |
//! |---|---|---|
//! | Vulkan, software drivers included | largest heap that is `DEVICE_LOCAL` | `VK_EXT_memory_budget` (`heapBudget` less `heapUsage`), if there |
//! | Metal | `MTLDevice.recommendedMaxWorkingSetSize` | that less `currentAllocatedSize`, which is of this process |
//! | DX12 | `Budget` of `IDXGIAdapter3::QueryVideoMemoryInfo` for local memory, what Windows grants this process now | that less `CurrentUsage` |
//!
//! A driver that names no such memory, or none of any size, is taken to have [`UNKNOWN_MEMORY`].

use std::sync::atomic::{AtomicU64, Ordering};

use crate::GpuError;

/// Share of the device's memory that is ours: others draw on the same card.
const DEFAULT_SHARE: f64 = 0.7;
/// Share of its free memory that is: drivers need some for themselves.
const FREE_SHARE: f64 = 0.9;
/// Limit where the driver does not say how much memory there is.
const UNKNOWN_MEMORY: u64 = 4 << 30;

/// Bytes of our buffers. Shared with each of them.
#[derive(Debug)]
pub struct Memory {
    used: AtomicU64,
    budget: AtomicU64,
}

/// Memory of the device itself according to its driver, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DeviceMemory {
    all: u64,
    /// Memory that neither other programs nor we have taken; nothing where the driver does not say.
    free: Option<u64>,
}

impl Memory {
    /// Memory with the limit that [`Memory::limit`] sets if it is given none.
    pub fn new(adapter: &wgpu::Adapter) -> Self {
        Self { used: 0.into(), budget: budget(device_memory(adapter), 0).into() }
    }

    /// Sets the limit; if none is given, to what the driver says now.
    pub fn limit(&self, adapter: &wgpu::Adapter, bytes: Option<u64>) {
        let said = || budget(device_memory(adapter), self.used.load(Ordering::Relaxed));
        self.budget.store(bytes.unwrap_or_else(said), Ordering::Relaxed);
    }

    /// Bytes up to the limit.
    pub fn free(&self) -> u64 {
        self.budget.load(Ordering::Relaxed).saturating_sub(self.used.load(Ordering::Relaxed))
    }

    /// Counts a new buffer, if it fits.
    pub fn take(&self, what: &str, bytes: u64) -> Result<(), GpuError> {
        let budget = self.budget.load(Ordering::Relaxed);
        let fits = |used: u64| used.checked_add(bytes).filter(|&sum| sum <= budget);
        self.used.fetch_update(Ordering::Relaxed, Ordering::Relaxed, fits).map(|_| ()).map_err(|used| {
            GpuError::OutOfMemory {
                what: what.to_owned(),
                needed: bytes.div_ceil(1 << 20),
                free: budget.saturating_sub(used) >> 20,
            }
        })
    }

    pub fn give_back(&self, bytes: u64) {
        self.used.fetch_sub(bytes, Ordering::Relaxed);
    }
}

/// Share that may be ours, if the user does not say; `used` bytes are already.
fn budget(said: Option<DeviceMemory>, used: u64) -> u64 {
    let Some(memory) = said.filter(|memory| memory.all > 0) else { return UNKNOWN_MEMORY };
    let share = |bytes: u64, share: f64| (bytes as f64 * share) as u64;
    let of_all = share(memory.all, DEFAULT_SHARE);
    memory.free.map_or(of_all, |free| of_all.min(used + share(free, FREE_SHARE)))
}

/// Asks the driver; nothing where it does not say.
#[cfg(target_vendor = "apple")]
fn device_memory(adapter: &wgpu::Adapter) -> Option<DeviceMemory> {
    use objc2_metal::MTLDevice;
    // SAFETY: the device is only asked questions, while the guard keeps the adapter alive.
    let adapter = unsafe { adapter.as_hal::<wgpu::hal::api::Metal>() }?;
    let device = adapter.raw_device();
    let all = device.recommendedMaxWorkingSetSize();
    Some(DeviceMemory { all, free: Some(all.saturating_sub(device.currentAllocatedSize() as u64)) })
}

/// Asks the driver; nothing where it does not say.
#[cfg(not(target_vendor = "apple"))]
fn device_memory(adapter: &wgpu::Adapter) -> Option<DeviceMemory> {
    #[cfg(windows)]
    if let Some(memory) = granted_by_windows(adapter) {
        return Some(memory);
    }
    vulkan_memory(adapter)
}

/// Memory of a DX12 adapter.
#[cfg(windows)]
fn granted_by_windows(adapter: &wgpu::Adapter) -> Option<DeviceMemory> {
    use windows::Win32::Graphics::Dxgi::DXGI_MEMORY_SEGMENT_GROUP_LOCAL;
    // SAFETY: the adapter is only asked a question, while the guard keeps it alive.
    let adapter = unsafe { adapter.as_hal::<wgpu::hal::api::Dx12>() }?;
    let granted = adapter.raw_adapter().query_video_memory_info(DXGI_MEMORY_SEGMENT_GROUP_LOCAL).ok()?;
    let free = granted.Budget.saturating_sub(granted.CurrentUsage);
    Some(DeviceMemory { all: granted.Budget, free: Some(free) })
}

#[cfg(not(target_vendor = "apple"))]
fn vulkan_memory(adapter: &wgpu::Adapter) -> Option<DeviceMemory> {
    use ash::{ext, vk};
    // SAFETY: the handles are only asked questions, while the guard keeps the adapter alive.
    let adapter = unsafe { adapter.as_hal::<wgpu::hal::api::Vulkan>() }?;
    let (instance, device) = (adapter.shared_instance(), adapter.raw_physical_device());
    let capabilities = adapter.physical_device_capabilities();
    // Part of Vulkan since 1.1, as what passes the question on.
    let version = instance.instance_api_version().min(capabilities.properties().api_version);
    let says_budget =
        version >= vk::API_VERSION_1_1 && capabilities.supports_extension(ext::memory_budget::NAME);
    let mut budgets = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
    let heaps = if says_budget {
        let mut answer = vk::PhysicalDeviceMemoryProperties2::default().push_next(&mut budgets);
        // SAFETY: both know the function and the structs, see above; the physical device is the instance's.
        unsafe { instance.raw_instance().get_physical_device_memory_properties2(device, &mut answer) };
        answer.memory_properties
    } else {
        // SAFETY: the physical device is the instance's.
        unsafe { instance.raw_instance().get_physical_device_memory_properties(device) }
    };
    let count = heaps.memory_heap_count as usize;
    let heaps = heaps.memory_heaps[..count].iter().enumerate();
    let own = heaps.filter(|(_, heap)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
    let (largest, heap) = own.max_by_key(|(_, heap)| heap.size)?;
    let free = budgets.heap_budget[largest].saturating_sub(budgets.heap_usage[largest]);
    Some(DeviceMemory { all: heap.size, free: says_budget.then_some(free) })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GIB: u64 = 1 << 30;

    #[test]
    fn what_is_ours_leaves_room_for_others() {
        let of = |all: u64, free: Option<u64>| Some(DeviceMemory { all, free });
        assert_eq!(budget(of(10 * GIB, None), 0), 7 * GIB);
        assert_eq!(budget(of(10 * GIB, Some(10 * GIB)), 0), 7 * GIB);
        // Most of the card is taken by others, or by ourselves.
        assert_eq!(budget(of(100 * GIB, Some(10 * GIB)), 0), 9 * GIB);
        assert_eq!(budget(of(100 * GIB, Some(10 * GIB)), 50 * GIB), 59 * GIB);
        assert_eq!(budget(of(100 * GIB, Some(0)), GIB), GIB);
        for unknown in [None, of(0, None), of(0, Some(0))] {
            assert_eq!(budget(unknown, GIB), UNKNOWN_MEMORY);
        }
    }

    /// Software drivers say what the computer has.
    #[test]
    fn every_driver_here_says_how_much_memory_it_has() {
        let adapters =
            crate::choice::choose(&crate::GpuChoice::Best).expect("tests need a GPU or a software driver");
        for adapter in adapters {
            let said = device_memory(&adapter);
            println!("{}: {said:?}", adapter.get_info().name);
            let said = said.expect("an answer");
            assert!(said.all >= GIB / 8, "{said:?}");
            assert!(said.free.is_none_or(|free| free > 0 && free <= said.all), "{said:?}");
        }
    }
}
