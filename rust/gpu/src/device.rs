use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::choice::choose;
use crate::kernel::{Checks, Compiled};
use crate::memory::Memory;
use crate::staging::Staging;
use crate::{AdapterSummary, GpuChoice, GpuError, matrices};

/// Bytes of arguments that a dispatch may carry ([`crate::Commands::run`]); every back end has them.
pub(crate) const IMMEDIATES: u32 = 64;
/// Most buffers that a kernel binds.
const BINDINGS: u32 = 12;
/// Most threads of a workgroup.
const INVOCATIONS: u32 = 256;
/// Most bytes that the threads of a workgroup share.
const WORKGROUP_MEMORY: u32 = 32 << 10;

/// A GPU. Cheap to share; every call may come from any thread.
#[derive(Debug)]
pub struct Gpu {
    adapter: wgpu::Adapter,
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    summary: AdapterSummary,
    limits: DeviceLimits,
    features: wgpu::Features,
    memory: Arc<Memory>,
    staging: Staging,
    bytes_read: AtomicU64,
    errors: Arc<Mutex<DeviceErrors>>,
    checks: Checks,
    compiled: Compiled,
    matrix_subgroup: OnceLock<Option<u32>>,
}

/// Limits of a GPU's kernels and buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceLimits {
    /// Bytes of a buffer, all of which can be bound.
    pub buffer: u64,
    /// Bytes of workgroup memory.
    pub workgroup_memory: u32,
    /// Invocations of a workgroup.
    pub invocations: u32,
    /// Multiple that the start of a bound part of a buffer has to be of, bytes.
    pub binding_alignment: u64,
    /// Smallest and largest subgroup, or none if kernels cannot see them.
    pub subgroup: Option<(u32, u32)>,
    /// 16-bit floats in kernels.
    pub f16: bool,
    /// Atomic additions of 32-bit floats.
    pub float_atomics: bool,
    /// Side of the matrices of 16-bit floats that a subgroup multiplies at once ([`Gpu::matrices`]).
    pub matrices: Option<u32>,
    /// Times on the device.
    pub timestamps: bool,
}

/// Errors since the last check.
#[derive(Debug, Default)]
struct DeviceErrors {
    lost: Option<String>,
    failed: Option<GpuError>,
}

