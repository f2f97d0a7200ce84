use std::sync::OnceLock;

use crate::GpuError;

/// Which GPU to take.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub enum GpuChoice {
    /// The best: discrete before integrated before virtual. Software drivers only if there is nothing else.
    #[default]
    Best,
    /// The best, but no software driver: the native kernels for the CPU are several times faster than those.
    BestHardware,
    /// The first whose name contains this, in any case.
    Named(String),
}

/// What the user is told about a GPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterSummary {
    /// As its driver calls it.
    pub name: String,
    /// `Vulkan`, `Metal` or `DX12`.
    pub backend: String,
    /// Driver and version.
    pub driver: String,
    /// Where it is plugged in, `domain:bus:device.function`, hexadecimal; empty if its back end does not say.
    pub pci_bus_id: String,
    /// Whether it is the CPU under a graphics API.
    pub software: bool,
}

impl AdapterSummary {
    pub(crate) fn new(info: &wgpu::AdapterInfo) -> Self {
        Self {
            name: info.name.clone(),
            backend: format!("{:?}", info.backend),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            pci_bus_id: info.device_pci_bus_id.clone(),
            software: info.device_type == wgpu::DeviceType::Cpu,
        }
    }
}

/// All GPUs, the best first.
pub fn adapters() -> Vec<AdapterSummary> {
    sorted_adapters().iter().map(|adapter| AdapterSummary::new(&adapter.get_info())).collect()
}

/// Those that a choice means, the best first; one at least.
pub(crate) fn choose(choice: &GpuChoice) -> Result<Vec<wgpu::Adapter>, GpuError> {
    if *choice == GpuChoice::BestHardware && !has_hardware() {
        return Err(GpuError::NoAdapter);
    }
    let adapters = sorted_adapters();
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
    let is_meant = |adapter: &wgpu::Adapter| match choice {
        GpuChoice::Best => true,
        GpuChoice::BestHardware => adapter.get_info().device_type != wgpu::DeviceType::Cpu,
        GpuChoice::Named(wanted) => adapter.get_info().name.to_lowercase().contains(&wanted.to_lowercase()),
    };
    let meant: Vec<_> = adapters.into_iter().filter(is_meant).collect();
    match (meant.is_empty(), choice) {
        (false, _) => Ok(meant),
        (true, GpuChoice::Named(wanted)) => {
            Err(GpuError::NotFound { wanted: wanted.clone(), found: names.join(", ") })
        }
        (true, _) => Err(GpuError::NoAdapter),
    }
}

/// Whether the system shows any graphics card. Asked before the drivers are: loading them takes a tenth of a second, and Mesa's
/// complain on standard error where there is no desktop.
fn has_hardware() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    let renders = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| entry.file_name().to_string_lossy().starts_with("renderD"))
    };
    // Mesa and AMD, NVIDIA, and Windows' subsystem for Linux.
    std::fs::read_dir("/dev/dri").is_ok_and(|mut nodes| nodes.any(renders))
        || ["/dev/nvidiactl", "/dev/dxg"].iter().any(|node| std::path::Path::new(node).exists())
}

fn sorted_adapters() -> Vec<wgpu::Adapter> {
    let mut adapters = pollster::block_on(instance().enumerate_adapters(BACKENDS));
    adapters.sort_by_key(|adapter| rank(adapter.get_info().device_type));
    adapters
}

/// The lower, the better.
pub(crate) fn rank(device_type: wgpu::DeviceType) -> u32 {
    match device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// Never OpenGL: it makes its context current on the calling thread, which ends Blender.
const BACKENDS: wgpu::Backends =
    wgpu::Backends::VULKAN.union(wgpu::Backends::METAL).union(wgpu::Backends::DX12);

fn instance() -> &'static wgpu::Instance {
    static INSTANCE: OnceLock<wgpu::Instance> = OnceLock::new();
    INSTANCE.get_or_init(|| {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = BACKENDS;
        // Indirect dispatches are not used, and their validation would cap buffers at 4 GiB.
        descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
        // An error that can be reported, before the driver takes the whole device away.
        descriptor.memory_budget_thresholds.for_resource_creation = Some(95);
        wgpu::Instance::new(descriptor)
    })
}
