use std::sync::OnceLock;

use crate::GpuError;

/// Choice of a GPU.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub enum GpuChoice {
    /// The best: discrete before integrated before virtual. Software drivers only if there is nothing else.
    #[default]
    Best,
    /// The best, but no software driver: the native kernels for the CPU are several times faster than those.
    BestHardware,
    /// The first whose name contains this, or that is plugged in there ([`AdapterSummary::pci_bus_id`], whole), or has this title
    /// ([`AdapterSummary::title`]); in any case.
    Named(String),
}

/// Description of a GPU for the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterSummary {
    /// Name that its driver gives.
    pub name: String,
    /// `Vulkan`, `Metal` or `DX12`.
    pub backend: String,
    /// Driver and version.
    pub driver: String,
    /// Slot that it is plugged in, `domain:bus:device.function`, hexadecimal; empty if its back end does not say.
    pub pci_bus_id: String,
    /// True for a CPU under a graphics API.
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

    /// True if [`GpuChoice::Named`] with this name means the GPU.
    pub(crate) fn is_called(&self, wanted: &str) -> bool {
        self.name.to_lowercase().contains(&wanted.to_lowercase())
            || [&self.pci_bus_id, &self.title()].iter().any(|whole| whole.eq_ignore_ascii_case(wanted))
    }

    /// Name, with the slot if that is known: cards of one name differ in it.
    pub fn title(&self) -> String {
        if self.pci_bus_id.is_empty() {
            self.name.clone()
        } else {
            format!("{} at {}", self.name, self.pci_bus_id)
        }
    }
}

/// All GPUs, the best first.
pub fn adapters() -> Vec<AdapterSummary> {
    sorted_adapters().iter().map(|adapter| AdapterSummary::new(&adapter.get_info())).collect()
}

/// Those that a choice means, the best first; one at least.
pub(crate) fn choose(choice: &GpuChoice) -> Result<Vec<wgpu::Adapter>, GpuError> {
    let hardware = has_hardware();
    if *choice == GpuChoice::BestHardware && hardware == Some(false) {
        return Err(GpuError::NoAdapter);
    }
    let adapters = sorted_adapters();
    if adapters.is_empty() {
        return Err(nothing_found(hardware));
    }
    let summary = |adapter: &wgpu::Adapter| AdapterSummary::new(&adapter.get_info());
    let titles: Vec<String> = adapters.iter().map(|adapter| summary(adapter).title()).collect();
    let is_meant = |adapter: &wgpu::Adapter| match choice {
        GpuChoice::Best => true,
        GpuChoice::BestHardware => !summary(adapter).software,
        GpuChoice::Named(wanted) => summary(adapter).is_called(wanted),
    };
    let meant: Vec<_> = adapters.into_iter().filter(is_meant).collect();
    match (meant.is_empty(), choice) {
        (false, _) => Ok(meant),
        (true, GpuChoice::Named(wanted)) => {
            Err(GpuError::NotFound { name: wanted.clone(), found: titles.join(", ") })
        }
        (true, _) => Err(nothing_found(hardware)),
    }
}

/// Why there is no adapter; `hardware` is what [`has_hardware`] says.
pub(crate) fn nothing_found(hardware: Option<bool>) -> GpuError {
    if hardware == Some(true) { GpuError::NoDriver } else { GpuError::NoAdapter }
}

/// True if the system shows any graphics card; nothing where it cannot be asked. Asked before the drivers are: loading
/// them takes a tenth of a second, and Mesa's complain on standard error where there is no desktop.
fn has_hardware() -> Option<bool> {
    if !cfg!(target_os = "linux") {
        return None;
    }
    let renders = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| entry.file_name().to_string_lossy().starts_with("renderD"))
    };
    // Mesa and AMD, NVIDIA, and Windows' subsystem for Linux.
    let has_node = std::fs::read_dir("/dev/dri").is_ok_and(|mut nodes| nodes.any(renders))
        || ["/dev/nvidiactl", "/dev/dxg"].iter().any(|node| std::path::Path::new(node).exists());
    Some(has_node)
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