impl Gpu {
    /// The process's device of this choice: the one that is open, or a new one if there is none or it was lost. Choices that mean
    /// the same GPU share its device.
    ///
    /// # Errors
    /// See [`Gpu::open`].
    pub fn shared(choice: &GpuChoice) -> Result<Arc<Self>, GpuError> {
        static OPEN: Mutex<Vec<(GpuChoice, Arc<Gpu>)>> = Mutex::new(Vec::new());
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|(_, gpu)| !gpu.is_lost());
        if let Some((_, gpu)) = open.iter().find(|(of, _)| of == choice) {
            return Ok(Arc::clone(gpu));
        }
        let others = open.iter().map(|(_, gpu)| Arc::clone(gpu)).collect();
        let gpu = Self::open_beside(choice, others)?;
        open.push((choice.clone(), Arc::clone(&gpu)));
        Ok(gpu)
    }

    /// Opens a device, on a thread of its own: drivers leave things on the thread that opens them, and in Blender the
    /// caller's may be the one that draws.
    ///
    /// # Errors
    /// If there is none, or none that is suitable.
    pub fn open(choice: &GpuChoice) -> Result<Arc<Self>, GpuError> {
        Self::open_beside(choice, Vec::new())
    }

    /// [`Gpu::open`], but one of these devices if it is of the same GPU.
    fn open_beside(choice: &GpuChoice, others: Vec<Arc<Self>>) -> Result<Arc<Self>, GpuError> {
        let choice = choice.clone();
        Self::on_a_thread(move || Self::open_here(&choice, &others))
    }

    /// Opens the same GPU once more, with kernels that check themselves or do not: for measuring what that costs. It has a memory
    /// budget of its own.
    ///
    /// # Errors
    /// See [`Gpu::open`].
    pub fn open_second(&self, checks: Checks) -> Result<Arc<Self>, GpuError> {
        let adapter = self.adapter.clone();
        Self::on_a_thread(move || Self::open_adapter(&adapter, checks))
    }

    fn on_a_thread(
        open: impl FnOnce() -> Result<Arc<Self>, GpuError> + Send + 'static,
    ) -> Result<Arc<Self>, GpuError> {
        let thread = std::thread::Builder::new().name("relume-gpu".into());
        match thread.spawn(open).map(std::thread::JoinHandle::join) {
            Ok(Ok(result)) => result,
            Ok(Err(_)) => Err(GpuError::Lost("its driver failed while it was opened".into())),
            Err(error) => Err(GpuError::Lost(format!("no thread to open it on: {error}"))),
        }
    }

    fn open_here(choice: &GpuChoice, others: &[Arc<Self>]) -> Result<Arc<Self>, GpuError> {
        let adapters = choose(choice)?;
        let mut opened = adapters.iter().map(|adapter| {
            let summary = AdapterSummary::new(&adapter.get_info());
            let known = others.iter().find(|gpu| gpu.summary == summary);
            let open = || Self::open_adapter(adapter, Checks::of_this_build());
            known.map_or_else(open, |gpu| Ok(Arc::clone(gpu)))
        });
        // The next best may do; if none does, what the best one lacks is said.
        let best = opened.next().unwrap_or(Err(GpuError::NoAdapter));
        best.or_else(|error| opened.find_map(Result::ok).ok_or(error))
    }

    fn open_adapter(adapter: &wgpu::Adapter, checks: Checks) -> Result<Arc<Self>, GpuError> {
        let info = adapter.get_info();
        let unsuitable = |missing: String| GpuError::Unsuitable { adapter: info.name.clone(), missing };
        if let Some(missing) = missing(adapter.features(), &adapter.limits()) {
            return Err(unsuitable(missing));
        }
        let features = adapter.features() & wanted_features();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("relume"),
            required_features: features,
            required_limits: adapter.limits(),
            // SAFETY: cooperative matrices are only used by kernels whose results are compared with those of the plain
            // ones; nothing else that is experimental is asked for.
            experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| unsuitable(error.to_string()))?;
        let errors = Arc::new(Mutex::new(DeviceErrors::default()));
        watch(&device, &errors);
        let memory = Arc::new(Memory::new(adapter));
        let limits = limits(adapter, features);
        let (compiled, staging, bytes_read, matrix_subgroup) = Default::default();
        let summary = AdapterSummary::new(&info);
        let adapter = adapter.clone();
        Ok(Arc::new(Self {
            adapter,
            device,
            queue,
            summary,
            limits,
            features,
            memory,
            staging,
            bytes_read,
            errors,
            checks,
            compiled,
            matrix_subgroup,
        }))
    }

    /// Description of the GPU for the user.
    pub fn summary(&self) -> &AdapterSummary {
        &self.summary
    }

    /// Limits of its kernels and buffers.
    pub fn limits(&self) -> &DeviceLimits {
        &self.limits
    }

    pub(crate) fn adapter(&self) -> &wgpu::Adapter {
        &self.adapter
    }

    pub(crate) fn features(&self) -> wgpu::Features {
        self.features
    }

    pub(crate) fn memory(&self) -> &Arc<Memory> {
        &self.memory
    }

    pub(crate) fn staging(&self) -> &Staging {
        &self.staging
    }

    /// Bytes that our buffers may still take.
    pub fn free_memory(&self) -> u64 {
        self.memory.free()
    }

    /// Sets how many bytes all our buffers together may take; if not given, what the driver says now, less what others may need
    /// (`memory.rs` tells what is asked of which driver).
    pub fn set_memory_budget(&self, bytes: Option<u64>) {
        self.memory.limit(&self.adapter, bytes);
    }

    /// Bytes that were copied to the CPU so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    pub(crate) fn count_read(&self, bytes: u64) {
        self.bytes_read.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Checks that the device still works and has taken all commands so far.
    ///
    /// # Errors
    /// [`GpuError::Lost`] from the loss of the device on; once for commands that were refused [`GpuError::Refused`], or
    /// [`GpuError::DriverOutOfMemory`].
    pub fn check(&self) -> Result<(), GpuError> {
        let mut errors = self.errors.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reason) = &errors.lost {
            return Err(GpuError::Lost(reason.clone()));
        }
        errors.failed.take().map_or(Ok(()), Err)
    }

    /// Waits until all that was submitted is done.
    ///
    /// # Errors
    /// See [`Gpu::check`].
    pub fn wait(&self) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map(|_| ()).map_err(|error| self.found_lost(&error))
    }

    fn is_lost(&self) -> bool {
        self.errors.lock().unwrap_or_else(PoisonError::into_inner).lost.is_some()
    }

    /// Notes a loss that the driver has not told of.
    pub(crate) fn found_lost(&self, reason: &dyn std::fmt::Display) -> GpuError {
        let mut errors = self.errors.lock().unwrap_or_else(PoisonError::into_inner);
        GpuError::Lost(errors.lost.get_or_insert_with(|| reason.to_string()).clone())
    }

    /// Takes the device away, as a driver reset would: for tests of what happens then.
    pub fn lose(&self) {
        self.device.destroy();
        let _ = self.device.poll(wgpu::PollType::Poll);
    }

    pub(crate) fn checks(&self) -> Checks {
        self.checks
    }

    pub(crate) fn compiled(&self) -> &Compiled {
        &self.compiled
    }

    /// Invocations of a subgroup in kernels with matrices; nothing if those were refused.
    pub(crate) fn matrix_subgroup(&self) -> &OnceLock<Option<u32>> {
        &self.matrix_subgroup
    }
}

/// Features or limits that kernels need and this driver does not have, in words.
pub(crate) fn missing(features: wgpu::Features, limits: &wgpu::Limits) -> Option<String> {
    let needed = [
        ("push constants", IMMEDIATES, limits.max_immediate_size),
        ("buffers of a kernel", BINDINGS, limits.max_storage_buffers_per_shader_stage),
        ("threads of a workgroup", INVOCATIONS, limits.max_compute_invocations_per_workgroup),
        ("bytes of workgroup memory", WORKGROUP_MEMORY, limits.max_compute_workgroup_storage_size),
    ];
    if !features.contains(wgpu::Features::IMMEDIATES) {
        return Some("its driver has no push constants".into());
    }
    let lacks = needed.into_iter().find(|(_, least, has)| has < least);
    lacks.map(|(what, least, has)| format!("its driver has {has} {what}, {least} are needed"))
}

fn wanted_features() -> wgpu::Features {
    wgpu::Features::IMMEDIATES
        | wgpu::Features::SHADER_F16
        | wgpu::Features::SUBGROUP
        | wgpu::Features::SHADER_FLOAT32_ATOMIC
        | wgpu::Features::TIMESTAMP_QUERY
        | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS
        | wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX
}

fn limits(adapter: &wgpu::Adapter, features: wgpu::Features) -> DeviceLimits {
    let (limits, info) = (adapter.limits(), adapter.get_info());
    let subgroup = (info.subgroup_min_size, info.subgroup_max_size);
    let of_matrices = wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX
        | wgpu::Features::SHADER_F16
        | wgpu::Features::SUBGROUP;
    DeviceLimits {
        buffer: limits.max_buffer_size.min(limits.max_storage_buffer_binding_size),
        workgroup_memory: limits.max_compute_workgroup_storage_size,
        invocations: limits.max_compute_invocations_per_workgroup,
        binding_alignment: u64::from(limits.min_storage_buffer_offset_alignment),
        subgroup: features.contains(wgpu::Features::SUBGROUP).then_some(subgroup),
        f16: features.contains(wgpu::Features::SHADER_F16),
        float_atomics: features.contains(wgpu::Features::SHADER_FLOAT32_ATOMIC),
        matrices: features
            .contains(of_matrices)
            .then(|| matrices::side(&adapter.cooperative_matrix_properties()))
            .flatten(),
        timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
    }
}

/// Notes what the driver says between calls.
fn watch(device: &wgpu::Device, errors: &Arc<Mutex<DeviceErrors>>) {
    let noted = Arc::clone(errors);
    device.set_device_lost_callback(move |reason, message| {
        let mut errors = noted.lock().unwrap_or_else(PoisonError::into_inner);
        errors.lost.get_or_insert_with(|| format!("{reason:?}: {message}"));
    });
    let noted = Arc::clone(errors);
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        let mut errors = noted.lock().unwrap_or_else(PoisonError::into_inner);
        errors.failed.get_or_insert_with(|| uncaptured(&error));
    }));
}

/// Error that the driver reported outside of any scope.
pub(crate) fn uncaptured(error: &wgpu::Error) -> GpuError {
    match error {
        wgpu::Error::OutOfMemory { source } => GpuError::DriverOutOfMemory(source.to_string()),
        error => GpuError::Refused(error.to_string()),
    }
}
